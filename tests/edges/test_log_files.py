"""Sixty files as loggers write them, and damaged ones of every format."""

import numpy as np
import pytest

from studies import mutations
from studies.log_files import SEED, log_files
from studies.log_writers import PLAIN
from tuners.catalogue import load
from tuners.cli.log_options import log_options
from tuners.logs import LogError, Options, SelectionError, read_log

PLANT = load("ts-ff-lag-vx").plant
NEEDS = {".mf4": "asammdf", ".xlsx": "python_calamine", ".mcap": "mcap_ros2", ".blf": "cantools"}
FILES = log_files()


def options_of(file, folder):
    """What the command makes of a file's flags."""
    import click

    read = click.command()(log_options(lambda options: options))
    flags = [str(folder / f) if f.endswith(".dbc") else f for f in file.flags]
    return read.main(flags, standalone_mode=False)


def test_there_are_sixty():
    assert len(FILES) >= 60 and len({file.name for file in FILES}) == len(FILES)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_a_file_holds_the_recording_or_is_refused_with_the_way_out(file, tmp_path):
    for suffix, module in NEEDS.items():
        if file.name.endswith(suffix):
            pytest.importorskip(module)
    if file.name == "timetable.mat":
        pytest.importorskip("scipy")
    path = tmp_path / file.name
    file.write(path)
    options = options_of(file, tmp_path) if file.flags else Options()
    if file.refusal:
        with pytest.raises((LogError, SelectionError), match=file.refusal.replace("+", r"\+")) as e:
            read_log(path, PLANT, options)
        assert "\n" not in str(e.value) and str(path) in str(e.value)
        return
    log = read_log(path, PLANT, options)
    count = len(log.u)
    assert count >= len(PLAIN["t"]) - 10 and log.Ts == pytest.approx(0.01, rel=1e-4)
    assert log.measured["v_x"].mean() == pytest.approx(18.0, rel=1e-3)
    off = {"stray_quote.csv": 5e-3, "clocks_apart.csv": 1e-2}.get(file.name, 1e-6)
    np.testing.assert_allclose(log.y, PLAIN["yaw_rate"][:count], atol=off)
    if file.name != "clocks_apart.csv":
        np.testing.assert_allclose(log.u, PLAIN["steer"][:count], atol=1e-6)


def test_a_structure_that_ends_scipys_process_is_refused(tmp_path):
    file = next(file for file in FILES if file.name == "simulink.mat")
    file.write(tmp_path / file.name)
    _, content = mutations.mutated((tmp_path / file.name).read_bytes(), 3446)
    (tmp_path / file.name).write_bytes(content)
    with pytest.raises(LogError, match="damaged"):
        read_log(tmp_path / file.name, PLANT)


@pytest.mark.slow
def test_damaged_files_of_every_format_do_no_harm(tmp_path):
    """200 of the hunt of `scripts/log_files.py`."""
    contents = mutations._written(tmp_path)
    clean, counts = mutations.tuned(tmp_path / "plain.csv"), {}
    for k in range(200):
        source = mutations.SOURCES[k % len(mutations.SOURCES)]
        damage, content = mutations.mutated(contents[source], SEED + k)
        path = tmp_path / f"damaged_{source}"
        path.write_bytes(content)
        dbc = tmp_path / "trace.dbc" if source == "trace.blf" else None
        with np.errstate(all="ignore"):
            found, words = mutations.outcome(path, dbc, clean)
        assert found not in mutations.FORBIDDEN, (source, k, damage, words)
        counts[found] = counts.get(found, 0) + 1
    assert counts[mutations.RIGHT] >= 20 and counts[mutations.REFUSED] >= 50
