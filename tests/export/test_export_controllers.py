"""Gains as a controller: its reference in Python, C, MATLAB, JSON, and the command."""

import json
import re
from functools import cache

import control
import numpy as np
import pytest
from c_programs import notices, passes, written
from exported import dc_motor, one, trained
from first_order import TS
from hypothesis import given, settings
from hypothesis import strategies as st
from imports import modules_after
from scipy.signal import lfilter

import tuners
from tuners.export import (
    DigitalPI,
    Gains,
    export,
    json_text,
    literals,
    matlab_script,
    pi_program,
)
from tuners.tuner.rivals import Nominal
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PI = DigitalPI(0.31, 0.22, 0.01, -0.3, 0.5)
KP, TI = st.floats(1e-3, 10.0), st.floats(1e-3, 100.0)
VEHICLE = yaw_rate(Task())
UNLIMITED = {"low": -1e9, "high": 1e9}


@cache
def result(case):
    return one(trained(case))


# The reference


@given(KP, TI, st.sampled_from([0.001, 0.01, 0.05]))
@settings(max_examples=40)
def test_between_the_limits_it_is_the_tustin_pi(kp, Ti, Ts):
    errors = np.random.default_rng(0).standard_normal(200)
    pi = DigitalPI(kp, Ti, Ts, **UNLIMITED)
    commands = pi.run(errors)
    scale = np.abs(commands).max()
    np.testing.assert_allclose(
        commands, lfilter(*pi.difference_equation(), errors), atol=1e-12 * scale
    )
    C = control.sample_system(control.tf([kp * Ti, kp], [Ti, 0]), Ts, "tustin")
    right = control.forced_response(C, inputs=errors).outputs
    np.testing.assert_allclose(commands, right, atol=1e-9 * scale)


@given(st.floats(-1, 1), st.floats(-0.3, 0.5))
def test_the_start_is_bumpless(error, command):
    assert PI.run(np.array([error]), start=(error, command))[0] == pytest.approx(command, abs=1e-15)


def test_a_saturated_controller_comes_back_at_once():
    errors = np.concatenate([np.full(500, 2.0), np.full(5, -0.2)])
    commands = PI.run(errors)
    assert (commands[:500] == PI.high).all()
    assert commands[500] < PI.high  # without tracking it would stay there for 50 s
    wound_up = DigitalPI(PI.kp, PI.Ti, PI.Ts, **UNLIMITED).run(errors)
    assert wound_up[-1] > 10 * PI.high


def test_a_missing_sample_holds_the_command():
    errors = np.array([0.1, np.nan, np.inf, 0.1])
    commands = PI.run(errors)
    assert commands[0] == commands[1] == commands[2]
    assert commands[3] == PI.run(errors[[0, 3]])[1]


SPIKES = st.floats(allow_nan=False, allow_infinity=False)


@given(SPIKES, st.integers(0, 300), st.floats(-0.5, 0.5))
@settings(max_examples=60)
def test_no_single_error_takes_the_controller_to_the_opposite_limit(spike, after, before):
    """What follows is as without the spike, or nearer to its own limit."""
    errors = np.full(after + 400, 0.0)
    errors[:after] = 0.1 * before
    with_spike = np.insert(errors, after, spike)
    plain, hit = PI.run(errors)[after:], PI.run(with_spike)[after + 1 :]
    assert np.isfinite(hit).all()
    towards = np.sign(spike) * (hit - plain)
    assert (towards >= -1e-9).all()
    assert (np.abs(hit) <= max(abs(PI.low), PI.high)).all()


def test_an_absurd_error_leaves_no_trace_but_the_limit():
    """A step of 1.7e308 and zeros: the limit, and then what an error of that size may add."""
    pi = DigitalPI(10.0, 1.0, 0.01, -1.0, 1.0)
    commands = pi.run(np.array([1.7e308, *np.zeros(5), -1e6, *np.zeros(5)]))
    assert commands[0] == pi.high and commands[6] == pi.low
    assert (np.abs(commands[[1, 2, 3, 4, 5, 7, 8, 9]]) < pi.high).all()


# C


@pytest.mark.parametrize(
    "kp, Ti, real",
    [(PI.kp, PI.Ti, "float"), (1e-3, 100.0, "double"), (10.0, 1e-3, "double")],
)
def test_the_pi_compiles_and_meets_its_golden_vectors(tmp_path, kp, Ti, real):
    limits = (PI.low, PI.high)
    paths = export((kp, Ti), "c", tmp_path / "new", Ts=0.01, limits=limits, real=real)
    assert [p.name for p in paths] == ["yawrate_pi.h", "yawrate_pi.c", "yawrate_pi_test.c"]
    assert passes(tmp_path / "new", "yawrate_pi")


def test_golden_vectors_reach_both_limits_and_notice_a_wrong_controller(tmp_path):
    files = pi_program(PI, name="lane_keeping")
    golden = files["lane_keeping_test.c"]
    assert all(golden.count(repr(limit)) >= 10 for limit in (PI.low, PI.high))
    assert "NAN" in golden and "INFINITY" in golden
    assert passes(written(tmp_path, files), "lane_keeping")
    mistakes = {
        "STEP * counted": "STEP",
        "TRACKING *": "0.9 * TRACKING *",
        "unlimited, LOW, HIGH": "unlimited, LOW, 0.9 * HIGH",
        "(before < HIGH) ? before : HIGH": "LOW",
        "isfinite(error) != 0": "error < 1e9",
    }
    assert notices(tmp_path, "lane_keeping.c", mistakes, "lane_keeping")


def test_other_numbers_and_names_are_refused(tmp_path):
    for real in ("half", "long double"):
        with pytest.raises(ValueError, match="real = "):
            export((0.3, 0.2), "json", tmp_path / "x", real=real)
    for name in ("", "1pi", "a-b", "x" * 40):
        with pytest.raises(ValueError, match="name = "):
            pi_program(PI, name=name)
    for value in (np.nan, np.inf, 1e39):
        with pytest.raises(ValueError, match="float"):
            literals.number(value, "float")


# Documents


def test_json_gives_the_controller_in_every_form():
    content = json.loads(json_text(PI))
    assert (content["format"], content["version"]) == ("yawrate-controller", 1)
    z = np.exp(1j * np.linspace(0.01, 3.1, 50))
    right = PI.kp * (1 + PI.Ts / (2 * PI.Ti) * (z + 1) / (z - 1))
    equation, state = content["difference_equation"], content["state"]
    C = control.tf(equation["b"], equation["a"], content["Ts"])
    np.testing.assert_allclose(C(z), right, rtol=1e-9)
    np.testing.assert_allclose(state["n1"] + state["step"] / (z - 1), right, rtol=1e-12)
    assert content["parallel"]["Ki"] == content["standard"]["Kp"] / content["standard"]["Ti"]
    assert content["limits"] == [PI.low, PI.high]


def test_the_matlab_script_holds_the_same_numbers():
    script = matlab_script(PI)
    numbers = dict(re.findall(r"^(\w+) = ([-\d.e]+);", script, re.M))
    assert [float(numbers[n]) for n in ("kp", "Ti", "Ts")] == [PI.kp, PI.Ti, PI.Ts]
    assert [float(numbers[n]) for n in ("n1", "n0")] == [PI.gain, PI.step]
    b = [float(x) for x in re.search(r"^b = \[(.*)\];", script, re.M)[1].split(",")]
    assert b == PI.difference_equation()[0]
    assert "tf('z', Ts)" in script and not re.search(r"[{}#]", script)


def test_gains_of_a_pi_are_a_controller_in_the_plants_units(tmp_path):
    motor = result("loop")
    (path,) = export(motor, "json", tmp_path / "pi.json", limits=(-12.0, 12.0))
    content = json.loads(path.read_text())
    assert (content["Ts"], content["limits"]) == (dc_motor.target.Ts, [-12.0, 12.0])
    assert [content["units"][x] for x in ("u", "e", "kp", "Ti")] == [
        "V", "rad/s", "(V)/(rad/s)", "s",
    ]  # fmt: skip
    assert {name: content[name] for name in motor.gains} == motor.gains
    export(motor, "c", tmp_path / "pi", limits=(0.0, 12.0))  # a command need not change its sign
    assert passes(tmp_path / "pi", "yawrate_pi")
    header = (tmp_path / "pi" / "yawrate_pi.h").read_text()
    assert "last command [V]" in header and "measured speed [rad/s]" in header
    export(motor, "matlab", tmp_path / "pi.m", limits=(-12.0, 12.0))
    script = (tmp_path / "pi.m").read_text()
    assert "Out: voltage [V]." in script and "limits = [-12.0, 12.0];  % [V]" in script
    assert Gains.of(result("logarithms")).pi(limits=(0.0, 100.0)).Ts == TS


def test_json_is_always_possible(tmp_path):
    (path,) = export(result("measured"), "json", tmp_path / "gains.json")
    content = json.loads(path.read_text())
    assert (content["format"], content["version"]) == ("yawrate-gains", 1)
    assert content["gains"] == result("measured").gains
    assert content["trusted"] is result("measured").trusted
    assert content["signals"] == {"input": "u", "output": "y"} and content["target"] is None
    export(Gains({"kp": np.nan, "Ti": np.nan}), "json", path)
    assert json.loads(path.read_text())["gains"] == {"kp": None, "Ti": None}
    export(Gains({"kp": 1.0, "Ti": 1.0}, target=Target(controller="printed")), "json", path)
    assert json.loads(path.read_text())["target"]["controller"] == "printed"
    export(result("loop"), "json", path)
    assert json.loads(path.read_text())["target"]["crossover"] == dc_motor.target.crossover


# Refusals


def refusals():
    """Source, target, options and the argument that the message names."""
    printed = Gains({"kp": 1.0, "Ti": 1.0}, Ts=0.01, target=Target(controller="printed"))
    pair, vehicle, box = (0.3, 0.2), {"plant": VEHICLE}, {"limits": (-1.0, 1.0)}
    yield pair, "rust", {}, "target = 'rust'"
    yield (0.3, -0.2), "matlab", vehicle, "Ti = -0.2"
    yield (np.nan, 0.2), "c", vehicle, "kp = nan"
    yield (0.3, 0.2, 0.1), "c", vehicle, "source"
    yield tuners.Tuner(VEHICLE, Nominal()), "json", {}, "source"
    yield pair, "onnx", {}, "source"
    yield pair, "c", box, "Ts"
    yield pair, "c", {"Ts": 0.01}, "limits"
    yield (1e39, 0.2), "matlab", vehicle, r"abs\(gain\)"
    yield (1e-36, 1e3), "c", vehicle, r"abs\(step\)"
    yield pair, "json", vehicle | {"Ts": 1001.0}, "Ts = 1001"
    yield Gains({"K": 1.0}), "json", {"Ts": "fast"}, "Ts = "
    for limits in ((0.0, -1.0), (-1.0, 1.0, 2.0), 3.0, (0.1, 0.2), (-1e-60, 1.0)):
        yield pair, "json", vehicle | {"limits": limits}, "limits|low"
    for target in ("c", "matlab"):
        yield result("measured"), target, box, "gains Kc, Ti, Td.*target json"
        yield printed, target, box, "'printed'.*target json"
        yield result("loop"), target, {}, r"limits of voltage \[V\].*--limits.*target json"
        yield result("loop"), target, {"limits": (2.0, 1.0)}, r"limits = .* in V\."
        yield result("loop"), target, {"limits": ("a", 1.0)}, "low = 'a'"


def test_misuse_is_refused_before_anything_is_written(tmp_path):
    for source, target, options, message in refusals():
        with pytest.raises(ValueError, match=message):
            export(source, target, tmp_path / "x", **options)
    assert not list(tmp_path.iterdir())


def test_files_in_the_way_are_kept(tmp_path):
    (tmp_path / "x").write_text("mine")
    with pytest.raises(ValueError, match="x is a file"):
        export((0.3, 0.2), "c", tmp_path / "x", plant=VEHICLE)
    assert (tmp_path / "x").read_text() == "mine"
    (tmp_path / "pi" / "yawrate_pi_test.c").mkdir(parents=True)
    with pytest.raises(ValueError, match="yawrate_pi_test.c"):
        export((0.3, 0.2), "c", tmp_path / "pi", plant=VEHICLE)
    assert [path.name for path in (tmp_path / "pi").iterdir()] == ["yawrate_pi_test.c"]


def test_exporting_gains_needs_nothing_heavy(tmp_path):
    path = str(tmp_path / "pi.json")
    program = f"from tuners.export import export; export((0.3, 0.2), 'json', {path!r})"
    heavy = {"jinja2", "onnx", "control", "xgboost", "torch", "safetensors"}
    assert not modules_after(f"import tuners.pidtune; {program}") & heavy
