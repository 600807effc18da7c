"""Faults of tuners for plants that were once made, each with its test."""

import pickle

import gymnasium
import numpy as np
import pytest
from first_order import TS, U, described, design, plant, simulate

import tuners
import yawrate_env
from tuners import Recipe, Recording, Tuner
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.trend import TrendSettings
from tuners.trust.intervals import conformal
from tuners.tuner.recipes import recipe_for
from tuners.tuner.training import calibrate
from tuners.tuner.tuner_file import TunerFileError
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

QUICK = Recipe(Laguerre(8, 2.0), FeedForwardSettings(neurons=6, epochs=40), noise_draws=2)


@pytest.fixture(scope="module")
def tuner():
    return tuners.train(QUICK, plant, episodes=120)


def test_every_learner_is_saved_with_its_plant(tmp_path):
    trend = Recipe(
        FrequencyResponse(8, 2.0, 0.05, 2.0),
        TrendSettings(FeedForwardSettings(neurons=4, epochs=10)),
    )
    own = tuners.train(trend, plant, episodes=60)
    own.save(tmp_path / "own.tuner")
    y = recorded(plant, "test", 0, 4).y
    recording = Recording(U[None], y, TS)
    found, expected = (t.gains(recording) for t in (tuners.load(tmp_path / "own.tuner"), own))
    np.testing.assert_array_equal(found.values, expected.values)


@pytest.mark.parametrize("crossover", [1.0, 24.0])
def test_white_noise_is_never_coloured(tuner, crossover):
    own = Tuner(described(linear=True, crossover=crossover), tuner.method)
    recording = Recording(U[None], recorded(plant, "test", 0, 64).y, TS)
    colour = own.assess(recording)[1].findings["colour"]
    assert (colour.values <= colour.limit).mean() > 0.98


def test_clocks_may_differ_by_a_few_ppm(tuner):
    y = recorded(plant, "test", 0, 1).y[0]
    exact, *others = (tuner.tune(U, y, TS * (1 + ppm * 1e-6)) for ppm in (0, -100, -2, 2, 100))
    for off in others:
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
    own = tuners.train(QUICK, described(design=some_have_none), episodes=150, calibration=150)
    assert all(0 < factor < 6 for factor in own.calibration)
    assert np.isfinite(own.fallback).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"prior": Prior(mu_s=(0.8, 0.8), M_delta=(100.0, 100.0))},
        {"prior": Prior(mu_s=(0.8, 0.8))},
        {"target": Target(phase_margin=5.0)},
    ],
)
def test_what_is_known_or_cannot_be_reached_does_not_stop_a_calibration(changes):
    task = Task(experiment=Experiment(Ts=0.01, N=1000), **changes)
    tuner = tuners.load("gb", yaw_rate(task))
    calibrate(tuner, 60)
    assert np.isfinite(tuner.calibration).all()


def test_a_plant_that_writes_into_its_arguments_can_be_pinned():
    def rude(theta, u, rng):
        y = simulate(theta, u, rng)
        theta[:], u[:] = 0.0, 0.0
        return y

    env = gymnasium.make(yawrate_env.PLANT_ID, plant=described(simulate=rude))
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
        ({"excite": lambda integers: np.tile(-U, (len(integers), 1))}, "its recordings changed"),
        ({"design": lambda theta: 1.01 * design(theta)}, "design"),
        ({"simulate": lambda theta, u, rng: 1.01 * simulate(theta, u, rng)}, "simulate"),
        ({"prior": {"K": (0.5, 2.1), "T": (0.2, 1.0)}}, "prior"),
        ({"noise": 0.1}, "noise"),
    ],
)
def test_all_that_a_tuner_depends_on_is_compared(tuner, tmp_path, change, words):
    tuner.save(tmp_path / "own.tuner")
    own = described(**{"simulate": broadcast} | change)
    with pytest.raises(TunerFileError, match=words):
        tuners.load(tmp_path / "own.tuner", own)


def broadcast(theta, u, rng):
    return simulate(theta, u, rng)


def test_answers_without_numbers_are_compared_too(tmp_path):
    own = tuners.train(QUICK, described(design=some_have_none), episodes=100)
    own.save(tmp_path / "own.tuner")
    almost = described(design=lambda theta: some_have_none(theta) * (1 + 1e-13))
    assert tuners.load(tmp_path / "own.tuner", almost).plant is almost


def test_values_that_the_simulator_was_not_made_for_are_refused():
    car = yaw_rate(Task())
    env = gymnasium.make(yawrate_env.PLANT_ID, plant=car)
    for name, value in (("v_x", 0.0), ("mu_s", -1.0), ("M_delta", 1e300)):
        with pytest.raises(ValueError, match=f"{name} = .*wider prior"):
            env.reset(options={name: value})
    env.reset(options={"v_x": 25.0})


def test_units_are_doubted_where_the_plant_says_what_can_be(tuner):
    own = Tuner(described(plausible=(1.5, 3.0)), tuner.method)
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


def test_a_speed_beyond_a_cars_is_doubted_by_who_knows_every_speed():
    cars = yaw_rate(Task())
    test = recorded(cars, "test", 0, 3)
    theta = np.column_stack([test.theta[:, :2], [20.0, 149.0, 160.0]])
    speed = tuners.load("gb").assess(Recording(test.u, test.y, cars.Ts, theta))[1].findings["speed"]
    assert (speed.values > speed.limit).tolist() == [False, False, True]


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
    def registers(integers):
        return np.sign(np.random.default_rng(0).standard_normal((len(integers), 500)))

    usual, other = recipe_for(plant), recipe_for(described(excite=registers))
    assert isinstance(other.features, Regularised)
    assert other.features.order > 2 * usual.features.order
    assert other.episodes > usual.episodes
