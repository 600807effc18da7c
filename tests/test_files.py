import os
import stat

import pytest

from yawrate_env.files import replacing, write_text


def test_a_file_is_replaced_whole(tmp_path):
    path = tmp_path / "table.csv"
    write_text(path, "old")
    with replacing(path) as file:
        file.write(b"new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    assert os.listdir(tmp_path) == ["table.csv"]


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "table.csv"
    write_text(path, "old")
    with pytest.raises(ZeroDivisionError), replacing(path) as file:
        file.write(b"half of it")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["table.csv"]


def test_text_is_utf_8(tmp_path):
    write_text(tmp_path / "t", "1 µs, 60°")
    assert (tmp_path / "t").read_bytes() == "1 µs, 60°".encode()


def test_what_is_no_regular_file_is_left_alone(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path):
        with pytest.raises(ValueError, match="no regular file"):
            write_text(path, "x")
    assert pipe.is_fifo() and list(tmp_path.iterdir()) == [pipe]
