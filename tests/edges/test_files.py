import os
import stat

import pytest

from yawrate_env.files import check_folder, leftovers, replacing, write_text


def test_a_file_is_replaced_whole_or_left_as_it_is(tmp_path):
    path = tmp_path / "table.csv"
    write_text(path, "1 µs, 60°")
    assert path.read_bytes() == "1 µs, 60°".encode()
    with pytest.raises(ZeroDivisionError), replacing(path) as file:
        file.write(b"half of it")
        raise ZeroDivisionError
    with replacing(path) as file:
        file.write(b"new")
        assert path.read_text() == "1 µs, 60°"
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    assert os.listdir(tmp_path) == ["table.csv"]


def test_an_error_names_the_file_and_not_the_temporary_one(tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    with pytest.raises(FileNotFoundError, match="absent/table.csv'$"):
        write_text(tmp_path / "absent" / "table.csv", "x")

    def fail(temporary, target):
        raise PermissionError(13, "Permission denied", temporary, None, str(target))

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(PermissionError) as caught:
        write_text(path, "x")
    assert str(caught.value) == f"[Errno 13] Permission denied: {str(path)!r}"


def test_a_folder_that_cannot_be_written_to_is_known_before(tmp_path, monkeypatch):
    check_folder(tmp_path)
    with pytest.raises(ValueError, match="does not exist"):
        check_folder(tmp_path / "absent")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(ValueError, match="cannot be written to"):
        check_folder(tmp_path)


def test_what_is_no_regular_file_is_left_alone(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path):
        with pytest.raises(ValueError, match="no regular file"):
            write_text(path, "x")
    assert pipe.is_fifo() and list(tmp_path.iterdir()) == [pipe]


def test_the_folder_is_synchronised_after_the_file(tmp_path, monkeypatch):
    synchronised, fsync = [], os.fsync

    def note(handle):
        synchronised.append((stat.S_ISDIR(os.fstat(handle).st_mode), os.listdir(tmp_path)))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", note)
    write_text(tmp_path / "t", "text")
    (of_file, before), (of_folder, after) = synchronised
    assert not of_file and before[0].startswith(".t.")
    assert of_folder and after == ["t"]


def test_leftovers_of_killed_processes_are_found(tmp_path):
    for name in (".a.csv.x1y2z3", ".b.csv.x1y2z3", "a.csv", ".a.csv"):
        (tmp_path / name).touch()
    assert leftovers(tmp_path / "a.csv") == [tmp_path / ".a.csv.x1y2z3"]
    assert len(leftovers(tmp_path / "*.csv")) == 2
