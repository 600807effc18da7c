"""Tuners of plants with several channels in other programs."""

import numpy as np
import pytest
from c_programs import notices, passes
from two_by_two import described, plant

import tuners
from tuners.export import export
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.parametrisation import of_gains

LEARNER = FeedForwardSettings(neurons=6, epochs=40)
PROGRAM = "yawrate_tuner", "yawrate_laguerre"


@pytest.fixture(scope="module")
def tuner():
    """Of a plant whose second gain is negative, as where an input lowers an output."""
    turned = described(
        design=lambda theta: np.array(plant.design(theta)) * [1, 1, -1, 1],
        parametrisation=of_gains(("log",) * 4, (1, 1, -1, 1)),
    )
    return tuners.train(Recipe(Laguerre(3, 0.15), LEARNER), turned, episodes=150, calibration=0)


def test_a_tuner_in_c_meets_its_golden_vectors_and_notices_exchanged_channels(tuner, tmp_path):
    export(tuner, "c", tmp_path)
    assert passes(tmp_path, *PROGRAM) and passes(tmp_path, "yawrate_laguerre")
    mistakes = {"* output[k]": "* output[OUTPUTS - 1 - k]", "= input[k];": "= input[0];"}
    assert notices(tmp_path, "yawrate_laguerre.c", mistakes, *PROGRAM)


def test_a_tuner_in_onnx_answers_as_python_does(tuner, tmp_path):
    runtime = pytest.importorskip("onnxruntime")
    export(tuner, "onnx", tmp_path / "two.onnx")
    block = recorded(tuner.plant, "test", 0, 40)
    session = runtime.InferenceSession(tmp_path / "two.onnx")
    assert [each.name for each in session.get_inputs()] == ["top", "bottom"]
    *gains, status = session.run(None, {"top": block.y[:, 0], "bottom": block.y[:, 1]})
    right = tuner.gains(Recording(block.u, block.y, tuner.plant.Ts)).values
    np.testing.assert_allclose(np.stack(gains, axis=1), right, rtol=1e-9)
    assert (right[:, 2] < 0).all() and not status.any()
