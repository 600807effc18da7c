"""The commands that make data sets and train tuners."""

import re

import numpy as np
import pytest
from command import (
    TRUSTED,
    UNUSABLE,
    WRONG,
    call,
    lag_file,
    refused,
    short,
    tuned,
)
from first_order import TS, U, plant
from log_files import write
from recordings import ROOT

import tuners


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
