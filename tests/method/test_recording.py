"""Recordings from arrays and from observations, and what is refused."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import observations, recorded

from tuners.tuner.recording import Recording
from yawrate_env.vehicle.task import Experiment

GOOD = np.zeros(5)


def test_one_episode_from_arrays():
    recording = Recording.of([1, 2, 3], (4.0, 5.0, 6.0), 0.01, v_x=[19.0, 20.0, 21.0])
    np.testing.assert_array_equal(recording.u, [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(recording.y, [[4.0, 5.0, 6.0]])
    assert recording.u.dtype == recording.y.dtype == np.float64
    assert recording.Ts == 0.01 and recording.v_x == 20.0 and recording.context is None
    assert len(recording) == 1
    assert Recording.of([1, 2], [3, 4], 0.01).v_x is None


@pytest.mark.parametrize(
    "arguments, message",
    [
        ((np.zeros(4), GOOD, 0.001), "u has 4 samples and y has 5. Cut"),
        (([], [], 0.001), "number of samples = 0 .* at least 2.* Record more"),
        ((GOOD[None], GOOD, 0.001), r"u has shape \(1, 5\), wanted \(any\)"),
        ((GOOD, GOOD[:, None], 0.001), r"y has shape \(5, 1\)"),
        ((GOOD, [0, 0, np.nan, 0, 0], 0.001), "y has nan at flat index 2"),
        (([0, np.inf, 0, 0, 0], GOOD, 0.001), "u has inf at flat index 1"),
        (("text", GOOD, 0.001), "u is not an array of numbers"),
        ((GOOD, GOOD, 0.0), "Ts = 0 must be finite, above 0.* seconds"),
        ((GOOD, GOOD, "fast"), "Ts = 'fast' is not a number"),
        ((GOOD, GOOD, 0.001, -20.0), "v_x = -20 must be finite, above 0.* m/s"),
        ((GOOD, GOOD, 0.001, np.nan), "v_x has nan"),
    ],
)
def test_arrays_that_cannot_be_used_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Recording.of(*arguments)


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_observations_show_as_much_as_they_have_rows(rows):
    obs = np.arange(3 * rows * 4, dtype=np.float32).reshape(3, rows, 4) + 1
    recording, single = Recording.of_observations(obs, 0.001)
    assert not single and len(recording) == 3
    np.testing.assert_array_equal(recording.u, obs[:, 0])
    np.testing.assert_array_equal(recording.y, obs[:, 1])
    assert (recording.v_x is None) == (rows == 2) and (recording.context is None) == (rows < 5)
    if rows > 2:
        np.testing.assert_array_equal(recording.v_x, obs[:, 2, 0])
    if rows == 5:
        assert recording.context is not None
        np.testing.assert_array_equal(recording.context.mu_s, obs[:, 3, 0])
        np.testing.assert_array_equal(recording.context.M_delta, obs[:, 4, 0])


def test_a_single_observation_is_a_batch_of_one():
    obs = observations(recorded(3))
    one, single = Recording.of_observations(obs[1], 0.001)
    assert single and len(one) == 1
    np.testing.assert_array_equal(one.y[0], obs[1, 1])


@pytest.mark.parametrize("register, inputs", [("same", 1), ("random", 3)])
def test_equal_commands_are_kept_once(register, inputs):
    obs = observations(recorded(3, Experiment(register=register)))
    recording, _ = Recording.of_observations(obs, 0.001)
    assert len(recording.u) == inputs
    np.testing.assert_array_equal(np.broadcast_to(recording.u, recording.y.shape), obs[:, 0])


@given(shape=st.lists(st.integers(0, 6), max_size=4))
def test_observations_of_other_shapes_are_refused(shape):
    fits = len(shape) in (2, 3) and shape[-2] in (2, 3, 5)
    if not fits:
        with pytest.raises(ValueError, match=re.escape(f"obs has shape {tuple(shape)}, wanted")):
            Recording.of_observations(np.zeros(shape), 0.001)


def test_observations_that_are_not_finite_are_refused():
    obs = observations(recorded(2))
    obs[1, 1, 3] = np.nan
    with pytest.raises(ValueError, match="obs has nan at flat index 30003"):
        Recording.of_observations(obs, 0.001)


@pytest.mark.parametrize("register", ["same", "random"])
def test_parts_keep_what_belongs_to_them(register):
    whole = recorded(3, Experiment(register=register))
    part = whole.part(slice(1, 3))
    assert len(part) == 2 and part.Ts == whole.Ts
    np.testing.assert_array_equal(part.u, whole.u if register == "same" else whole.u[1:])
    np.testing.assert_array_equal(part.y, whole.y[1:])
    assert whole.v_x is not None and whole.context is not None and part.context is not None
    np.testing.assert_array_equal(part.v_x, whole.v_x[1:])
    np.testing.assert_array_equal(part.context.mu_s, whole.context.mu_s[1:])
    assert Recording(whole.u, whole.y, whole.Ts).part(slice(0, 1)).context is None
