"""What went wrong once at the edges of `tuners.plants`."""

import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from first_order import TS, U, described, design, plant, simulate
from recordings import recorded as driven

import tuners
import yawrate_env
from tuners import data, plants
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.trend import TrendSettings
from tuners.trust.checks import conformal
from tuners.trust.vehicle_calibration import calibrate
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe
from tuners.tuner.training import recipe_for
from tuners.tuner.tuner_file import ModelFileError
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

QUICK = Recipe(Laguerre(8, 2.0), FeedForwardSettings(neurons=6, epochs=40), noise_draws=2)


@pytest.fixture(scope="module")
def tuner():
    return plants.train(plant, QUICK, count=120, calibration=0)


def test_every_learner_is_saved_with_its_plant(tmp_path):
    trend = Recipe(
        FrequencyResponse(8, 2.0, 0.05, 2.0),
        TrendSettings(FeedForwardSettings(neurons=4, epochs=10)),
    )
    own = plants.train(plant, trend, count=60, calibration=0)
    own.save(tmp_path / "own.tuner")
    y = recorded(plant, "test", 0, 4).y
    np.testing.assert_array_equal(plants.load(tmp_path / "own.tuner").gains(U, y), own.gains(U, y))


@pytest.mark.parametrize("crossover", [1.0, 4.2, 12.0, 24.0])
def test_white_noise_is_never_coloured(tuner, crossover):
    own = plants.PlantTuner(
        described(linear=True, crossover=crossover), tuner.stages, tuner.black_box, {}
    )
    colour = own.assess(U, recorded(plant, "test", 0, 64).y)[1].findings["colour"]
    assert (colour.values <= colour.limit).mean() > 0.98


@pytest.mark.parametrize("ppm", [-100, -2, 2, 100])
def test_clocks_may_differ_by_a_few_ppm(tuner, ppm):
    y = recorded(plant, "test", 0, 1).y[0]
    exact, off = (tuner.tune(U, y, TS * (1 + one * 1e-6)) for one in (0, ppm))
    assert off.gains == pytest.approx(exact.gains, rel=2e-3) and off.notes == ()


def test_resampling_holds_what_held_over_the_larger_part():
    steps = Recording(np.arange(5.0)[None], np.zeros((1, 5)), 0.1)
    assert list(steps.resampled(0.05).u[0]) == [0, 0, 1, 1, 2, 2, 3, 3, 4]
    assert list(steps.resampled(0.2).u[0]) == [0, 2, 4]
    assert list(steps.resampled(0.1 * (1 - 1e-5)).u[0]) == [0, 1, 2, 3, 4]


def some_have_none(theta):
    gains = design(theta)
    gains[theta[:, 0] > 1.6] = np.nan
    return gains


def test_plants_that_no_gains_suit_ask_for_no_interval():
    own = plants.train(described(design=some_have_none), QUICK, count=150, calibration=150)
    assert all(0 < factor < 6 for factor in own.calibration)
    assert np.isfinite(own.fallback).all()


def test_what_calibrates_nothing_is_refused():
    def judge(theta, gains):
        return np.where(theta[:, :1] > 1.6, np.nan, gains[:, :1] / design(theta)[:, :1])

    unstable = described(evaluate=judge, metrics={"gain": 1.0})
    with pytest.raises(ValueError, match="of 128 loops that calibrate .*at most a tenth"):
        plants.train(unstable, QUICK, count=100, calibration=128)


@pytest.mark.parametrize(
    "task",
    [
        Task(prior=Prior(mu_s=(0.8, 0.8), M_delta=(100.0, 100.0))),
        Task(prior=Prior(mu_s=(0.8, 0.8))),
        Task(target=Target(phase_margin=5.0)),
    ],
)
def test_what_is_known_or_cannot_be_reached_does_not_stop_a_calibration(task):
    tuner = tuners.load("gb", task)
    calibrate(tuner, episodes=128)
    assert np.isfinite(tuner.calibration.factors).all()


def test_a_gain_called_as_anothers_target_has_no_column(tmp_path):
    clash = described(gains=("kp", "log_kp"))
    with pytest.raises(ValueError, match="'log_kp' would be the name of two columns"):
        data.generate(clash, CONTEXT_SETS["train"], Laguerre(8, 3.0), 60, 0, tmp_path / "d")
    assert not (tmp_path / "d").exists()


def test_functions_may_write_into_what_they_get():
    def rude(theta, u, rng):
        y = simulate(theta, u, rng)
        theta[:], u[:] = 0.0, 0.0
        return y

    def ruder(theta):
        gains = design(theta)
        theta /= 2
        return gains

    mine = U + 0.0
    own = described(simulate=rude, design=ruder, u=mine)
    mine[:] = 7.0
    np.testing.assert_array_equal(own.u, U)
    theta = recorded(plant, "test", 0, 3).theta
    np.testing.assert_array_equal(own.respond(theta), plant.respond(theta))
    np.testing.assert_array_equal(own.oracle(theta), design(theta))
    env = gymnasium.make(yawrate_env.PLANT_ID, plant=own)
    env.reset(seed=0, options={"K": 1.0})
    assert env.step(env.action_space.low)[4]["K"] == 1.0


@pytest.mark.parametrize(
    "change, words",
    [
        ({"target": (9.0, 9.0)}, "its target changed"),
        ({"linear": True}, "its linear changed"),
        ({"crossover": 4.9}, "its crossover changed"),
        ({"plausible": (1.0, 9.0)}, "its plausible changed"),
        ({"search_limits": {"K": (0.1, 3.0)}}, "its search_limits changed"),
        ({"excite": lambda words: np.tile(-U, (len(words), 1))}, "its recordings changed"),
    ],
)
def test_all_that_a_tuner_depends_on_is_compared(tuner, tmp_path, change, words):
    tuner.save(tmp_path / "own.tuner")
    own = described(simulate=broadcast, **change)
    with pytest.raises(ModelFileError, match=words):
        plants.load(tmp_path / "own.tuner", own)


def broadcast(theta, u, rng):
    return simulate(theta, u, rng)


def test_answers_without_numbers_are_compared_too(tmp_path):
    plants.train(described(design=some_have_none), QUICK, count=100, calibration=0).save(
        tmp_path / "own.tuner"
    )
    almost = described(design=lambda theta: some_have_none(theta) * (1 + 1e-13))
    assert plants.load(tmp_path / "own.tuner", almost).plant is almost


def test_values_that_the_simulator_was_not_made_for_are_refused():
    car = yaw_rate(Task())
    env = gymnasium.make(yawrate_env.PLANT_ID, plant=car)
    for name, value in (("v_x", 0.0), ("mu_s", -1.0), ("M_delta", 1e300)):
        with pytest.raises(ValueError, match=f"{name} = .*wider prior"):
            env.reset(options={name: value})
    env.reset(options={"v_x": 25.0})


def test_units_are_doubted_where_the_plant_says_what_can_be(tuner):
    own = plants.PlantTuner(described(plausible=(1.5, 3.0)), tuner.stages, tuner.black_box, {})
    y = recorded(plant, "test", 0, 1).y[0]
    assert own.tune(U, y).trusted
    result = own.tune(57.3 * U, 57.3 * y)
    assert "larger than it can be: check the units." in result.reasons[0]


def test_a_log_too_slow_for_what_bends_between_its_samples_is_not_trusted(tuner):
    theta, noise = np.array([[1.3, 0.45]]), np.random.default_rng(0).standard_normal(100)
    y = plant.respond(theta)[0, ::5] + 0.02 * noise
    result = tuner.tune(U[::5], y, 5 * TS)
    between = next(check for check in result.checks if check.name == "between")
    assert not between.passed and any("record faster" in reason for reason in result.reasons)


@pytest.mark.parametrize("v_x, doubted", [(20.0, False), (149.0, False), (160.0, True)])
def test_a_speed_beyond_a_cars_is_doubted_by_who_knows_every_speed(v_x, doubted):
    recording = replace(driven(1), v_x=np.array([v_x]))
    speed = tuners.load("gb").assess(recording)[1].findings["speed"]
    assert (speed.values[0] > speed.limit) == doubted


@pytest.mark.parametrize("count, finite", [(0, False), (8, False), (9, True)])
def test_a_few_episodes_calibrate_nothing(count, finite):
    errors = np.random.default_rng(0).standard_normal((count, 2))
    factors = conformal(np.zeros((count, 2)), np.ones((count, 2)), errors)
    assert factors.shape == (2,) and np.isfinite(factors).all() == finite


@pytest.mark.parametrize("make", [lambda: plant, lambda: yaw_rate(Task())])
def test_plants_and_their_environments_are_pickled(make):
    own = make()
    again = pickle.loads(pickle.dumps(own))
    theta = np.repeat(own.middle, 3, axis=0)
    np.testing.assert_array_equal(again.respond(theta), own.respond(theta))
    np.testing.assert_array_equal(again.oracle(theta), own.oracle(theta))
    envs = gymnasium.make_vec(yawrate_env.PLANT_ID, 2, plant=own)
    other = pickle.loads(pickle.dumps(envs))
    np.testing.assert_array_equal(envs.reset(seed=1)[0], other.reset(seed=1)[0])


def test_inputs_of_their_own_ask_for_more():
    def registers(words):
        return np.sign(np.random.default_rng(0).standard_normal((len(words), 500)))

    usual, other = recipe_for(plant), recipe_for(described(excite=registers))
    assert isinstance(other.compressor, Regularised)
    assert other.compressor.order > 2 * usual.compressor.order
    assert other.vehicles > usual.vehicles
