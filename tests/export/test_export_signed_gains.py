"""Gains of either sign end to end: a state feedback is trained, tuned, saved and exported."""

import json
import sys

import numpy as np
import pytest
from c_programs import passes

import tuners
from tuners.export import export
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from yawrate_env.loop.target import Target
from yawrate_env.plant.parametrisation import of_gains, signed

MODULE = '''
"""A servo whose motor is wired the other way round: inertia and friction unknown."""
import numpy as np
from yawrate_env.loop.discretisation import zoh
from yawrate_env.loop.state_feedback import StateFeedback
from yawrate_env.loop.target import Target
from yawrate_env.plant.control_loop import ControlLoop
from yawrate_env.signals.excitation import prbs


def sampled(theta, Ts):
    J, d = theta.T
    A, B = np.zeros((len(theta), 2, 2)), np.zeros((len(theta), 2))
    A[:, 0, 1], A[:, 1, 1], B[:, 1] = 1.0, -d / J, -1 / J
    A[:, 0, 0] = -0.05
    return zoh(A, B, np.array([1.0, 0.0]), Ts)


loop = ControlLoop(
    sampled, 0.02, Target(crossover=1.0, Ts=0.02), ("voltage [V]", "angle [rad]"),
    StateFeedback(("k_angle", "k_speed")), "lqr", ("phase_margin [deg]", "Ms"), weight=0.02,
)
plant = loop.plant(
    prior={"J": (0.5, 1.5), "d": (0.5, 2.0)}, u=prbs(500, 0.02, 0.4, 1.0)[0], noise=0.005,
    command_limits=(-24.0, 24.0), entry="reversed_servo:plant",
)
'''


@pytest.fixture
def plant(tmp_path, monkeypatch):
    (tmp_path / "reversed_servo.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "reversed_servo", raising=False)
    import reversed_servo

    return reversed_servo.plant


@pytest.mark.slow
def test_negative_gains_go_all_the_way(plant, tmp_path):
    recipe = tuners.Recipe(Laguerre(8, 3.0), FeedForwardSettings(neurons=6, epochs=20))
    tuner = tuners.train(recipe, plant, episodes=80, calibration=50)
    theta = np.array([[0.8, 1.1]])
    y = plant.respond(theta)[0] + 0.005 * np.random.default_rng(0).standard_normal(500)
    result = tuner.tune(plant.u, y)
    assert result.trusted and (np.array(list(result.gains.values())) < 0).all()
    np.testing.assert_allclose(list(result.gains.values()), plant.oracle(theta)[0], rtol=0.05)
    tuner.save(tmp_path / "servo.tuner")
    again = tuners.load(tmp_path / "servo.tuner").tune(plant.u, y)
    assert again.gains == result.gains
    export(result, "c", tmp_path / "feedback")
    assert passes(tmp_path / "feedback", "yawrate_state_feedback")
    (path,) = export(result, "json", tmp_path / "feedback.json")
    written = json.loads(path.read_text())
    assert written["controller"] == "state feedback" and written["gains"] == result.gains
    files = export(tuner, "c", tmp_path / "tuner")
    assert "sinh(values[0])" in next(f for f in files if f.name == "yawrate_tuner.c").read_text()
    assert passes(tmp_path / "tuner", "yawrate_laguerre", "yawrate_tuner")
    drawn = result.loop
    assert drawn is not None and drawn.stable and len(drawn.responses) == 2
    assert drawn.responses[0].value[-1] == pytest.approx(1.0, abs=0.05)


def test_onnx_gives_negative_gains_too(plant, tmp_path):
    onnxruntime = pytest.importorskip("onnxruntime")
    recipe = tuners.Recipe(Laguerre(8, 3.0), FeedForwardSettings(neurons=6, epochs=8))
    tuner = tuners.train(recipe, plant, episodes=60, calibration=0)
    (path,) = export(tuner, "onnx", tmp_path / "servo.onnx")
    y = plant.respond(np.array([[0.8, 1.1], [1.2, 0.7]]))
    session = onnxruntime.InferenceSession(str(path))
    found = session.run(None, {session.get_inputs()[0].name: y})
    named = dict(zip((o.name for o in session.get_outputs()), found, strict=True))
    from tuners.tuner.recording import Recording

    expected = tuner.gains(Recording(plant.u[None], y, plant.Ts, np.full((2, 2), np.nan))).values
    for i, name in enumerate(plant.gains):
        np.testing.assert_allclose(named[name], expected[:, i], rtol=1e-9)


def test_signed_coordinates_go_there_and_back():
    coordinates = signed(2.0, 0.1)
    gains = np.array([[-30.0, 0.0], [1e-9, 5.0], [0.0, -0.02]])
    np.testing.assert_allclose(coordinates.decode(coordinates.encode(gains)), gains, atol=1e-15)
    assert coordinates.names(("k1", "k2")) == ("asinh_k1", "asinh_k2")
    mixed = of_gains(("log", "linear"))
    np.testing.assert_allclose(mixed.decode(mixed.encode(np.array([[3.0, 0.0]]))), [[3.0, 0.0]])
    assert np.isnan(mixed.encode(np.array([[-3.0, 0.0]]))[0, 0])
    assert np.isnan(coordinates.decode(np.array([[800.0, 0.0]]))).all()


@pytest.mark.parametrize("arguments, name", [
    ((("logarithm",),), "kind = 'logarithm'"),
    ((("signed",), (0.0,)), "scale = 0"),
    ((("signed",), (1.0, 2.0)), "scales"),
])  # fmt: skip
def test_wrong_columns_are_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        of_gains(*arguments)


def test_the_target_of_a_loop_names_no_coordinates_of_other_controllers():
    from yawrate_env.plants import sopdt

    aim = {"phase_margin": 60, "crossover": 0.01}
    assert sopdt(rule="loop-shaping", target=aim).loop_target == Target(60, 0.01, 1.0)
    assert sopdt(rule="loop-shaping", target=aim, controller="PIDF").loop_target is None
