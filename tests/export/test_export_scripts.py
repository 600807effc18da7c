"""Controllers as MATLAB scripts and as structured text, read by small readers of both."""

from dataclasses import replace

import numpy as np
import pytest
from controller_values import TS, VALUES
from small_languages import Block, Function, objects, scalars

from tuners.export import DigitalPI, DigitalPID, DigitalStateFeedback, Gains, export
from tuners.export.pid_program import golden_signals
from tuners.export.scripts import (
    matlab_script,
    pi_script,
    pid_block,
    state_feedback_block,
    state_feedback_script,
)
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.state_feedback import STATE_FEEDBACK

STATES = DigitalStateFeedback({"k1": -2.5, "k2": 0.3}, 1.7, TS, -1.0, 2.0)


def gains(name):
    return Gains({gain: VALUES[gain] for gain in CONTROLLERS[name].gains}, Ts=TS, controller=name)


def digital(name):
    return gains(name).pid(limits=(-1.0, 2.0))


def responses(name, omega):
    """From reference and output to the command, by the loop's own compensator."""
    row = np.array([[VALUES[gain] for gain in CONTROLLERS[name].gains]])
    made = CONTROLLERS[name].parallel(row, TS).compensator(TS)
    delta = (np.exp(1j * omega * TS) - 1) / TS
    top = [np.polyval(p[0], delta) for p in (made.reference, made.output)]
    return [p / np.polyval(made.denominator[0], delta) for p in top]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_matlab_object_has_the_response_of_the_loops_controller(name, tmp_path):
    (path,) = export(gains(name), "matlab", tmp_path / "of.m", limits=(-1.0, 2.0))
    found = objects(path.read_text())
    omega = np.geomspace(1e-3, 0.99 * np.pi / TS, 60)
    of_r, of_y = responses(name, omega)
    two = not np.allclose(of_r, of_y)
    standard = {"kp", "Ti"} <= set(CONTROLLERS[name].gains)
    names = {"C", "C_r", "C_y"} if two else {"C", "C_tf"}
    assert set(found) == names | ({"C_std"} if standard else set())
    for of, made in found.items():
        expected = [of_r] if of == "C_r" else [of_r, of_y] if len(made) == 2 else [of_y]
        assert len(made) == len(expected)
        for one, right in zip(made, expected, strict=True):
            np.testing.assert_allclose(one(np.exp(1j * omega * TS)), right, rtol=1e-8, err_msg=of)
    assert scalars(path.read_text())["limits"] == [-1.0, 2.0]


def test_a_pis_script_is_the_pidss():
    pi = DigitalPI(0.3, 0.2, 0.01, -0.5, 0.5)
    b, a = pi.difference_equation()
    (C,), (C_tf,) = (objects(pi_script(pi))[name] for name in ("C", "C_tf"))
    z = np.exp(1j * np.linspace(0.01, 3.0, 20))
    for made in (C, C_tf):
        np.testing.assert_allclose(made(z), np.polyval(b, z) / np.polyval(a, z), rtol=1e-9)


def test_a_state_feedback_is_a_static_gain():
    A, B, C, D, Ts = objects(state_feedback_script(STATES))["C"]
    assert (A, B, C, Ts) == ([], [], [], TS)
    np.testing.assert_array_equal(D, [1.7, 2.5, -0.3])


@pytest.mark.parametrize("name", CONTROLLERS)
def test_sample_by_sample_both_are_the_digital_controller(name):
    pid = digital(name)
    reference, measured, start = golden_signals(pid)
    right = pid.run(reference, measured, start=start)
    assert (right == pid.low).any() and (right == pid.high).any()
    block, function = Block(pid_block(pid)), Function(matlab_script(pid))
    at_start = dict(zip(("Setpoint", "ProcessValue", "ManualCommand"), start, strict=True))
    assert block(**at_start, Manual=True) == start[2]
    function(*start)
    function.memory |= initial(function, pid, start)
    found = [block(Setpoint=r, ProcessValue=y, Manual=False)
             for r, y in zip(reference, measured, strict=True)]  # fmt: skip
    np.testing.assert_allclose(found, right, atol=1e-11 * (pid.high - pid.low))
    found = [function(r, y, 0.0) for r, y in zip(reference, measured, strict=True)]
    np.testing.assert_allclose(found, right, atol=1e-11 * (pid.high - pid.low))


def initial(function, pid, start):
    """The function's memory before its first sample, which starts and steps in one."""
    fresh = Function(matlab_script(pid))
    first = fresh(*start)
    assert first == pytest.approx(start[2])  # no bump
    r, y, u = start
    error = min(max(r - y, -pid.largest), pid.largest)
    proportional = pid.Kp * (error - (1 - pid.b) * r) + pid.half * error
    return {"integral": u - proportional, "derivative": 0.0, "last": error - (1 - pid.c) * r,
            "output": u}  # fmt: skip


def test_a_block_goes_between_manual_and_automatic_without_a_bump():
    block = Block(pid_block(digital("2DOF")))
    for k in range(30):
        block(Setpoint=0.5, ProcessValue=0.3 + 0.01 * k, Manual=False, ManualCommand=0.2)
    before = block.memory["Command"]
    assert block(Setpoint=0.5, ProcessValue=0.6, Manual=True, ManualCommand=1.1) == 1.1 != before
    assert block(Setpoint=0.5, ProcessValue=0.6, Manual=False) == pytest.approx(1.1)
    assert block(Setpoint=0.5, ProcessValue=0.6, Manual=True, ManualCommand=9.0) == 2.0  # a limit
    assert block(Setpoint=np.nan, ProcessValue=0.6, Manual=False) == 2.0  # held


def test_a_state_feedbacks_block_and_function_are_the_digital_one():
    rng = np.random.default_rng(0)
    reference, states = rng.uniform(-2, 2, 40), rng.uniform(-1, 1, (40, 2))
    states[7, 0], reference[9] = np.nan, np.inf
    right = STATES.run(reference, states, start=0.4)
    block, function = Block(state_feedback_block(STATES)), Function(state_feedback_script(STATES))
    block(Manual=True, ManualCommand=0.4)
    found = [block(Setpoint=r, X1=x[0], X2=x[1], Manual=False)
             for r, x in zip(reference, states, strict=True)]  # fmt: skip
    np.testing.assert_allclose(found, right, rtol=1e-12)
    found = [function(r, lambda i, x=x: x[i - 1], 0.4)
             for r, x in zip(reference, states, strict=True)]  # fmt: skip
    np.testing.assert_allclose(found, right, rtol=1e-12)


def test_structured_text_is_written_for_either_type(tmp_path):
    small = Gains({"kp": 1e-6, "Ti": 3.0, "Td": 0.2, "Tf": 0.1}, Ts=TS, controller="PIDF",
                  signals=("valve *) [%]", "level [m]"))  # fmt: skip
    for real, kind in (("double", "LREAL"), ("float", "REAL")):
        (path,) = export(small, "st", tmp_path / f"{kind}.st", limits=(0.0, 100.0), real=real)
        block = Block(path.read_text())
        assert set(block.names.values()) == {"BOOL", kind}
        assert block.memory["KP"] == pytest.approx(1e-6, rel=1e-6)
    (path,) = export((0.3, 0.2), "st", tmp_path / "pi.st", limits=(-1.0, 1.0), Ts=0.01)
    assert Block(path.read_text()).memory["STEP_GAIN"] == pytest.approx(0.3 * 0.01 / 0.2)
    several = Gains({"k1": 1.0, "kr": 2.0}, Ts=TS, controller=STATE_FEEDBACK)
    (path,) = export(several, "st", tmp_path / "x.st", limits=(-1.0, 1.0))
    assert Block(path.read_text())(Setpoint=0.1, X1=0.3, Manual=False) == pytest.approx(-0.1)


def test_a_block_needs_a_name_that_is_one():
    with pytest.raises(ValueError, match="name"):
        pid_block(digital("PI"), name="2 pid")
    assert "FUNCTION_BLOCK Heater" in pid_block(digital("PI"), name="Heater")
    assert isinstance(replace(digital("PI"), b=0.5), DigitalPID)
