"""Sixty files as loggers write them, from one recording whose answer is known.

Each file holds ``examples/log.csv`` in another form.  Those that cannot be read without a choice
of the user's are to be refused with the way out.
"""

import bz2
import gzip
import lzma
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.log_writers import (
    DEGREES,
    EXAMPLE,
    PLAIN,
    T,
    U,
    V,
    Write,
    Y,
    arrow,
    can,
    hdf5,
    interleaved,
    mat,
    mcap,
    mdf,
    named,
    of_rows,
    packed,
    parquet,
    stamps,
    text,
    timetable,
    xlsx,
    zipped,
)

SEED = 14


@dataclass(frozen=True, slots=True)
class LogFile:
    """A file, the flags that a user would give, and what to expect.

    Attributes
    ----------
    name : str
        Of the file.
    write : callable
        Writes it to a path.
    flags : tuple of str
        Beside the path.
    refusal : str
        What the refusal says; empty where the file is to be answered.
    """

    name: str
    write: Write
    flags: tuple[str, ...] = ()
    refusal: str = ""


def log_files() -> list[LogFile]:
    """All of them."""
    return [*_layouts(), *_times(), *_names(), *_packed(), *_binary()]


def _layouts() -> list[LogFile]:
    semicolons = {"delimiter": ";", "decimal": ","}
    preamble = "Logger 3000;v2\nx;y;z;w\n" + "".join(f"ch{k};{k},5\n" for k in range(300))
    names = ",".join(PLAIN)
    lines = EXAMPLE.read_text().splitlines()
    quoted = [*lines[:606], lines[606] + '"', *lines[607:]]
    speeds = {**PLAIN, "speed": [f'"{1000 * v:,.1f}"' for v in V]}
    integers = {**PLAIN, "speed": ["18,000"] * len(V)}
    return [
        LogFile("plain.csv", text(PLAIN)),
        LogFile("hash.csv", text(PLAIN, header=f"# {names}")),
        LogFile("percent.txt", text(PLAIN, header=f"% {names}")),
        LogFile("slashes.csv", text(PLAIN, header=f"//{names}")),
        LogFile("preamble.csv", text(PLAIN, above=preamble, **semicolons)),
        LogFile("numbers_above.csv", text(PLAIN, above="1,2,3,4\n" * 30)),
        LogFile("trailing_commas.csv", text(PLAIN, end=",")),
        LogFile("trailing_header.csv", text(PLAIN, header=names + ",,")),
        LogFile(
            "two_line_names.csv",
            text(PLAIN, header='t,"steer\n[rad]","yaw rate\n[rad/s]",speed'),
        ),
        LogFile("stray_quote.csv", lambda path: _ignored(path.write_text("\n".join(quoted)))),
        LogFile("utf16_without_mark.csv", text(PLAIN, encoding="utf-16-le")),
        LogFile("utf16_big.csv", text(PLAIN, encoding="utf-16-be")),
        LogFile("old_mac.csv", text(PLAIN, newline="\r")),
        LogFile("units_row.csv", text(DEGREES, row="s,deg,deg/s,km/h")),
        LogFile("latin.csv", text(DEGREES, row="s;°;°/s;km/h", encoding="cp1252", **semicolons)),
        LogFile("thousands.csv", text(speeds, row="s,rad,rad/s,mm/s")),
        LogFile("ambiguous.csv", text(integers, delimiter=";"), refusal="1.8e+04"),
        LogFile("blanks.txt", text(PLAIN, delimiter="    ")),
    ]


def _times() -> list[LogFile]:
    rng = np.random.default_rng(SEED)
    end = 23 * 3600 + 59 * 60 + 50.0  # midnight comes while it is recorded
    dates = ["31.03.2024" if t + end < 86400 else "01.04.2024" for t in T]
    clock = stamps("{h:02d}:{m:02d}:{s:06.3f}", end)
    wrapped = (np.rint(1e3 * T) + 60000) % 65536
    twice = np.sort(np.concatenate([np.arange(len(T)), np.arange(0, len(T), 50)]))
    shuffled = np.arange(len(T))
    shuffled[500:504] = [503, 500, 502, 501]

    def at(time: Any, name: str = "t") -> dict[str, Any]:
        return dict(zip((name, *list(PLAIN)[1:]), (time, U, Y, V), strict=True))

    late = np.where(np.arange(len(T)) % 50 == 49, T - 0.01, T)
    bursts = T[np.minimum(np.arange(len(T)) // 10 * 10 + 9, len(T) - 1)]
    return [
        LogFile("clock.csv", text(at(clock))),
        LogFile("dates.csv", text(at([f"{d} {c}" for d, c in zip(dates, clock, strict=True)]))),
        LogFile("two_columns.csv", text({"Datum": dates, **at(clock, "Uhrzeit")}, delimiter=";")),
        LogFile("afternoon.csv", text(at(stamps("03:{m:02d}:{s:06.3f} PM")))),
        LogFile("epoch_ms.csv", text(at(1e3 * T + 1.7e12))),
        LogFile("epoch_us.csv", text(at(np.rint(1e6 * T) + 1.7e15, "timestamp"))),
        LogFile("epoch_ns.csv", text(at([str(1_700_000_000 * 10**9 + round(1e9 * t)) for t in T]))),
        LogFile("wrapped.csv", text(at(wrapped, "t_ms"))),
        LogFile("repeated_rows.csv", text(of_rows(twice))),
        LogFile("repeated_stamps.csv", text(at(late))),
        LogFile("shuffled.csv", text(of_rows(shuffled))),
        LogFile("jitter.csv", text(at(T + rng.uniform(-0.004, 0.004, len(T))))),
        LogFile("bursts.csv", text(at(bursts + 1e-4 * (np.arange(len(T)) % 10)))),
        LogFile("clocks_apart.csv", text(interleaved(0.001))),
        LogFile("seconds_only.csv", text(at(np.floor(T))), refusal="--Ts"),
    ]  # fmt: skip


def _names() -> list[LogFile]:
    wheel = ("--steer-ratio", "16")
    hand = {**PLAIN, "steer": 16 * U}
    two = {**PLAIN, "yaw_rate_imu": Y, "yaw_rate_esp": 1.02 * Y}
    del two["yaw_rate"]
    position = {"t": T, "steer": U, "y(m)": np.cumsum(Y), "speed": V}
    return [
        LogFile("symbols.csv", text(named("t", "delta", "omega(rad/s)", "v_ego"))),
        LogFile("openpilot.csv", text(named("t", "carControl.steeringAngleDeg", "yawRate_dps",
                                            "carState.vEgo", {**DEGREES, "speed": V}))),
        LogFile("vector.csv", text(named("Time[s]", "EPS_SteerAngleCmd[deg]",
                                         "ESP_Gierrate[°/s]", "VehSpd[km/h]", DEGREES))),
        LogFile("words.csv", text(named("Time", '"Steering, Measured [rad]"', "YAW RATE",
                                        "VehSpeed"))),
        LogFile("german.csv", text(named("Zeit", "Lenkradwinkel [rad]", "Giergeschwindigkeit",
                                         "Fahrzeuggeschwindigkeit", hand)), wheel),
        LogFile("carmaker.csv", text(named("Time", "VC.Steer.Ang", "Car.YawRate", "Car.v"))),
        LogFile("carsim.csv", text(named("Time", "Steer_SW [deg]", "AVz [deg/s]", "Vx [km/h]",
                                         {**DEGREES, "steer": 16 * np.degrees(U)})), wheel),
        LogFile("position.csv", text(position), refusal="--output-column"),
        LogFile("two_gyros.csv", text(two), refusal="yaw_rate_imu, yaw_rate_esp"),
        LogFile("two_speeds.csv", text({**PLAIN, "gps_speed": 1.3 * V})),
    ]  # fmt: skip


def _packed() -> list[LogFile]:
    return [
        LogFile("log.csv.gz", packed(gzip.compress)),
        LogFile("log.csv.bz2", packed(bz2.compress)),
        LogFile("log.csv.xz", packed(lzma.compress)),
        LogFile("log.zip", zipped("log.csv")),
        LogFile("two.zip", zipped("a.csv", "b.csv"), refusal="a.csv, b.csv"),
        LogFile("log.xlsx", xlsx),
    ]


def _binary() -> list[LogFile]:
    even = 0.01 * np.arange(len(T)) + T[0]
    none = np.empty(0)
    channels = {"yaw_rate": (Y, np.round(T, 2))}, {"speed": (V[::10], T[::10])}
    signals = [{"label": name, "values": PLAIN[name]} for name in ("steer", "yaw_rate", "speed")]
    elements = [{"name": name, "data": values} for name, values in PLAIN.items()]
    bag = b"#ROSBAG V2.0\n" + bytes(100)
    return [
        LogFile("rounded.mf4", mdf({"steer": (U, even)}, *channels)),
        LogFile("empty_group.mf4", mdf({"steer": (none, none)}, {"steer": (U, T)}, *channels)),
        LogFile("twice.mf4", mdf({"steer": (U, T)}, {"steer": (U, T)}, *channels)),
        LogFile("two_steers.mf4", mdf({"steer": (U, T)}, {"steer": (-U, T)}, *channels),
                refusal="steer #1, steer #2"),
        LogFile("slow_clock.mf4", mdf(*({name: (x, 2 * T)} for name, x in
                                        (("steer", U), ("yaw_rate", Y), ("speed", V)))),
                ("--Ts", "0.01")),
        LogFile("structure.mat", mat({"log": {"X": PLAIN, "driver": "A"}})),
        LogFile("array.mat", mat({"log": elements})),
        LogFile("simulink.mat", mat({"out": {"time": T, "signals": signals}})),
        LogFile("timetable.mat", timetable),
        LogFile("loop.h5", hdf5(link_loop=True)),
        LogFile("units.h5", hdf5(units=True)),
        LogFile("log.feather", arrow),
        LogFile("log.parquet", parquet),
        LogFile("bag.mcap", mcap),
        LogFile("trace.blf", can, ("--dbc", "trace.dbc")),
        LogFile("log.bag", lambda path: _ignored(path.write_bytes(bag)), refusal="MCAP"),
    ]  # fmt: skip


def _ignored(_: Any) -> None:
    return None
