"""Stages that are not the package's: trained, saved, loaded, or refused before the training."""

import numpy as np
import own_stages
import pytest
from first_order import described, plant

import tuners
from tuners import Recipe
from tuners.data import generate
from tuners.data import train as train_on
from tuners.export import export
from tuners.features.laguerre import Laguerre
from tuners.learners.estimator import Estimator
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.torch_module import TorchSettings
from tuners.tuner.recording import Recording
from yawrate_env.plant.episodes import recorded

LAGUERRE = Laguerre(4, 2.0)
SMALL = FeedForwardSettings(neurons=4, epochs=20)


def boosted():
    pytest.importorskip("skops")
    from sklearn.ensemble import HistGradientBoostingRegressor

    return HistGradientBoostingRegressor(max_iter=20)


STAGES = {
    "scikit-learn": lambda: Recipe(LAGUERRE, boosted()),
    "torch": lambda: Recipe(LAGUERRE, TorchSettings(own_stages.network, epochs=200)),
    "own learner": lambda: Recipe(LAGUERRE, own_stages.Neighbours(7)),
    "own features": lambda: Recipe(own_stages.Means(25), SMALL),
}


@pytest.fixture(scope="module")
def recordings():
    block = recorded(plant, "test", 1, 1000)
    return Recording(block.u, block.y, plant.Ts, block.theta), plant.oracle(block.theta)


@pytest.mark.parametrize("name", STAGES)
def test_a_saved_tuner_gives_the_same_gains(name, recordings, tmp_path):
    recording, right = recordings
    tuner = tuners.train(STAGES[name](), plant, episodes=400)
    tuner.save(tmp_path / "own.tuner")
    again = tuners.load(tmp_path / "own.tuner")
    gains, then = (each.gains(recording).values for each in (tuner, again))
    np.testing.assert_array_equal(then, gains)  # the limit is 1e-5 in 99 %
    errors = gains / right - 1
    assert np.sqrt((errors**2).mean(axis=0)).max() < 0.15  # the middle of the prior is 0.4 off
    result = again.tune(recording.u[0], recording.y[0], plant.Ts)
    assert result.trusted and set(result.gains) == {"kp", "Ti"}


def test_a_regressor_is_trained_as_a_clone_with_the_seed():
    estimator = boosted()
    one, same, other = (
        tuners.train(Recipe(LAGUERRE, estimator), plant, episodes=60, seed=seed).method.learner
        for seed in (0, 0, 1)
    )
    assert not hasattr(estimator, "n_iter_")
    X = np.random.default_rng(0).standard_normal((5, 4))
    np.testing.assert_array_equal(one(X), same(X))
    assert not np.array_equal(one(X), other(X))
    assert [model.random_state for model in one.models] == [0, 0]


def test_an_estimator_with_a_foreign_part_is_refused_by_name(tmp_path):
    boosted()
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer

    foreign = make_pipeline(FunctionTransformer(own_stages.doubled), boosted())
    with pytest.raises(ValueError, match=r"own_stages\.doubled"):
        tuners.train(Recipe(LAGUERRE, foreign), plant, episodes=60)
    import skops.io

    crafted = np.frombuffer(skops.io.dumps(foreign), dtype=np.uint8)
    scaling = {n: np.ones(1) for n in ("feature_mean", "feature_scale", "target_mean")}
    with pytest.raises(ValueError, match=r"own_stages\.doubled"):
        Estimator.from_arrays({**scaling, "target_scale": np.ones(1), "model0.skops": crafted})


@pytest.mark.parametrize(
    "make, named",
    [
        (lambda: Recipe(LAGUERRE, own_stages.Forgetful()), "Forgetful"),
        (lambda: Recipe(LAGUERRE, own_stages.Unsaved()), "Unsaved"),
        (lambda: Recipe(LAGUERRE, TorchSettings(own_stages.no_network)), "build"),
        (lambda: Recipe(LAGUERRE, TorchSettings(lambda n, t: None)), "build"),
        (lambda: Recipe(LAGUERRE, object()), "learner"),
        (lambda: Recipe(own_stages.Turned(), SMALL), "Turned"),
        (lambda: Recipe(own_stages.Table, SMALL), "features"),
        (lambda: Recipe(lambda u, y, Ts: y, SMALL), "features"),
    ],
)
def test_what_could_not_be_used_or_kept_is_refused_before_the_simulations(make, named):
    simulated = []

    def simulate(theta, u, rng):
        simulated.append(len(theta))
        return plant.simulate(theta, u, rng)

    counted = described(simulate=simulate)
    with pytest.raises(ValueError, match=named):
        tuners.train(make(), counted, episodes=400)
    assert sum(simulated) < 10


def test_a_data_set_has_features_of_ones_own(tmp_path):
    means = own_stages.Means(10)
    generate(plant, "train", means, 100, 0, tmp_path / "data", workers=1)
    tuner = train_on(tmp_path / "data", Recipe(means, SMALL), calibration=0)
    assert tuner.method.features == means


@pytest.mark.parametrize("target", ["c", "onnx"])
def test_other_learners_are_not_exported(target, tmp_path):
    tuner = tuners.train(STAGES["own learner"](), plant, episodes=60)
    with pytest.raises(ValueError, match="Table"):
        export(tuner, target, tmp_path / "own.onnx")


def test_a_file_whose_stage_is_gone_is_refused(tmp_path, monkeypatch):
    tuner = tuners.train(STAGES["own learner"](), plant, episodes=60)
    tuner.save(tmp_path / "own.tuner")
    monkeypatch.delattr(own_stages, "Table")
    with pytest.raises(tuners.TunerFileError, match="own_stages:Table"):
        tuners.load(tmp_path / "own.tuner")
