"""A saved tuner answers the same; files that cannot be used are refused."""

import numpy as np
import pytest
from families import one, trained
from first_order import described, linear

import tuners
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.trust.intervals import GAUSSIAN
from tuners.tuner import tuner_file
from tuners.tuner.recording import Recording
from tuners.tuner.rivals import GrayBox
from tuners.tuner.tuner import Tuner
from tuners.tuner.tuner_file import TunerFileError
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.parametrisation import Parametrisation
from yawrate_env.vehicle.single_track import Vehicle
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate


def test_a_saved_tuner_answers_the_same(tuner, plant, episodes, tmp_path):
    path = tmp_path / "own.tuner"
    tuner.save(path)
    again = tuners.load(path)
    np.testing.assert_array_equal(again.act(episodes), tuner.act(episodes))
    assert again.calibration == tuner.calibration != (GAUSSIAN,) * len(plant.counted)
    assert again.training == tuner.training and again.plant.entry == plant.entry
    assert again.method.settings() == tuner.method.settings()
    given = one(plant, episodes, 1)
    first, second = again.tune(**given), tuner.tune(**given)
    assert (first.gains, first.checks, first.intervals) == (
        second.gains, second.checks, second.intervals,
    )  # fmt: skip


def test_the_whole_task_is_saved(tmp_path):
    method = GrayBox()
    task = Task(
        Vehicle(J_z=2000.0, xi=0.7),
        Prior(mu_s=(0.4, 0.9), v_x=(15.0, 25.0)),
        Experiment(Ts=0.01, N=500, register="random", snr_db=20.0),
        Target(crossover=1.2, delay_samples=1),
    )
    tuner = Tuner(yaw_rate(task), method)
    tuner.save(tmp_path / "other.tuner")
    again = tuners.load(tmp_path / "other.tuner")
    assert again.plant.arguments == tuner.plant.arguments and type(again.method) is type(method)


QUICK = tuners.Recipe(Laguerre(8, 2.0), FeedForwardSettings(neurons=8, epochs=60))


def own_units():
    return Parametrisation(lambda gains: gains, lambda values: values)


def test_a_plant_that_cannot_be_found_again_is_not_saved(tmp_path):
    method, path = trained("lag").method, tmp_path / "lag.tuner"
    with pytest.raises(ValueError, match="entry="):
        Tuner(described(entry=""), method).save(path)
    assert not path.exists()
    Tuner(described(entry="gone:plant"), method).save(path)
    with pytest.raises(TunerFileError, match="'gone'"):
        tuners.load(path)


def test_gains_of_any_sign_have_their_own_coordinates():
    own = described(design=lambda theta: -linear.design(theta), parametrisation=own_units())
    tuner = tuners.train(QUICK, own, episodes=100)
    block = recorded(own, "test", 0, 64)
    found = tuner.act(Recording(block.u, block.y, own.Ts))
    assert np.abs(own.metric_values(block.theta, found)).mean() < 0.1


def test_what_is_saved_has_a_name_that_load_knows_for_a_file(tmp_path):
    with pytest.raises(ValueError, match=r"path = .*own' must end in \.tuner.*own\.tuner'"):
        trained("lag").save(tmp_path / "own")
    assert not list(tmp_path.iterdir())
    trained("lag").save(str(tmp_path / "own.tuner"))
    assert tuners.load(str(tmp_path / "own.tuner")).plant.entry == "first_order:linear"


CHANGES = [
    ({"features": None}, "features"),
    ({"features": {"name": "laguerre", "order": 0, "pole": 2.0}}, "order"),
    ({"calibration": [1.0]}, "calibration"),
    ({"calibration": [-1.0, 1.0]}, "calibration"),
    ({"calibration": [float("nan"), 1.0]}, "calibration"),
    ({"calibration": ["a", "b"]}, "calibration"),
    ({"training": "yes"}, "training"),
    ({"parametrisation": "polar"}, "parametrisation"),
    ({"method": "transformer"}, "transformer"),
    ({"plant": 5}, "cannot be used|misnames"),
]


class Altered:
    """A saved tuner's settings and arrays, which are written again and refused."""

    def __init__(self, tuner, path):
        tuner.save(path)
        self.path, self.parts = path, tuner_file.read(path)

    def refused(self, settings, arrays, words):
        tuner_file.write(self.path, settings, arrays)
        with pytest.raises(TunerFileError, match=rf"odd\.tuner .*({words})"):
            tuners.load(self.path)


@pytest.fixture
def altered(request, tmp_path):
    return Altered(trained(getattr(request, "param", "lag")), tmp_path / "odd.tuner")


@pytest.mark.parametrize("change, words", CHANGES)
def test_settings_that_cannot_be_used_are_refused_with_the_path(altered, change, words):
    settings, arrays = altered.parts
    altered.refused(settings | change, arrays, words)


LOST = "method", "features", "learner", "parametrisation", "plant", "calibration", "W1"


@pytest.mark.parametrize("lost", LOST)
def test_files_that_are_incomplete_are_refused(altered, lost):
    settings, arrays = ({k: v for k, v in part.items() if k != lost} for part in altered.parts)
    altered.refused(settings, arrays, f"'{lost}'")


@pytest.mark.parametrize("change", [{"b2": np.zeros(3)}, {"b1": np.full(8, np.nan)}])
def test_arrays_that_cannot_be_used_are_refused(altered, change):
    settings, arrays = altered.parts
    altered.refused(settings, arrays | change, "W2|b1")


@pytest.mark.parametrize("altered", ["vehicle"], indirect=True)
def test_settings_of_another_version_are_refused(altered):
    settings, arrays = altered.parts
    settings["plant"]["arguments"]["experiment"]["sampling"] = 0.001
    altered.refused(settings, arrays, "sampling")
