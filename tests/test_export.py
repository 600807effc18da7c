import json
import re

import control
import numpy as np
import onnx
import onnxruntime
import pytest
from c_programs import compiled, passes
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import recorded
from scipy.signal import lfilter
from imports import modules_after

import tuners
from tuners.export import (
    DigitalPI,
    c_source,
    compressor_source,
    export,
    json_text,
    literals,
    matlab_script,
)  # fmt: skip
from tuners.export.control_models import pi_controller
from tuners.export.onnx_tuner import onnx_model
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForward, _Scaling
from tuners.tuner.baselines import Nominal
from tuners.tuner.coordinates import decode, encode
from tuners.tuner.stages import Stages
from tuners.tuner.two_stage import TwoStage
from yawrate_env.loop.design import Status
from yawrate_env.loop.target import CONTROLLERS, Target
from yawrate_env.vehicle.task import Experiment, Task

PI = DigitalPI(0.31, 0.22, 0.01, -0.3, 0.5)
KP, TI = st.floats(1e-3, 10.0), st.floats(1e-3, 100.0)


# The program's reference


@given(KP, TI, st.sampled_from([0.001, 0.01, 0.05]))
def test_between_the_limits_it_is_the_tustin_pi(kp, Ti, Ts):
    errors = np.random.default_rng(0).standard_normal(200)
    commands = DigitalPI(kp, Ti, Ts, -1e9, 1e9).run(errors)
    scale = np.abs(commands).max()
    b, a = DigitalPI(kp, Ti, Ts).difference_equation()
    np.testing.assert_allclose(commands, lfilter(b, a, errors), atol=1e-12 * scale)
    C = pi_controller(kp, Ti, Ts)
    expected = control.forced_response(C, inputs=errors).outputs
    np.testing.assert_allclose(commands, expected, atol=1e-9 * scale)


@given(st.floats(-1, 1), st.floats(-0.3, 0.5))
def test_the_start_is_bumpless(error, command):
    assert PI.run(np.array([error]), start=(error, command))[0] == pytest.approx(command, abs=1e-15)


def test_a_saturated_controller_comes_back_at_once():
    errors = np.concatenate([np.full(500, 2.0), np.full(5, -0.2)])
    commands = PI.run(errors)
    assert (commands[:500] == PI.high).all()
    assert commands[500] < PI.high  # without tracking it would stay there for 50 s
    wound_up = DigitalPI(PI.kp, PI.Ti, PI.Ts, -1e9, 1e9).run(errors)
    assert wound_up[-1] > 10 * PI.high


def test_a_missing_sample_holds_the_command():
    errors = np.array([0.1, np.nan, np.inf, 0.1])
    commands = PI.run(errors)
    assert commands[0] == commands[1] == commands[2]
    assert commands[3] == PI.run(errors[[0, 3]])[1]


# C


@pytest.mark.parametrize("real", ["double", "float"])
def test_the_pi_compiles_and_meets_its_golden_vectors(tmp_path, real):
    written = export((PI.kp, PI.Ti), "c", tmp_path / "new", limits=(PI.low, PI.high), real=real)
    assert [p.name for p in written] == ["yawrate_pi.h", "yawrate_pi.c", "yawrate_pi_test.c"]
    assert passes(tmp_path / "new", "yawrate_pi")


@settings(max_examples=5)
@given(KP, TI)
def test_other_gains_do_so_too(tmp_path_factory, kp, Ti):
    folder = tmp_path_factory.mktemp("pi")
    export((kp, Ti), "c", folder)
    assert passes(folder, "yawrate_pi")


def test_golden_vectors_reach_both_limits_and_see_a_wrong_controller(tmp_path):
    files = c_source(PI, name="lane_keeping")
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    golden = files["lane_keeping_test.c"]
    assert all(golden.count(repr(limit)) >= 10 for limit in (PI.low, PI.high))
    assert "NAN" in golden and "INFINITY" in golden
    assert passes(tmp_path, "lane_keeping")
    source = tmp_path / "lane_keeping.c"
    mistakes = {
        "STEP * error": "STEP",
        "TRACKING *": "0.9 * TRACKING *",
        "> HIGH": "> 0.9 * HIGH",
        "isfinite(error) != 0": "error < 1e9",
    }
    for right, wrong in mistakes.items():
        source.write_text(files["lane_keeping.c"].replace(right, wrong))
        assert source.read_text() != files["lane_keeping.c"]
        parts = "lane_keeping.c", "lane_keeping_test.c"
        assert compiled(tmp_path, *parts, flags=["-Wno-unused"]).returncode == 1


@pytest.mark.parametrize(
    "compressor", [Laguerre(8, 12.0), Laguerre(3, 5.0), FrequencyResponse(6, 9.0, points=4)]
)
@pytest.mark.parametrize("Ts", [0.001, 0.004])
def test_the_first_stage_in_c_computes_pythons_features(tmp_path, compressor, Ts):
    for name, text in compressor_source(compressor, Ts, name="lag").items():
        (tmp_path / name).write_text(text)
    assert passes(tmp_path, "lag")


@pytest.mark.parametrize("real", ["half", "long double"])
def test_other_numbers_are_refused(real):
    with pytest.raises(ValueError, match="real = "):
        c_source(PI, real=real)


@pytest.mark.parametrize("name", ["", "1pi", "a-b", "x" * 40])
def test_a_name_that_c_does_not_know_is_refused(name):
    with pytest.raises(ValueError, match="no C identifier"):
        c_source(PI, name=name)


# Documents


def test_json_gives_the_controller_in_every_form(tmp_path):
    (path,) = export((PI.kp, PI.Ti), "json", tmp_path / "pi.json", limits=(PI.low, PI.high))
    content = json.loads(path.read_text())
    assert (content["format"], content["version"]) == ("yawrate-controller", 1)
    z = np.exp(1j * np.linspace(0.01, 3.1, 50))
    expected = pi_controller(PI.kp, PI.Ti, PI.Ts)(z)
    equation, state = content["difference_equation"], content["state"]
    C = control.tf(equation["b"], equation["a"], content["Ts"])
    np.testing.assert_allclose(C(z), expected, rtol=1e-9)
    np.testing.assert_allclose(state["n1"] + state["step"] / (z - 1), expected, rtol=1e-12)
    assert content["parallel"]["Ki"] == content["standard"]["Kp"] / content["standard"]["Ti"]
    assert content["limits"] == [PI.low, PI.high]


def test_the_matlab_script_holds_the_same_numbers():
    script = matlab_script(PI)
    numbers = dict(re.findall(r"^(\w+) = ([-\d.e]+);", script, re.M))
    assert [float(numbers[n]) for n in ("kp", "Ti", "Ts")] == [PI.kp, PI.Ti, PI.Ts]
    assert [float(numbers[n]) for n in ("n1", "n0")] == [PI.gain, PI.step]
    b = [float(x) for x in re.search(r"^b = \[(.*)\];", script, re.M)[1].split(",")]
    assert b == PI.difference_equation()[0]
    assert "tf('z', Ts)" in script and not re.search(r"[$#]", script)


# ONNX


def run(model, **inputs):
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    return session.run(["kp", "Ti", "status"], inputs)


@pytest.mark.parametrize(("name", "rtol"), [("ts-ff-lag", 1e-6), ("ts-gbm-lag", 1e-4)])
def test_a_tuner_as_a_graph_gives_pythons_gains(tmp_path, name, rtol):
    tuner, recording = tuners.load(name), recorded(40)
    expected, _ = tuner.gains(recording)
    (path,) = export(tuner, "onnx", tmp_path / "tuner.onnx")
    kp, Ti, status = run(onnx.load(path), yaw_rate=recording.y)
    np.testing.assert_allclose(kp, expected.kp, rtol=rtol)
    np.testing.assert_allclose(Ti, expected.Ti, rtol=rtol)
    np.testing.assert_array_equal(status, expected.status)
    one = run(onnx.load(path), yaw_rate=recording.y[:1])
    np.testing.assert_allclose(one[0], expected.kp[:1], rtol=rtol)


def test_the_graph_from_features_serves_any_command(tmp_path):
    tuner = tuners.load("ts-ff-lag")
    other = recorded(10, Experiment(register="random"))
    features, _ = tuner.stages.compressor(other.u, other.y, other.Ts)
    (path,) = export(tuner, "onnx", tmp_path / "tuner.onnx", features=True)
    kp, Ti, _ = run(onnx.load(path), features=features)
    expected, _ = tuner.gains(other)
    np.testing.assert_allclose([kp, Ti], [expected.kp, expected.Ti], rtol=1e-6)
    export(tuner, "c", tmp_path, features=True)
    assert passes(tmp_path, "yawrate_laguerre")


class Echo(FeedForward):
    """A network whose hidden layer is so small that it is linear: it gives back its input."""

    def __init__(self, n):
        eye = np.eye(2, n)
        scaling = [_Scaling(np.zeros(k), np.ones(k)) for k in (n, 2)]
        super().__init__(1e-9 * eye, np.zeros(2), 1e9 * np.eye(2), np.zeros(2), *scaling)


@pytest.mark.parametrize("form", CONTROLLERS)
@pytest.mark.parametrize("coordinates", ["loop", "gains"])
def test_every_status_is_decoded_as_in_python(form, coordinates):
    task = Task(target=Target(controller=form))
    tuner = TwoStage(task, Stages(Laguerre(order=2), Echo(2)), coordinates, {})
    values = np.array([[-1.0, -0.4], [-1.0, 0.0], [0.5, 0.3], [0.5, -1.6], [0.2, 0.3]])
    expected = decode(values, task.target, coordinates)
    kp, Ti, status = run(onnx_model(tuner, features=True), features=values)
    np.testing.assert_allclose(kp, expected.kp, rtol=1e-7)
    np.testing.assert_allclose(Ti, expected.Ti, rtol=1e-7)
    assert status.tolist() == expected.status.tolist()
    assert {Status.OK, Status.UNREACHABLE} <= set(status.tolist())
    back = encode(kp[:1], Ti[:1], task.target, coordinates)
    if coordinates == "loop":
        np.testing.assert_allclose(back, values[:1], rtol=1e-7)


@pytest.mark.parametrize("name", ["ts-ff", "ts-gbm", "gb", "nominal"])
@pytest.mark.parametrize("target", ["onnx", "c"])
def test_other_tuners_are_refused_with_what_can_be_exported(tmp_path, name, target):
    with pytest.raises(ValueError, match="is not exported.* Export ts-ff-lag or ts-gbm-lag"):
        export(tuners.load(name), target, tmp_path / "x")
    assert not list(tmp_path.iterdir())


def test_misuse_is_refused_before_anything_is_written(tmp_path):
    path = tmp_path / "x"
    for source, target, message in [
        ((0.3, 0.2), "rust", "target = 'rust'"),
        ((0.3, -0.2), "json", "Ti = -0.2"),
        ((np.nan, 0.2), "c", "kp = nan"),
        ((0.3, 0.2, 0.1), "c", "holds no gains"),
        (Nominal(Task()), "json", "Tune a recording first"),
        ((0.3, 0.2), "onnx", "target onnx needs a tuner"),
        ((None, 0.2), "json", "kp = None is not a number"),
        ((1e39, 0.2), "matlab", r"abs\(gain\) = 1.025e\+39 must be"),
        ((1e-36, 1e3), "c", r"abs\(step\) = 1e-41 must be"),
    ]:
        with pytest.raises(ValueError, match=message):
            export(source, target, path)
    with pytest.raises(ValueError, match=r"limits = \[0, -1\] must have low below 0"):
        export((0.3, 0.2), "c", path, limits=(0.0, -1.0))
    for wrong in ((-1.0, 1.0, 2.0), (-1.0,), 3.0, (0.1, 0.2), (-1e-60, 1.0)):
        with pytest.raises(ValueError, match=r"limits|low"):
            export((0.3, 0.2), "json", path, limits=wrong)
    with pytest.raises(ValueError, match="Ts = 1001 must be .* at most 1000"):
        export((0.3, 0.2), "json", path, Ts=1001.0)
    with pytest.raises(ValueError, match="real = 'half'"):
        export((0.3, 0.2), "json", path, real="half")
    tuner = TwoStage(Task(), Stages(Laguerre(order=2), Echo(3)), "loop", {})
    with pytest.raises(ValueError, match="has 3 features, 2 of them"):
        export(tuner, "onnx", path)
    random = Task(experiment=Experiment(register="random"))
    tuner = TwoStage(random, Stages(Laguerre(order=2), Echo(2)), "loop", {})
    with pytest.raises(ValueError, match="features=True"):
        export(tuner, "onnx", path)
    assert not list(tmp_path.iterdir())


def test_a_file_is_not_taken_for_cs_folder(tmp_path):
    (tmp_path / "x").write_text("mine")
    with pytest.raises(ValueError, match="x is a file, and target c writes several"):
        export((0.3, 0.2), "c", tmp_path / "x")
    assert (tmp_path / "x").read_text() == "mine"


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e39])
def test_constants_of_a_program_are_finite(value):
    with pytest.raises(ValueError, match="is no finite float"):
        literals.number(value, "float")


def test_a_tuning_result_is_exported_as_it_is(tmp_path):
    recording = recorded(1)
    result = tuners.load("nominal").tune(recording.u[0], recording.y[0], recording.Ts)
    (path,) = export(result, "json", tmp_path / "pi.json")
    assert json.loads(path.read_text()) == json.loads(
        json_text(DigitalPI(result.kp, result.Ti, 0.01))
    )


def test_exporting_gains_needs_nothing_heavy(tmp_path):
    path = str(tmp_path / "pi.json")
    program = f"from tuners.export import export; export((0.3, 0.2), 'json', {path!r})"
    assert not modules_after(program) & {"onnx", "control", "xgboost", "torch", "safetensors"}
