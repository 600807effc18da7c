"""Data sets and training: the same for everyone, and refused where they cannot work."""

import dataclasses

import numpy as np
import pytest
import torch

import tuners
from tuners.catalogue import RECIPES
from tuners.features.armax import Armax
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.tuner.stages import Recipe
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import examples
from yawrate_env.plant.parametrisation import loop
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops, record
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

torch.set_num_threads(1)

TRAIN = CONTEXT_SETS["train"]
# The paper's leaves of 25 vehicles would leave 48 of them in one.
QUICK = {
    "ts-ff": FeedForwardSettings(epochs=15),
    "ts-gbm": GBMSettings(n_estimators=20, min_child_weight=5.0),
}


@pytest.fixture(autouse=True)
def quick_recipes(monkeypatch):
    for name, recipe in RECIPES.items():
        learner = QUICK["ts-ff" if "ff" in name else "ts-gbm"]
        quick = dataclasses.replace(recipe, learner=learner, noise_draws=min(recipe.noise_draws, 2))
        monkeypatch.setitem(RECIPES, name, quick)


@pytest.fixture(scope="module")
def data():
    return examples(yaw_rate(Task()), 60, 0, Armax())


def test_a_data_set_is_features_of_the_episodes_and_gains_of_the_rule(data):
    draw = TRAIN.draw(Prior(), 0, 0, 60)
    u, y = record(Task(), draw)
    features, usable = Armax()(u, np.asarray(y), 0.001)
    oracle = loops(Task(), draw.context).design()
    assert len(data) == 60
    np.testing.assert_array_equal(data.features, features)
    np.testing.assert_array_equal(data.usable, usable)
    np.testing.assert_array_equal(data.theta[:, 0], draw.context.mu_s)
    np.testing.assert_array_equal(data.gains, np.transpose([oracle.kp, oracle.Ti]))
    assert data.targets(loop(Target())).shape == (60, 2)


def test_chunks_and_sizes_do_not_matter(data):
    more = examples(yaw_rate(Task()), 270, 0, Armax())  # 128 at a time
    np.testing.assert_array_equal(more.features[:60], data.features)
    again = examples(yaw_rate(Task()), 14, 0, Armax())
    np.testing.assert_array_equal(more.features[:14], again.features)
    draw = TRAIN.draw(Prior(), 0, 256, 14)
    np.testing.assert_array_equal(more.theta[256:, 0], draw.context.mu_s)


def test_noise_draws_repeat_the_vehicles_with_fresh_noise(data):
    twice = examples(yaw_rate(Task()), 60, 0, Armax(), noise_draws=2)
    assert len(twice) == 120
    np.testing.assert_array_equal(twice.features[:60], data.features)
    np.testing.assert_array_equal(twice.theta[60:, 0], data.theta[:, 0])
    np.testing.assert_array_equal(twice.gains[60:], data.gains)
    np.testing.assert_array_equal(twice.number, np.tile(np.arange(60), 2))
    change = twice.features[60:] - data.features
    assert (change != 0).all() and (change.std(axis=0) < data.features.std(axis=0)).all()


def test_vehicles_that_cannot_reach_the_target_are_not_usable(data):
    task = Task(target=Target(phase_margin=55.0, crossover=2.0))
    found = examples(yaw_rate(task), 60, 0, Armax())
    reachable = np.isfinite(found.gains).all(axis=1)
    assert 0 < reachable.sum() < 60
    np.testing.assert_array_equal(found.usable, reachable & data.usable)


def test_progress_of_simulation_and_training():
    calls = []
    tuners.train("ts-ff", Task(), episodes=60, progress=lambda *call: calls.append(call))
    assert {what for what, _, _ in calls} == {"simulating", "training ts-ff"}
    assert calls[0] == ("simulating", 60, 60)
    assert [done for what, done, _ in calls if what != "simulating"] == list(range(1, 16))


@pytest.mark.parametrize("name", RECIPES)
def test_every_recipe_trains_and_repeats(name, data, tmp_path):
    dataset = data if RECIPES[name].compressor == Armax() else None
    one, two = (tuners.train(name, Task(), episodes=60, dataset=dataset) for _ in range(2))
    again = examples(yaw_rate(Task()), 60, 0, RECIPES[name].compressor)
    prediction = one.stages.learner(again.features)
    np.testing.assert_array_equal(two.stages.learner(again.features), prediction)
    truth = again.targets(yaw_rate(Task(), RECIPES[name].coordinates).coordinates)
    assert (((prediction - truth) ** 2).mean(axis=0) < 0.5 * truth.var(axis=0)).all()
    assert one.training["name"] == name and one.training["seed"] == 0
    assert one.stages.compressor == RECIPES[name].compressor
    one.save(tmp_path / "one.tuner")
    loaded = tuners.load(tmp_path / "one.tuner")
    np.testing.assert_array_equal(loaded.stages.learner(again.features), prediction)


def test_data_simulated_before_or_during_training_are_the_same(data):
    with_data = tuners.train("ts-ff", Task(), episodes=60, dataset=data)
    without = tuners.train("ts-ff", Task(), episodes=60)
    np.testing.assert_array_equal(with_data.stages.learner.W1, without.stages.learner.W1)


def test_the_seed_decides_the_data_and_the_weights():
    one, other = (tuners.train("ts-ff", Task(), episodes=60, seed=seed) for seed in (0, 1))
    assert not np.allclose(one.stages.learner.inputs.middle, other.stages.learner.inputs.middle)


def test_four_fifths_of_the_vehicles_train(data, monkeypatch):
    seen = {}

    class Spy:
        def fit(self, X, T, X_val, T_val, random_state, progress):
            seen.update(X=X, T=T, X_val=X_val, T_val=T_val)
            return QUICK["ts-gbm"].fit(X, T, X_val, T_val, random_state)

    monkeypatch.setitem(RECIPES, "ts-gbm", Recipe(Armax(), Spy()))
    tuners.train("ts-gbm", Task(), episodes=60, dataset=data)
    used = int(data.usable.sum())
    assert len(seen["X"]) + len(seen["X_val"]) == used
    assert abs(len(seen["X"]) - 0.8 * used) <= 1
    rows = np.concatenate([seen["X"], seen["X_val"]])
    assert len(np.unique(rows, axis=0)) == used  # nothing is in both parts
    order = [int(np.flatnonzero((data.features == row).all(axis=1))[0]) for row in rows]
    targets = np.concatenate([seen["T"], seen["T_val"]])
    np.testing.assert_array_equal(targets, data.targets(loop(Target()))[order])


def test_no_vehicle_is_in_both_parts(monkeypatch):
    both = examples(yaw_rate(Task()), 60, 0, Armax(), noise_draws=2)
    seen = {}

    class Spy:
        def fit(self, X, T, X_val, T_val, random_state, progress):
            seen.update(T=T, T_val=T_val)
            return QUICK["ts-gbm"].fit(X, T, X_val, T_val, random_state)

    monkeypatch.setitem(RECIPES, "ts-gbm", Recipe(Armax(), Spy()))
    tuners.train("ts-gbm", Task(), episodes=60, dataset=both)
    # A vehicle's target is its own.
    assert not np.isin(seen["T_val"][:, 0], seen["T"][:, 0]).any()


@pytest.mark.parametrize(
    "name, arguments, message",
    [
        ("ts-ff", {"episodes": 49}, "episodes = 49 must be .* at least 50"),
        ("ts-ff", {"episodes": 0}, "episodes = 0 must be .* at least 50"),
        ("ts-ff", {"episodes": 60.5}, "episodes = 60.5 must be a whole number"),
        ("ts-ff", {"episodes": 60, "seed": -1}, "seed = -1"),
        ("gb", {}, "tuner = 'gb' is unknown. Choose one of ts-gbm, ts-ff"),
        ("pidtune", {}, "tuner = 'pidtune' is unknown"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(name, arguments, message, monkeypatch):
    def forbidden(*_, **__):
        raise AssertionError("simulated")

    monkeypatch.setattr("tuners.tuner.training.examples", forbidden)
    with pytest.raises(ValueError, match=message):
        tuners.train(name, Task(), **arguments)


def test_a_record_has_the_recipes_name(data):
    def recorded(recipe, **kwargs):
        tuner = tuners.train(recipe, Task(), episodes=60, dataset=data, **kwargs)
        return tuner.training["name"]

    recipe = RECIPES["ts-ff"]
    other = dataclasses.replace(recipe, learner=FeedForwardSettings(neurons=3, epochs=5))
    assert recorded(recipe) == "ts-ff" and recorded(other) == "custom"
    assert recorded(other, name="ts-ff") == "ts-ff"


def test_a_task_is_a_task():
    for attempt in (lambda: tuners.train("ts-ff", 5), lambda: tuners.load("gb", 5)):
        with pytest.raises(ValueError, match="task = 5 is not a Task. Make one with"):
            attempt()


@pytest.mark.parametrize("name", ["ts-ff", "ts-gbm"])
def test_a_target_that_no_pi_reaches_is_refused(name):
    task = Task(target=Target(phase_margin=170.0))
    with pytest.raises(ValueError, match="0 of 60 episodes are usable.*Choose a target"):
        tuners.train(name, task, episodes=60)


def test_a_tuner_of_another_task_keeps_it():
    task = Task(target=Target(crossover=1.2), experiment=Experiment(Ts=0.01, N=1000))
    tuner = tuners.train("ts-ff", task, episodes=60)
    assert tuner.task == task
