"""Recordings of every format come out as the same arrays, or are refused with the reason."""

import os
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from log_files import CASES, check_same, read, write

from tuners.logs import LogError
from tuners.logs.csv_file import find_layout

VEHICLE, LAG = CASES["vehicle"], CASES["lag"]

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
