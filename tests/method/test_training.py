"""Examples and training: the same for everyone, and refused where they cannot work."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from families import FAMILIES, VEHICLE
from first_order import TS, described, simulate
from first_order import plant as lag

import tuners
from tuners.catalogue import RECIPES
from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.learners.trend import TrendSettings
from tuners.trust.basis import suited
from tuners.tuner.against_bound import remarks
from tuners.tuner.examples import examples
from tuners.tuner.method import Rung
from tuners.tuner.recipes import features_by_name, recipe_for
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe, coordinates_of
from tuners.tuner.tuner import Tuner
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded, sample, share_without_gains
from yawrate_env.signals.excitation import RANDOM_ORDER, prbs
from yawrate_env.vehicle.yaw_rate import yaw_rate

torch.set_num_threads(1)

PLANT, ARMAX = FAMILIES["vehicle"], Armax()
NETWORK = FeedForwardSettings(epochs=15)
# The paper's leaves of 25 vehicles would leave 48 of them in one.
TREES = GBMSettings(n_estimators=20, min_child_weight=5.0)
QUICK = Recipe(Laguerre(8, 12.0), NETWORK)


@pytest.fixture(scope="module")
def data():
    return examples(PLANT, 60, 0, ARMAX)


def test_examples_are_features_of_the_episodes_and_gains_of_the_rule(data):
    block = recorded(PLANT, "train", 0, 128)
    features, usable = ARMAX(block.u, block.y, PLANT.Ts)
    assert len(data) == 60
    np.testing.assert_array_equal(data.features, features[:60])
    np.testing.assert_array_equal(data.usable, usable[:60])
    np.testing.assert_array_equal(data.theta, block.theta[:60])
    np.testing.assert_array_equal(data.gains, PLANT.oracle(block.theta[:60]))
    np.testing.assert_array_equal(data.targets(coordinates_of(PLANT, "gains")), data.gains)
    coordinates = coordinates_of(PLANT, "plant")
    np.testing.assert_array_equal(data.targets(coordinates), coordinates.encode(data.gains))


def test_measured_parameters_are_features():
    plant = FAMILIES["vehicle of any speed"]
    found = examples(plant, 10, 0, ARMAX)
    expected = plant.measured_features(found.theta)
    assert expected.shape == (10, 1)
    np.testing.assert_array_equal(found.features[:, 6:], expected)


def test_blocks_and_sizes_do_not_matter(data):
    more = examples(PLANT, 140, 0, ARMAX)  # 128 at a time
    np.testing.assert_array_equal(more.features[:60], data.features)
    np.testing.assert_array_equal(more.number, np.arange(140))
    again = examples(PLANT, 14, 0, ARMAX)
    np.testing.assert_array_equal(more.features[:14], again.features)


def test_noise_draws_repeat_the_plants_with_fresh_noise(data):
    twice = examples(PLANT, 60, 0, ARMAX, noise_draws=2)
    assert len(twice) == 120
    np.testing.assert_array_equal(twice.features[:60], data.features)
    np.testing.assert_array_equal(twice.theta[60:], data.theta)
    np.testing.assert_array_equal(twice.gains[60:], data.gains)
    np.testing.assert_array_equal(twice.number, np.tile(np.arange(60), 2))
    change = twice.features[60:] - data.features
    assert (change != 0).all() and (change.std(axis=0) < data.features.std(axis=0)).all()


def test_plants_that_cannot_reach_the_target_are_not_usable(data):
    plant = yaw_rate(replace(VEHICLE, target=Target(phase_margin=55.0, crossover=2.0)))
    found = examples(plant, 60, 0, ARMAX)
    _, reachable = plant.designs(found.theta)
    assert 0 < reachable.sum() < 60
    np.testing.assert_array_equal(found.usable, reachable & data.usable)


def test_progress_of_simulation_training_and_calibration():
    calls = []
    tuners.train(QUICK, PLANT, episodes=60, calibration=60, name="own",
                 progress=lambda *call: calls.append(call))  # fmt: skip
    kinds = list(dict.fromkeys(what for what, _, _ in calls))
    assert kinds == ["simulating", "training own", "calibrating"]
    assert calls[0] == ("simulating", 60, 60) and calls[-1] == ("calibrating", 60, 60)
    training = [done for what, done, _ in calls if what == "training own"]
    assert list(dict.fromkeys(training)) == list(range(1, training[-1] + 1))


STAGES = [
    Recipe(ARMAX, NETWORK),
    Recipe(ARMAX, TREES, "gains"),
    Recipe(Laguerre(8, 12.0), TREES, noise_draws=2),
    Recipe(Laguerre(8, 12.0), TrendSettings(TREES, degree=2)),
    Recipe(FrequencyResponse(order=12, pole=12.0), TrendSettings(NETWORK), noise_draws=2),
]


@pytest.mark.parametrize("recipe", STAGES, ids=lambda r: f"{type(r.features).__name__}-"
                         f"{type(r.learner).__name__}-{r.parametrisation}")  # fmt: skip
def test_every_combination_trains_repeats_and_is_saved(recipe, tmp_path):
    one, two = (tuners.train(recipe, PLANT, episodes=60) for _ in range(2))
    again = examples(PLANT, 60, 0, recipe.features)
    prediction = one.method.learner(again.features)
    np.testing.assert_array_equal(two.method.learner(again.features), prediction)
    truth = again.targets(coordinates_of(PLANT, recipe.parametrisation))
    assert (((prediction - truth) ** 2).mean(axis=0) < 0.5 * truth.var(axis=0)).all()
    assert one.training["name"] == "custom" and one.training["seed"] == 0
    assert one.method.features == recipe.features
    one.save(tmp_path / "one.tuner")
    loaded = tuners.load(tmp_path / "one.tuner")
    np.testing.assert_array_equal(loaded.method.learner(again.features), prediction)


def test_data_simulated_before_or_during_training_are_the_same_and_the_seed_decides(data):
    recipe = replace(RECIPES["ts-ff"], learner=NETWORK)
    given = tuners.train(recipe, PLANT, episodes=60, data=data, name="mine")
    own, other = (tuners.train(recipe, PLANT, episodes=60, seed=seed) for seed in (0, 1))
    np.testing.assert_array_equal(given.method.learner.W1, own.method.learner.W1)
    assert not np.allclose(own.method.learner.inputs.middle, other.method.learner.inputs.middle)
    plain = tuners.train(RECIPES["ts-ff"], PLANT, episodes=60, data=data)
    names = [tuner.training["name"] for tuner in (given, own, plain)]
    assert names == ["mine", "custom", "ts-ff"]


class Spy:
    """Keeps what it is given to learn from."""

    def fit(self, training, validation, random_state, progress=None):
        ((self.X, self.T),), ((self.X_val, self.T_val),) = training, validation
        return TREES.fit(training, validation, random_state)


def test_four_fifths_of_the_plants_train_and_none_is_in_both_parts():
    draws = 2
    rows, spy = examples(PLANT, 60, 0, ARMAX, noise_draws=draws), Spy()
    tuners.train(Recipe(ARMAX, spy), PLANT, episodes=60, data=rows)
    used = int(rows.usable.sum())
    assert len(spy.X) + len(spy.X_val) == used
    assert abs(len(spy.X) - 0.8 * used) <= draws + 1
    together = np.concatenate([spy.X, spy.X_val])
    assert len(np.unique(together, axis=0)) == used
    order = [int(np.flatnonzero((rows.features == row).all(axis=1))[0]) for row in together]
    targets = rows.targets(PLANT.parametrisation)[order]
    np.testing.assert_array_equal(np.concatenate([spy.T, spy.T_val]), targets)
    # A plant's target is its own.
    assert not np.isin(spy.T_val[:, 0], spy.T[:, 0]).any()


@pytest.mark.parametrize(
    "what, arguments, name",
    [
        ("ts-ff", {"episodes": 49}, "episodes = 49"),
        ("ts-ff", {"episodes": 60.5}, "episodes = 60.5"),
        ("ts-ff", {"episodes": 60, "seed": -1}, "seed = -1"),
        ("ts-ff", {"calibration": 20}, "calibration = 20"),
        ("gb", {}, "tuner = 'gb'"),
        ("pidtune", {}, "tuner = 'pidtune'"),
        (5, {}, "recipe = 5"),
        (PLANT, {}, "plant is given twice"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(what, arguments, name, monkeypatch):
    def forbidden(*_, **__):
        raise AssertionError("simulated")

    monkeypatch.setattr("tuners.tuner.training.examples", forbidden)
    with pytest.raises(ValueError, match=name):
        tuners.train(what, PLANT, **arguments)


@pytest.mark.parametrize(
    "wrong", [{"parametrisation": "polar"}, {"noise_draws": 0}, {"episodes": 0}]
)
def test_wrong_recipes_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        replace(QUICK, **wrong)
    with pytest.raises(ValueError, match="features"):
        Recipe(NETWORK, NETWORK)


def test_a_target_that_no_pi_reaches_is_refused():
    plant = yaw_rate(replace(VEHICLE, target=Target(phase_margin=170.0)))
    with pytest.raises(ValueError, match="target"):
        tuners.train("ts-ff", plant, episodes=60)


def test_a_plants_default_recipe_is_calibrated_and_near_the_bound():
    recipe = recipe_for(lag)
    assert recipe.features == suited(lag, 8) == features_by_name(lag, "laguerre")
    assert 0.7 < suited(lag, 4).pole < 6.0  # rad/s; the plants' are 1 to 5
    tuner = tuners.train(lag, episodes=100, calibration=60)
    assert tuner.training["name"] == "two-stage" and len(tuner.calibration) == 2
    named = tuners.train("first_order:plant", episodes=100, calibration=0)
    np.testing.assert_array_equal(named.method.learner.W1, tuner.method.learner.W1)


def registers(integers):
    """A random register for each integer."""
    return prbs(500, TS, 0.5, 1.0, order=RANDOM_ORDER, start=integers)


@pytest.fixture(scope="module")
def various():
    """A tuner for a plant with another input in every episode."""
    plant = described(excite=registers)
    learner = FeedForwardSettings(neurons=12, epochs=150, max_fail=20)
    features = recipe_for(plant).features
    assert isinstance(features, Regularised)
    return tuners.train(Recipe(features, learner, noise_draws=4), plant, episodes=500)


def error_of(tuner, samples=500, amplitude=1.0, sigma=0.02):
    theta, rng = sample(tuner.plant, 64), np.random.default_rng(0)
    integers = np.arange(1, 65, dtype=np.uint64)
    u = amplitude * prbs(samples, TS, 0.5, 1.0, order=RANDOM_ORDER, start=integers)
    y = simulate(theta, u, None) + sigma * rng.standard_normal(u.shape)
    found = tuner.gains(Recording(u, y, TS)).values
    return np.median(np.abs(found / tuner.plant.oracle(theta) - 1), axis=0)


def test_a_recording_that_says_more_is_answered_nearly_as_well(various):
    usual = error_of(various)
    for samples in (1000, 2500):
        assert (error_of(various, samples) < 2 * usual).all()
    assert (error_of(various, amplitude=3.0) < usual).all()
    assert (error_of(various, sigma=0.002) < usual).all()


def test_any_input_is_answered_without_a_note(various):
    block = recorded(various.plant, "test", 0, 1)
    result = various.tune(block.u[0], block.y[0])
    assert result.trusted and result.notes == ()
    assert (error_of(various) < 0.03).all()


def test_a_learner_well_above_the_bound_leaves_the_answer_to_the_fitted_plant(tmp_path):
    few = replace(recipe_for(lag), episodes=50, noise_draws=1)
    tuner = tuners.train(few, lag, calibration=100)
    record = tuner.training
    assert record["answers"] == "FITTED_PLANT" and max(record["ratio"].values()) < 1.2
    block = recorded(lag, "test", 0, 64)
    recording = Recording(block.u, block.y, lag.Ts)
    climbed, _ = tuner.climb(recording)
    assert (climbed.rung == Rung.FITTED_PLANT).all()
    right = lag.oracle(block.theta)
    own, answered = (
        np.sqrt(np.mean((gains / right - 1) ** 2))
        for gains in (tuner.gains(recording).values, climbed.gains.values)
    )
    assert answered < 0.8 * own
    tuner.save(tmp_path / "few.tuner")
    assert tuners.load(tmp_path / "few.tuner", lag).rungs == tuner.rungs
    assert Tuner(lag, tuner.method).rungs[0] is Rung.METHOD  # nothing was measured


def test_a_training_says_what_its_user_should_know():
    def half(theta):
        gains = lag.design(theta)
        gains[theta[:, 0] > 1.25] = np.nan
        return gains

    tuner = Tuner(lag, tuners.load("gb", lag).method, {"ratio": {"a [deg]": 1.0, "b": 1.4}})
    (said,) = remarks(tuner)
    assert "b is 1.40 times the bound" in said
    with pytest.warns(UserWarning, match="prior"):
        tuners.train(Recipe(Laguerre(4, 2.0), TREES), described(design=half), episodes=60)
    assert share_without_gains(described(design=half)) == pytest.approx(0.5, abs=0.1)
    tuner.training |= {"ratio": {"b": 1.1}, "without_gains": 0.3}
    (said,) = remarks(tuner)
    assert "30%" in said
