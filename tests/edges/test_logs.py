"""Time base and stretch of a log, and what is refused or noted of its signals."""

from dataclasses import replace

import numpy as np
import pytest
from drives import drive
from log_files import CASES, check_same, read, write

from tuners.logs import LogError
from tuners.logs.actuator import through_actuator
from tuners.logs.time_base import pace_of, time_base

VEHICLE, LAG = CASES["vehicle"], CASES["lag"]
RNG = np.random.default_rng(0)


# Time


def test_rounded_stamps_are_an_even_grid():
    base = time_base(np.round(np.arange(1000) / 30, 3), 3.0, pace_of(VEHICLE.plant))
    assert base.even and base.notes == ()
    assert base.Ts == pytest.approx(1 / 30, rel=1e-4)


def test_jitter_is_resampled_and_noted(path, case):
    t = case.columns["t"] + RNG.uniform(-0.2, 0.2, len(case.u)) * case.Ts
    log = read(write(path, case.changed(time=t, output=np.sin(2 * t))), case.plant)
    assert "resampled" in log.notes[0]
    assert log.Ts == pytest.approx(case.Ts, rel=1e-4)
    np.testing.assert_allclose(log.y, np.sin(2 * log.time), atol=2e-4)
    both = min(len(log.u), len(t))
    np.testing.assert_allclose(log.u[:both], case.u[:both], atol=1e-9)


def test_a_gap_leaves_the_longest_stretch_and_lost_samples_are_bridged(path, case):
    kept = np.r_[0:100, 200 : len(case.u)]
    log = read(write(path, {n: v[kept] for n, v in case.columns.items()}), case.plant)
    assert "gap" in log.notes[0] and "sample 101" in log.notes[0]
    assert log.t0 == pytest.approx(200 * case.Ts) and len(log.u) == len(case.u) - 200
    y = case.y.tolist()
    y[100] = "NaN"
    log = read(write(path, case.changed(output=y)), case.plant)
    assert len(log.notes) == 2 and len(log.u) == len(y)
    assert abs(log.y[100] - case.y[100]) < 0.2 * np.ptp(case.y)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda t, Ts: np.where(np.arange(len(t)) % 140 == 139, t - 5 * Ts, t),
         r"runs backwards at t = .* \(sample 140\)"),
        (lambda t, Ts: t + 2.0 * (np.arange(len(t)) // 140), "A gap of 2"),
        (lambda t, Ts: 0 * t, "Time"),
        (lambda t, Ts: np.floor(t) + 1.7e9, "repeat.*--Ts"),
        (lambda t, Ts: 1e3 * t, "sampling time is .*--time-unit"),
    ],
)  # fmt: skip
def test_time_that_cannot_be_used_is_refused(path, case, change, message):
    with pytest.raises(LogError, match=message):
        read(write(path, case.changed(time=change(case.columns["t"], case.Ts))), case.plant)


def test_clocks_and_dates_are_times(path, case):
    t, *rest = case.columns.values()
    for name, stamps in {
        "t_ns": [1700000000000000000 + round(1e9 * x) for x in t],
        "t": [f"2026-01-01 12:00:{x:06.3f}" for x in t],
    }.items():
        columns = dict(zip((name, *case.names[1:]), (stamps, *rest), strict=True))
        log = read(write(path, columns), case.plant)
        assert log.Ts == case.Ts and log.u == pytest.approx(case.u)


def test_the_sampling_time_may_be_given(path, case):
    columns = case.columns
    del columns["t"]
    with pytest.raises(LogError, match="time.*--Ts"):
        read(write(path, columns), case.plant)
    check_same(read(path, case.plant, Ts=case.Ts), case)
    with pytest.raises(LogError, match="sampling time is 0.5 s"):
        read(path, case.plant, Ts=0.5)


# Stretches and excitation


def test_a_stretch_is_chosen(path, case):
    log = read(write(path, case.columns), case.plant, start=2.0, stop=6.0)
    first, last = round(2 / case.Ts), round(6 / case.Ts) + 1
    assert log.t0 == 2.0 and len(log.u) == last - first
    np.testing.assert_allclose(log.y, case.y[first:last], rtol=1e-9)


def test_the_best_excited_stretch_is_found(path, case):
    length = 2 * len(case.plant.u) * case.plant.Ts
    quiet = np.zeros(round(1.5 * length / case.Ts))
    u = np.concatenate([quiet, case.u, quiet])
    t = case.Ts * np.arange(len(u))
    u = u + 0.01 * np.ptp(u) * np.sin(0.3 * t)
    columns = (t, u, np.cos(t), np.full(len(t), case.value))
    log = read(write(path, dict(zip(case.names, columns, strict=True))), case.plant)
    assert log.t0 <= t[len(quiet)] and log.t0 + length >= t[len(quiet) + len(case.u) - 1]
    at = np.searchsorted(t, log.t0 - 1e-9)
    np.testing.assert_allclose(log.u, u[at : at + len(log.u)], atol=1e-9)
    assert any("Best-excited" in note for note in log.notes)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"input": lambda x: 0 * x + 0.02}, "is constant"),
        ({"output": lambda x: 0 * x}, "is constant"),
        ({"input": lambda x: 1e-3 * x}, "hardly moves"),
        ({"measured": lambda x: 0 * x}, "runs from 0 to 0"),
        ({"measured": lambda x: 100 * x}, "must lie between"),
        ({"measured": lambda x: x * np.linspace(0.8, 1.2, len(x))}, "varies from .* --from"),
    ],
)
def test_hopeless_recordings_are_refused(path, case, change, message):
    values = dict(zip(("time", "input", "output", "measured"), case.columns.values(), strict=True))
    changed = {role: function(values[role]) for role, function in change.items()}
    with pytest.raises(LogError, match=message):
        read(write(path, case.changed(**changed)), case.plant)


def test_values_that_no_car_reaches_and_slow_drift_are_refused(path):
    drift = 0.02 * np.sin(2e-3 * np.arange(len(VEHICLE.u))) + 1e-6 * VEHICLE.u
    for change, message in (
        ({"input": drift}, "hardly moves between 0.5 and 5 Hz"),
        ({"input": 57.3 * VEHICLE.u}, "rad, at most.*--input-unit"),
        ({"output": 400 * VEHICLE.y}, "rad/s, at most.*--output-unit"),
    ):
        with pytest.raises(LogError, match=message):
            read(write(path, VEHICLE.changed(**change)), VEHICLE.plant)


def test_short_recordings_are_refused(path, case):
    count = round(2.5 / case.Ts)
    write(path, {name: values[:count] for name, values in case.columns.items()})
    with pytest.raises(LogError, match=r"2\.50 s are too short; at least 3 s"):
        read(path, case.plant)
    write(path, {name: values[:9] for name, values in case.columns.items()})
    with pytest.raises(LogError, match="9 complete samples"):
        read(path, case.plant)


def test_excitation_is_measured_and_weakness_noted(path, case):
    log = read(write(path, case.columns), case.plant)
    found = log.excitation
    assert found.amplitude == pytest.approx(np.ptp(case.u) / 2) and found.notes == ()
    assert found.duration == pytest.approx(len(case.u) * case.Ts)
    assert found.band == pytest.approx((case.plant.crossover / 3, case.plant.crossover / 0.3))
    assert 0.3 < found.rms / found.amplitude < 1 and found.changes > 4
    weak = read(write(path, case.changed(input=0.05 * case.u)), case.plant)
    assert "Weak excitation" in weak.notes[0] and weak.notes == weak.excitation.notes


def test_hard_cornering_and_the_hand_wheel_are_noted(path):
    log = read(write(path, VEHICLE.changed(output=4 * VEHICLE.y)), VEHICLE.plant)
    assert "Lateral acceleration" in log.notes[0]
    columns = dict(zip(("t", "SWA [deg]", "r", "v"), VEHICLE.columns.values(), strict=True))
    columns["SWA [deg]"] = np.degrees(16 * VEHICLE.u)
    log = read(write(path, columns), VEHICLE.plant, input_scale=1 / 16)
    check_same(log, VEHICLE)
    assert not any("hand wheel" in note for note in log.notes)
    columns["SWA [deg]"] /= 16
    assert any("hand wheel" in n for n in read(write(path, columns), VEHICLE.plant).notes)


def test_a_plant_that_starts_at_rest_is_read_from_its_start(path):
    bent = replace(LAG.plant, linear=False, black_box=None)
    columns = LAG.columns
    check_same(read(write(path, columns), bent), LAG)
    y = LAG.y.tolist()
    y[0] = ""
    with pytest.raises(LogError, match="first row.*--from"):
        read(write(path, LAG.changed(output=y)), bent)
    kept = np.r_[0:100, 160 : len(LAG.u)]
    with pytest.raises(LogError, match="from the plant's start on"):
        read(write(path, {n: v[kept] for n, v in columns.items()}), bent)


# A measured actuator position


@pytest.mark.parametrize("Ts", [0.001, 0.01])
def test_measured_angles_give_the_whole_vehicle(Ts):
    """Output of the whole vehicle for the measured angle, against python-control's drive."""
    _, angle, yaw_rate = drive(Ts=Ts, warm_up=0.0, snr_db=200.0, seconds=8.0)
    command, filtered, fine, parts = through_actuator(angle, yaw_rate, Ts, VEHICLE.plant)
    assert fine == pytest.approx(0.001) and parts == round(Ts / fine)
    expected = VEHICLE.plant.respond(np.array([[0.8, 120.0, 18.0]]), command)[0]
    error = np.sqrt(np.mean((filtered - expected) ** 2)) / expected.std()
    assert error < (1e-4 if Ts == 0.001 else 4e-3)


def test_measured_angles_are_noted(path):
    log = read(write(path, VEHICLE.columns), VEHICLE.plant, input_is="measured")
    assert log.Ts == pytest.approx(0.001) and log.recorded_Ts == VEHICLE.Ts
    count = 10 * (len(VEHICLE.u) - 1)
    assert len(log.u) == len(log.y) == len(log.measured["v_x"]) == count
    assert any("filtered through the actuator" in note for note in log.notes)


def test_the_outputs_unit_needs_no_reference(tmp_path):
    case = CASES["vehicle"]
    path = write(tmp_path / "log.csv", case.changed(output=np.degrees(case.y)))
    check_same(read(path, case.plant, units={"output": "deg/s"}), case)
