"""Recordings from arrays and from observations, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, SHORT, observed, one

from tuners.tuner.recording import Recording
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

CARS, LAG = FAMILIES["vehicle of any speed"], FAMILIES["lag"]
GOOD = np.zeros(5)


def test_one_episode_from_arrays():
    recording = Recording.of(CARS, [1, 2, 3], (4.0, 5.0, 6.0), 0.02, {"v_x": [19.0, 20.0, 21.0]})
    np.testing.assert_array_equal(recording.u, [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(recording.y, [[4.0, 5.0, 6.0]])
    assert recording.u.dtype == recording.y.dtype == np.float64
    assert recording.Ts == 0.02 and len(recording) == 1
    np.testing.assert_array_equal(recording.known, [[np.nan, np.nan, 20.0]])
    assert recording.variation == pytest.approx(0.1)
    plain = Recording.of(CARS, [1, 2], [3, 4])
    assert plain.known is None and plain.Ts == CARS.Ts and plain.variation == 0


def test_observations_show_as_much_as_they_have_rows(plant, episodes):
    blind = observed(plant, episodes)[:3]
    recording, single = Recording.of_observations(plant, blind)
    assert not single and len(recording) == 3
    np.testing.assert_array_equal(np.broadcast_to(recording.u, blind[:, 0].shape), blind[:, 0])
    np.testing.assert_array_equal(recording.y, blind[:, 1])
    measured = plant.indices(plant.measured_names)
    if measured:
        np.testing.assert_array_equal(recording.known[:, measured], episodes.known[:3, measured])
        assert np.isnan(recording.known[:, plant.unknown]).all()
    else:
        assert recording.known is None
    names = [n for n in plant.prior if n in plant.measured]
    names += [n for n in plant.prior if n not in plant.measured]
    truth = episodes.known[:3, plant.indices(names), None] + np.zeros((1, 1, len(plant.u)))
    seeing, _ = Recording.of_observations(plant, np.concatenate([blind[:, :2], truth], axis=1))
    np.testing.assert_array_equal(seeing.known, episodes.known[:3])
    alone, single = Recording.of_observations(plant, blind[1])
    assert single and len(alone) == 1
    np.testing.assert_array_equal(alone.y[0], blind[1, 1])


@pytest.mark.parametrize("register, inputs", [("same", 1), ("random", 3)])
def test_equal_inputs_are_kept_once(register, inputs):
    plant = yaw_rate(Task(experiment=replace(SHORT, register=register)))
    block = recorded(plant, "test", 0, 3)
    obs = observed(plant, Recording(block.u, block.y, plant.Ts, block.theta))
    recording, _ = Recording.of_observations(plant, obs)
    assert len(recording.u) == inputs
    np.testing.assert_array_equal(recording.u, block.u)


def test_parts_keep_what_belongs_to_them(plant, episodes):
    part = episodes.part(slice(1, 3))
    assert len(part) == 2 and part.Ts == episodes.Ts
    np.testing.assert_array_equal(part.u, episodes.u)
    np.testing.assert_array_equal(part.y, episodes.y[1:3])
    np.testing.assert_array_equal(part.known, episodes.known[1:3])
    own = Recording(np.repeat(episodes.u, len(episodes), axis=0), episodes.y, episodes.Ts)
    assert own.part(slice(0, 2)).known is None and len(own.part(slice(0, 2)).u) == 2


def test_what_a_recording_does_not_tell_is_in_mid_prior(plant, episodes):
    theta = episodes.parameters(plant)
    np.testing.assert_array_equal(
        theta[:, plant.unknown], plant.middle[:, plant.unknown].repeat(len(theta), 0)
    )
    np.testing.assert_array_equal(theta[:, plant.known], episodes.known[:, plant.known])
    given = one(plant, episodes, 2)
    single = Recording.of(plant, given["u"], given["y"], given["Ts"], given["measured"])
    np.testing.assert_array_equal(single.parameters(plant)[0], theta[2])
