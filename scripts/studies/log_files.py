"""Sixty files as loggers write them, from one recording whose answer is known.

Each file holds ``examples/log.csv`` in another form.  Those that cannot be read without a choice
of the user's are to be refused with the way out.
"""

import bz2
import gzip
import lzma
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Write = Callable[[Path], None]

EXAMPLE = Path(__file__).parents[2] / "examples" / "log.csv"
T, U, Y, V = np.loadtxt(EXAMPLE, delimiter=",", skiprows=1).T
PLAIN = {"t": T, "steer": U, "yaw_rate": Y, "speed": V}
DEGREES = {"t": T, "steer": np.degrees(U), "yaw_rate": np.degrees(Y), "speed": 3.6 * V}
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


def text(
    columns: Mapping[str, Any],
    *,
    delimiter: str = ",",
    decimal: str = ".",
    above: str = "",
    row: str = "",
    header: str | None = None,
    end: str = "",
    encoding: str = "utf-8",
    newline: str = "\n",
) -> Write:
    """Write columns as text; `row` stands below the names, `above` over them."""
    names = delimiter.join(columns) if header is None else header
    lines = [*([names] if names else []), *([row] if row else [])]
    for values in zip(*columns.values(), strict=True):
        cells = (_cell(value).replace(".", decimal) for value in values)
        lines.append(delimiter.join(cells) + end)
    content = (above + "\n".join(lines) + "\n").replace("\n", newline).encode(encoding)

    def write(path: Path) -> None:
        path.write_bytes(content)

    return write


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    return "" if np.isnan(value) else f"{value:.15g}"


def stamps(form: str, start: float = 0.0) -> list[str]:
    """Clock times of the recording."""
    found = []
    for t in T + start:
        hours, rest = divmod(round(1e3 * t), 3_600_000)
        minutes, ms = divmod(rest, 60_000)
        found.append(
            form.format(h=hours % 24, m=minutes, s=ms / 1e3, ms=ms % 1000, full=ms // 1000)
        )
    return found


def named(time: str, steer: str, yaw_rate: str, speed: str, source: Any = PLAIN) -> dict[str, Any]:
    """The recording under other names."""
    return dict(zip((time, steer, yaw_rate, speed), source.values(), strict=True))


def packed(opener: Callable[[bytes], bytes]) -> Write:
    """A compressed file."""
    content = EXAMPLE.read_bytes()

    def write(path: Path) -> None:
        path.write_bytes(opener(content))

    return write


def zipped(*members: str) -> Write:
    """A zip file of members that are all the recording."""

    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for member in members:
                archive.write(EXAMPLE, member)

    return write


def mdf(
    *groups: Mapping[str, tuple[Array, Array]], units: Mapping[str, str] | None = None
) -> Write:
    """MDF 4 with a group for each mapping of channels to values and stamps."""

    def write(path: Path) -> None:
        from asammdf import MDF, Signal

        with MDF(version="4.10") as file:
            for group in groups:
                file.append(
                    [
                        Signal(values, time, name=name, unit=(units or {}).get(name, ""))
                        for name, (values, time) in group.items()
                    ]
                )
            file.save(path, overwrite=True)

    return write


def mat(variables: Mapping[str, Any]) -> Write:
    """A MATLAB file of version 5."""

    def write(path: Path) -> None:
        from scipy.io import savemat

        savemat(path, dict(variables))

    return write


def hdf5(link_loop: bool = False, units: bool = False) -> Write:
    """An HDF5 file with a group of vectors."""

    def write(path: Path) -> None:
        import h5py

        with h5py.File(path, "w") as file:
            group = file.create_group("log")
            source = DEGREES if units else PLAIN
            for (name, values), unit in zip(
                source.items(), ("s", "deg", "deg/s", "km/h"), strict=True
            ):
                group[name] = values
                if units:
                    group[name].attrs["units"] = unit
            if link_loop:
                group["again"] = file["/log"]
                file["gone"] = h5py.SoftLink("/nowhere")

    return write


def timetable(path: Path) -> None:
    """A MATLAB timetable."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import pandas as pd
        from matio import save_to_mat

    index = pd.Index(np.rint(1e3 * T).astype("timedelta64[ms]"), name="Time")
    table = pd.DataFrame({"steer": U, "yaw_rate": Y, "speed": V}, index=index)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        save_to_mat(str(path), {"log": table}, version="v7")


def arrow(path: Path) -> None:
    """A Feather file."""
    import pyarrow as pa
    from pyarrow import feather

    feather.write_feather(pa.table(PLAIN), str(path))


def parquet(path: Path) -> None:
    """A Parquet file with dates."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    time = pa.array(np.rint(1e6 * (T + 1.7e9)).astype(np.int64), pa.timestamp("us"))
    pq.write_table(pa.table({**PLAIN, "t": time}), path)


def xlsx(path: Path) -> None:
    """A spreadsheet, written by hand: no writer is needed for numbers."""
    rows = [list(PLAIN), ["s", "rad", "rad/s", "m/s"], *zip(*PLAIN.values(), strict=True)]
    cells = "".join(
        "<row>"
        + "".join(
            f'<c t="inlineStr"><is><t>{value}</t></is></c>'
            if isinstance(value, str)
            else f"<c><v>{value:.15g}</v></c>"
            for value in row
        )
        + "</row>"
        for row in rows
    )
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    kind = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.'
        'relationships+xml"/>'
        f'<Override PartName="/xl/workbook.xml" ContentType="{kind}.sheet.main+xml"/>'
        f'<Override PartName="/xl/worksheets/s.xml" ContentType="{kind}.worksheet+xml"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets>'
        '<sheet name="log" sheetId="1" r:id="r1"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships">'
        f'<Relationship Id="r1" Type="{office}/worksheet" Target="worksheets/s.xml"/>'
        "</Relationships>",
        "xl/worksheets/s.xml": f'<worksheet xmlns="{main}"><sheetData>{cells}</sheetData>'
        "</worksheet>",
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)


def mcap(path: Path) -> None:
    """A ROS 2 bag with commands, a gyro 1 ms later, and the speed ten times slower."""
    from mcap_ros2.writer import Writer

    with path.open("wb") as file:
        writer: Any = Writer(file)
        number = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
        vector = writer.register_msgdef(
            "geometry_msgs/msg/Vector3", "float64 x\nfloat64 y\nfloat64 z"
        )
        for k, t in enumerate(T):
            at = round(1e9 * (1.7e9 + t))
            writer.write_message("/steering_cmd", number, {"data": U[k]}, at)
            rate = {"x": 0.0, "y": 0.0, "z": Y[k]}
            writer.write_message("/imu/angular_velocity", vector, rate, at)
            if k % 10 == 0:
                writer.write_message("/vehicle/speed", number, {"data": V[k]}, at)
        writer.finish()


DBC = """VERSION ""
NS_ :
BS_:
BU_: ECU
BO_ 100 Steer: 8 ECU
 SG_ SteerCmd : 0|32@1- (1E-7,0) [-1|1] "rad" ECU
BO_ 200 ESP: 8 ECU
 SG_ YawRate : 0|32@1- (1E-6,0) [-100|100] "deg/s" ECU
 SG_ VehSpd : 32|16@1+ (0.01,0) [0|300] "km/h" ECU
"""


def can(path: Path) -> None:
    """A CAN trace, BLF or ASC by the suffix, and its DBC file beside it."""
    import can
    import cantools

    path.with_suffix(".dbc").write_text(DBC)
    database: Any = cantools.database.load_string(DBC, "dbc")
    writer: Any = can.Logger(str(path))
    for t, u, y, v in zip(T, U, Y, V, strict=True):
        for name, values in (
            ("Steer", {"SteerCmd": u}),
            ("ESP", {"YawRate": np.degrees(y), "VehSpd": 3.6 * v}),
        ):
            message = database.get_message_by_name(name)
            writer.on_message_received(
                can.Message(
                    timestamp=1.7e9 + t, arbitration_id=message.frame_id, is_extended_id=False,
                    data=message.encode(values),
                )
            )  # fmt: skip
    writer.stop()


def interleaved(late: float) -> dict[str, Array]:
    """Steering in odd rows, the yaw rate later in even ones."""
    from scipy.interpolate import CubicSpline

    def rows(values: Array, first: int) -> Array:
        found = np.full(2 * len(values), np.nan)
        found[first::2] = values
        return found

    moved = np.asarray(CubicSpline(T, Y)(T + late))
    time = np.stack([T, T + late], axis=1).ravel()
    return {"t": time, "steer": rows(U, 0), "yaw_rate": rows(moved, 1), "speed": rows(V, 0)}


def of_rows(rows: Any, source: Mapping[str, Any] = PLAIN) -> dict[str, Any]:
    """Some rows of the recording."""
    return {name: values[rows] for name, values in source.items()}


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
