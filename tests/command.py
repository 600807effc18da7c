"""The yawrate command as a user calls it, for two plants: a vehicle and a first-order lag."""

import json
import re
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from click.testing import CliRunner
from first_order import gauged
from log_files import CASES
from recordings import ROOT

import tuners
from tuners.cli import main
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.logs import Log
from tuners.logs.excitation import check
from yawrate_env.vehicle.vehicle_file import example as paper

EXAMPLE = ROOT / "examples" / "log.csv"
TRUSTED, UNUSABLE, WRONG, UNTRUSTED = 0, 1, 2, 3
FEW = tuners.Recipe(
    Laguerre(4, 3.0), FeedForwardSettings(neurons=8, epochs=200, max_fail=20), noise_draws=2
)


def call(*arguments):
    """Exit status, stdout, stderr; exceptions are raised."""
    done = CliRunner().invoke(main, list(map(str, arguments)), catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


def refused(status, *arguments):
    """The one line of a refusal."""
    code, out, err = call(*arguments)
    assert code == status, (code, out, err)
    assert out == "" and re.fullmatch(r"error: [^\n]+\n", err), (out, err)
    return err


def tuned(log, tuner, *flags):
    """What ``yawrate tune --json`` prints; the exit status agrees with it."""
    code, out, err = call("tune", log, "--tuner", tuner, "--json", *flags)
    assert err == "" and code in (TRUSTED, UNTRUSTED), err
    found = json.loads(out)
    assert found["trusted"] is (code == TRUSTED)
    return found


@cache
def tuner_of(name):
    """A tuner, by name or file, for the plant of a case."""
    if name == "vehicle":
        return "ts-ff-lag-vx"
    path = Path(mkdtemp(prefix="tuner")) / "lag.tuner"
    tuners.train(FEW, gauged, episodes=300, calibration=128).save(path)
    return str(path)


def log_of(name, **changes):
    """A case's log without a file; `changes` are those of its attributes."""
    case = CASES[name]
    measured = {case.measured: 0 * case.y + case.value}
    excited = check(case.plant, case.u, case.y, measured, case.Ts)
    values = {"source": "log.csv", "t0": 12.0, "u": case.u, "y": case.y, "Ts": case.Ts,
              "measured": measured, "notes": (), "excitation": excited,
              "recorded_Ts": case.Ts} | changes  # fmt: skip
    return Log(**values)


@cache
def result_of(name, sign=1):
    """The tuner's result for a case's recording, or with the input's sign reversed."""
    log = log_of(name)
    return tuners.load(tuner_of(name)).tune(sign * log.u, log.y, log.Ts, log.measured)


def lag_file(folder):
    """TOML of the lag; its module is one of the tests'."""
    (folder / "lag.toml").write_text('[plant]\nentry = "first_order:gauged"\n')
    return folder / "lag.toml"


def short(path, J_z=2400.0):
    """A vehicle's file, with short episodes."""
    text = paper().replace("N = 10_000", "N = 1_000").replace("Ts = 0.001", "Ts = 0.01")
    path.write_text(text.replace("J_z = 2400.0", f"J_z = {J_z}"))
    return path
