"""Help, wrong usage and start of the command."""

import os
import subprocess
import sys

import click
import pytest
from command import (
    EXAMPLE,
    TRUSTED,
    UNUSABLE,
    WRONG,
    call,
    refused,
    tuner_of,
)
from imports import modules_after
from recordings import ROOT

from tuners.catalogue import shipped
from tuners.cli import COMMANDS, main
from yawrate_env import plants
from yawrate_env.plant.entry import from_toml
from yawrate_env.vehicle.vehicle_file import example as paper


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
