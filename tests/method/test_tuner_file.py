"""Tuner files: round trips, damage of every kind, and writes that fail."""

import errno
import hashlib
import lzma
import os
import pickle

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import tuners
from tuners.catalogue import shipped
from tuners.tuner.tuner_file import TunerFileError, read, write

SETTINGS = {
    "method": "two-stage",
    "nested": {"numbers": [1, 2.5, None], "text": "µs"},
    "flag": True,
}
ARRAYS = {
    "floats": np.linspace(-1, 1, 12).reshape(3, 4),
    "transposed": np.arange(6.0).reshape(2, 3).T,
    "single": np.float32([1.5, np.nan]),
    "bytes": np.frombuffer(b"\x00\xff binary", dtype=np.uint8),
    "scalar": np.array(3.0),
}


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "one.tuner"
    write(path, SETTINGS, ARRAYS)
    return path


def sealed(body):
    """A file with this body and a checksum that agrees."""
    return b"yawrate-tuner 1 %s\n" % hashlib.sha256(body).hexdigest().encode() + body


def test_round_trip(saved):
    settings, arrays = read(saved)
    assert settings == SETTINGS
    assert set(arrays) == set(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays[name], array)


def test_the_same_content_gives_the_same_file(saved, tmp_path):
    write(tmp_path / "two.tuner", dict(reversed(SETTINGS.items())), ARRAYS)
    assert (tmp_path / "two.tuner").read_bytes() == saved.read_bytes()


def header_of(header):
    return sealed(lzma.compress(len(header).to_bytes(8, "little") + header))


FOREIGN = "is not a tuner file"
DAMAGED = "is damaged"
UNREADABLE = "cannot be read"


OTHER_FILES = {
    "empty": (b"", FOREIGN),
    "an empty line": (b"\n", FOREIGN),
    "CSV": (b"tuner,episode,mu_s\nts-ff,0,0.5\n", FOREIGN),
    "a pickle": (pickle.dumps(SETTINGS), FOREIGN),
    "noise": (np.random.default_rng(0).bytes(4096), FOREIGN),
    "half a header": (b"yawrate-tuner 1\n", FOREIGN),
    "version 2": (b"yawrate-tuner 2 %s\nbody" % (b"0" * 64), "version 2"),
    "wrong checksum": (b"yawrate-tuner 1 %s\nbody" % (b"0" * 64), DAMAGED),
    "no body": (sealed(b""), UNREADABLE),
    "not xz": (sealed(b"not xz"), UNREADABLE),
    "not safetensors": (sealed(lzma.compress(b"not safetensors")), UNREADABLE),
    "metadata of another type": (header_of(b'{"__metadata__": null}'), UNREADABLE),
    "a list for a header": (header_of(b"[1]"), UNREADABLE),
    "brackets without end": (header_of(b"[" * 100_000), UNREADABLE),
    "settings of another type": (header_of(b'{"__metadata__": {"settings": "3"}}'), UNREADABLE),
    "no settings": (sealed(lzma.compress(b"\x02" + bytes(7) + b"{}")), UNREADABLE),
}


@pytest.mark.parametrize("content, message", OTHER_FILES.values(), ids=OTHER_FILES)
def test_files_that_are_something_else_are_refused(tmp_path, content, message):
    path = tmp_path / "other.tuner"
    path.write_bytes(content)
    with pytest.raises(TunerFileError, match=message) as caught:
        read(path)
    assert str(path) in str(caught.value)
    with pytest.raises(ValueError, match=message):
        tuners.load(path)


def test_pickles_are_never_executed(tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    for body in (pickle.dumps(Trap()), lzma.compress(pickle.dumps(Trap()))):
        (tmp_path / "trap.tuner").write_bytes(sealed(body))
        with pytest.raises(TunerFileError):
            read(tmp_path / "trap.tuner")
    assert not (tmp_path / "sprung").exists()


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    (tmp_path / "folder.tuner").mkdir()
    for name, reason in (("absent", "No such file"), ("folder", "Is a directory")):
        with pytest.raises(TunerFileError, match=rf"{name}\.tuner: {reason}"):
            tuners.load(tmp_path / f"{name}.tuner")


def test_a_file_cut_anywhere_is_refused(tmp_path):
    content = shipped("ts-ff").read_bytes()
    path = tmp_path / "cut.tuner"
    for length in range(0, len(content), 293):
        path.write_bytes(content[:length])
        with pytest.raises(TunerFileError):
            read(path)
    path.write_bytes(content + b"\x00")
    with pytest.raises(TunerFileError, match=DAMAGED):
        read(path)


def refuses_altered(path, content, changes):
    altered = bytearray(content)
    for position, change in changes.items():
        altered[position % len(content)] ^= change
    if altered == content:  # two changes of one byte that undo each other
        return
    path.write_bytes(altered)
    with pytest.raises(TunerFileError):
        tuners.load(path)


def test_one_byte_altered_anywhere_is_refused(tmp_path):
    content = shipped("ts-ff").read_bytes()
    for position in [*range(150), *range(150, len(content), 293)]:
        refuses_altered(tmp_path / "altered.tuner", content, {position: 1 + position % 255})


@settings(max_examples=30)
@given(changes=st.dictionaries(st.integers(0, 10**6), st.integers(1, 255), min_size=1, max_size=8))
@example(changes={13: 0x20 ^ 0x09})  # the blank after the format's name becomes a tab
@example(changes={15: 0x20 ^ 0x1F})
@example(changes={80: 0x0A ^ 0x20})  # the end of the header's line
@pytest.mark.parametrize("name", ["ts-ff", "ts-gbm"])
def test_bytes_altered_at_random_are_refused(name, changes, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / f"{name}-altered.tuner"
    refuses_altered(path, shipped(name).read_bytes(), changes)


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
@pytest.mark.parametrize("function", ["fsync", "replace"])
def test_a_write_that_fails_leaves_the_old_file_alone(saved, monkeypatch, function, error):
    before = saved.read_bytes()

    def fail(*_):
        raise error

    monkeypatch.setattr(f"yawrate_env.files.os.{function}", fail)
    with pytest.raises(type(error)):
        write(saved, {"kind": "other"}, {})
    assert saved.read_bytes() == before
    assert os.listdir(saved.parent) == [saved.name]


def test_a_write_replaces_the_old_file(saved):
    write(saved, {"kind": "other"}, {"a": np.zeros(2)})
    assert read(saved)[0] == {"kind": "other"}
    assert os.listdir(saved.parent) == [saved.name]
