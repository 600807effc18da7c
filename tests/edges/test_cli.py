"""The yawrate command as a user calls it: answers, exit statuses, and never a traceback."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import click
import numpy as np
import pytest
from command import (
    EXAMPLE,
    TRUSTED,
    UNTRUSTED,
    UNUSABLE,
    WRONG,
    call,
    log_of,
    refused,
    result_of,
    tuned,
    tuner_of,
)
from first_order import TS, U, gauged, plant
from imports import modules_after
from log_files import CASES, write
from recordings import ROOT

import tuners
from tuners.catalogue import shipped
from tuners.cli import COMMANDS, main
from tuners.cli.answer import as_json
from tuners.cli.text import as_text
from tuners.export.forms import Forms
from yawrate_env import plants
from yawrate_env.loop.target import Target
from yawrate_env.plant.entry import from_toml
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.vehicle_file import example as paper


@pytest.fixture(params=CASES)
def name(request):
    return request.param


@pytest.fixture
def case(name):
    return CASES[name]


@pytest.fixture
def log(case, tmp_path):
    return write(tmp_path / "log.csv", case.columns)


KEYS = {
    "gains", "metrics", "trusted", "reasons", "notes", "status", "converged", "fallback",
    "verdict", "answered_by", "left", "metrics_if_plant_exact", "logs", "validation",
    "parameters", "deviations", "units", "checks", "forms", "target", "tuner", "plant", "log",
    "fit", "controller",
}  # fmt: skip


@cache
def answer(name):
    """The answer to a case's log."""
    return tuned(write(Path(mkdtemp()) / "log.csv", CASES[name].columns), tuner_of(name))


# Tune


def test_json_has_everything(name, case):
    found, plant = answer(name), case.plant
    gains = dict(zip(plant.gains, (found[gain] for gain in plant.gains), strict=True))
    assert set(found) == KEYS | set(gains) | set(found["metrics"])
    assert gains == found["gains"] and found["fallback"].keys() == gains.keys()
    assert found["trusted"] and found["verdict"] == "usable" and found["answered_by"] == "tuner"
    assert found["reasons"] == found["left"] == [] and found["status"] == "ok"
    for metric, interval in found["metrics"].items():
        assert found[metric] == interval and interval["low"] < interval["value"] < interval["high"]
    assert all(check["passed"] for check in found["checks"])
    label = {"vehicle": "speed", "lag": "K"}[name]
    assert found["log"][label] == pytest.approx(case.value)
    assert (found["log"]["file"], found["log"]["samples"]) == ("log.csv", len(case.u))
    assert found["log"]["excitation"]["rms"] > 0
    assert set(found["deviations"]) == {list(plant.prior)[i] for i in plant.unknown}
    for parameter in found["deviations"]:
        assert found["fit"][parameter] == found["parameters"][parameter]
    assert set(found["units"]) == {*gains, *found["metrics"], *plant.prior}
    assert found["plant"]["signals"] == list(plant.signals)


def test_gains_that_do_not_exist_are_null_or_none():
    result, log = result_of("lag", sign=-1), log_of("lag")
    gone = dict.fromkeys(result.gains, np.nan)
    text = as_text(replace(result, gains=gone), log)
    assert re.search(r"\n  kp +none\n", text) and "REFUSED\n  - " in text
    assert f"kp {result.fallback['kp']:.4g}" in text
    without = replace(result, gains=gone, fallback=gone)
    assert "No gains are stable" in as_text(without, log)
    found = as_json(without, log, "my.tuner")
    json.dumps(found, allow_nan=False)
    assert found["kp"] is None and found["gains"] == found["fallback"] == dict.fromkeys(gone)
    assert found["forms"] is None


def test_text_and_report_have_gains_metrics_and_the_difference_equation(name, log, tmp_path):
    page = tmp_path / "out.html"
    report = ("--report", page) if name == "lag" else ()
    code, out, err = call("tune", log, "--tuner", tuner_of(name), *report)
    assert code == TRUSTED and err == "" and out.startswith("log.csv: 0.00 to ")
    assert re.search(r"\n  kp +\d\.\d+", out) and re.search(r"\n  Ti +\d\.\d+", out)
    assert len(re.findall(r"between .* and .* \(90 %\)", out)) == 2
    assert ("every         10 ms: u[k] = u[k-1] +" in out) is (name == "vehicle")
    assert "\n\nUSABLE\n" in out
    assert not report or "controller from log.csv" in page.read_text()


def test_a_reversed_sign_is_found(name, case, tmp_path):
    tuner, log = tuner_of(name), write(tmp_path / "log.csv", case.changed(input=-case.u))
    code, out, _ = call("tune", log, "--tuner", tuner)
    assert code == UNTRUSTED and "REFUSED\n  - " in out and "--flip-input" in out
    assert "(90 %)" not in out  # metrics that the recording does not support
    assert tuned(log, tuner, "--flip-input")["trusted"]
    right = write(tmp_path / "right.csv", case.columns)
    assert any("leave out" in note for note in tuned(right, tuner, "--flip-input")["notes"])


@pytest.mark.parametrize("name, early", [("vehicle", False), ("lag", True)])
def test_a_late_output_is_found(name, case, early, tmp_path):
    shift = 6 if name == "vehicle" else 4
    last, first = slice(shift, None), slice(None, -shift)
    u, y = (first, last) if early else (last, first)
    columns = dict(zip(case.names, case.columns.values(), strict=True))
    t, parameter = (columns[case.names[i]][first] for i in (0, 3))
    log = write(
        tmp_path / "log.csv",
        dict(zip(case.names, (t, case.u[u], case.y[y], parameter), strict=True)),
    )
    found = tuned(log, tuner_of(name))
    ms = 1e3 * shift * case.Ts
    assert found["verdict"] != "usable"
    assert any(f"logged {ms:g} ms late" in note for note in found["notes"]) is not early


def test_the_start_is_the_users(tmp_path):
    name, case = "vehicle", CASES["vehicle"]
    offset = 0.3 * np.std(case.y)
    log = write(tmp_path / "log.csv", case.changed(output=case.y + offset))
    auto, unknown, rest = (
        tuned(log, tuner_of(name), "--start", start)["fit"] for start in ("auto", "unknown", "rest")
    )
    assert rest["from_rest"] and not auto["from_rest"] and not unknown["from_rest"]
    for fit in (auto, unknown):
        assert fit["offset"] == pytest.approx(offset, rel=0.2)


def scaled(case):
    """The columns of a case in other units and under other names, with `measured` doubled."""
    t, u, y, p = case.columns.values()
    return {"clock": 1e3 * t, "in": -10 * u, "out": 2 * y, "beside": p}


GIVEN = ("--time-column", "clock", "--time-unit", "ms", "--output-scale", 0.5)
FLAGS = [
    ("vehicle", (*GIVEN, "--steer-column", "in", "--yaw-rate-column", "out", "--flip-steer",
                 "--steer-ratio", 10, "--speed-column", "beside")),
    ("vehicle", (*GIVEN, "--input-column", "2", "--output-column", "3", "--input-scale", -0.1,
                 "--speed", 64.8, "--speed-unit", "km/h")),
    ("vehicle", (*GIVEN, "--input-column", "in", "--output-column", "out", "--input-scale", 0.1,
                 "--flip-input", "--measured", "v_x=18")),
    ("lag", (*GIVEN, "--input-column", "in", "--output-column", "out", "--input-scale", -0.1,
             "--measured", "K=beside")),
    ("lag", (*GIVEN, "--input-column", "2", "--output-column", "3", "--flip-steer",
             "--steer-ratio", 10, "--measured", "K=1.25")),
]  # fmt: skip


@pytest.mark.parametrize("name, flags", FLAGS)
def test_flags_say_what_is_in_a_log(name, flags, case, tmp_path):
    other = write(tmp_path / "other.csv", scaled(case))
    plain, found = answer(name), tuned(other, tuner_of(name), *flags)
    assert found["gains"] == pytest.approx(plain["gains"], rel=1e-6)
    assert found["trusted"] and found["log"]["samples"] == plain["log"]["samples"]


def test_a_stretch_and_a_sampling_time_are_given(tmp_path):
    case, tuner = CASES["lag"], tuner_of("lag")
    _, *names = case.names
    untimed = write(tmp_path / "untimed.csv", {name: case.columns[name] for name in names})
    found = tuned(untimed, tuner, "--Ts", case.Ts)
    assert found["gains"] == pytest.approx(answer("lag")["gains"])
    found = tuned(untimed, tuner, "--Ts", case.Ts, "--from", 1, "--to", 7)
    assert found["log"]["start"] == pytest.approx(1.0)
    assert found["log"]["samples"] == pytest.approx(6 / case.Ts + 1, abs=1)


def test_the_answer_is_there_even_if_the_report_cannot_be_written(monkeypatch, tmp_path):
    def full(*_):
        raise OSError(28, "No space left on device", "out.html")

    monkeypatch.setattr("tuners.cli.report.write_report", full)
    code, out, err = call("tune", EXAMPLE, "--report", tmp_path / "out.html")
    assert code == UNUSABLE and "kp " in out
    assert err == "error: [Errno 28] No space left on device: 'out.html'\n"


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


# The other commands


def test_a_vehicles_file_is_written_once(tmp_path):
    path = tmp_path / "car.toml"
    code, out, _ = call("init", "-o", path)
    assert code == TRUSTED and path.read_text() == paper() and f"--vehicle {path}" in out
    assert "exists" in refused(WRONG, "init", "-o", path)
    assert call("init", "-o", path, "--force")[0] == TRUSTED


def lag_file(folder):
    """TOML of the lag; its module is one of the tests'."""
    (folder / "lag.toml").write_text('[plant]\nentry = "first_order:gauged"\n')
    return folder / "lag.toml"


def short(path, J_z=2400.0):
    """A vehicle's file, with short episodes."""
    text = paper().replace("N = 10_000", "N = 1_000").replace("Ts = 0.001", "Ts = 0.01")
    path.write_text(text.replace("J_z = 2400.0", f"J_z = {J_z}"))
    return path


def test_the_input_to_apply_is_the_experiments(name, tmp_path):
    if name == "vehicle":
        plants_file, Ts, says = short(tmp_path / "car.toml"), 0.01, "steering, ±1 deg"
        u = prbs(1000, 0.01, 0.1, np.radians(1.0))[0]
    else:
        plants_file, Ts, says, u = lag_file(tmp_path), TS, "valve, ±1 %", gauged.u
    code, out, _ = call("excite", "--vehicle", plants_file, "-o", tmp_path / "prbs.csv")
    assert code == TRUSTED and f"10 s of {says}" in out
    t, found = np.loadtxt(tmp_path / "prbs.csv", delimiter=",", skiprows=1).T
    np.testing.assert_allclose(t, Ts * np.arange(len(u)), atol=1e-9)
    np.testing.assert_allclose(found, u, rtol=1e-8)


@pytest.fixture
def quick(monkeypatch):
    """Less calibration and validation than `yawrate train` has."""
    monkeypatch.setattr("tuners.cli.train.CALIBRATION", 200)
    monkeypatch.setattr("tuners.data.training.CALIBRATION", 200)
    monkeypatch.setattr("tuners.cli.train.VALIDATION", 60)


def test_from_a_toml_file_to_trusted_gains(tmp_path, quick):
    """As somebody does who has one file with a plant, in a folder of their own."""
    code = (ROOT / "tests" / "first_order.py").read_text()
    (tmp_path / "my_valve.py").write_text(code.replace("first_order:plant", "my_valve:plant"))
    (tmp_path / "my.toml").write_text('[plant]\nentry = "my_valve:plant"\n')
    tuner = tmp_path / "my.tuner"
    made = ("--vehicle", tmp_path / "my.toml", "-o", tuner, "--episodes", 60)
    code, out, err = call("train", *made)
    assert code == TRUSTED and "training" in err and "calibrating" in err
    assert len(re.findall(r"relative error of \w+ [\d.e-]+ rms \(bound [\d.e-]+\)", out)) == 2
    assert "0 of 60 loops unstable" in out
    assert tuners.load(tuner).plant.entry == "my_valve:plant"
    noise = 0.02 * np.random.default_rng(0).normal(size=len(U))
    y = plant.respond(np.array([[1.2, 0.5]]))[0] + noise
    t = TS * np.arange(len(U))
    found = tuned(write(tmp_path / "a.csv", {"t": t, "valve": U, "flow [l/s]": y}), tuner)
    assert found["trusted"]
    assert found["gains"]["kp"] == pytest.approx(0.5 / (1.2 * 0.3), rel=0.1)


@pytest.mark.slow
def test_a_data_set_is_made_verified_and_learned_from(tmp_path, quick):
    folder, vehicle = tmp_path / "set", ("--vehicle", short(tmp_path / "car.toml", 2600.0))
    made = ("dataset", "--out", folder, *vehicle, "--workers", 1, "--episodes")
    assert call(*made, "1e2")[:2] == (TRUSTED, f"{folder}: 100 episodes\n")
    code, out, _ = call("dataset", "--out", folder, "--verify")
    assert code == TRUSTED and out.endswith("100 episodes, intact\n")
    assert "seed" in call(*made, 100, "--seed", 1)[2]
    assert call(*made, 200)[1] == f"{folder}: 200 episodes\n"
    assert "episodes" in call(*made, 100)[2]
    train = ("train", "--data", folder, "-o", tmp_path / "my.tuner")
    code, out, err = call(*train)
    assert code == TRUSTED and "verifying" in err and "calibrating" in err and "bound" in out
    tuner = tuners.load(tmp_path / "my.tuner")
    assert tuner.training["episodes"] == 200
    assert tuner.plant.arguments["vehicle"]["J_z"] == 2600.0
    for other in (short(tmp_path / "other.toml", 2500.0), lag_file(tmp_path)):
        refused(UNUSABLE, *train, "--vehicle", other)


def test_what_cannot_be_trained_from(tmp_path):
    out = ("-o", tmp_path / "car.tuner")
    assert "--data" in refused(WRONG, "train", "--data", tmp_path / "none", *out)
    assert "_manifest.json" in refused(UNUSABLE, "train", "--data", tmp_path, *out)
    both = ("train", "--data", tmp_path, *out, "--episodes", 100)
    assert "--episodes" in refused(WRONG, *both)
    made = ("dataset", "--out", tmp_path / "set", "--episodes", 60, "--workers", 1)
    car = ("--vehicle", short(tmp_path / "car.toml"))
    assert call(*made, *car, "--context", "test")[0] == TRUSTED
    assert "test set" in call("train", "--data", tmp_path / "set", *out)[2]
    assert not out[1].exists()


def test_training_without_torch_is_refused_before_it_simulates(tmp_path, monkeypatch):
    monkeypatch.setattr("tuners.cli.train.find_spec", lambda name: None)
    assert "PyTorch" in refused(UNUSABLE, "train", "-o", tmp_path / "car.tuner")


def test_completion_is_a_script():
    for shell in ("bash", "zsh", "fish"):
        code, out, _ = call("completion", shell)
        assert code == TRUSTED and "_YAWRATE_COMPLETE" in out


@pytest.mark.parametrize("name", COMMANDS)
def test_help_explains_every_option_and_ends_with_an_example_that_parses(name):
    code, out, _ = call(name, "--help")
    assert code == TRUSTED
    words = out.strip().rpartition("Example:\n")[2].split()
    assert words[:2] == ["yawrate", name]
    options = [p for p in main.get_command(None, name).params if isinstance(p, click.Option)]
    flags = {flag for option in options for flag in option.opts}
    assert {word for word in words if word.startswith("-")} <= flags
    assert all(option.help for option in options)


# Refusals


REFUSED = [
    ("tune absent.csv", WRONG, "absent.csv"),
    ("tune {log} --colour", WRONG, "--colour"),
    ("tune {log} --from nan", WRONG, "--from"),
    ("tune {log} --speed 0", WRONG, "--speed"),
    ("tune {log} --input-scale 0", WRONG, "--input-scale"),
    ("tune {log} --input-is angle", WRONG, "--input-is"),
    ("tune {log} --tuner ts", WRONG, "'ts'"),
    ("tune {log} --tuner absent.tuner", WRONG, "absent.tuner"),
    ("tune {log} --tuner {log}", WRONG, "No tuner"),
    ("tune {log} --tuner {damaged}", UNUSABLE, "damaged.tuner"),
    ("tune {log} --report {tmp}/no/out.html", WRONG, "--report"),
    ("tune {log} --report {tmp}/out.csv", WRONG, "--report"),
    ("tune {log} --report {pipe}", WRONG, "no regular file"),
    ("tune {log} --steer-column w", WRONG, "'w'"),
    ("tune {log} --input-column yaw_rate", WRONG, "yaw_rate"),
    ("tune {log} --steer-unit kg", WRONG, "kg"),
    ("tune {log} --speed 18 --measured speed=20", WRONG, "speed"),
    ("tune {log} --measured v_x=1 --measured speed=2", WRONG, "given twice"),
    ("tune {log} --measured v_x", WRONG, "--measured"),
    ("tune {log} --measured speed=wheel", WRONG, "'wheel'"),
    ("tune {log} --tuner {lag}", UNUSABLE, "valve"),
    ("tune {log} --Ts 0.01 --time-column t", WRONG, "--Ts 0.01 and --time-column t contradict"),
    ("tune {log} --Ts 10 --time-unit ms", WRONG, "--time-unit ms contradict"),
    ("train -o {tmp}/my.tuner --episodes 1e10", WRONG, "--episodes"),
    ("train -o {tmp}/my.tuner --episodes 1.5", WRONG, "--episodes"),
    ("train -o {tmp}/my.tuner --episodes 3", UNUSABLE, "episodes"),
    ("train -o {tmp}/my.bin", WRONG, ".tuner"),
    ("train", WRONG, "--out"),
    ("train --vehicle {bad} -o {tmp}/my.tuner", UNUSABLE, "xi"),
    ("excite --vehicle {nowhere} -o {tmp}/prbs.csv", UNUSABLE, "no_such_module"),
    ("dataset --out {tmp}/set", WRONG, "--episodes"),
    ("dataset --out {tmp}/set --verify", WRONG, "set"),
    ("export --kp 0.4 -o {tmp}/pi", WRONG, "--Ti"),
    ("export --kp 0.4 --Ti 0.3 --target onnx -o {tmp}/x.onnx", WRONG, "--tuner"),
    ("export --kp 0.4 --Ti 0.3 --tuner ts-ff-lag --target onnx -o {tmp}/x.onnx", WRONG, "not both"),
    ("export --kp 0.4 --Ti 0.3 -o {log}", WRONG, "log.csv"),
    ("export --tuner ts-ff-lag --Ts 0.01 -o {tmp}/pi", WRONG, "--Ts"),
    ("export --tuner ts-ff-lag --vehicle {car} -o {tmp}/pi", WRONG, "--vehicle"),
    ("export --result {log} -o {tmp}/pi", UNUSABLE, "log.csv"),
    ("tune {page} --report {page}", WRONG, "log.html"),
    ("excite --vehicle {car} -o {car}", WRONG, "overwritten"),
    ("train --vehicle {car} -o {car}", WRONG, "overwritten"),
    ("export --tuner {car} --target onnx -o {car}", WRONG, "overwritten"),
]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Paths that the refused commands name."""
    tmp = tmp_path_factory.mktemp("files")
    damaged = bytearray(shipped("ts-ff").read_bytes())
    damaged[500] ^= 1
    (tmp / "damaged.tuner").write_bytes(damaged)
    (tmp / "log.csv").write_bytes(EXAMPLE.read_bytes())
    (tmp / "log.html").write_bytes(EXAMPLE.read_bytes())
    (tmp / "car.tuner").write_text(paper())
    (tmp / "bad.toml").write_text(paper().replace("xi = 0.9", "xi = 0"))
    (tmp / "nowhere.toml").write_text('[plant]\nentry = "no_such_module:plant"\n')
    os.mkfifo(tmp / "pipe.html")
    return {
        "tmp": tmp, "log": tmp / "log.csv", "page": tmp / "log.html", "pipe": tmp / "pipe.html",
        "damaged": tmp / "damaged.tuner", "car": tmp / "car.tuner", "bad": tmp / "bad.toml",
        "nowhere": tmp / "nowhere.toml", "lag": tuner_of("lag"),
    }  # fmt: skip


@pytest.mark.parametrize("line, status, named", REFUSED, ids=[row[0] for row in REFUSED])
def test_wrong_usage_and_unusable_files_are_one_line(line, status, named, files):
    before = {path: path.read_bytes() for path in files["tmp"].iterdir() if path.is_file()}
    message = refused(status, *line.format(**files).split())
    assert named in message, message
    after = {path: path.read_bytes() for path in files["tmp"].iterdir() if path.is_file()}
    assert before == after


def test_no_command_shows_the_help():
    code, _, err = call()
    assert code == WRONG and "Commands:" in err
    assert "tunes" in refused(WRONG, "tunes")


# Start-up


def test_the_command_starts_light_and_reads_a_log_lightly():
    loaded = modules_after(
        "import sys, tuners.cli; assert not {'pyarrow', 'jinja2'} & {*sys.modules}; "
        "from pathlib import Path; from tuners.logs import Options, read_log; "
        "from tuners.cli.sources import plant_from; "
        "read_log(Path('examples/log.csv'), plant_from(None), Options())"
    )
    assert "pyarrow" in loaded
    heavy = {"matplotlib", "torch", "pandas", "h5py", "xgboost", "control", "jinja2"}
    assert not loaded & heavy


def test_the_command_is_installed_and_ends_with_its_status():
    program = "from tuners.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, "tune", "absent.csv"],
        cwd=ROOT, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == WRONG and done.stderr.startswith("error: ") and not done.stdout


@pytest.mark.parametrize("name", plants.NAMES)
def test_a_ready_plants_file_has_its_defaults_and_is_one(tmp_path, name):
    path = tmp_path / f"{name}.toml"
    code, out, _ = call("init", "--plant", name, "-o", path)
    assert code == TRUSTED and f"--vehicle {path}" in out
    found, default = from_toml(path), getattr(plants, name)()
    assert found.arguments == default.arguments and found.entry == default.entry
    code, _, _ = call("excite", "--vehicle", path, "-o", tmp_path / "u.csv")
    assert code == TRUSTED
    assert "exists" in refused(WRONG, "init", "--plant", name, "-o", path)
