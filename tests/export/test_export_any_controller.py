"""Controllers beyond a PI as programs: reference in Python, C, JSON, vendors' forms."""

import json
from dataclasses import replace

import control
import numpy as np
import pytest
from c_programs import notices, passes, written
from controller_values import TS, VALUES
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from tuners.export import DigitalPID, Gains, export, pid_program
from tuners.export.digital_state_feedback import DigitalStateFeedback
from tuners.export.forms import vendors_forms
from tuners.export.pid_program import golden_signals, state_feedback_program
from yawrate_env.loop.controllers import CONTROLLERS

UNLIMITED = (-1e9, 1e9)


def gains(name):
    values = {gain: VALUES[gain] for gain in CONTROLLERS[name].gains}
    return Gains(values, Ts=TS, controller=name)


def digital(name, limits=(-1.0, 2.0)):
    return gains(name).pid(limits=limits)


PIDF = digital("PIDF")


@pytest.mark.parametrize("name", CONTROLLERS)
def test_between_the_limits_it_is_the_compensator_of_the_loops(name):
    of = CONTROLLERS[name]
    row = np.array([[VALUES[gain] for gain in of.gains]])
    made = of.parallel(row, TS).compensator(TS)
    rng = np.random.default_rng(0)
    r, y = rng.standard_normal((2, 200))
    r[0] = y[0] = 0.0

    def in_z(delta):  # coefficients in powers of delta to those of z^-1
        total = np.poly1d([0.0])
        for c in delta:
            total = total * np.poly1d([1 / TS, -1 / TS]) + c
        return np.concatenate([np.zeros(len(delta) - len(total.coeffs)), total.coeffs])

    top_r, top_y, bottom = (in_z(p[0]) for p in (made.reference, made.output, made.denominator))
    expected = lfilter(top_r, bottom, r) - lfilter(top_y, bottom, y)
    found = digital(name, UNLIMITED).run(r, y, start=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_a_pidf_is_python_controls_tustin():
    s = control.tf("s")
    C = 1.3 * (1 + 1 / (2.1 * s) + 0.4 * s / (1 + 0.1 * s))
    e = np.random.default_rng(1).standard_normal(150)
    e[0] = 0.0
    right = control.forced_response(control.sample_system(C, TS, "tustin"), inputs=e).outputs
    found = digital("PIDF", UNLIMITED).run(e, 0 * e, start=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(found, right, atol=1e-9 * np.abs(right).max())


@pytest.mark.parametrize("name", CONTROLLERS)
@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-1.0, 2.0))
@settings(max_examples=15)
def test_the_start_is_bumpless(name, reference, measured, command):
    one = np.array([reference]), np.array([measured])
    found = digital(name).run(*one, start=(reference, measured, command))
    assert found[0] == pytest.approx(command, abs=1e-12)


@pytest.mark.parametrize("name", ["PID", "PIDF", "PI-D", "2DOF", "I"])
def test_a_saturated_controller_comes_back_at_once(name):
    """Ten integral times at the limit, then the error turns: the command leaves it in one."""
    reference = np.concatenate([np.full(500, 40.0), np.full(60, 40.0)])
    measured = np.concatenate([np.zeros(500), np.full(60, 42.0)])
    found = digital(name).run(reference, measured, start=(0.0, 0.0, 0.0))
    assert (found[100:500] == 2.0).all()
    assert (found[505:520] < 2.0).all()
    wound_up = digital(name, UNLIMITED).run(reference, measured, start=(0.0, 0.0, 0.0))
    assert wound_up[-1] > 20.0


def test_a_setpoint_weight_leaves_the_integral_free_to_balance_it():
    """b and c 0.4 and 0: a large steady reference is no windup, and none is taken for one."""
    pid = digital("2DOF")
    found = pid.run(np.full(50, 300.0), np.full(50, 300.0), start=(300.0, 300.0, 0.7))
    np.testing.assert_allclose(found, 0.7, atol=1e-9)


SIGNALS = st.floats(allow_nan=True, allow_infinity=True)


@given(SIGNALS, SIGNALS, st.integers(1, 100))
@settings(max_examples=60)
def test_whatever_comes_the_command_is_within_limits_and_recovers(reference, measured, at):
    r, y = np.full(at + 600, 0.5), np.full(at + 600, 0.4)
    r[at], y[at] = reference, measured
    for name in ("PIDF", "2DOF"):
        found = digital(name).run(r, y, start=(0.5, 0.4, 0.3))
        assert ((found >= -1.0) & (found <= 2.0)).all()
        pid = digital(name)
        plain = pid.run(r[:at], y[:at], start=(0.5, 0.4, 0.3))
        np.testing.assert_array_equal(found[:at], plain)
        slope = pid.step * 0.1
        assert found[-1] == 2.0 or found[-1] - found[-2] == pytest.approx(slope, rel=1e-6)


# C


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("name", ["PIDF", "2DOF"])
def test_programs_meet_their_golden_vectors(tmp_path, name, real):
    paths = export(gains(name), "c", tmp_path / "new", limits=(-1.0, 2.0), real=real)
    assert [p.name for p in paths] == ["yawrate_pid.h", "yawrate_pid.c", "yawrate_pid_test.c"]
    assert passes(tmp_path / "new", "yawrate_pid")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["P", "I", "PD", "PDF", "PID", "PI-D", "lead-lag"])
def test_programs_of_every_kind_meet_their_golden_vectors(tmp_path, name):
    export(gains(name), "c", tmp_path / "new", limits=(-1.0, 2.0))
    assert passes(tmp_path / "new", "yawrate_pid")


def test_golden_vectors_notice_a_wrong_controller(tmp_path):
    pid = digital("2DOF")
    reference, measured, start = golden_signals(pid)
    commands = pid.run(reference, measured, start=start)
    assert min((commands == pid.low).sum(), (commands == pid.high).sum()) >= 10
    assert passes(written(tmp_path, pid_program(pid)), "yawrate_pid")
    mistakes = {
        "STEP * error": "STEP",
        "TRACKING *": "0.9 * TRACKING *",
        "DECAY *": "0.9 * DECAY *",
        "RATE * change": "RATE * error",
        "REST * reference": "reference",
        "state->output + (KP": "state->output - (KP",
        "isfinite(measured) != 0": "measured < 1e9",
    }
    assert notices(tmp_path, "yawrate_pid.c", mistakes, "yawrate_pid")


@pytest.mark.parametrize("real", ["double", "float"])
def test_a_state_feedback_of_negative_gains_compiles(tmp_path, real):
    of = DigitalStateFeedback({"k1": -3.2, "k2": 0.7}, -3.2, TS, -1.0, 2.0)
    assert passes(written(tmp_path, state_feedback_program(of, real=real)),
                  "yawrate_state_feedback")  # fmt: skip
    assert notices(tmp_path, "yawrate_state_feedback.c", {"unlimited -=": "unlimited +="},
                   "yawrate_state_feedback")  # fmt: skip
    r, x = np.array([0.1, 0.1, np.nan, 5.0]), np.array([[0.0, 0], [0.1, 0.2], [0, 0], [0, 0]])
    np.testing.assert_allclose(of.run(r, x), [-0.32, -0.14, -0.14, -1.0])


# JSON and forms


def test_json_has_the_program_and_every_form(tmp_path):
    (path,) = export(gains("PIDF"), "json", tmp_path / "pid.json", limits=(-1.0, 2.0))
    content = json.loads(path.read_text())
    assert (content["format"], content["controller"]) == ("yawrate-controller", "PIDF")
    assert content["gains"] == dict(gains("PIDF").values) and content["limits"] == [-1.0, 2.0]
    state = content["state"]
    assert (state["h"], state["s"], state["a"], state["g"]) == (
        PIDF.half, PIDF.step, PIDF.decay, PIDF.rate,
    )  # fmt: skip
    without = json.loads(export(gains("lead-lag"), "json", tmp_path / "l.json")[0].read_text())
    assert without["controller"] == "lead-lag" and set(without["forms"]) == {"parallel"}


@given(st.floats(0.01, 100.0), st.floats(0.1, 100.0), st.floats(0.01, 0.25))
@settings(max_examples=30)
def test_every_form_is_the_same_controller(kp, Ti, share):
    forms = vendors_forms("PID", {"kp": kp, "Ti": Ti, "Td": share * Ti}, TS)
    s = 1j * np.geomspace(0.01, 100, 7)
    of = forms["parallel"]
    expected = of["Kp"] + of["Ki"] / s + of["Kd"] * s
    of = forms["standard"]
    np.testing.assert_allclose(of["Kc"] * (1 + 1 / (of["tau_I"] * s) + of["tau_D"] * s), expected)
    of = forms["series"]
    found = of["Kc"] * (1 + 1 / (of["tau_I"] * s)) * (1 + of["tau_D"] * s)
    np.testing.assert_allclose(found, expected, rtol=1e-7)
    of = forms["proportional band"]
    found = (
        100 / of["PB_percent"] * (1 + 1 / (60 * of["minutes"] * s) + 60 * of["rate_minutes"] * s)
    )
    np.testing.assert_allclose(found, expected)


def test_complex_zeros_have_no_series_form():
    assert "series" not in vendors_forms("PID", {"kp": 1.0, "Ti": 1.0, "Td": 0.5}, TS)
    assert vendors_forms("PID", {"kp": np.nan, "Ti": 1.0, "Td": 0.5}, TS) == {}


@pytest.mark.parametrize("changes, name", [
    ({"Tf": 0.02}, "Tf = 0.02"),
    ({"Kp": -1.0}, "Kp = -1"),
    ({"Kp": 0.0, "Ki": 0.0}, "Kp"),
    ({"Kd": np.inf}, "Kd"),
    ({"low": 3.0}, "limits"),
    ({"Ts": 0.0}, "Ts"),
    ({"Kd": 1e39}, "abs"),
])  # fmt: skip
def test_wrong_controllers_are_named(changes, name):
    with pytest.raises(ValueError, match=name):
        replace(PIDF, **changes)


def test_what_cannot_be_written_is_refused(tmp_path):
    for target in ("c", "matlab", "st"):
        with pytest.raises(ValueError, match="limits"):
            export(gains("PIDF"), target, tmp_path / "x")
    with pytest.raises(ValueError, match="Td = nan"):
        none = Gains({"kp": 1.0, "Ti": 1.0, "Td": np.nan}, Ts=TS, controller="PID")
        export(none, "c", tmp_path / "x", limits=(-1.0, 2.0))
    assert not list(tmp_path.iterdir())
    assert isinstance(PIDF, DigitalPID)


@pytest.mark.parametrize("target", ["c", "json"])
def test_a_controller_that_nobody_knows_is_refused(target, tmp_path):
    unknown = Gains({"kp": 1.0, "Ti": 2.0}, Ts=TS, controller="my own")
    with pytest.raises(ValueError, match="my own"):
        export(unknown, target, tmp_path / "of", limits=(-1.0, 1.0))
    assert not (tmp_path / "of").exists()
