"""The yawrate command as a user calls it: answers, exit statuses, and never a traceback."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from answers import answer
from drives import drive
from click.testing import CliRunner
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from recordings import ROOT
from test_imports import modules_after

import tuners
from tuners import data
from tuners.catalogue import shipped
from tuners.cli import COMMANDS, main
from tuners.export.forms import Forms
from tuners.features import compressor
from tuners.learners.feedforward import FeedForwardSettings
from tuners.tuner.stages import Recipe
from yawrate_env.loop.target import Target
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.vehicle_file import example as paper

EXAMPLE = ROOT / "examples" / "log.csv"
UNUSABLE, WRONG, UNTRUSTED = 1, 2, 3


def call(*arguments):
    """Exit status, stdout, stderr; what is not an exit is a traceback, and raised."""
    done = CliRunner().invoke(main, list(map(str, arguments)), catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


def refused(status, *arguments):
    """The one line that a refusal is."""
    code, out, err = call(*arguments)
    assert code == status, (code, out, err)
    assert out == "" and re.fullmatch(r"error: [^\n]+\n", err), (out, err)
    return err


@pytest.fixture
def answering(monkeypatch):
    """Let every tuner give one answer."""

    class Stub:
        def __init__(self, trusted, fitted):
            self.result, _, self.task = answer(trusted, fitted)

        def tune(self, u, y, Ts, v_x=None, start="auto"):
            return self.result

    def use(trusted=True, fitted=True):
        monkeypatch.setattr(tuners, "load", lambda name: Stub(trusted, fitted))

    return use


@pytest.mark.parametrize("trusted, status", [(True, 0), (False, UNTRUSTED)])
def test_json_has_everything(answering, trusted, status):
    answering(trusted)
    code, out, err = call("tune", EXAMPLE, "--json", "--tuner", "gb")
    assert code == status and err == ""
    found = json.loads(out)
    result, _, _ = answer(trusted)
    assert (found["kp"], found["Ti"], found["trusted"]) == (result.kp, result.Ti, trusted)
    assert found["phase_margin"] == {"value": 60.02, "low": 59.81, "high": 60.22}
    assert found["reasons"] == list(result.reasons)
    assert found["fallback"] == {"kp": 0.2, "Ti": 0.31}
    assert [check["passed"] for check in found["checks"]] == [trusted, True]
    assert found["fit"]["mu_s"] == 0.8 and found["log"]["Ts"] == 0.01


def test_json_has_no_numbers_that_json_has_not(answering, monkeypatch):
    answering(fitted=False)
    result, log, task = answer(fitted=False)
    from tuners.cli.answer import as_json
    from tuners.tuner.result import Interval

    object.__setattr__(result, "phase_margin", Interval(np.nan, -np.inf, np.inf))
    found = json.loads(json.dumps(as_json(result, log, task, "gb"), allow_nan=False))
    assert found["phase_margin"] == {"value": None, "low": None, "high": None}
    assert found["fit"] is None


@pytest.mark.parametrize("trusted", [True, False])
def test_words_have_gains_margins_and_reasons(answering, trusted):
    answering(trusted)
    _, out, _ = call("tune", EXAMPLE, "--tuner", "gb")
    assert "kp            0.1506 s" in out
    margins = "phase margin  60.02 deg, between 59.81 and 60.22 (90 %)"
    equation = "10 ms: u[k] = u[k-1] + 0.157828 e[k] - 0.143389 e[k-1]"
    assert (margins in out) == (equation in out) == trusted
    if trusted:
        assert "Trusted: every check passed." in out
    else:
        assert "NOT TRUSTED\n  - The residual is not white" in out
        assert "kp 0.2 s, Ti 0.31 s" in out


@pytest.mark.parametrize("controller", ["pi", "printed"])
def test_the_difference_equation_is_the_controller(controller):
    """Against the response of the loop's own controller, at one frequency."""
    import control

    target = Target(controller=controller)
    forms = Forms.of(0.3, 0.2, target)
    z = np.exp(1j * 0.1)
    found = (forms.b0 * z + forms.b1) / (z + forms.a1)
    C = control.tf([0.2 * 0.3, 0.3], [0.2, 0]) if controller == "pi" else control.tf(0.3, [0.2, 1])
    assert found == pytest.approx(complex(control.sample_system(C, target.Ts, "tustin")(z)))
    assert f"{forms.b0:.6g} e[k]" in forms.equation


def test_a_report_is_written(answering, tmp_path):
    answering()
    code, _, err = call("tune", EXAMPLE, "--tuner", "gb", "--report", tmp_path / "out.html")
    assert code == 0 and err == ""
    assert "Yaw-rate controller from log.csv" in (tmp_path / "out.html").read_text()


# The other commands


def test_the_answer_is_there_even_if_the_report_cannot_be_written(answering, monkeypatch, tmp_path):
    def full(*_):
        raise OSError(28, "No space left on device", "out.html")

    answering()
    monkeypatch.setattr("tuners.cli.report.write_report", full)
    code, out, err = call("tune", EXAMPLE, "--report", tmp_path / "out.html")
    assert code == UNUSABLE and "kp            0.1506 s" in out
    assert err == "error: [Errno 28] No space left on device: 'out.html'\n"


def test_a_vehicles_file_is_written_once(tmp_path):
    path = tmp_path / "car.toml"
    code, out, _ = call("init", "-o", path)
    assert code == 0 and path.read_text() == paper() and f"--vehicle {path}" in out
    assert "exists" in refused(WRONG, "init", "-o", path)
    assert call("init", "-o", path, "--force")[0] == 0


def test_the_signal_to_drive_is_the_experiments(tmp_path):
    (tmp_path / "car.toml").write_text(paper().replace("N = 10_000", "N = 2_000"))
    code, out, _ = call(
        "excite", "--vehicle", tmp_path / "car.toml", "-o", tmp_path / "prbs.csv"
    )  # fmt: skip
    assert code == 0 and "2 s of steering, ±1 deg" in out
    t, u = np.loadtxt(tmp_path / "prbs.csv", delimiter=",", skiprows=1).T
    np.testing.assert_allclose(t, 0.001 * np.arange(2000), atol=1e-9)
    np.testing.assert_allclose(u, prbs(2000, 0.001, 0.1, np.radians(1.0))[0], rtol=1e-8)


@pytest.fixture
def quick(monkeypatch):
    """Less calibration and validation than `yawrate train` has."""
    monkeypatch.setattr("tuners.cli.train.CALIBRATION", 300)
    monkeypatch.setattr("tuners.cli.train.VALIDATION", 60)


def short(path, J_z):
    """A vehicle's file, with short episodes."""
    text = paper().replace("N = 10_000", "N = 1_000").replace("Ts = 0.001", "Ts = 0.01")
    path.write_text(text.replace("J_z = 2400.0", f"J_z = {J_z}"))
    return path


def test_a_tuner_is_trained_for_a_vehicle(tmp_path, quick):
    car = short(tmp_path / "car.toml", 2600.0)
    made = ("--vehicle", car, "-o", tmp_path / "car.tuner", "--episodes", 60)
    code, out, err = call("train", *made)
    assert code == 0 and "training" in err
    assert re.search(r"phase margin [\d.e-]+ deg rms \(bound [\d.]+\), crossover .* 0 of 60", out)
    tuner = tuners.load(tmp_path / "car.tuner")
    assert tuner.task.vehicle.J_z == 2600 and tuner.training["name"] == "ts-ff-lag-vx"


@pytest.mark.parametrize("stage, name", [("response", "ts-ff-lag-vx"), ("laguerre", "custom")])
def test_a_tuner_is_trained_from_a_data_set(stage, name, tmp_path, quick, monkeypatch):
    recipe = Recipe(compressor(stage), FeedForwardSettings(neurons=3, epochs=5))
    monkeypatch.setattr("tuners.cli.train.LEARNER", recipe.learner)
    car, other = short(tmp_path / "car.toml", 2600.0), short(tmp_path / "other.toml", 2500.0)
    made = ("--vehicle", car, "--compressor", stage, "--workers", 1, "--raw", "--episodes", 200)
    assert call("dataset", "--out", tmp_path / "set", *made)[0] == 0
    train = ("train", "--data", tmp_path / "set", "-o", tmp_path / "car.tuner")
    code, out, err = call(*train)
    assert code == 0 and "verifying" in err and f"training {name}" in err and "calibrating" in err
    assert re.search(r"phase margin [\d.e-]+ deg rms \(bound [\d.]+\), crossover .* of 60", out)
    found = tuners.load(tmp_path / "car.tuner")
    assert found.task.vehicle.J_z == 2600.0 and found.calibration.episodes == 300
    assert found.training["name"] == name and found.training["vehicles"] == 200
    expected = data.train(recipe, tmp_path / "set")
    np.testing.assert_array_equal(found.stages.learner.W1, expected.stages.learner.W1)
    assert "task.vehicle.J_z is 2600.0 there and 2500.0 here" in refused(
        UNUSABLE, *train, "--vehicle", other
    )


def test_what_cannot_be_trained_from(tmp_path):
    out = ("-o", tmp_path / "car.tuner")
    assert "does not exist" in refused(WRONG, "train", "--data", tmp_path / "none", *out)
    assert "_manifest.json: No such file" in refused(UNUSABLE, "train", "--data", tmp_path, *out)
    both = ("train", "--data", tmp_path, *out, "--episodes", 100)
    assert "leave out --episodes" in refused(WRONG, *both)
    made = ("dataset", "--out", tmp_path / "set", "--episodes", 60, "--workers", 1)
    assert call(*made, "--context", "test")[0] == 0
    assert "the test set" in call("train", "--data", tmp_path / "set", *out)[2]
    assert not out[1].exists()


def test_gains_and_tuners_are_exported(tmp_path):
    gains = ("export", "--kp", 0.42, "--Ti", 0.31)
    code, out, _ = call(
        *gains, "--limits", -0.1, 0.2, "--target", "json", "-o", tmp_path / "pi.json"
    )
    assert code == 0 and out == f"{tmp_path / 'pi.json'}\n"
    assert json.loads((tmp_path / "pi.json").read_text())["kp"] == 0.42
    code, out, _ = call(*gains, "--Ts", 0.005, "-o", tmp_path / "pi")
    assert code == 0 and [line.rpartition(".")[2] for line in out.split()] == ["h", "c", "c"]
    assert "--kp and --Ti" in refused(WRONG, *gains[:3], "-o", tmp_path / "pi")
    assert "holds no gains" in refused(
        UNUSABLE, "export", "--tuner", "ts-ff", "--target", "json", "-o", tmp_path / "x.json"
    )
    assert "folder" in refused(WRONG, *gains, "-o", tmp_path / "no" / "pi")
    onnx = ("--target", "onnx", "-o", tmp_path / "x.onnx")
    assert "give --tuner" in refused(WRONG, *gains, *onnx)
    assert "not both" in refused(WRONG, *gains, "--tuner", "ts-ff-lag", *onnx)
    assert "writes a folder" in refused(WRONG, *gains, "-o", tmp_path / "pi.json")


def test_a_data_set_is_made_and_verified(tmp_path):
    made = ("dataset", "--episodes", "1e2", "--out", tmp_path / "set", "--workers", 1)
    code, out, _ = call(*made)
    assert code == 0 and out == f"{tmp_path / 'set'}: 100 episodes\n"
    code, out, _ = call("dataset", "--out", tmp_path / "set", "--verify")
    assert code == 0 and out.endswith("100 episodes, intact\n")
    assert "seed" in call(*made, "--seed", 1)[2]
    more = ("dataset", "--episodes", 120, *made[3:])
    assert call(*more)[1] == f"{tmp_path / 'set'}: 120 episodes\n"
    assert "episodes is 120 there and 100 here" in call(*made)[2]
    assert "--episodes" in refused(WRONG, "dataset", "--out", tmp_path / "other")
    assert "not a whole" in refused(WRONG, *made[:2], 1.5, "--out", tmp_path / "other")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_a_script(shell):
    code, out, _ = call("completion", shell)
    assert code == 0 and "_YAWRATE_COMPLETE" in out


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_with_an_example_that_parses(name):
    code, out, _ = call(name, "--help")
    assert code == 0
    words = out.strip().rpartition("Example:\n")[2].split()
    assert words[:2] == ["yawrate", name]
    command = main.get_command(None, name)
    flags = {flag for option in command.params for flag in option.opts}
    assert {word for word in words if word.startswith("-")} <= flags


def test_every_option_is_explained():
    for name in COMMANDS:
        for option in main.get_command(None, name).params:
            assert option.param_type_name == "argument" or option.help, (name, option.name)


# Mistakes


def test_wrong_usage_is_one_line(tmp_path):
    assert "No such command" in refused(WRONG, "tunes")
    assert "does not exist" in refused(WRONG, "tune", tmp_path / "absent.csv")
    assert "No such option" in refused(WRONG, "tune", EXAMPLE, "--colour")
    assert "not a finite number" in refused(WRONG, "tune", EXAMPLE, "--from", "nan")
    assert "not above 0" in refused(WRONG, "tune", EXAMPLE, "--speed", "0")
    assert "No tuner 'ts'" in refused(WRONG, "tune", EXAMPLE, "--tuner", "ts")
    assert "No tuner file" in refused(WRONG, "tune", EXAMPLE, "--tuner", "absent.tuner")
    assert "folder" in refused(WRONG, "tune", EXAMPLE, "--report", tmp_path / "no" / "out.html")
    assert "must end in .html" in refused(WRONG, "tune", EXAMPLE, "--report", tmp_path / "r.csv")
    os.mkfifo(tmp_path / "pipe.html")
    pipe = refused(WRONG, "tune", EXAMPLE, "--report", tmp_path / "pipe.html")
    assert "no regular file" in pipe
    assert "above 1e+09" in refused(
        WRONG, "train", "--episodes", "1e10", "-o", tmp_path / "x.tuner"
    )
    assert "must end in .tuner" in refused(WRONG, "train", "-o", tmp_path / "car.bin")
    wrong = ("tune", EXAMPLE, "--tuner", "gb")
    assert "No column 'w' for steer" in refused(WRONG, *wrong, "--steer-column", "w")
    assert "Nothing between 90 and" in refused(WRONG, *wrong, "--from", 90)


def drive_log(path, steer, yaw_rate, Ts):
    columns = Ts * np.arange(len(steer)), steer, yaw_rate, np.full(len(steer), 18.0)
    np.savetxt(
        path, np.stack(columns, 1), "%.9g", ",", header="t,steer,yaw_rate,speed", comments=""
    )
    return path


def test_a_reversed_sign_and_a_late_channel_are_found(tmp_path):
    u, _, r = drive(Ts=0.01, seconds=8.0)
    reversed_log = drive_log(tmp_path / "reversed.csv", -u, r, 0.01)
    late = drive_log(tmp_path / "late.csv", u[6:], r[:-6], 0.01)
    early = drive_log(tmp_path / "early.csv", u[:-6], r[6:], 0.01)
    code, out, _ = call("tune", reversed_log)
    assert code == UNTRUSTED and "try --flip-steer" in out
    code, out, _ = call("tune", reversed_log, "--flip-steer")
    assert code == 0 and "--flip-steer" not in out
    right = drive_log(tmp_path / "right.csv", u, r, 0.01)
    assert "leave out --flip-steer" in call("tune", right, "--flip-steer")[1]
    code, out, _ = call("tune", late)
    assert code == UNTRUSTED and "logged 60 ms late" in out and "flip" not in out
    code, out, _ = call("tune", early)
    assert code == UNTRUSTED and "late:" not in out and "flip" not in out


def test_the_start_is_the_users():
    fits = [json.loads(call("tune", EXAMPLE, "--json", "--start", start)[1])["fit"]
            for start in ("auto", "unknown", "rest")]  # fmt: skip
    assert fits[0] == fits[1] and not fits[0]["from_rest"] and fits[2]["from_rest"]


def test_what_is_read_is_not_written_over(tmp_path):
    log, car = tmp_path / "log.html", tmp_path / "car.tuner"
    log.write_bytes(EXAMPLE.read_bytes())
    car.write_text(paper())
    for arguments in (
        ("tune", log, "--report", log),
        ("excite", "--vehicle", car, "-o", car),
        ("train", "--vehicle", car, "-o", car),
        ("export", "--tuner", car, "--target", "onnx", "-o", car),
    ):
        assert "would be written over" in refused(WRONG, *arguments)
    assert log.read_bytes() == EXAMPLE.read_bytes() and car.read_text() == paper()


def test_training_without_torch_is_refused_before_it_simulates(tmp_path, monkeypatch):
    monkeypatch.setattr("tuners.cli.train.find_spec", lambda name: None)
    line = refused(UNUSABLE, "train", "-o", tmp_path / "car.tuner")
    assert line == 'error: Training needs PyTorch: pip install "yawrate[tuners]".\n'


def test_no_command_shows_the_help():
    code, _, err = call()
    assert code == WRONG and "Commands:" in err


def test_broken_files_are_one_line(tmp_path):
    damaged = bytearray(shipped("ts-ff").read_bytes())
    damaged[500] ^= 1
    (tmp_path / "damaged.tuner").write_bytes(damaged)
    assert "checksum" in refused(UNUSABLE, "tune", EXAMPLE, "--tuner", tmp_path / "damaged.tuner")
    (tmp_path / "car.toml").write_text(paper().replace("xi = 0.9", "xi = 0"))
    arguments = ("excite", "--vehicle", tmp_path / "car.toml", "-o", tmp_path / "prbs.csv")
    assert "car.toml, line 14: vehicle.xi" in refused(UNUSABLE, *arguments)
    assert not (tmp_path / "prbs.csv").exists()


# Malformed files, generated


LINES = EXAMPLE.read_text().splitlines()[:402]
CELLS = st.sampled_from(
    ["", "nan", "inf", "-1e999", "1e308", "1e19", "x", "-", "0x10", "1,5", "1;2", '"', "\t",
     "999999", "-0.0", "12:00:01", "2024-01-01", "true", "µ"]
)  # fmt: skip
EDITS = st.lists(
    st.one_of(
        st.tuples(st.just("cell"), st.integers(0, 401), st.integers(0, 3), CELLS),
        st.tuples(st.just("column"), st.integers(0, 3), CELLS),
        st.tuples(st.just("drop"), st.integers(0, 401), st.integers(1, 300)),
        st.tuples(st.just("repeat"), st.integers(1, 401), st.integers(1, 50)),
        st.tuples(st.just("swap"), st.integers(0, 401), st.integers(0, 401)),
        st.tuples(st.just("cut"), st.integers(0, 12000)),
        st.tuples(st.just("insert"), st.integers(0, 12000), st.binary(min_size=1, max_size=20)),
    ),
    min_size=1,
    max_size=5,
)


def edited(edits):
    """The example's first 4 s with damage done to it."""
    lines, content = list(LINES), None
    for kind, *how in edits:
        if kind == "cell":
            row, column, text = how
            if row < len(lines):
                cells = lines[row].split(",")
                cells[min(column, len(cells) - 1)] = text
                lines[row] = ",".join(cells)
        elif kind == "column":
            column, text = how
            for k, line in enumerate(lines[1:], 1):
                cells = line.split(",")
                cells[min(column, len(cells) - 1)] = text
                lines[k] = ",".join(cells)
        elif kind == "drop":
            del lines[how[0] : sum(how)]
        elif kind == "repeat":
            lines[how[0] : how[0]] = lines[how[0] - 1 : how[0]] * how[1]
        elif kind == "swap":
            i, j = (min(k, len(lines) - 1) for k in how)
            if lines:
                lines[i], lines[j] = lines[j], lines[i]
    content = "\n".join(lines).encode()
    for kind, *how in edits:
        if kind == "cut":
            content = content[: how[0]]
        elif kind == "insert":
            content = content[: how[0]] + how[1] + content[how[0] :]
    return content


def answers_or_refuses(*arguments):
    """Status 0 or 3 with finite gains, or a refusal in one line."""
    code, out, err = call("tune", *arguments, "--tuner", "gb", "--json")
    if code in (0, UNTRUSTED):
        found = json.loads(out)
        assert 0 < found["kp"] < np.inf and 0 < found["Ti"] < np.inf
        assert found["trusted"] is (code == 0) and bool(found["reasons"]) is (code == UNTRUSTED)
        assert err == ""
    else:
        assert code == UNUSABLE and out == "" and re.fullmatch(r"error: [^\n]+\n", err), (code, err)


@given(edits=EDITS)
@example(edits=[("column", 1, "")])
@example(edits=[("column", 0, "1e308")])
@example(edits=[("cell", 200, 2, "1e308")])
@example(edits=[("cell", 200, 1, "inf")])
@example(edits=[("drop", 0, 1)])
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_logs_never_give_a_traceback(edits, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(edited(edits))
    answers_or_refuses(path)


HEADS = [b"", b"t,steer,yaw_rate,speed\n", b"PAR1", b"MATLAB 5.0 MAT-file, ", b"\xff\xfe",
         b"\x89HDF\r\n\x1a\n", b"MDF     4.10    ", b"\xef\xbb\xbf"]  # fmt: skip


@given(
    content=st.binary(max_size=300),
    head=st.sampled_from(HEADS),
    suffix=st.sampled_from(["csv", "mat"]),
)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_files_of_noise_are_refused(content, head, suffix, tmp_path):
    path = tmp_path / f"noise.{suffix}"
    path.write_bytes(head + content)
    refused(UNUSABLE, "tune", path, "--tuner", "gb")


@given(
    changes=st.dictionaries(st.integers(0, 10**6), st.integers(1, 255), min_size=1, max_size=4),
    cut=st.none() | st.integers(0, 1600),
)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_tuners_are_refused(changes, cut, tmp_path):
    content = bytearray(shipped("ts-ff").read_bytes())
    for position, change in changes.items():
        content[position % len(content)] ^= change
    path = tmp_path / "damaged.tuner"
    path.write_bytes(content[:cut])
    assert re.search(
        "tuner file|damaged|version", refused(UNUSABLE, "tune", EXAMPLE, "--tuner", path)
    )


@given(text=st.text(max_size=200), position=st.integers(0, len(paper())), cut=st.booleans())
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_vehicles_are_refused_or_used(text, position, cut, tmp_path):
    path = tmp_path / "car.toml"
    whole = paper()
    damaged = whole[:position] + text + whole[position:] * (not cut)
    path.write_bytes(damaged.encode("utf-8", "replace"))
    code, _, err = call("excite", "--vehicle", path, "-o", tmp_path / "prbs.csv")
    assert (code, err) == (0, "") or (code == UNUSABLE and re.fullmatch(r"error: [^\n]+\n", err))


# Start-up


def test_the_command_starts_light():
    loaded = modules_after("import tuners.cli")
    assert not loaded & {"pyarrow", "matplotlib", "torch", "pandas", "h5py", "jinja2"}
    assert "tuners" in loaded


def test_reading_a_log_is_light():
    loaded = modules_after(
        "from pathlib import Path; from tuners.logs import Options, read_log; "
        "from yawrate_env.vehicle.task import Task; "
        "read_log(Path('examples/log.csv'), Task(), Options())"
    )
    assert "pyarrow" in loaded
    assert not loaded & {"matplotlib", "torch", "pandas", "h5py", "jinja2", "xgboost", "control"}


def test_the_command_is_installed_and_ends_with_its_status():
    program = "from tuners.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, "tune", "absent.csv"],
        cwd=ROOT, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == WRONG and done.stderr.startswith("error: ") and not done.stdout
