"""Training from a folder: the same tuner as from memory."""

import dataclasses

import numpy as np
import pytest
import torch
from recordings import ROOT

import tuners
from tuners import data
from tuners.catalogue import RECIPES
from tuners.data import DatasetError, generate, shards
from tuners.data.training import Part
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.tuner.stages import trains
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import examples
from yawrate_env.plant.parametrisation import loop
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

torch.set_num_threads(1)

TRAIN = CONTEXT_SETS["train"]
STAGE = Laguerre(order=4)
TASK = Task(experiment=Experiment(Ts=0.01, N=1000), target=Target(55.0, 2.0))
QUICK = {
    "ts-ff-lag": FeedForwardSettings(neurons=6, epochs=12),
    "ts-gbm-lag": GBMSettings(n_estimators=30, min_child_weight=5.0),
}


@pytest.fixture(autouse=True)
def quick_recipes(monkeypatch):
    for name, learner in QUICK.items():
        quick = dataclasses.replace(RECIPES[name], compressor=STAGE, learner=learner)
        monkeypatch.setitem(RECIPES, name, quick)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("training") / "data"
    return generate(TASK, TRAIN, STAGE, 400, 0, out, shard_size=70, workers=1)


@pytest.mark.parametrize("name", QUICK)
def test_a_tuner_is_that_of_the_same_data_in_memory(name, folder):
    loaded = examples(yaw_rate(TASK), 400, 0, STAGE)
    expected = tuners.train(name, TASK, episodes=400, dataset=loaded)
    calls = []
    found = data.train(name, folder.path, progress=lambda *call: calls.append(call))
    X = loaded.features
    # Sums in another order, and a dozen steps that amplify them.
    np.testing.assert_allclose(
        found.stages.learner(X), expected.stages.learner(X), rtol=1e-6, atol=1e-6
    )
    assert found.task == TASK and found.stages.compressor == STAGE
    assert found.training == expected.training | {"noise_draws": 1}
    assert {what for what, _, _ in calls} == {"verifying", f"training {name}"}


def test_parts_are_the_usable_rows_of_the_split(folder):
    loaded, chosen = examples(yaw_rate(TASK), 400, 0, STAGE), trains(400, 0)
    assert 0 < loaded.usable.sum() < 400
    rows = loaded.usable & chosen
    coordinates = loop(TASK.target)
    part = Part(folder, chosen, coordinates)
    for _ in range(2):  # it can be iterated over again
        X, T = (np.concatenate(side) for side in zip(*part, strict=True))
        np.testing.assert_array_equal(X, loaded.features[rows])
        np.testing.assert_array_equal(T, loaded.targets(coordinates)[rows])
    assert max(len(X) for X, _ in part) <= 70


def test_a_split_is_four_fifths_and_repeats():
    chosen = trains(1000, 3)
    assert chosen.sum() == 800
    np.testing.assert_array_equal(chosen, trains(1000, 3))
    assert (chosen != trains(1000, 4)).any()


@pytest.mark.parametrize("learner", QUICK.values(), ids=QUICK)
def test_how_the_data_are_cut_does_not_matter(learner):
    rng = np.random.default_rng(0)
    X = rng.standard_normal((500, 3))
    T = np.stack([np.sin(X[:, 0]) + X[:, 1], X[:, 1] * X[:, 2]], axis=1)
    checked = [(X[400:], T[400:])]
    whole = learner.fit(X[:400], T[:400], *checked[0], 0)
    for cuts in ([400], [1, 399], [37] * 10 + [30]):
        ends = np.cumsum([0, *cuts])
        parts = [(X[i:j], T[i:j]) for i, j in zip(ends[:-1], ends[1:], strict=True)]
        found = learner.fit_batches(parts, checked, 0)
        np.testing.assert_allclose(found(X), whole(X), rtol=1e-6, atol=1e-6)


def test_the_documentations_example_runs(tmp_path, monkeypatch):
    text = (ROOT / "docs" / "datasets.md").read_text()
    program = text.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(program.replace("1_000_000", "60").replace("sample=100", "sample=2"), {})
    assert tuners.load("big.tuner").training["vehicles"] == 60


def test_another_compressor_is_refused(folder):
    with pytest.raises(DatasetError, match="features of Laguerre.*ts-ff works on.*Armax"):
        data.train("ts-ff", folder.path)


def test_any_recipe_learns_from_its_features(folder):
    recipe = dataclasses.replace(RECIPES["ts-ff"], compressor=STAGE, learner=QUICK["ts-ff-lag"])
    found, named = data.train(recipe, folder.path), data.train("ts-ff-lag", folder.path)
    assert (found.training["name"], named.training["name"]) == ("custom", "ts-ff-lag")
    np.testing.assert_array_equal(found.stages.learner.W1, named.stages.learner.W1)


def test_other_vehicles_are_refused(folder):
    other = dataclasses.replace(TASK, target=Target(55.0, 2.1))
    with pytest.raises(DatasetError, match="other vehicles: task.target.crossover is 2.0 there"):
        data.train("ts-ff-lag", folder.path, task=other)
    assert data.train("ts-ff-lag", folder.path, task=TASK).task == TASK


@pytest.mark.parametrize("name", ["test", "calibration"])
def test_nothing_learns_from_what_tells_how_good_it_is(name, tmp_path):
    generate(TASK, name, STAGE, 60, 0, tmp_path / "data", workers=1)
    with pytest.raises(DatasetError, match=f"the {name} set.*nothing may learn.*the train set"):
        data.train("ts-ff-lag", tmp_path / "data")


def test_damage_is_refused_before_training(tmp_path):
    folder = generate(TASK, TRAIN, STAGE, 60, 0, tmp_path / "data")
    path = folder.path / folder.manifest.shards[0].file
    path.write_bytes(path.read_bytes()[:-1] + b"!")
    with pytest.raises(DatasetError, match="is damaged"):
        data.train("ts-ff-lag", folder.path)


def test_too_few_usable_rows_are_refused(tmp_path):
    folder = generate(TASK, TRAIN, STAGE, 25, 0, tmp_path / "data")
    with pytest.raises(DatasetError, match=r"\d+ of 25 episodes are usable, at least 20"):
        data.train("ts-ff-lag", folder.path)


@pytest.mark.parametrize(
    "name, arguments, message",
    [("pidtune", {}, "tuner = 'pidtune'"), ("ts-ff-lag", {"seed": -1}, "seed = -1")],
)
def test_wrong_arguments_are_refused(name, arguments, message, folder, monkeypatch):
    monkeypatch.setattr(shards, "read", None)
    with pytest.raises(ValueError, match=message):
        data.train(name, folder.path, **arguments)
