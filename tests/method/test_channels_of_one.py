"""Invariants of channels: one of each is the plant without, and their order is of no matter."""

import gymnasium
import numpy as np
import pytest
from first_order import linear
from hypothesis import given, settings
from hypothesis import strategies as st
from two_by_two import TS, N, U, plant

import tuners
from tuners.cli.proposal import proposed
from tuners.export import tuner_program
from tuners.features import features_named
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForwardSettings
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe
from yawrate_env.env.interface import Interface
from yawrate_env.plant import Plant
from yawrate_env.plant.episodes import recorded

ID = "yawrate_env:yawrate/Plant-v0"
RECIPE = Recipe(Laguerre(4, 3.0), FeedForwardSettings(neurons=6, epochs=40))


def described(**changes):
    """The linear lag without its crossover, which plants with channels cannot have."""
    given = {
        "prior": linear.prior, "design": linear.design, "gains": linear.gains, "u": linear.u,
        "simulate": linear.simulate, "Ts": linear.Ts, "noise": linear.noise, "linear": True,
        "entry": "test_channels_of_one:single",
    }  # fmt: skip
    return Plant(**{**given, **changes})


single = described()
one = described(
    u=single.u[None], channels=(("u",), ("y",)),
    simulate=lambda theta, u, rng: linear.simulate(theta, u[..., 0, :], rng)[:, None],
)  # fmt: skip


def pairs():
    """Tuners of both plants."""
    learned = (tuners.train(RECIPE, each, episodes=120, calibration=50) for each in (single, one))
    return [tuple(tuners.load("gb", each) for each in (single, one)), tuple(learned)]


def assert_equal_results(found, right):
    """But for the check of a loop that nobody named, which is of one input and output."""
    assert found.gains == right.gains and found.fit.parameters == right.fit.parameters
    assert found.intervals == right.intervals and found.exact_intervals == right.exact_intervals
    assert (found.verdict, found.reasons, found.notes) == (
        right.verdict,
        right.reasons,
        right.notes,
    )
    checks = {check.name: check.value for check in right.checks}
    assert {check.name: check.value for check in found.checks} | {
        "feedback": checks["feedback"]
    } == checks
    np.testing.assert_array_equal(found.fit.measured[0], right.fit.measured)


def test_a_plant_with_one_channel_of_each_answers_as_the_plant_without():
    """To the bit: alone, from an operating point, from several recordings, and exported."""
    block, again = (recorded(single, "test", 0, 1, repeat=k) for k in range(2))
    np.testing.assert_array_equal(recorded(one, "test", 0, 1).y[:, 0], block.y)
    for without, channels in pairs():
        for start, offset in ((0, 0.0), (60, 1.0)):
            u, y = block.u[0, start:], block.y[0, start:] + offset
            assert_equal_results(channels.tune(u[None], y[None]), without.tune(u, y))
        logs = [(b.u[0], b.y[0]) for b in (block, again)]
        pooled = without.pool([Recording.of(single, *log) for log in logs])
        other = channels.pool([Recording.of(one, u[None], y[None]) for u, y in logs])
        assert_equal_results(other, pooled)
        assert [share.chi_square for share in other.logs] == [s.chi_square for s in pooled.logs]
    assert tuner_program(channels) == tuner_program(without)


def test_environments_and_proposals_of_one_channel_are_those_without():
    first, second = (gymnasium.make(ID, plant=each) for each in (single, one))
    np.testing.assert_array_equal(first.reset(seed=3)[0], second.reset(seed=3)[0])
    action = (first.action_space.low + first.action_space.high) / 3
    assert first.step(action)[1:] == second.step(action)[1:]
    u, said = proposed(single, 0.05, "both", None, 30.0, 0)
    other, same = proposed(one, 0.05, "both", None, 30.0, 0)
    np.testing.assert_array_equal(other[0], u)
    assert same == said


def exchanged(order):
    """The 2 x 2 plant with its channels in another order, and their gains with them."""
    pairs = [k for i in order for k in (2 * i, 2 * i + 1)]

    def simulate(theta, u, rng):
        own = np.empty_like(u)
        own[list(order)] = u
        return plant.simulate(theta, own, rng)[list(order)]

    return Plant(
        prior=plant.prior, simulate=simulate, batched=False, linear=True, u=plant.u[list(order)],
        design=lambda theta: np.array(plant.design(theta))[pairs], Ts=TS,
        gains=tuple(plant.gains[k] for k in pairs), noise=tuple(plant.noise[i] for i in order),
        channels=tuple(tuple(names[i] for i in order) for names in plant.channels),
    )  # fmt: skip


def test_the_order_of_channels_is_of_no_matter():
    other, block = exchanged((1, 0)), recorded(plant, "test", 1, 1)
    u, y = block.u[0], block.y[0]
    right = tuners.load("gb", plant).tune(u, y)
    found = tuners.load("gb", other).tune(u[::-1], y[::-1])
    assert found.gains == pytest.approx(right.gains, rel=1e-7)
    assert found.verdict is right.verdict
    np.testing.assert_allclose(found.fit.simulated[::-1], right.fit.simulated, atol=1e-7)
    for name, ends in right.exact_gain_intervals.items():
        other_ends = found.exact_gain_intervals[name]
        assert (other_ends.low, other_ends.high) == pytest.approx((ends.low, ends.high), rel=1e-5)
    obs, permuted = (gymnasium.make(ID, plant=each).reset(seed=0)[0] for each in (plant, other))
    np.testing.assert_allclose(permuted[:2], obs[:2][::-1])
    # Noise belongs to a place in the stack and not to a name.
    clean = plant.respond(plant.middle)[0]
    np.testing.assert_allclose(other.respond(plant.middle)[0], clean[::-1])


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 3), st.integers(1, 3), st.integers(1, 4), st.integers(16, 40))
def test_observations_hold_recordings_of_any_shape(inputs, outputs, count, samples):
    rng = np.random.default_rng(inputs + 10 * outputs)
    weights = rng.standard_normal((outputs, inputs))
    made = Plant(
        prior={"K": (0.5, 1.5)}, batched=False, gains=("kp",), Ts=TS, noise=0.1,
        simulate=lambda theta, u, rng: theta[0] * weights @ u, design=lambda theta: 1 / theta,
        u=rng.standard_normal((inputs, samples)),
        channels=(
            tuple(f"in{i}" for i in range(inputs)), tuple(f"out{j}" for j in range(outputs))
        ),
    )  # fmt: skip
    interface, block = Interface.of(made), recorded(made, "test", 0, count)
    obs = interface.observe(block.u, block.y, block.theta)
    assert obs.shape == (count, inputs + outputs, samples)
    u, y, _ = interface.recordings(obs)
    assert u.shape == (1, inputs, samples) and y.shape == (count, outputs, samples)
    np.testing.assert_array_equal(u, block.u.astype(np.float32))
    np.testing.assert_array_equal(y, block.y.astype(np.float32))
    row = made.in_a_row([made.stacked(block.y), made.stacked(block.y)])
    np.testing.assert_allclose(
        made.unstacked(row).reshape(count, outputs, -1), np.tile(block.y, 2), rtol=1e-12
    )


def test_an_experiment_for_a_wanted_interval_keeps_its_inputs_apart():
    u, said = proposed(plant, 0.004, "length", None, None, 0)
    assert u.shape[0] == 2 and u.shape[1] > 1.5 * N and "reflux" in said and "steam" in said
    alike = np.corrcoef(U)[0, 1]
    assert abs(np.corrcoef(u)[0, 1]) < abs(alike) + 0.1 < 0.3
    np.testing.assert_array_equal(u[:, N : N + 50], plant.u[:, :50])
    with pytest.raises(ValueError, match="noise"):
        proposed(plant, 0.01, "both", 0.1, None, 0)


@pytest.mark.parametrize("features", [
    FrequencyResponse(4, 0.1, 0.005, 0.05), features_named("armax"),
])  # fmt: skip
def test_features_of_one_input_and_output_are_refused(features):
    with pytest.raises(ValueError, match="features"):
        tuners.train(Recipe(features, RECIPE.learner), plant, episodes=100)
