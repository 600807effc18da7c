"""Time stamps as loggers write them, against samples that are known."""

import numpy as np
import pytest
from log_files import CASES, check_same, read, write

from tuners.logs import LogError, SelectionError, stamps
from tuners.logs.clock import seconds

VEHICLE = CASES["vehicle"]
T = VEHICLE.columns["t"]
N = len(T)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"


def logged(path, **options):
    def reading(**changes):
        return read(write(path, VEHICLE.changed(**changes)), VEHICLE.plant, **options)

    return reading


@pytest.mark.parametrize("seed", range(4))
def test_jittered_stamps_of_even_samples_cost_nothing(path, seed):
    jitter = np.random.default_rng(seed).uniform(-0.004, 0.004, N)
    log = logged(path)(time=T + jitter)
    np.testing.assert_allclose(log.u, VEHICLE.u, rtol=1e-9)
    np.testing.assert_allclose(log.y, VEHICLE.y, rtol=1e-9)
    assert log.Ts == pytest.approx(VEHICLE.Ts, rel=2e-4)
    assert len(log.notes) == 1 and "jitter by up to 4" in log.notes[0]


def test_losses_are_found_under_jitter():
    rng, wrong = np.random.default_rng(0), 0
    for _ in range(50):
        kept = np.sort(rng.choice(1000, 1000 - rng.integers(1, 6), replace=False))
        time = 0.01 * kept + rng.uniform(-0.003, 0.003, len(kept))
        count = stamps.line_with_losses(time).count
        off = np.abs(count - (kept - kept[0]))
        wrong += off.max() > 1 or off.sum() > 5  # a loss may be placed some samples aside
    assert wrong <= 1


def test_bursts_and_coarse_stamps_are_even_samples(path):
    bursts = T[np.minimum(np.arange(N) // 10 * 10 + 9, N - 1)] + 1e-4 * (np.arange(N) % 10)
    for time in (bursts, np.floor(10 * T) / 10, np.where(np.arange(N) % 50 == 49, T - 0.01, T)):
        log = logged(path)(time=time)
        np.testing.assert_allclose(log.u, VEHICLE.u, rtol=1e-9)
        assert log.Ts == pytest.approx(VEHICLE.Ts, rel=1e-3)


@pytest.mark.parametrize(
    "counter, modulus",
    [("t_ms", 2**16), ("t_us", 2**32), ("t", 60), ("t_ms", 10_000), ("t", 604_800)],
)
def test_wrapped_counters_are_joined(path, counter, modulus):
    scale = {"t": 1, "t_ms": 1e3, "t_us": 1e6}[counter]
    time = np.round(T * scale + modulus - 4 * scale, 3) % modulus
    columns = VEHICLE.columns
    columns = {counter: time} | {name: columns[name] for name in list(columns)[1:]}
    log = read(write(path, columns), VEHICLE.plant)
    np.testing.assert_allclose(log.u, VEHICLE.u, rtol=1e-9)
    assert log.Ts == pytest.approx(VEHICLE.Ts) and any("began again" in n for n in log.notes)


@pytest.mark.parametrize("unit, factor", [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_epochs_tell_their_unit(path, unit, factor):
    time = [str(1_700_000_000 * round(factor) + round(factor * t)) for t in T]
    log = logged(path)(time=time)
    assert log.Ts == VEHICLE.Ts and f"{unit} since 1970" in log.notes[0]


CLOCKS = {
    "23:59:58.500|00:00:00.250": 1.75, "12:00:00 AM|12:00:01 PM": 43201.0,
    "31.12.2024 23:59:59,5|01.01.2025 00:00:00,5": 1.0,
    "2024-02-29T12:00:00Z|2024-03-01 12:00": 86400.0,
    "29-Feb-2024 00:00:00|1-Mar-2024 00:00:00": 86400.0, "01:02.5|01:03.75": 1.25,
    "20240229 10:00:00|20240229 10:00:01": 1.0, "10:00:00:250|10:00:00:500": 0.25,
    "2/29/2024 1:00:00|3/1/2024 1:00:00": 86400.0,
}  # fmt: skip


@pytest.mark.parametrize("cells, apart", CLOCKS.items())
def test_clocks_and_dates_are_seconds(cells, apart):
    first, last = seconds("t", [cell.lower() for cell in cells.split("|")])
    assert last - first == pytest.approx(apart, abs=1e-5)


def test_clocks_are_no_signals_and_have_no_unit(path):
    clock = [f"12:00:{t:06.3f}" for t in T]
    with pytest.raises(LogError, match="yaw_rate .*times"):
        logged(path)(output=clock)
    with pytest.raises(SelectionError, match="--time-unit ms"):
        logged(path, units={"time": "ms"})(time=clock)


def test_rows_that_repeat_and_rows_out_of_order(path):
    twice = np.sort(np.concatenate([np.arange(N), np.arange(0, N, 50)]))
    shuffled = np.arange(N)
    shuffled[100:103] = [102, 100, 101]
    for rows, said in ((twice, f"left out: {-(-N // 50)}"), (shuffled, "by time: 3")):
        log = read(write(path, {n: v[rows] for n, v in VEHICLE.columns.items()}), VEHICLE.plant)
        check_same(log, VEHICLE)
        assert said in log.notes[0]


@pytest.mark.parametrize("late", [0.001, 0.004])
def test_channels_on_different_clocks_keep_their_own(path, late):
    """The command is a millisecond early in the output's steps: their means count it."""
    rows = {name: np.full(2 * N, np.nan) for name in VEHICLE.names}
    rows["t"] = np.stack([T, T + late], axis=1).ravel()
    rows["steer"][::2], rows["speed"][::2] = VEHICLE.u, VEHICLE.value
    rows["yaw_rate"][1::2] = np.sin(2 * (T + late))
    text = {name: ["" if np.isnan(x) else x for x in v.tolist()] for name, v in rows.items()}
    log = read(write(path, text), VEHICLE.plant)
    np.testing.assert_allclose(log.y, np.sin(2 * log.time), atol=1e-9)
    share = late / VEHICLE.Ts
    after = np.append(VEHICLE.u[1:], VEHICLE.u[-1])
    expected = (1 - share) * VEHICLE.u + share * after
    np.testing.assert_allclose(log.u, expected[: len(log.u)], atol=1e-9)
    assert any(f"{1e3 * late:g} ms apart" in note for note in log.notes)


def test_a_single_reading_is_noted(path):
    once = ["" if k != 7 else VEHICLE.value for k in range(N)]
    log = logged(path)(measured=once)
    check_same(log, VEHICLE)
    assert f"1 reading in {N} rows" in log.notes[0]


def test_the_sampling_time_overrides_clocks_of_channels(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for name, values in list(VEHICLE.columns.items())[1:]:
            file.append(asammdf.Signal(values, 2 * T, name=name))
        file.save(tmp_path / "log.mf4")
    check_same(read(tmp_path / "log.mf4", VEHICLE.plant, Ts=VEHICLE.Ts), VEHICLE)
