"""From a log file to gains: what an engineer gets for drives that python-control simulated."""

from dataclasses import replace

import numpy as np
import pytest
from command import TRUSTED, call, tuned
from drives import PAPER, drive
from log_files import write

import tuners
from tuners.cli.tuning import DEFAULT
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.vehicle_file import example
from yawrate_env.vehicle.yaw_rate import yaw_rate

VEHICLES = [(0.45, 40.0), (0.8, 120.0), (1.05, 280.0)]
SPEEDS = [28.0, 18.0, 15.0]


@pytest.fixture(params=["gb", DEFAULT])
def tuner(request):
    return request.param


def log_of(path, steer, yaw_rate, speed, Ts=0.01, t0=0.0):
    t = t0 + Ts * np.arange(len(steer))
    columns = {"t": t, "steer": steer, "yaw_rate": yaw_rate, "speed": 0 * t + speed}
    return write(path / "log.csv", columns)


def off_target(found, mu_s, M_delta, v_x, vehicle=PAPER):
    """Phase margin and crossover of the true vehicle's loop, less the target's."""
    plant, theta = yaw_rate(Task(vehicle)), np.array([[mu_s, M_delta, v_x]])
    return plant.errors(theta, np.array([[found["kp"], found["Ti"]]]))[0]


def check_on_target(found, mu_s, M_delta, v_x, vehicle=PAPER, phase=0.5, crossover=0.02):
    errors = off_target(found, mu_s, M_delta, v_x, vehicle)
    assert abs(errors[0]) < phase and abs(errors[1]) < crossover
    return errors


@pytest.mark.parametrize("mu_s, M_delta", VEHICLES)
def test_a_drive_as_in_the_training(tmp_path, tuner, mu_s, M_delta):
    u, _, y = drive(mu_s, M_delta, 20.0, Ts=0.001, seconds=10.0, warm_up=0.0, order=7)
    found = tuned(log_of(tmp_path, u, y, 20.0, Ts=0.001), tuner)
    phase, _ = check_on_target(found, mu_s, M_delta, 20.0, phase=0.1, crossover=0.005)
    assert found["trusted"]
    # The intervals are around the truth, which is not in the log.
    assert found["phase_margin"]["low"] - 0.1 < 60 + phase < found["phase_margin"]["high"] + 0.1


@pytest.mark.parametrize(
    "mu_s, M_delta, v_x", [(*v, s) for v, s in zip(VEHICLES, SPEEDS, strict=True)]
)
def test_a_drive_that_no_training_saw(tmp_path, tuner, mu_s, M_delta, v_x):
    """Another signal and speed, 100 Hz, from mid-drive, an offset on both channels."""
    u, _, y = drive(mu_s, M_delta, v_x, bias=np.radians(0.3), offset=np.radians(0.5))
    found = tuned(log_of(tmp_path, u, y, v_x, t0=5.0), tuner)
    check_on_target(found, mu_s, M_delta, v_x)
    assert found["trusted"] and not found["fit"]["from_rest"]


def test_a_measured_angle_leads_to_the_same_loop(tmp_path, tuner):
    _, angle, y = drive(0.8, 120.0, 18.0)
    log = log_of(tmp_path, angle, y, 18.0)
    check_on_target(tuned(log, tuner, "--steer-is", "measured"), 0.8, 120.0, 18.0)
    asked = tuned(log, tuner)  # as if it were the command
    assert asked["verdict"] != "usable"
    assert not asked["trusted"] or any("is the logged" in why for why in asked["reasons"])


def test_degrees_a_hand_wheel_and_km_per_hour_give_the_same_gains(tmp_path):
    u, _, y = drive()
    expected = tuned(log_of(tmp_path, u, y, 18.0), DEFAULT)["gains"]
    log = log_of(tmp_path, 16 * np.degrees(u), np.degrees(y), 3.6 * 18.0)
    found = tuned(log, DEFAULT, "--steer-unit", "deg", "--steer-ratio", 16,
                  "--yaw-rate-unit", "deg/s", "--speed-unit", "km/h")  # fmt: skip
    assert found["gains"] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("fault", ["unit", "dead"])
def test_a_wrong_unit_and_a_dead_sensor_are_not_trusted(tmp_path, tuner, fault):
    u, _, y = drive()
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(u))
    found = tuned(log_of(tmp_path, u, {"unit": 3 * y, "dead": noise}[fault], 18.0), tuner)
    assert not found["trusted"] and found["reasons"] and found["fallback"]["kp"] > 0


def test_a_tuner_of_ones_own_lands_as_well(tmp_path, monkeypatch):
    """Another car, a narrow prior, few vehicles; the drive is not the training's either."""
    monkeypatch.setattr("tuners.cli.train.CALIBRATION", 200)
    monkeypatch.setattr("tuners.cli.train.VALIDATION", 60)
    vehicle = replace(PAPER, J_z=2900.0, l_f=1.3)
    text = example().replace("J_z = 2400.0", "J_z = 2900.0").replace("l_f = 1.18", "l_f = 1.3")
    text = text.replace("N = 10_000", "N = 1_000").replace("Ts = 0.001", "Ts = 0.01")
    (tmp_path / "car.toml").write_text(text.replace("v_x = 20.0", "v_x = 18.0"))
    made = tmp_path / "car.tuner"
    code, out, err = call(
        "train", "--vehicle", tmp_path / "car.toml", "--episodes", 400, "-o", made
    )  # fmt: skip
    assert code == TRUSTED and "training" in err and "calibrating" in err, err
    assert "0 of 60 loops unstable" in out and out.count(" rms (bound ") == 2
    assert tuners.load(made).plant.arguments["vehicle"]["J_z"] == 2900.0
    u, _, y = drive(vehicle=vehicle)
    log = log_of(tmp_path, u, y, 18.0)
    found = tuned(log, made)
    check_on_target(found, 0.8, 120.0, 18.0, vehicle)
    assert found["trusted"]
    papers = tuned(log, "gb")
    assert not papers["trusted"] or max(abs(off_target(papers, 0.8, 120.0, 18.0, vehicle))) > 0.5


def test_an_input_that_is_joined_by_lines(tmp_path):
    """A generator's ramps, logged at 20 Hz: taken for held they act early."""
    plant, Ts = tuners.load("gb").plant, 0.05
    t = Ts * np.arange(201)
    steer = np.radians(1.0) * np.sign(np.random.default_rng(3).standard_normal(201))
    fine = np.interp(0.001 * np.arange(10001) + 0.0005, t, steer)
    theta = np.array([[0.8, 120.0, 20.0]])
    y = plant.respond(theta, fine)[0, ::50]
    y += 1e-4 * np.random.default_rng(0).standard_normal(201)
    log = log_of(tmp_path, steer, y, 20.0, Ts)
    lines = tuned(log, "gb", "--input-between", "lines")
    check_on_target(lines, *theta[0], phase=0.5, crossover=0.02)
    held = tuned(log, "gb", "--input-between", "held")
    assert abs(off_target(held, *theta[0])[0]) > 1.5
    assert tuned(log, "gb")["kp"] == held["kp"]
    assert call("tune", log, "--input-between", "held", "--input-is", "measured")[0] == 2
