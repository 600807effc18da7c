"""Writers of one recording in the forms that loggers write: text, spreadsheets, binary files."""

import zipfile
from collections.abc import Callable, Mapping
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
