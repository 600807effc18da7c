"""Training from a folder: the same tuner as from memory; and the table of scikit-learn's kind."""

import numpy as np
import pytest
import torch
from data_sets import STAGE, cars, damage, made, rich
from first_order import described, plant
from recordings import ROOT

import tuners
from tuners import data
from tuners.data import DatasetError, load_gains, shards
from tuners.data.training import Part
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.tuner.examples import examples
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe, training_split
from yawrate_env.plant.episodes import recorded

torch.set_num_threads(1)

EPISODES = 200
NETWORK = Recipe(STAGE, FeedForwardSettings(neurons=6, epochs=12))
TREES = Recipe(STAGE, GBMSettings(n_estimators=20, min_child_weight=5.0))


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    out = tmp_path_factory.mktemp("training")
    return {of: made(out / str(k), EPISODES, of=of) for k, of in enumerate((plant, rich, cars))}


def numbers(record):
    """The numbers of a nested record, in its order."""
    return [n for v in record.values() for n in (numbers(v) if isinstance(v, dict) else [v])]


@pytest.mark.parametrize(
    "of, recipe, calibration",
    [(rich, NETWORK, 60), (cars, TREES, 0)],
    ids=["a network of measured plants", "trees of vehicles"],
)
def test_a_tuner_is_that_of_the_same_data_in_memory(of, recipe, calibration, folders):
    calls, settings = [], {"seed": 3, "calibration": calibration}
    expected = tuners.train(recipe, of, episodes=EPISODES, name="two-stage", **settings)
    found = data.train(
        folders[of].path, recipe, **settings, progress=lambda *call: calls.append(call)
    )
    test = recorded(of, "test", 0, 50)
    recording = Recording(test.u, test.y, of.Ts, test.theta)
    # Sums in another order, and a dozen steps that amplify them.
    np.testing.assert_allclose(
        found.gains(recording).values, expected.gains(recording).values, rtol=1e-5
    )
    np.testing.assert_allclose(found.calibration, expected.calibration, rtol=1e-4)
    one, other = ({**each.training} for each in (found, expected))
    for ratios in ("ratio", "against_bound"):
        np.testing.assert_allclose(*(numbers(each.pop(ratios, {})) for each in (one, other)), 1e-4)
    assert one == other and found.plant.arguments == of.arguments
    assert {"verifying", "training two-stage"} <= {what for what, _, _ in calls}


def test_parts_are_the_usable_rows_of_the_split(folders):
    loaded, chosen = examples(cars, EPISODES, 3, STAGE), training_split(EPISODES, 0)
    assert 0 < loaded.usable.sum() < EPISODES and chosen.sum() == 0.8 * EPISODES
    rows = loaded.usable & chosen
    part = Part(folders[cars], chosen, cars.parametrisation)
    for _ in range(2):  # it can be iterated over again
        X, T = (np.concatenate(side) for side in zip(*part, strict=True))
        np.testing.assert_array_equal(X, loaded.features[rows])
        np.testing.assert_array_equal(T, loaded.targets(cars.parametrisation)[rows])
    assert max(len(X) for X, _ in part) <= 50


@pytest.mark.parametrize("recipe", [NETWORK, TREES], ids=["network", "trees"])
def test_how_the_data_are_cut_does_not_matter(recipe):
    rng = np.random.default_rng(0)
    X = rng.standard_normal((300, 3))
    T = np.stack([np.sin(X[:, 0]) + X[:, 1], X[:, 1] * X[:, 2]], axis=1)
    validation = [(X[240:], T[240:])]
    whole = recipe.learner.fit([(X[:240], T[:240])], validation, 0)
    for cuts in ([240], [1, 239], [37] * 6 + [18]):
        ends = np.cumsum([0, *cuts])
        parts = [(X[i:j], T[i:j]) for i, j in zip(ends[:-1], ends[1:], strict=True)]
        found = recipe.learner.fit(parts, validation, 0)
        np.testing.assert_allclose(found(X), whole(X), rtol=1e-6, atol=1e-6)


def test_the_documentations_example_runs(tmp_path, monkeypatch):
    text = (ROOT / "docs" / "datasets.md").read_text()
    program = text.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(program.replace("1_000_000", "60").replace("sample=100", "sample=2"), {})
    assert tuners.load("big.tuner").training["used"] <= 60


@pytest.mark.parametrize(
    "arguments, name",
    [
        ({"recipe": "ts-ff"}, "recipe"),
        ({"recipe": Recipe(Laguerre(5, 2.0), NETWORK.learner)}, "features of Laguerre.*Generate"),
        ({"seed": -1}, "seed"),
        ({"calibration": 3}, "calibration"),
        ({"plant": "nowhere:plant"}, "nowhere"),
        ({"plant": described(noise=0.5)}, "the plant's noise has changed"),
    ],
)
def test_wrong_arguments_are_refused_before_reading(arguments, name, folders, monkeypatch):
    monkeypatch.setattr(shards, "read", None)
    with pytest.raises(ValueError, match=name):
        data.train(folders[plant].path, **arguments)


def test_folders_that_no_tuner_learns_from_are_refused(tmp_path):
    few = made(tmp_path / "few", 19)
    with pytest.raises(DatasetError, match="19 of 19 episodes are usable, at least 20"):
        data.train(few.path, NETWORK)
    damage(few.path / few.manifest.shards[0].file)
    with pytest.raises(DatasetError, match="is damaged"):
        data.train(few.path, NETWORK)
    for name in ("test", "calibration"):  # they evaluate it
        made(tmp_path / name, 20, set=name)
        with pytest.raises(DatasetError, match=f"the {name} set"):
            data.train(tmp_path / name, NETWORK)


# --- the table


@pytest.mark.parametrize(
    "parametrisation, names", [("gains", "kp Ti"), ("plant", "log_gain phase")]
)
def test_the_table_is_the_usable_part_of_the_data_set(parametrisation, names, folders):
    loaded = examples(cars, EPISODES, 3, STAGE)
    table = load_gains(folders[cars].path, parametrisation=parametrisation)
    np.testing.assert_array_equal(table.data, loaded.features[loaded.usable])
    targets = loaded.targets(cars.parametrisation) if names[0] == "l" else loaded.gains
    np.testing.assert_array_equal(table.target, targets[loaded.usable])
    assert table.feature_names == [f"laguerre_{i}" for i in range(1, 5)]
    assert table.target_names == names.split() and table.frame is None
    assert f"{loaded.usable.sum()} plants" in table.DESCR and "yaw_rate" in table.DESCR
    assert table["data"] is table.data
    with pytest.raises(AttributeError, match="colour"):
        _ = table.colour


def test_arrays_or_frames(folders):
    path = folders[cars].path
    X, y = load_gains(path, return_X_y=True)
    table = load_gains(path, as_frame=True)
    assert list(table.frame) == [*table.feature_names, *table.target_names]
    assert list(table.data) == table.feature_names and list(table.target) == ["kp", "Ti"]
    np.testing.assert_array_equal(table.frame.to_numpy(), np.hstack([X, y]))
    X, y = load_gains(path, return_X_y=True, as_frame=True)
    assert X.equals(table.data) and y.equals(table.target)
    with pytest.raises(ValueError, match="parametrisation = 'polar'"):
        load_gains(path, parametrisation="polar")


def test_without_a_folder_it_is_simulated():
    X, y = load_gains(return_X_y=True)
    assert X.shape == (1500, 10) and y.shape == (1500, 2)
    residual = y - np.c_[X, np.ones(1500)] @ np.linalg.lstsq(np.c_[X, np.ones(1500)], y)[0]
    assert residual[:, 0].std() < 0.1 * y[:, 0].std()  # features tell of the gains
