"""The command line for a plant of one's own."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from first_order import U, plant
from recordings import ROOT

from tuners.cli import main

ENTRY = "first_order:plant"


def call(*arguments):
    done = CliRunner().invoke(main, list(map(str, arguments)), catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


def test_from_a_toml_file_to_trusted_gains(tmp_path):
    """As somebody does who has one file with a plant, in a folder of their own."""
    code = (ROOT / "tests" / "first_order.py").read_text()
    (tmp_path / "my_valve.py").write_text(code.replace("first_order:plant", "my_valve:plant"))
    (tmp_path / "my.toml").write_text('[plant]\nentry = "my_valve:plant"\n')
    tuner, log = tmp_path / "my.tuner", tmp_path / "log.csv"
    code, out, _ = call("train", "--vehicle", tmp_path / "my.toml", "-o", tuner, "--episodes", 60)
    assert code == 0 and "relative error of kp" in out and "(bound" in out, out

    y = plant.respond(np.array([[1.2, 0.5]]))[0] + 0.02 * np.random.default_rng(0).normal(size=500)
    rows = [f"{k * 0.02:.2f},{U[k]},{y[k]:.5f}" for k in range(500)]
    log.write_text("\n".join(["t,valve,flow [l/s]", *rows]))
    code, out, err = call("tune", log, "--tuner", tuner, "--json")
    found = json.loads(out)
    assert (code, err) == (0, "") and found["trusted"]
    assert found["gains"]["kp"] == pytest.approx(0.5 / (1.2 * 0.3), rel=0.1)
    code, out, _ = call("tune", log, "--tuner", tuner)
    assert code == 0 and "Trusted" in out

    log.write_text(
        "\n".join(["t,u,y", *(f"{k * 0.02:.2f},{U[k]},{-y[k]:.5f}" for k in range(500))])
    )
    code, out, _ = call("tune", log, "--tuner", tuner)
    assert code == 3 and "NOT TRUSTED" in out and "--flip-input" in out


@pytest.mark.parametrize(
    "toml, words",
    [
        ("[plant]\n", "entry"),
        ('[plant]\nentry = "gone:plant"\n', "no module 'gone'"),
        ("[plant\n", "is not TOML"),
    ],
)
def test_a_bad_toml_file_is_one_line_of_error(tmp_path, toml, words):
    (tmp_path / "my.toml").write_text(toml)
    code, out, err = call("train", "--vehicle", tmp_path / "my.toml", "-o", tmp_path / "a.tuner")
    assert code == 1 and out == "" and words in err and err.count("\n") == 1


def test_the_input_to_drive_is_written(tmp_path):
    (tmp_path / "my.toml").write_text(f'[plant]\nentry = "{ENTRY}"\n')
    out = tmp_path / "u.csv"
    code, said, _ = call("excite", "--vehicle", tmp_path / "my.toml", "-o", out)
    assert code == 0 and "10 s of valve" in said
    written = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_allclose(written[:, 1], U)
    np.testing.assert_allclose(np.diff(written[:, 0]), plant.Ts)
