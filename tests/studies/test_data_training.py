"""Training from a folder: the same tuner as from memory."""

import numpy as np
import pytest
import torch
from data_sets import STAGE, cars, made, rich
from first_order import described, plant
from recordings import ROOT

import tuners
from tuners import data
from tuners.data import DatasetError, shards
from tuners.data.training import Part
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.tuner.examples import examples
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe, training_split
from yawrate_env.plant.episodes import recorded

torch.set_num_threads(1)

EPISODES = 250
QUICK = {
    "network": FeedForwardSettings(neurons=6, epochs=12),
    "trees": GBMSettings(n_estimators=30, min_child_weight=5.0),
}
KINDS = pytest.mark.parametrize("of", [rich, cars], ids=["rich", "cars"])
NETWORK = Recipe(STAGE, QUICK["network"])


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    out = tmp_path_factory.mktemp("training")
    return {of: made(out / str(k), EPISODES, of=of) for k, of in enumerate((plant, rich, cars))}


@KINDS
@pytest.mark.parametrize("learner", QUICK.values(), ids=QUICK)
def test_a_tuner_is_that_of_the_same_data_in_memory(of, learner, folders):
    recipe, calls = Recipe(STAGE, learner), []
    expected = tuners.train(recipe, of, episodes=EPISODES, seed=3, calibration=0, name="two-stage")
    found = data.train(
        folders[of].path, recipe, seed=3, calibration=0, progress=lambda *call: calls.append(call)
    )
    test = recorded(of, "test", 0, 50)
    recording = Recording(test.u, test.y, of.Ts, test.theta)
    # Sums in another order, and a dozen steps that amplify them.
    np.testing.assert_allclose(
        found.gains(recording).values, expected.gains(recording).values, rtol=1e-5
    )
    assert found.training == expected.training and found.plant is of
    assert {what for what, _, _ in calls} == {"verifying", "training two-stage"}


def test_a_tuner_is_calibrated(folders):
    expected = tuners.train(NETWORK, rich, episodes=EPISODES, seed=3, calibration=60)
    found = data.train(folders[rich].path, NETWORK, seed=3, calibration=60)
    np.testing.assert_allclose(found.calibration, expected.calibration, rtol=1e-4)


def test_a_tuner_learns_what_suits_the_plant_by_default(folders, tmp_path):
    tuner = data.train(folders[plant].path, calibration=60)
    tuner.save(tmp_path / "first.tuner")
    test = recorded(plant, "test", 0, 100)
    again = tuners.load(tmp_path / "first.tuner")
    gains = again.gains(Recording(test.u, test.y, plant.Ts, test.theta)).values
    assert np.sqrt((plant.metric_values(test.theta, gains) ** 2).mean()) < 0.05
    assert len(tuner.calibration) == 2


def test_parts_are_the_usable_rows_of_the_split(folders):
    loaded, chosen = examples(cars, EPISODES, 3, STAGE), training_split(EPISODES, 0)
    assert 0 < loaded.usable.sum() < EPISODES
    rows = loaded.usable & chosen
    part = Part(folders[cars], chosen, cars.parametrisation)
    for _ in range(2):  # it can be iterated over again
        X, T = (np.concatenate(side) for side in zip(*part, strict=True))
        np.testing.assert_array_equal(X, loaded.features[rows])
        np.testing.assert_array_equal(T, loaded.targets(cars.parametrisation)[rows])
    assert max(len(X) for X, _ in part) <= 50


def test_a_split_is_four_fifths_and_repeats():
    chosen = training_split(1000, 3)
    assert chosen.sum() == 800
    np.testing.assert_array_equal(chosen, training_split(1000, 3))
    assert (chosen != training_split(1000, 4)).any()


@pytest.mark.parametrize("learner", QUICK.values(), ids=QUICK)
def test_how_the_data_are_cut_does_not_matter(learner):
    rng = np.random.default_rng(0)
    X = rng.standard_normal((500, 3))
    T = np.stack([np.sin(X[:, 0]) + X[:, 1], X[:, 1] * X[:, 2]], axis=1)
    validation = [(X[400:], T[400:])]
    whole = learner.fit([(X[:400], T[:400])], validation, 0)
    for cuts in ([400], [1, 399], [37] * 10 + [30]):
        ends = np.cumsum([0, *cuts])
        parts = [(X[i:j], T[i:j]) for i, j in zip(ends[:-1], ends[1:], strict=True)]
        found = learner.fit(parts, validation, 0)
        np.testing.assert_allclose(found(X), whole(X), rtol=1e-6, atol=1e-6)


def test_the_documentations_example_runs(tmp_path, monkeypatch):
    text = (ROOT / "docs" / "datasets.md").read_text()
    program = text.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(program.replace("1_000_000", "60").replace("sample=100", "sample=2"), {})
    assert tuners.load("big.tuner").training["used"] <= 60


def test_other_features_are_refused(folders):
    with pytest.raises(DatasetError, match="features of Laguerre.*Generate"):
        data.train(folders[plant].path, Recipe(Laguerre(5, 2.0), QUICK["network"]))


def test_another_plant_is_refused(folders):
    with pytest.raises(DatasetError, match="the plant's noise has changed"):
        data.train(folders[plant].path, NETWORK, described(noise=0.5))


@pytest.mark.parametrize("name", ["test", "calibration"])
def test_no_tuner_is_trained_on_the_sets_that_evaluate_it(name, tmp_path):
    made(tmp_path / "data", 60, set=name)
    with pytest.raises(DatasetError, match=f"the {name} set"):
        data.train(tmp_path / "data", NETWORK)


def test_damage_is_refused_before_training(tmp_path):
    folder = made(tmp_path / "data", 60)
    path = folder.path / folder.manifest.shards[0].file
    path.write_bytes(path.read_bytes()[:-1] + b"!")
    with pytest.raises(DatasetError, match="is damaged"):
        data.train(folder.path, NETWORK)


def test_too_few_usable_rows_are_refused(tmp_path):
    made(tmp_path / "data", 19)
    with pytest.raises(DatasetError, match="19 of 19 episodes are usable, at least 20"):
        data.train(tmp_path / "data", NETWORK)


@pytest.mark.parametrize(
    "arguments, name",
    [
        ({"recipe": "ts-ff"}, "recipe"),
        ({"seed": -1}, "seed"),
        ({"calibration": 3}, "calibration"),
        ({"plant": "nowhere:plant"}, "nowhere"),
    ],
)
def test_wrong_arguments_are_refused(arguments, name, folders, monkeypatch):
    monkeypatch.setattr(shards, "read", None)
    with pytest.raises(ValueError, match=name):
        data.train(folders[plant].path, **arguments)
