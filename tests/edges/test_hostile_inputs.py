"""Inputs that would hang, exhaust memory or end in a traceback: one line, and the way out."""

import os
import re
import subprocess
import sys
import threading

import numpy as np
import pytest
from command import EXAMPLE, TRUSTED, UNUSABLE, WRONG, call, refused
from log_files import CASES, read, write

from tuners.catalogue import shipped
from tuners.logs import LogError, source
from tuners.tuner import tuner_file
from yawrate_env.vehicle.vehicle_file import example as paper

VEHICLE = CASES["vehicle"]


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null"])
def test_devices_are_refused(device):
    assert device in refused(UNUSABLE, "tune", device)


def test_pipes_are_read_once_and_silent_ones_refused(tmp_path, monkeypatch):
    """Without a speed two tuners look at the log, which is opened once."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    rows = [line.rsplit(",", 1)[0] for line in EXAMPLE.read_text().splitlines()]
    text = "\n".join(rows)
    writer = threading.Thread(target=pipe.write_text, args=(text,))
    writer.start()
    code, out, _ = call("tune", pipe)
    writer.join()
    assert code == TRUSTED and "3.00 to 15.00 s" in out
    monkeypatch.setattr(source, "PATIENCE", 0.2)
    with pytest.raises(LogError, match="Nothing came through"):
        read(pipe, VEHICLE.plant)


def test_what_is_too_large_is_refused_before_it_is_read(tmp_path, monkeypatch):
    import gzip

    monkeypatch.setattr(source, "LARGEST", 1000)
    path = write(tmp_path / "log.csv", VEHICLE.columns)
    packed = tmp_path / "log.csv.gz"
    packed.write_bytes(gzip.compress(bytes(10**6)))
    for each in (path, packed):
        with pytest.raises(LogError, match="has more than"):
            read(each, VEHICLE.plant)


@pytest.mark.parametrize(
    "content, said",
    [(b"#ROSBAG V2.0\n", "MCAP"), (b"SQLite format 3\0", "MCAP"), (b"{}", "JSON"),
     (b"TDSm" + bytes(50), "TDMS"), (b"ULog\x01", "ulog2csv"), (b"%PDF-1.7", "PDF"),
     (b"<html>", "web page"), (b"PK\x03\x04" + bytes(40), "damaged"),
     (b"\x1f\x8b\x08" + bytes(40), "damaged"), (b"LOGG" + bytes(200), "--dbc"),
     (b"\x89MCAP0\r\n" + bytes(50), "MCAP"), (b"ARROW1" + bytes(50), "Feather")],
)  # fmt: skip
def test_other_formats_are_named_with_the_way_out(tmp_path, content, said):
    path = tmp_path / "log.bin"
    path.write_bytes(content)
    with pytest.raises(LogError, match=said) as caught:
        read(path, VEHICLE.plant)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "flags, said",
    [
        (("--from", 5, "--to", 4), "--from 5"),
        (("--steer-ratio", 16, "--input-scale", 0.1), "--steer-ratio 16"),
        (("--flip-input", "--input-scale", -1), "--flip-input"),
        (("--flip-output", "--output-scale", -1), "--flip-output"),
        (("--speed", 18, "--speed-column", "speed"), "given twice"),
        (("--Ts", 0.01, "--time-column", "t"), "--Ts 0.01"),
    ],
)
def test_options_that_contradict_each_other(flags, said):
    assert said in refused(WRONG, "tune", EXAMPLE, *flags)


def test_a_dbc_file_is_for_can_traces(tmp_path):
    (tmp_path / "bus.dbc").write_text('VERSION ""\n')
    assert "no CAN trace" in refused(
        UNUSABLE, "tune", EXAMPLE, "--dbc", tmp_path / "bus.dbc"
    )  # fmt: skip


def test_the_stretch_is_steady_and_of_the_tuners_range(tmp_path):
    """Strong steering at 8.8 m/s, where the tuner was not made for, is passed over."""
    count = len(VEHICLE.u)
    speeds = np.repeat([8.8, 14.0, 14.0, 26.0, 26.0, 26.0], count)
    u = np.tile(VEHICLE.u, 6) * np.where(speeds < 10, 3.0, 1.0)
    columns = {"t": 0.01 * np.arange(6 * count), "steer": u, "yaw_rate": np.tile(VEHICLE.y, 6)}
    long = write(tmp_path / "log.csv", columns | {"speed": speeds})
    log = read(long, VEHICLE.plant)
    used = log.measured["v_x"]
    assert np.ptp(used) == 0 and used[0] in (14.0, 26.0)
    assert "Best-excited" in log.notes[0] and f"speed {used[0]:g}" in log.notes[0]
    assert any("from 14" in note or "to 26" in note for note in log.notes) or used[0] == 26.0
    assert log.whole is not None and log.whole.used == pytest.approx((log.t0, log.time[-1]))


DEEP = "[" * 20_000 + "]" * 20_000


@pytest.mark.parametrize("text", [f"x = {DEEP}", f"[plant]\nentry = 'a:b'\narguments = {DEEP}"])
def test_deeply_nested_files_are_refused(tmp_path, text):
    path = tmp_path / "car.toml"
    path.write_text(text)
    out = tmp_path / "prbs.csv"
    assert str(path) in refused(UNUSABLE, "excite", "--vehicle", path, "-o", out)
    path.write_bytes(b"\xef\xbb\xbf" + paper().encode())
    assert call("excite", "--vehicle", path, "-o", out)[0] == 0


@pytest.mark.parametrize(
    "section, line",
    [("target", "Ts = 1e-9"), ("experiment", "snr_db = -40.0"), ("prior", "v_x = 1e-6"),
     ("prior", "M_delta = -1894.0")],
)  # fmt: skip
def test_absurd_settings_are_refused_before_the_work(tmp_path, section, line):
    path, key = tmp_path / "car.toml", line.split(" ")[0]
    parts = re.split(r"(?m)^(?=\[)", paper())
    (k,) = (k for k, part in enumerate(parts) if part.startswith(f"[{section}]"))
    parts[k] = re.sub(rf"(?m)^{key} = .*$", line, parts[k])
    path.write_text("".join(parts))
    assert line in path.read_text()
    words = refused(UNUSABLE, "excite", "--vehicle", path, "-o", tmp_path / "prbs.csv")
    assert str(path) in words and key.split("_")[0] in words


@pytest.mark.parametrize(
    "body", ["import sys; sys.exit(3)", "raise BaseException('no')", "raise GeneratorExit",
             "class E(Exception):\n    def __str__(self): raise ValueError\nraise E"],
)  # fmt: skip
def test_a_plants_module_may_raise_anything(tmp_path, body):
    name = f"plant_{abs(hash(body))}"
    (tmp_path / f"{name}.py").write_text(body)
    (tmp_path / "plant.toml").write_text(f"[plant]\nentry = '{name}:plant'\n")
    out = tmp_path / "prbs.csv"
    assert name in refused(UNUSABLE, "excite", "--plant", tmp_path / "plant.toml", "-o", out)


def spoilt(arrays):
    """Arrays of a shipped tuner with one spoilt in a way that its checksum does not show."""
    for name, array in arrays.items():
        if array.dtype == np.float64 and array.ndim:
            yield name, np.where(np.arange(array.size).reshape(array.shape) == 0, np.nan, array)
            yield name, array[:-1]
            yield name, array[..., None]
            yield name, array.astype(np.int8)
            yield name, np.array(1.0)


@pytest.mark.parametrize("name", ["ts-ff", "ts-ff-lag-vx"])
def test_crafted_tuners_are_refused_with_their_name(tmp_path, name):
    settings, arrays = tuner_file.read(shipped(name))
    path = tmp_path / "crafted.tuner"
    for key, array in spoilt(arrays):
        tuner_file.write(path, settings, arrays | {key: array})
        assert "crafted.tuner" in refused(UNUSABLE, "tune", EXAMPLE, "--tuner", path), key


@pytest.mark.slow
def test_a_damaged_cache_is_rebuilt(tmp_path, monkeypatch):
    """A kernel whose files were cut short is compiled again, in a process of its own."""
    module = tmp_path / "kernels.py"
    module.write_text(
        "from yawrate_env.compiled import kernel\n"
        "@kernel\ndef twice(x):\n    return 2 * x\n"
        "print(twice(21.0), sum(twice.stats.cache_hits.values()))\n"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run():
        done = subprocess.run([sys.executable, module], env=environment, capture_output=True,
                              text=True)  # fmt: skip
        assert done.stderr == ""
        return done.stdout.split()

    assert [run(), run()] == [["42.0", "0"], ["42.0", "1"]]
    for kind in ("nbi", "nbc"):
        for path in tmp_path.rglob(f"*.{kind}"):
            path.write_bytes(path.read_bytes()[:40])
        assert run() == ["42.0", "0"] and run() == ["42.0", "1"]


@pytest.mark.slow
def test_warnings_of_libraries_never_reach_stderr(tmp_path):
    """The command as a program, in a process of its own."""
    late = tmp_path / "log.csv"
    u = np.array(VEHICLE.u)
    write(late, VEHICLE.changed(output=np.where(np.arange(len(u)) == 5, 1e300, VEHICLE.y)))
    done = subprocess.run([sys.executable, "-m", "tuners.cli", "tune", late, "--tuner", "gb"],
                          capture_output=True, text=True)  # fmt: skip
    assert done.returncode in (TRUSTED, UNUSABLE, 3) and done.stderr.count("\n") <= 1
