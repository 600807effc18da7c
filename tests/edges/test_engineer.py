"""From a log file to gains: what an engineer gets for drives that python-control simulated."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from drives import PAPER, drive

import tuners
from tuners.catalogue import shipped
from tuners.cli import main
from tuners.cli.tune import DEFAULT
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.vehicle_file import example

TUNERS = ["gb", *([DEFAULT] if DEFAULT in tuners.NAMES and shipped(DEFAULT).exists() else [])]


def tune(path, tuner, *arguments):
    """What `yawrate tune --json` prints, and its exit status."""
    done = CliRunner().invoke(
        main, ["tune", str(path), "--tuner", tuner, "--json", *map(str, arguments)],
        catch_exceptions=False,
    )  # fmt: skip
    return json.loads(done.stdout or "null"), done.exit_code


def write(path, t, steer, yaw_rate, speed):
    table = np.stack([t, steer, yaw_rate, np.full(len(t), speed)], axis=1)
    np.savetxt(path, table, delimiter=",", header="t,steer,yaw_rate,speed", comments="")


def margins(found, mu_s, M_delta, v_x, vehicle=PAPER):
    """Phase margin and crossover of the true vehicle's loop, less the target's."""
    judge = loops(Task(vehicle), Context.of(mu_s, M_delta, v_x))
    verdict = judge.evaluate(np.array([found["kp"]]), np.array([found["Ti"]])).margins
    return verdict.phase_margin[0] - 60.0, verdict.crossover[0] - 1.5


VEHICLES = [(0.45, 40.0), (0.8, 120.0), (1.05, 280.0)]


@pytest.mark.parametrize("tuner", TUNERS)
@pytest.mark.parametrize("mu_s, M_delta", VEHICLES)
def test_a_drive_as_in_the_training(tmp_path, tuner, mu_s, M_delta):
    u, _, y = drive(mu_s, M_delta, 20.0, Ts=0.001, seconds=10.0, warm_up=0.0, order=7)
    write(tmp_path / "log.csv", 0.001 * np.arange(len(u)), u, y, 20.0)
    found, status = tune(tmp_path / "log.csv", tuner)
    phase, crossover = margins(found, mu_s, M_delta, 20.0)
    assert abs(phase) < 0.1 and abs(crossover) < 0.005
    assert status == 0 and found["trusted"]
    # The intervals are around the truth, which is not in the log.
    assert found["phase_margin"]["low"] - 0.1 < 60 + phase < found["phase_margin"]["high"] + 0.1


@pytest.mark.parametrize("tuner", TUNERS)
@pytest.mark.parametrize("v_x", [15.0, 18.0, 28.0])
@pytest.mark.parametrize("mu_s, M_delta", VEHICLES)
def test_a_drive_that_no_training_saw(tmp_path, tuner, mu_s, M_delta, v_x):
    """Another signal and speed, 100 Hz, from mid-drive, an offset on both channels."""
    u, _, y = drive(mu_s, M_delta, v_x, bias=np.radians(0.3), offset=np.radians(0.5))
    write(tmp_path / "log.csv", 5.0 + 0.01 * np.arange(len(u)), u, y, v_x)
    found, status = tune(tmp_path / "log.csv", tuner)
    phase, crossover = margins(found, mu_s, M_delta, v_x)
    assert abs(phase) < 0.5 and abs(crossover) < 0.02
    assert status == 0 and not found["fit"]["from_rest"]


@pytest.mark.parametrize("tuner", TUNERS)
def test_a_measured_angle_leads_to_the_same_loop(tmp_path, tuner):
    _, angle, y = drive(0.8, 120.0, 18.0)
    write(tmp_path / "log.csv", 0.01 * np.arange(len(angle)), angle, y, 18.0)
    found, _ = tune(tmp_path / "log.csv", tuner, "--steer-is", "measured")
    phase, crossover = margins(found, 0.8, 120.0, 18.0)
    assert abs(phase) < 0.5 and abs(crossover) < 0.02
    taken_as_command, status = tune(tmp_path / "log.csv", tuner)
    assert status == 3 and not taken_as_command["trusted"]


@pytest.mark.parametrize("tuner", TUNERS)
def test_all_formats_and_degrees_give_the_same_gains(tmp_path, tuner):
    import h5py
    import pyarrow as pa
    from pyarrow import parquet
    from scipy.io import savemat

    u, _, y = drive()
    t = 0.01 * np.arange(len(u))
    columns = {"t": t, "steer": u, "yaw_rate": y, "speed": np.full(len(t), 18.0)}
    write(tmp_path / "log.csv", *(columns[name] for name in ("t", "steer", "yaw_rate")), 18.0)
    write(tmp_path / "deg.csv", t, 16 * np.degrees(u), np.degrees(y), 3.6 * 18.0)
    savemat(tmp_path / "five.mat", columns)
    with h5py.File(tmp_path / "seven.mat", "w", userblock_size=512) as file:
        for name, values in columns.items():
            file[name] = values[None]
    parquet.write_table(pa.table(columns), tmp_path / "log.parquet")
    found = [tune(tmp_path / name, tuner)[0]
             for name in ("log.csv", "five.mat", "seven.mat", "log.parquet")]  # fmt: skip
    found.append(
        tune(tmp_path / "deg.csv", tuner, "--steer-unit", "deg", "--steer-ratio", 16,
             "--yaw-rate-unit", "deg/s", "--speed-unit", "km/h")[0]
    )  # fmt: skip
    for other in found[1:]:
        assert other["kp"] == pytest.approx(found[0]["kp"], rel=1e-9)
        assert other["Ti"] == pytest.approx(found[0]["Ti"], rel=1e-9)


@pytest.mark.parametrize("tuner", TUNERS)
def test_a_wrong_sign_a_wrong_unit_and_a_dead_sensor_are_not_trusted(tmp_path, tuner):
    u, _, y = drive()
    t = 0.01 * np.arange(len(u))
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(t))
    for name, steer, yaw_rate in (("sign", -u, y), ("unit", u, 3 * y), ("dead", u, noise)):
        write(tmp_path / f"{name}.csv", t, steer, yaw_rate, 18.0)
        found, status = tune(tmp_path / f"{name}.csv", tuner)
        assert status == 3 and found["reasons"] and found["fallback"]["kp"] > 0, name


def test_a_tuner_of_ones_own_lands_as_well(tmp_path):
    """Another car, a narrow prior, few vehicles; the drive is not the training's either."""
    vehicle = replace(PAPER, J_z=2900.0, l_f=1.3)
    text = example().replace("J_z = 2400.0", "J_z = 2900.0").replace("l_f = 1.18", "l_f = 1.3")
    (tmp_path / "car.toml").write_text(text.replace("v_x = 20.0", "v_x = 18.0"))
    made = CliRunner().invoke(
        main, ["train", "--vehicle", str(tmp_path / "car.toml"), "--episodes", "400",
               "-o", str(tmp_path / "car.tuner")], catch_exceptions=False,
    )  # fmt: skip
    assert made.exit_code == 0, made.output
    u, _, y = drive(vehicle=vehicle)
    write(tmp_path / "log.csv", 0.01 * np.arange(len(u)), u, y, 18.0)
    found, status = tune(tmp_path / "log.csv", str(tmp_path / "car.tuner"))
    phase, crossover = margins(found, 0.8, 120.0, 18.0, vehicle)
    assert abs(phase) < 0.5 and abs(crossover) < 0.02 and status == 0
    papers, status = tune(tmp_path / "log.csv", "gb")
    assert max(map(abs, margins(papers, 0.8, 120.0, 18.0, vehicle))) > 0.5 or status == 3
