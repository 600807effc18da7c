"""Whatever a file holds, it is used or refused in one line: never a traceback."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from command import EXAMPLE, TRUSTED, UNTRUSTED, UNUSABLE, WRONG, call, refused, tuner_of
from damaged import EDITS, HEADS, edited
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from log_files import CASES, read

from tuners.catalogue import shipped
from tuners.logs import LogError, SelectionError
from yawrate_env.vehicle.vehicle_file import example as paper

FLAGS = ("--input-column", "2", "--output-column", "3", "--measured", "K=1")
COLUMNS = {
    "vehicle": {},
    "lag": {"columns": {"input": "2", "output": "3"}, "values": {"K": 1.0}},
}


def few(max_examples):
    fixtures = [HealthCheck.function_scoped_fixture]
    return settings(max_examples=max_examples, suppress_health_check=fixtures)


def read_or_refused(path, name):
    plant = CASES[name].plant
    if name == "lag":
        plant = replace(plant, u=0.02 * plant.u)  # the example steers by a degree
    try:
        log = read(path, plant, **COLUMNS[name])
    except (LogError, SelectionError) as error:
        assert "\n" not in str(error)
        return False
    assert len(log.u) == len(log.y) == len(log.time)
    assert np.isfinite([log.u, log.y, *log.measured.values()]).all() and 0 < log.Ts < 1
    return True


@pytest.mark.parametrize("name", CASES)
def test_the_example_is_read(name):
    assert read_or_refused(EXAMPLE, name)


@given(
    content=st.binary(max_size=300),
    head=st.sampled_from(HEADS),
    suffix=st.sampled_from(["csv", "mat"]),
)
@few(60)
def test_noise_is_refused(content, head, suffix, tmp_path):
    path = tmp_path / f"noise.{suffix}"
    path.write_bytes(head + content)
    assert not read_or_refused(path, "vehicle")


@pytest.mark.parametrize("name, flags", [("vehicle", ()), ("lag", FLAGS)])
@given(edits=EDITS)
@example(edits=[("column", 1, "")])
@example(edits=[("column", 0, "1e308")])
@example(edits=[("cell", 200, 2, "1e308")])
@example(edits=[("cell", 200, 1, "inf")])
@example(edits=[("drop", 0, 1)])
@few(20)
def test_damaged_logs_are_answered_or_refused(name, flags, edits, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(edited(edits))
    read_or_refused(path, name)
    tuner = "gb" if name == "vehicle" else tuner_of(name)
    code, out, err = call("tune", path, "--tuner", tuner, "--json", *flags)
    if code in (TRUSTED, UNTRUSTED):
        found = json.loads(out)
        assert found["trusted"] is (code == TRUSTED)
        assert bool(found["reasons"]) is (code == UNTRUSTED) and err == ""
        for gain in found["gains"].values():
            assert 0 < gain < np.inf if gain is not None else code == UNTRUSTED
    else:
        assert code in (UNUSABLE, WRONG) and out == "", (code, err)
        assert re.fullmatch(r"error: [^\n]+\n", err), (code, err)


@given(
    changes=st.dictionaries(st.integers(0, 10**6), st.integers(1, 255), min_size=1, max_size=4),
    cut=st.none() | st.integers(0, 1600),
)
@few(40)
def test_damaged_tuners_are_refused(changes, cut, tmp_path):
    content = bytearray(shipped("ts-ff").read_bytes())
    for position, change in changes.items():
        content[position % len(content)] ^= change
    path = tmp_path / "damaged.tuner"
    path.write_bytes(content[:cut])
    line = refused(UNUSABLE, "tune", EXAMPLE, "--tuner", path)
    assert re.search("tuner file|damaged|version", line)


@given(text=st.text(max_size=200), position=st.integers(0, len(paper())), cut=st.booleans())
@few(40)
def test_damaged_vehicles_are_refused_or_used(text, position, cut, tmp_path):
    path = tmp_path / "car.toml"
    whole = paper()
    damaged = whole[:position] + text + whole[position:] * (not cut)
    path.write_bytes(damaged.encode("utf-8", "replace"))
    code, _, err = call("excite", "--vehicle", path, "-o", tmp_path / "prbs.csv")
    assert (code, err) == (0, "") or (code == UNUSABLE and re.fullmatch(r"error: [^\n]+\n", err))
