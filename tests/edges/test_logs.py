"""Recordings of every format come out as the same arrays, or are refused with the reason."""

import os
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from drives import drive
from log_files import CASES, check_same, read, write

from tuners.logs import LogError, SelectionError
from tuners.logs.actuator import through_actuator
from tuners.logs.columns import find
from tuners.logs.csv_file import find_layout
from tuners.logs.options import Options
from tuners.logs.table import Column, Table
from tuners.logs.time_base import pace_of, time_base

VEHICLE, LAG = CASES["vehicle"], CASES["lag"]
RNG = np.random.default_rng(0)


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"


# Files


LAYOUTS = {
    "commas": {},
    "semicolons": {"delimiter": ";"},
    "tabs": {"delimiter": "\t"},
    "bars": {"delimiter": "|"},
    "blanks": {"delimiter": " "},
    "decimal commas": {"delimiter": ";", "decimal": ","},
    "a byte order mark": {"encoding": "utf-8-sig"},
    "UTF-16": {"encoding": "utf-16"},
    "comments and a preamble": {"above": "# driver: A\n% dry\n\nLogger 3000\n"},
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_text_of_any_layout(path, case, layout):
    log = read(write(path, case.columns, **layout), case.plant)
    check_same(log, case)
    assert log.notes == ()


def test_layout_of_a_table():
    lines = ["t;steer;comment", "s;rad;", "0,0;1,5;start", "0,1;-2;", "0,2;-2;"]
    layout = find_layout("\n".join(lines))
    assert (layout.delimiter, layout.body) == (";", len("\n".join(lines[:2])) + 1)
    assert layout.units == ("s", "rad", "")


def test_binary_formats(tmp_path, case):
    import h5py
    import pyarrow as pa
    from pyarrow import parquet
    from scipy.io import savemat

    parquet.write_table(pa.table(case.columns), tmp_path / "log.parquet")
    savemat(tmp_path / "five.mat", case.columns)
    savemat(tmp_path / "struct.mat", {"log": {"data": case.columns, "driver": "A"}})
    with h5py.File(tmp_path / "seven.mat", "w", userblock_size=512) as file:
        for name, values in case.columns.items():
            file.require_group("log")[name] = values[None]  # a MATLAB column
    for name in ("log.parquet", "five.mat", "struct.mat", "seven.mat"):
        check_same(read(tmp_path / name, case.plant), case)
    # The columns of a matrix have numbers.
    savemat(tmp_path / "x.mat", {"X": np.stack(list(case.columns.values()), axis=1)})
    columns = {"time": "1", "input": "X:2", "output": "3", case.measured: "X:4"}
    check_same(read(tmp_path / "x.mat", case.plant, columns=columns), case)


def test_mdf_channels_have_clocks_of_their_own(tmp_path, case):
    asammdf = pytest.importorskip("asammdf")
    t, *values = case.columns.values()
    with asammdf.MDF(version="4.10") as file:
        for name, signal, every in zip(case.names[1:], values, (1, 1, 10), strict=True):
            file.append(asammdf.Signal(signal[::every], t[::every], name=name))
        file.save(tmp_path / "log.mf4")
    log = read(tmp_path / "log.mf4", case.plant)
    count = len(log.u)  # the last measured parameter comes before the last output
    assert len(t) - 10 < count
    check_same(log, replace(case, u=case.u[:count], y=case.y[:count]))


def test_mdf_groups_with_rounded_stamps_or_none_at_all(tmp_path, case):
    asammdf = pytest.importorskip("asammdf")
    t, *values = case.columns.values()
    with asammdf.MDF(version="4.10") as file:
        file.append(asammdf.Signal(case.u[:0], t[:0], name=case.names[1]))
        for name, signal, off in zip(case.names[1:], values, (1e-15, 0, -1e-12), strict=True):
            file.append(asammdf.Signal(signal, t + off, name=name))
        file.save(tmp_path / "log.mf4")
    check_same(read(tmp_path / "log.mf4", case.plant), case)
    with asammdf.MDF(version="4.10") as file:
        for name, signal in zip(case.names[1:], values, strict=True):
            count = 0 if signal is case.y else None
            file.append(asammdf.Signal(signal[:count], t[:count], name=name))
        file.save(tmp_path / "log.mf4", overwrite=True)
    with pytest.raises(LogError, match=case.names[2]):
        read(tmp_path / "log.mf4", case.plant)


def test_a_stray_quote_costs_its_row(path, case):
    lines = write(path, case.columns).read_text().splitlines()
    lines[51] += '"'
    path.write_text("\n".join(lines))
    log = read(path, case.plant)
    assert "1 incomplete row" in log.notes[0] and len(log.u) == len(case.u)
    np.testing.assert_allclose(log.y[51:], case.y[51:])


def test_parquet_columns_of_other_types(tmp_path):
    import decimal

    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "log.parquet"
    t, u, y, v = VEHICLE.columns.values()
    table = {
        "t": pa.array(np.rint(1e6 * t).astype(int), pa.duration("us")),
        "steer": [decimal.Decimal(f"{x:.9f}") for x in u],
        "yaw_rate": [f"{x:.12e}" for x in y],
        "speed": v.astype(np.float16),
    }
    pq.write_table(pa.table(table), path, write_page_checksum=True, compression="none")
    log = read(path, VEHICLE.plant)
    assert log.Ts == VEHICLE.Ts
    np.testing.assert_allclose(log.u, u, atol=1e-9)
    np.testing.assert_allclose(log.y, y, atol=1e-11)
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)
    with pytest.raises(LogError, match="Parquet.*CRC"):
        read(path, VEHICLE.plant)


def test_a_pipe_is_read_whole(tmp_path, path):
    content, pipe = write(path, LAG.columns).read_bytes(), tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(content,))
    writer.start()
    check_same(read(pipe, LAG.plant), LAG)
    writer.join()


@pytest.mark.parametrize(
    "content, message",
    [
        (b"", "is empty"),
        (b"hello", "fewer than two lines"),
        (b"a,b\nc,d\n", "No row of numbers"),
        (b'a,b\n1,"2\n', "cannot be read"),
        (b"\x00\x01\x02" * 100, "zero bytes"),
        (b"PAR1 and nothing else", "Parquet file"),
        (b"MATLAB 5.0 MAT-file" + bytes(200), "MATLAB file"),
        (b"\x89HDF\r\n\x1a\n broken", "MATLAB file"),
        (b"MDF     4.10" + bytes(200), "MDF file"),
        (b"x,z,w\n" + b"1,2,3\n" * 20, "there are x, z, w.*--input-column"),
    ],
)
def test_other_files_are_refused(path, content, message):
    path.write_bytes(content)
    with pytest.raises(LogError, match=message) as caught:
        read(path, VEHICLE.plant)
    assert str(path) in str(caught.value) or "column" in message


def test_words_among_numbers_and_absent_files_are_named(path, case):
    with pytest.raises(LogError, match=str(path)):
        read(path, case.plant)
    u = case.u.tolist()
    u[122] = "left"
    with pytest.raises(LogError, match=f"Column {case.names[1]} has 'left' in data row 123"):
        read(write(path, case.changed(input=u)), case.plant)


def test_mdf_without_its_reader_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "log.mf4").write_bytes(b"MDF     4.10" + bytes(200))
    with pytest.raises(LogError, match=r'pip install "yawrate\[mdf\]"'):
        read(tmp_path / "log.mf4", LAG.plant)


# Columns


@pytest.mark.parametrize(
    "role, name",
    [("input", "Steering_Cmd [deg]"), ("input", "log.delta_f_cmd"), ("input", "steering command"),
     ("output", "YawRate"), ("output", "psi_dot"), ("output", "y_rad_s"), ("v_x", "v_x"),
     ("v_x", "v_mps"), ("v_x", "Vehicle Speed (km/h)"), ("time", "Timestamp_ms")],
)  # fmt: skip
def test_names_that_a_vehicle_has(role, name):
    rest = {"time": "t", "input": "steer", "output": "yaw_rate", "v_x": "speed"}
    del rest[role]
    table = Table(("other", name, *rest.values()), lambda _: Column(np.ones(9)))
    assert find(table, VEHICLE.plant, Options()).quantities[role].name == name


@pytest.mark.parametrize(
    "names",
    ["tuyK", ("Time", "Valve", "FLOW", "k"), ("t", "valve_%", "y", "K"),
     ("zeit", "log.valve [%]", "flow_l/s", "K (-)")],
)  # fmt: skip
def test_names_that_a_lag_has(path, names):
    columns = dict(zip(names, LAG.columns.values(), strict=True))
    check_same(read(write(path, columns), LAG.plant), LAG)


def test_the_first_of_the_plants_names_wins(path):
    columns = VEHICLE.columns | {"u": 0 * VEHICLE.u, "y": 0 * VEHICLE.y, "v": 0 * VEHICLE.u}
    check_same(read(write(path, columns), VEHICLE.plant), VEHICLE)


def test_columns_are_given_by_name_or_number(path, case):
    write(path, dict(zip("abcd", case.columns.values(), strict=True)))
    roles = "time", "input", "output", case.measured
    for header, given in ((True, "abcd"), (True, "1234"), (False, "1234")):
        if not header:
            path.write_text(path.read_text().partition("\n")[2])
        check_same(read(path, case.plant, columns=dict(zip(roles, given, strict=True))), case)


@pytest.mark.parametrize(
    "options, error, message",
    [
        ({"columns": {"input": "zork"}}, SelectionError, "zork.*there are t"),
        ({"columns": {"input": "3", "output": "3"}}, SelectionError, "both column"),
        ({"columns": {"zork": "3"}}, SelectionError, "'zork' is unknown"),
        ({"values": {"T": 1.0}}, SelectionError, "'T' is unknown"),
        ({"values": {"input": 1.0}}, SelectionError, "input"),
        ({"input_is": "measured"}, SelectionError, "input_is.*actuator"),
        ({"start": 20.0, "stop": 30.0}, SelectionError, r"20 and 30 s"),
    ],
)
def test_choices_that_a_log_does_not_have(path, options, error, message):
    with pytest.raises(error, match=message):
        read(write(path, LAG.columns), LAG.plant, **options)
    with pytest.raises(SelectionError, match="'K'.*no measured parameters"):
        read(path, replace(LAG.plant, measured={}), values={"K": 1.0})


@pytest.mark.parametrize(
    "change, message",
    [
        ({"synonyms": {"input": "steer"}}, "synonyms input"),
        ({"synonyms": {"zork": ("steer",)}}, "synonyms.*zork"),
        ({"cautions": {"swa": 1}}, "cautions swa"),
    ],
)
def test_a_plants_names_for_logs_are_checked(change, message):
    with pytest.raises(ValueError, match=message):
        replace(LAG.plant, **change)


# Measured parameters


def test_a_measured_parameter_is_a_column_or_a_value(path, case):
    name, value = case.measured, case.value
    write(path, case.columns | {case.names[3]: 0 * case.u, "other": 0 * case.u + value})
    check_same(read(path, case.plant, values={name: value}), case)
    check_same(read(path, case.plant, columns={name: "other"}), case)
    label = case.names[3].upper()  # what the plant calls it, in any case
    check_same(read(path, case.plant, values={label: value}), case)
    for double in ({"values": {name: value, f"{name} ": value}}, {"values": {name: value},
                   "columns": {label: "other"}}):  # fmt: skip
        with pytest.raises(SelectionError, match="given twice"):
            read(path, case.plant, **double)


def test_a_measured_parameter_that_is_missing(path, case):
    columns = case.columns
    del columns[case.names[3]]
    low, high = case.plant.prior[case.measured]
    with pytest.raises(LogError, match=f"{low:g} to {high:g}.*--measured {case.names[3]}={high:g}"):
        read(write(path, columns), case.plant)
    known = replace(case.plant, prior=case.plant.prior | {case.measured: (case.value,) * 2})
    log = read(path, known)
    check_same(log, case)
    assert case.names[3] in log.notes[0]


def test_a_parameter_that_is_recorded_less_often_is_interpolated(path, case):
    values = case.value + 1e-5 * np.arange(len(case.u))
    text = [x if k % 10 == 0 else "" for k, x in enumerate(values.tolist())]
    log = read(write(path, case.changed(measured=text)), case.plant)
    assert log.notes == () and len(log.u) == len(values)
    np.testing.assert_allclose(log.measured[case.measured][:-10], values[:-10])


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
