"""The yawrate command as a user calls it: answers, exit statuses, and never a traceback."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from command import (
    EXAMPLE,
    TRUSTED,
    UNTRUSTED,
    UNUSABLE,
    WRONG,
    call,
    lag_file,
    log_of,
    refused,
    result_of,
    short,
    tuned,
    tuner_of,
)
from first_order import TS, gauged
from log_files import CASES, write

from tuners.cli.answer import as_json
from tuners.cli.text import as_text
from tuners.export.forms import Forms
from yawrate_env.loop.target import Target
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
    assert found["trusted"] and found["verdict"] == "usable"
    assert found["answered_by"] == {"vehicle": "tuner", "lag": "fitted plant"}[name]
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
