"""Logs of closed loops on the command line: with a reference, with the old gains, with neither."""

import numpy as np
import pytest
from command import UNTRUSTED, WRONG, call, refused, tuned
from log_files import CASES, read, write

from studies.closed_loops import driven

TUNER = "ts-ff-lag-vx"
DEGREE = float(np.radians(1.0))


@pytest.fixture(scope="module")
def drives():
    return driven(2, seed=0)


def columns(drives, i):
    t = 0.01 * np.arange(drives.y.shape[1])
    speed = np.full(len(t), drives.v_x[i])
    names = ("t", "steer", "yaw_rate", "speed", "wanted")
    return dict(zip(names, (t, drives.u[i], drives.y[i], speed, drives.reference[i]), strict=True))


@pytest.fixture(scope="module")
def log(drives, tmp_path_factory):
    return write(tmp_path_factory.mktemp("loops") / "loop.csv", columns(drives, 0))


@pytest.mark.parametrize("way", ["reference", "old gains"])
def test_a_loop_is_tuned_with_its_reference_or_its_old_gains(way, drives, log):
    kp, Ti = drives.gains[0]
    old = ("--old-kp", f"{kp:.12g}", "--old-Ti", f"{Ti:.12g}")
    found = tuned(log, TUNER, *(("--reference", "wanted") if way == "reference" else old))
    assert drives.good(np.array([[found["kp"], found["Ti"]]] * 2))[0]
    assert any("reference explains 9" in note for note in found["notes"])
    assert not any("late" in note for note in found["notes"])


def test_a_loop_that_does_not_say_so_is_refused_and_told_what_helps(log):
    code, out, _ = call("tune", log, "--tuner", TUNER)
    assert code == UNTRUSTED
    assert "--reference" in out and "--old-kp" in out
    assert "late" not in out and "sooner" not in out


def test_the_reference_has_the_outputs_unit_and_sign(drives, tmp_path):
    given = columns(drives, 0)
    given["yaw_rate"], given["wanted"] = -given["yaw_rate"] / DEGREE, -given["wanted"] / DEGREE
    path = write(tmp_path / "degrees.csv", given)
    plant = CASES["vehicle"].plant
    options = {"columns": {"reference": "wanted"}, "units": {"output": "deg/s"}}
    read_as = read(path, plant, **options, output_scale=-1.0)
    np.testing.assert_allclose(read_as.reference, drives.reference[0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(read_as.y, drives.y[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "flags, named",
    [
        ("--old-kp 0.1", "--old-Ti"),
        ("--old-Ti 0.1", "--old-kp"),
        ("--reference wanted --old-kp 0.1 --old-Ti 0.1", "contradict"),
        ("--reference absent", "absent"),
        ("--reference yaw_rate", "yaw_rate"),
        ("--reference wanted --input-is measured", "contradict"),
        ("--old-kp 0.1 --old-Ti 0.1 --input-is measured", "contradict"),
        ("--old-kp 0 --old-Ti 0.1", "--old-kp"),
    ],
)
def test_what_contradicts_itself_is_refused_before_any_work(flags, named, log):
    assert named in refused(WRONG, "tune", log, *flags.split())
