"""Controllers and rules in a plant's file, through the command to programs and reports."""

import csv
import json
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from c_programs import passes
from command import EXAMPLE, TRUSTED, WRONG, call, refused, tuned

import tuners
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from yawrate_env.plant.entry import from_toml

LINES = (
    ('controller = "PI"', 'controller = "2DOF"'),
    ('rule = "simc"', 'rule = "lambda"'),
    ('# metrics = ["phase_margin [deg]", "Ms", "overshoot [%]"]   #',
     'metrics = {"phase_margin [deg]" = 12.0, "Ms" = 0.5, "IAE" = 10.0}  #'),
    ("N = 600 ", "N = 300 "),
    ("L = [3.0, 20.0]", "L = [5.0, 9.0]"),
)  # fmt: skip


@cache
def edited():
    """A plant's file with other controller, rule and metrics; its folder."""
    folder = Path(mkdtemp(prefix="heater"))
    file = folder / "heater.toml"
    code, *_ = call("init", "--plant", "fopdt", "-o", file)
    assert code == TRUSTED
    text = file.read_text()
    for before, after in LINES:
        assert before in text, before
        text = text.replace(before, after)
    file.write_text(text)
    return folder


@cache
def heater():
    """A tuner of the edited file, hardly trained, and a log; their folder."""
    folder = edited()
    plant = from_toml(folder / "heater.toml")
    recipe = tuners.Recipe(Laguerre(6, 0.1), FeedForwardSettings(neurons=6, epochs=20))
    tuners.train(recipe, plant, episodes=100, calibration=60).save(folder / "heater.tuner")
    y = plant.respond(np.array([[1.2, 22.0, 7.3]]))[0]
    y += plant.noise * np.random.default_rng(2).standard_normal(len(y))
    with (folder / "log.csv").open("w", newline="") as log:
        csv.writer(log).writerows([["t", "u", "y"], *zip(range(len(y)), plant.u, y, strict=True)])
    return folder


def test_a_file_chooses_controller_rule_and_metrics():
    plant = from_toml(edited() / "heater.toml")
    assert plant.controller == "2DOF" and plant.gains == ("kp", "Ti", "Td", "Tf", "b")
    assert {name: m.scale for name, m in plant.settings.items()} == {
        "phase_margin [deg]": 12.0, "Ms": 0.5, "IAE": 10.0,
    }  # fmt: skip
    (gains,) = plant.oracle(np.array([[1.2, 22.0, 7.3]]))
    L = 7.3 + 0.5  # the hold
    assert gains[:3] == pytest.approx(
        [(22 + L / 2) / (1.2 * 1.5 * L), 22 + L / 2, 22 * L / (44 + L)]
    )
    assert gains[4] == 1.0


@pytest.mark.slow
def test_tune_gives_speeds_and_every_form(tmp_path):
    folder = heater()
    found = tuned(folder / "log.csv", folder / "heater.tuner", "--speeds")
    assert list(found["speeds"]) == ["slow", "medium", "fast"]
    margins = [one["margins"]["phase_margin"] for one in found["speeds"].values()]
    assert margins[0] > margins[1] > margins[2] > 30
    assert found["speeds"]["medium"]["gains"]["kp"] == pytest.approx(found["gains"]["kp"], rel=0.1)
    forms = found["controller"]["forms"]
    assert found["controller"]["name"] == "2DOF"
    assert forms["parallel"]["Ki"] == pytest.approx(found["gains"]["kp"] / found["gains"]["Ti"])
    assert found["units"]["Td"] == "s"
    report = tmp_path / "report.html"
    code, out, _ = call("tune", folder / "log.csv", "--tuner", folder / "heater.tuner",
                        "--speeds", "--report", report)  # fmt: skip
    assert code == TRUSTED and "series" in out and "delay margin" in out
    assert "Modulus margin" in report.read_text()
    answer = tmp_path / "answer.json"
    answer.write_text(json.dumps(found))
    code, *_ = call("export", "--result", answer, "--limits", -5, 5, "--out", tmp_path / "c")
    assert code == TRUSTED and passes(tmp_path / "c", "yawrate_pid")


def test_the_vehicles_loops_have_speeds():
    found = tuned(EXAMPLE, "ts-ff-lag-vx", "--speeds")
    crossovers = [one["margins"]["crossover"] for one in found["speeds"].values()]
    assert crossovers == pytest.approx([1.0, 1.5, 2.25], abs=0.02)
    assert found["controller"]["name"] == "PI"
    assert found["controller"]["forms"]["parallel"]["Ki"] == found["forms"]["Ki"]
    assert tuned(EXAMPLE, "bb", "--speeds")["speeds"] == {}


def test_speeds_need_a_rule_that_has_them(tmp_path):
    from command import tuner_of
    from log_files import CASES, write

    log = write(tmp_path / "lag.csv", CASES["lag"].columns)
    assert "--speeds" in refused(WRONG, "tune", log, "--tuner", tuner_of("lag"), "--speeds")
    assert "--speeds" in refused(WRONG, "tune", EXAMPLE, "--each", "--speeds")
