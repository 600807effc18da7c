"""Recordings of every format come out as the same arrays, or are refused with the reason."""

import re
import sys

import control
import numpy as np
import pytest
from answers import drive

from tuners.logs import Choice, LogError, Options, SelectionError, read_log
from tuners.logs.actuator import actuated, through_actuator
from tuners.logs.columns import recognised
from tuners.logs.csv_file import find_layout
from tuners.logs.time_base import time_base
from yawrate_env.vehicle.single_track import Vehicle
from yawrate_env.vehicle.task import Prior, Task

TASK = Task(prior=Prior(v_x=(10.0, 33.0)))
TS = 0.01
RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def signals():
    u, _, r = drive(Ts=TS, seconds=8.0)
    return {"t": TS * np.arange(len(u)), "steer": u, "yaw_rate": r, "speed": np.full(len(u), 18.0)}


@pytest.fixture
def written(tmp_path, signals):
    """Write a text table of these columns."""

    def write(columns=None, *, delimiter=",", decimal=".", above="", names=None, encoding="utf-8"):
        columns = signals if columns is None else columns
        rows = [delimiter.join(names or columns)]
        for values in zip(*columns.values(), strict=True):
            cells = (f"{v:.12g}" if isinstance(v, float) else str(v) for v in values)
            rows.append(delimiter.join(cell.replace(".", decimal) for cell in cells))
        path = tmp_path / "log.csv"
        path.write_bytes((above + "\n".join(rows) + "\n").encode(encoding))
        return path

    return write


def read(path, **options):
    return read_log(path, TASK, Options(**options))


def same(log, signals, rtol=1e-9):
    np.testing.assert_allclose(log.steer, signals["steer"], rtol=rtol)
    np.testing.assert_allclose(log.yaw_rate, signals["yaw_rate"], rtol=rtol)
    np.testing.assert_allclose(log.speed, signals["speed"], rtol=rtol)
    assert log.Ts == TS and log.t0 == 0.0


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
def test_text_of_any_layout_is_the_same_log(written, signals, layout):
    log = read(written(**layout))
    same(log, signals)
    assert log.notes == ()


def test_a_row_of_units_is_read(written, signals):
    degrees = signals | {"steer": np.degrees(signals["steer"]), "speed": signals["speed"] * 3.6}
    path = written(degrees)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], "s,deg,rad/s,km/h", *lines[1:]]))
    log = read(path)
    same(log, signals)
    assert log.notes == (
        "Column steer is taken to be in deg.",
        "Column speed is taken to be in km/h.",
    )


@pytest.mark.parametrize("form", ["steer [deg]", "steer (deg)", "steer_deg", "Steering Angle [°]"])
def test_a_unit_in_a_name_is_read(written, signals, form):
    degrees = {name: values for name, values in signals.items()} | {
        "steer": np.degrees(signals["steer"])
    }
    same(read(written(degrees, names=["t", form, "yaw_rate", "speed"])), signals)


@pytest.mark.parametrize("form", ["speed [kn]", "speed (vehicle)"])
def test_a_unit_that_is_not_understood_is_refused(written, signals, form):
    path = written(names=["t", "steer", "yaw_rate", form])
    with pytest.raises(LogError, match=r"none of m/s, km/h, mph\. Give --speed-unit"):
        read(path)
    same(read(path, choice=Choice(units={"speed": "m/s"})), signals)


def test_units_ratio_and_signs_are_applied(written, signals):
    given = signals | {
        "t": 1e3 * signals["t"],
        "steer": -16 * np.degrees(signals["steer"]),
        "yaw_rate": -np.degrees(signals["yaw_rate"]),
        "speed": 3.6 * signals["speed"],
    }
    units = {"time": "ms", "steer": "deg", "yaw_rate": "deg/s", "speed": "km/h"}
    log = read(written(given), choice=Choice(units=units), steer_ratio=16.0, steer_sign=-1,
               yaw_rate_sign=-1)  # fmt: skip
    same(log, signals)


def test_columns_are_taken_by_name_or_number(written, signals):
    names = ["a", "b", "c", "d"]
    path = written(names=names)
    for columns in (dict(zip(("time", "steer", "yaw_rate", "speed"), key, strict=True))
                    for key in (names, "1234")):  # fmt: skip
        same(read(path, choice=Choice(columns)), signals)


def test_without_a_header_columns_have_numbers(written, signals):
    path = written()
    path.write_text(path.read_text().partition("\n")[2])
    columns = {"time": "1", "steer": "2", "yaw_rate": "3", "speed": "4"}
    same(read(path, choice=Choice(columns)), signals)


def test_binary_formats_are_the_same_log(tmp_path, signals):
    import h5py
    import pyarrow as pa
    from pyarrow import parquet
    from scipy.io import savemat

    parquet.write_table(pa.table(signals), tmp_path / "log.parquet")
    savemat(tmp_path / "five.mat", signals)
    savemat(tmp_path / "struct.mat", {"log": {"data": signals, "driver": "A"}})
    with h5py.File(tmp_path / "seven.mat", "w", userblock_size=512) as file:
        group = file.create_group("log")
        for name, values in signals.items():
            group[name] = values[None]  # a MATLAB column
    for name in ("log.parquet", "five.mat", "struct.mat", "seven.mat"):
        same(read(tmp_path / name), signals)


def test_parquet_columns_of_other_types_are_numbers(tmp_path, signals):
    import decimal

    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "log.parquet"
    microseconds = np.rint(1e6 * signals["t"]).astype(int)
    table = {
        "t": pa.array(microseconds, pa.duration("us")),
        "steer": [decimal.Decimal(f"{v:.9f}") for v in signals["steer"]],
        "yaw_rate": [f"{v:.12e}" for v in signals["yaw_rate"]],
        "speed": signals["speed"].astype(np.float16),
    }
    pq.write_table(pa.table(table), path, write_page_checksum=True, compression="none")
    log = read(path)
    assert log.Ts == TS
    np.testing.assert_allclose(log.steer, signals["steer"], atol=1e-9)
    np.testing.assert_allclose(log.yaw_rate, signals["yaw_rate"], atol=1e-11)
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)
    with pytest.raises(LogError, match="Parquet file cannot be read: .*CRC"):
        read(path)


def test_a_matrix_has_numbered_columns(tmp_path, signals):
    from scipy.io import savemat

    savemat(tmp_path / "matrix.mat", {"X": np.stack(list(signals.values()), axis=1)})
    columns = {"time": "1", "steer": "X:2", "yaw_rate": "3", "speed": "X:4"}
    same(read(tmp_path / "matrix.mat", choice=Choice(columns)), signals)


def test_channels_of_mdf_with_clocks_of_their_own(tmp_path, signals):
    asammdf = pytest.importorskip("asammdf")
    slow = slice(None, None, 10)
    with asammdf.MDF(version="4.10") as file:
        for name, unit in (("steer", "rad"), ("yaw_rate", "rad/s"), ("speed", "m/s")):
            part = slow if name == "speed" else slice(None)
            file.append(
                asammdf.Signal(signals[name][part], signals["t"][part], name=name, unit=unit)
            )
        file.save(tmp_path / "log.mf4")
    log = read(tmp_path / "log.mf4")
    count = len(log.steer)  # the last speed comes before the last yaw rate
    assert len(signals["t"]) - 10 < count
    same(log, {name: values[:count] for name, values in signals.items()})


@pytest.mark.parametrize(
    "role, name",
    [("steer", "Steering_Cmd [deg]"), ("steer", "log.delta_f_cmd"), ("yaw_rate", "YawRate"),
     ("yaw_rate", "psi_dot"), ("yaw_rate", "y_rad_s"), ("speed", "v_x"), ("speed", "v_mps"),
     ("speed", "Vehicle Speed (km/h)"), ("time", "Timestamp_ms")],
)  # fmt: skip
def test_names_that_are_recognised(role, name):
    assert recognised(role, ["other", name]) == name


def test_layout_of_a_table():
    lines = ["t;steer;comment", "s;rad;", "0,0;1,5;start", "0,1;-2;", "0,2;-2;"]
    layout = find_layout(lines)
    assert (layout.delimiter, layout.decimal, layout.body) == (";", ",", 2)
    assert layout.units == ("s", "rad", "")


# Time


def test_rounded_stamps_are_an_even_grid():
    base = time_base(np.round(np.arange(1000) / 30, 3), 3.0)
    assert base.even and base.notes == ()
    assert base.Ts == pytest.approx(1 / 30, rel=1e-4)


def test_jitter_is_resampled_and_said(written, signals):
    jitter = RNG.uniform(-0.2, 0.2, len(signals["t"])) * TS
    t = signals["t"] + jitter
    smooth = np.sin(2 * np.pi * t)
    path = written(signals | {"t": t, "yaw_rate": smooth})
    log = read(path)
    assert re.match(r"Time stamps are off an even grid by up to 2\.\d+ ms: resamp", log.notes[0])
    assert log.Ts == pytest.approx(TS, rel=1e-4)
    np.testing.assert_allclose(log.yaw_rate, np.sin(2 * np.pi * log.time), atol=2e-4)
    shared = min(len(log.steer), len(t))
    assert (log.steer[:shared] == pytest.approx(signals["steer"][:shared], abs=1e-9))  # fmt: skip


def test_a_gap_leaves_the_longest_stretch(written, signals):
    kept = np.r_[0:200, 300:800]
    log = read(written({name: values[kept] for name, values in signals.items()}))
    assert "A gap of 1.01 s at t = 1.99 s (sample 201)" in log.notes[0]
    assert log.t0 == pytest.approx(3.0) and len(log.steer) == 500


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda t: np.where(np.arange(len(t)) % 200 == 199, t - 0.05, t),
         r"Time stands still or runs backwards at t = 1\.98 s \(sample 200\), and no stretch "),
        (lambda t: t + 2.0 * (np.arange(len(t)) // 150), r"A gap of 2\.01 s at t = 1\.49 s"),
        (lambda t: 0 * t, "Time does not run forwards anywhere"),
        (lambda t: np.floor(t) + 1.7e9, "99% of the time stamps repeat.*with --Ts"),
        (lambda t: 1e3 * t, "sampling time is 10 s.*--time-unit"),
    ],
)  # fmt: skip
def test_time_that_cannot_be_used_is_refused_with_the_place(written, signals, change, message):
    with pytest.raises(LogError, match=message):
        read(written(signals | {"t": change(signals["t"])}))


def test_lost_samples_are_bridged_and_said(written, signals):
    text = {name: values.tolist() for name, values in signals.items()}
    text["yaw_rate"][100] = "NaN"
    log = read(written(text))
    assert log.notes[0] == "Rows without a number somewhere were left out: 1."
    assert log.notes[1] == "1 sample lost: resampled to 10 ms."
    assert len(log.steer) == len(signals["t"]) and abs(log.yaw_rate[100]) < 1


def test_a_speed_that_is_recorded_less_often_is_interpolated(written, signals):
    text = {name: values.tolist() for name, values in signals.items()}
    text["speed"] = [18.0 + 0.001 * k if k % 10 == 0 else "" for k in range(len(text["t"]))]
    log = read(written(text))
    assert log.notes == () and len(log.speed) == len(text["t"])
    np.testing.assert_allclose(log.speed[:-10], 18.0 + 0.001 * np.arange(len(log.speed) - 10))


def test_clocks_and_dates_are_times(written, signals):
    for stamps in (
        [1700000000000000000 + round(1e9 * t) for t in signals["t"]],
        [f"2026-01-01 12:00:{t:06.3f}" for t in signals["t"]],
    ):
        name = "t_ns" if isinstance(stamps[0], int) else "t"
        log = read(written({name: stamps} | {n: v for n, v in signals.items() if n != "t"}))
        assert log.Ts == TS and log.steer == pytest.approx(signals["steer"])


def test_the_sampling_time_may_be_given(written, signals):
    columns = {name: values for name, values in signals.items() if name != "t"}
    with pytest.raises(LogError, match="No column looks like time.*--Ts"):
        read(written(columns))
    same(read(written(columns), Ts=TS), signals)


# Stretches and excitation


def test_a_stretch_is_chosen(written, signals):
    log = read(written(), start=2.0, stop=6.0)
    assert log.t0 == 2.0 and len(log.steer) == 401
    assert (log.yaw_rate == pytest.approx(signals["yaw_rate"][200:601], rel=1e-9))  # fmt: skip
    with pytest.raises(
        SelectionError, match=r"Nothing between 20 and 30 s.* from 0\.00 to 7\.99 s"
    ):
        read(written(), start=20.0, stop=30.0)


def test_the_best_excited_stretch_is_found(written, signals):
    quiet = np.zeros(3000)
    t = TS * np.arange(7000)
    drift = 1e-3 * np.sin(0.3 * t)
    whole = {
        "t": t,
        "steer": drift + np.concatenate([quiet, np.tile(signals["steer"], 2)[:1000], quiet]),
        "yaw_rate": np.cos(t),
        "speed": np.full(7000, 18.0),
    }
    log = read(written(whole))
    assert log.t0 <= 30.0 and log.t0 + 20 >= 40.0
    at = np.searchsorted(t, log.t0 - 1e-9)
    np.testing.assert_allclose(log.steer, whole["steer"][at : at + 2000], atol=1e-9)
    np.testing.assert_allclose(log.yaw_rate, whole["yaw_rate"][at : at + 2000], atol=1e-9)
    assert any("Best-excited stretch used" in note for note in log.notes)


STEER, YAW_RATE = "steer", "yaw_rate"


@pytest.mark.parametrize(
    "change, message",
    [
        ({STEER: lambda x: 0 * x + 0.02}, r"steering is constant \(1\.15 deg\)"),
        ({YAW_RATE: lambda x: 0 * x}, "yaw rate is constant"),
        ({STEER: lambda x: np.degrees(x)}, "reaches 57.3 deg at the road wheel.*--steer-unit"),
        ({STEER: lambda x: 0.02 * np.sin(np.arange(len(x)) * 2e-3) + x * 1e-6}, "hardly moves"),
        ({YAW_RATE: lambda x: 400 * x}, r"yaw rate reaches 38\.2 rad/s\. Give --yaw-rate-unit"),
        ({"speed": lambda x: 0 * x}, r"speed runs from 0 to 0 m/s"),
        ({"speed": lambda x: np.linspace(15, 21, len(x))}, "varies from 15 to 21 m/s, .* --from"),
    ],
)
def test_hopeless_recordings_are_refused(written, signals, change, message):
    changed = {name: function(signals[name]) for name, function in change.items()}
    with pytest.raises(LogError, match=message):
        read(written(signals | changed))


def test_short_recordings_are_refused(written, signals):
    with pytest.raises(LogError, match=r"2\.50 s are too short; at least 3 s"):
        read(written({name: values[:250] for name, values in signals.items()}))
    with pytest.raises(LogError, match="Only 9 complete samples"):
        read(written({name: values[:9] for name, values in signals.items()}))


def test_weak_excitation_is_said(written, signals):
    log = read(written(signals | {"steer": 0.05 * signals["steer"]}))
    assert re.match(r"Weak excitation: 0\.0\d+ deg rms between 0\.5 and 5 Hz", log.notes[0])


# A measured road-wheel angle


def test_the_actuator_is_the_vehicles():
    """A sine long after the start, against the transfer function of eq. (9)."""
    vehicle, Ts, omega = Vehicle(), 0.001, 2 * np.pi * 2.0
    t = Ts * np.arange(4000)
    found = actuated(np.sin(omega * t), Ts, vehicle)[2000:]
    G = control.tf([vehicle.omega_n**2], [1, 2 * vehicle.xi * vehicle.omega_n, vehicle.omega_n**2])
    response = complex(G(1j * omega))
    expected = np.abs(response) * np.sin(omega * t[2000:] + np.angle(response))
    np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize("Ts", [0.001, 0.01])
def test_measured_angles_give_the_whole_vehicle(Ts):
    """Output of the whole vehicle for the measured angle, against python-control's drive."""
    from yawrate_env.loop.simulation import simulate
    from yawrate_env.vehicle.episode import plants
    from yawrate_env.vehicle.single_track import Context

    _, angle, yaw_rate = drive(Ts=Ts, warm_up=0.0, snr_db=200.0, seconds=8.0)
    command, filtered, fine, parts = through_actuator(angle, yaw_rate, Ts, Vehicle())
    assert fine == pytest.approx(0.001) and parts == round(Ts / fine)
    expected = simulate(plants(Vehicle(), Context.of(0.8, 120.0, 18.0), fine), command)[0]
    error = np.sqrt(np.mean((filtered - expected) ** 2)) / expected.std()
    assert error < (1e-4 if Ts == 0.001 else 4e-3)


def test_measured_angles_are_said(written, signals):
    log = read(written(), steer_is="measured")
    assert log.Ts == pytest.approx(0.001) and log.recorded_Ts == TS
    assert len(log.steer) == len(log.yaw_rate) == len(log.speed) == 10 * (len(signals["t"]) - 1)
    assert any("filtered through the actuator" in note for note in log.notes)


# Files that are something else


@pytest.mark.parametrize(
    "content, message",
    [
        (b"", "is empty"),
        (b"hello", "fewer than two lines"),
        (b"a,b\nc,d\n", "No row of numbers"),
        (b"\x00\x01\x02" * 100, "zero bytes"),
        (b"PAR1 and nothing else", "Parquet file cannot be read"),
        (b"MATLAB 5.0 MAT-file" + bytes(200), "MATLAB file"),
        (b"\x89HDF\r\n\x1a\n broken", "MATLAB file cannot be read"),
        (b"MDF     4.10" + bytes(200), "MDF file cannot be read"),
        (b"x,y,z\n" + b"1,2,3\n" * 20, "No column looks like steer; there are x, y, z"),
    ],
)
def test_other_files_are_refused(tmp_path, content, message):
    path = tmp_path / "other.csv"
    path.write_bytes(content)
    with pytest.raises(LogError, match=message) as caught:
        read(path)
    assert str(path) in str(caught.value) or "No column" in message


def test_words_among_numbers_are_named(written, signals):
    text = {name: values.tolist() for name, values in signals.items()}
    text["steer"][122] = "left"
    with pytest.raises(LogError, match="Column steer has 'left' in data row 123"):
        read(written(text))


def test_mdf_without_its_reader_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "log.mf4").write_bytes(b"MDF     4.10" + bytes(200))
    with pytest.raises(LogError, match=r'pip install "yawrate\[mdf\]"'):
        read(tmp_path / "log.mf4")
