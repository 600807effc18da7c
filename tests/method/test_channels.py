"""Several inputs and outputs, against plants with one of each, closed forms and counts."""

import numpy as np
import pytest
from two_by_two import TS, N, U, apart, described, lag, plant

import tuners
import tuners.data
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.trust.bound import cramer_rao, parameter_covariance
from tuners.trust.identification import identify
from tuners.tuner import hidden_faults
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe
from yawrate_env.env.tuning_env import plant_env
from yawrate_env.env.vector_env import plant_vector_env
from yawrate_env.plant import Plant
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.fingerprint import changed, fingerprint
from yawrate_env.signals.excitation import prbs


def alone(which):
    """One of the two loops as a plant of its own."""
    ends = {name: plant.prior[f"{name}{which}"] for name in ("K", "T")}
    return Plant(
        prior=ends, simulate=lambda theta, u, rng: lag(*theta, u), batched=False,
        design=lambda theta: (theta[1] / (5 * theta[0]), theta[1]), gains=("kp", "Ti"),
        u=U[which - 1], Ts=TS, noise=plant.noise[which - 1], linear=True,
    )  # fmt: skip


def test_arrays_have_a_row_for_each_channel():
    theta = np.repeat(plant.middle, 3, axis=0)
    assert plant.respond(theta).shape == (3, 2, N)
    own = np.stack([U, -U, U[::-1]])
    y = plant.respond(theta, own)
    np.testing.assert_array_equal(y[1], -plant.respond(theta[:1])[0])
    block = recorded(plant, "test", 0, 200)
    assert block.u.shape == (1, 2, N) and block.y.shape == (200, 2, N)
    noise = (block.y - plant.respond(block.theta)).std(axis=(0, 2))
    np.testing.assert_allclose(noise, plant.noise, rtol=0.02)
    np.testing.assert_array_equal(
        plant.unstacked(plant.stacked(block.y)).round(12), block.y.round(12)
    )


def test_channels_that_do_not_cross_are_two_plants():
    """Gray box, bound and its parameters are those of either channel alone."""
    both, block = described(simulate=apart), recorded(described(simulate=apart), "test", 1, 6)
    found = identify(both, block.u, block.y)
    covariance, bound = parameter_covariance(both, block.theta), cramer_rao(both, block.theta)
    for which in (1, 2):
        one, at = alone(which), [which - 1, which + 1]
        single = identify(one, block.u[:, which - 1], block.y[:, which - 1])
        np.testing.assert_allclose(found.theta[:, at], single.theta, rtol=1e-5)
        theta = block.theta[:, at]
        right = parameter_covariance(one, theta)
        np.testing.assert_allclose(covariance[:, at][:, :, at], right, rtol=1e-3, atol=1e-12)
        np.testing.assert_allclose(
            bound[:, 2 * which - 2 : 2 * which], cramer_rao(one, theta), rtol=1e-3
        )


@pytest.mark.parametrize("own", [False, True])
def test_features_are_the_coefficients_of_each_pair(own):
    """Of outputs that are sums of single functions of either input."""
    functions, rng = Laguerre(3, 0.2), np.random.default_rng(0)
    u = rng.standard_normal((4 if own else 1, 2, N))
    phi = np.stack([functions.regressors(each, TS) for each in u])  # (B, m, order, N)
    weights = rng.standard_normal((4, 2, 2, 3))
    y = np.einsum("bqmn,bmnk->bqk", weights, np.broadcast_to(phi, (4, *phi.shape[1:])))
    values, usable = functions(u, y, TS)
    assert usable.all()
    np.testing.assert_allclose(values, weights.reshape(4, -1), atol=1e-9)
    still = u.copy()
    still[:, 1] = 0.0
    assert not functions(still, y, TS)[1].any()


@pytest.mark.parametrize("several", [(("a",), ("b", "c")), (("a", "b"), ("c",))])
def test_one_input_or_one_output_is_enough_of_several(several):
    inputs, outputs = several

    def simulate(theta, u, rng):
        one = lag(theta[0], 6.0, u[0]) + (lag(theta[1], 9.0, u[1]) if len(u) > 1 else 0.0)
        return np.stack([one, lag(theta[1], 12.0, u[0])][: len(outputs)])

    made = Plant(
        prior={"K": (0.5, 1.5), "G": (0.5, 1.5)}, simulate=simulate, batched=False,
        design=lambda theta: 1 / theta, gains=("kp", "kq"), u=U[: len(inputs)], Ts=TS, noise=0.1,
        linear=True, channels=several,
    )  # fmt: skip
    block = recorded(made, "test", 0, 3)
    result = tuners.load("gb", made).tune(block.u[0], block.y[0])
    assert result.verdict.value == "usable"
    np.testing.assert_allclose(list(result.gains.values()), made.oracle(block.theta)[0], rtol=0.05)


def test_gray_box_is_on_the_bound_trusted_and_undeceived():
    """40 recordings, then with either output half as large again; what crosses contradicts that."""
    tuner, block = tuners.load("gb", plant), recorded(plant, "test", 0, 40)

    def assessed(y):
        gains, found = tuner.assess(Recording(block.u, y, TS))
        error = plant.metric_values(block.theta, gains.values)
        return found, error, (np.abs(error) > 2 * plant.metric_setting("error")).any(axis=1)

    found, error, missed = assessed(block.y)
    ratio = np.sqrt((error**2).mean(axis=0)) / np.sqrt(
        (cramer_rao(plant, block.theta) ** 2).mean(0)
    )
    assert (ratio < 1.3).all() and (found.verdicts == 0).all() and not missed.any()
    for j in range(2):
        y = block.y.copy()
        y[:, j] *= 1.5
        found, _, missed = assessed(y)
        assert missed.sum() >= 35 and not (missed & found.trusted).any()


def excited(integers):
    """A place in the register for each input and episode."""
    starts = np.stack([integers, integers >> np.uint64(30)], axis=1).ravel()
    return prbs(N, TS, 8.0, 1.0, order=9, start=starts).reshape(len(integers), 2, N)


def test_every_episode_may_have_inputs_of_its_own():
    own = described(excite=excited)
    block, batch = recorded(own, "test", 0, 3), plant_vector_env(3, plant=own)
    assert block.u.shape == (3, 2, N) and (block.u[0] != block.u[1]).any()
    obs, _ = batch.reset(seed=4)
    for i in range(3):
        np.testing.assert_array_equal(plant_env(own).reset(seed=4 + i)[0], obs[i])
    assert (obs[0, :2] != obs[1, :2]).any()
    gains, found = tuners.load("gb", own).assess(Recording(block.u, block.y, TS))
    np.testing.assert_allclose(gains.values, own.oracle(block.theta), rtol=0.1)
    assert (found.verdicts == 0).all()
    with pytest.raises(ValueError, match="excite"):
        described(excite=lambda integers: excited(integers)[:, 0])


@pytest.mark.slow
def test_faults_that_a_prior_hides_are_those_of_one_channel(monkeypatch):
    """Without what crosses, a scale is a gain; two levels hide a limit and a dead band."""
    monkeypatch.setattr(hidden_faults, "PLANTS", 12)
    found = {}
    for name, made in (("apart", described(simulate=apart)), ("crossing", plant)):
        found[name] = [each.fault for each in hidden_faults.hidden_faults(tuners.load("gb", made))]
    assert found["crossing"] == []
    assert {"an output scaled by 1.5 (top)", "an output scaled by 1.5 (bottom)"} < {*found["apart"]}
    assert sum("actuator" in fault and "(steam)" in fault for fault in found["apart"]) == 2


def test_offsets_of_each_output_and_other_sampling_make_no_difference():
    tuner, block = tuners.load("gb", plant), recorded(plant, "test", 3, 1)
    (u,), (y,) = block.u, block.y
    right = tuner.tune(u, y)
    assert right.fit.measured.shape == right.fit.simulated.shape == (2, N)
    np.testing.assert_allclose(right.fit.measured, y)
    moved = tuner.tune(u[:, 60:], y[:, 60:] + np.array([[3.0], [-5.0]]))
    assert not moved.fit.from_rest and moved.fit.offset == pytest.approx(-5.0, abs=0.3)
    for gain, ends, true in zip(
        moved.gains.values(),
        moved.gain_intervals.values(),
        plant.oracle(block.theta)[0],
        strict=True,
    ):
        assert abs(gain - true) <= ends.high - ends.low < 0.25 * true
    slow = tuner.tune(u.repeat(2, 1), y.repeat(2, 1), Ts=TS / 2)
    assert slow.gains == pytest.approx(right.gains, rel=1e-6)


def test_a_trained_tuner_answers_and_is_saved(tmp_path):
    learner = FeedForwardSettings(neurons=8, epochs=60)
    tuner = tuners.train(Recipe(Laguerre(4, 0.15), learner), plant, episodes=300)
    tuner.save(tmp_path / "two.tuner")
    again, block = tuners.load(tmp_path / "two.tuner"), recorded(plant, "test", 0, 5)
    given = Recording(block.u, block.y, TS)
    np.testing.assert_array_equal(again.gains(given).values, tuner.gains(given).values)
    error = plant.metric_values(block.theta, tuner.gains(given).values)
    assert np.abs(error).max() < 0.25
    noisier = described(noise=(0.02, 0.06))
    assert changed(noisier, fingerprint(plant)) in ("noise", "recordings")


def test_several_recordings_of_one_plant_are_pooled_and_another_is_found_out():
    """Their information adds up; a third, which did not tune, agrees with them."""
    first, second, third = (recorded(plant, "test", 0, 1, repeat=k) for k in range(3))
    tuner = tuners.load("gb", plant)
    one, two, other = (Recording.of(plant, b.u[0], b.y[0]) for b in (first, second, third))
    result = tuner.pool([one, two], validate=other)
    assert result.verdict.value == "usable" and result.validation.agrees
    np.testing.assert_allclose(
        result.fit.measured, np.concatenate([one.y[0], two.y[0]], axis=1), atol=1e-12
    )
    np.testing.assert_allclose(result.fit.u, np.concatenate([one.u[0], two.u[0]], axis=1))
    alone = tuner.tune(one.u[0], one.y[0]).exact_gain_intervals
    for name, ends in result.exact_gain_intervals.items():
        ratio = (ends.high - ends.low) / (alone[name].high - alone[name].low)
        assert ratio == pytest.approx(1 / np.sqrt(2), abs=0.05)
    changed = recorded(plant, "test", 5, 1)
    result = tuner.pool([one, two, Recording.of(plant, changed.u[0], changed.y[0])])
    assert [share.agrees for share in result.logs] == [True, True, False]
    assert not result.trusted


def test_a_closed_loop_of_several_channels_is_refused():
    block = recorded(plant, "test", 0, 1)
    with pytest.raises(ValueError, match="reference"):
        tuners.load("gb", plant).tune(*block.u, *block.y, reference=U[0])


@pytest.mark.parametrize("changes, name", [
    ({"channels": None}, "u has 2 inputs"),
    ({"channels": (("a",), ("c", "d"))}, "u has shape"),
    ({"channels": (("a", "b"), ("b", "d"))}, "channel"),
    ({"channels": ("ab", "cd", "ef")}, "channels"),
    ({"noise": (0.1,)}, "noise"),
    ({"noise": (0.1, 0.0)}, "noise"),
    ({"noise": lambda y: 0.1}, "noise"),
    ({"u": np.stack([U[0], 0 * U[0]])}, "u is zero"),
    ({"in_loop": True}, "in_loop"),
    ({"crossover": 0.01}, "crossover"),
    ({"simulate": lambda theta, u, rng: apart(theta, u, rng)[0]}, "simulate"),
])  # fmt: skip
def test_descriptions_that_contradict_each_other_are_refused(changes, name):
    with pytest.raises(ValueError, match=name):
        described(**changes)


@pytest.mark.parametrize("u, y, name", [
    (U[0], U, "u"), (U, U[0], "y"), (U[:, :-1], U, "samples"), (np.r_[U, U], U, "u"),
])  # fmt: skip
def test_recordings_of_other_shapes_are_refused(u, y, name):
    with pytest.raises(ValueError, match=name):
        tuners.load("gb", plant).tune(u, y)
