"""Damaged files are refused in one line, or used: never a traceback."""

import json
import re

import numpy as np
import pytest
from command import EXAMPLE, TRUSTED, UNTRUSTED, UNUSABLE, WRONG, call, refused, tuner_of
from damaged import EDITS, edited
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tuners.catalogue import shipped
from yawrate_env.vehicle.vehicle_file import example as paper

FLAGS = {
    "gb": (),
    "lag": ("--input-column", "2", "--output-column", "3", "--measured", "K=1"),
}


def answers_or_refuses(path, name):
    """Status 0 or 3 with an answer, or a refusal in one line."""
    tuner = "gb" if name == "gb" else tuner_of(name)
    code, out, err = call("tune", path, "--tuner", tuner, "--json", *FLAGS[name])
    if code in (TRUSTED, UNTRUSTED):
        found = json.loads(out)
        assert found["trusted"] is (code == TRUSTED)
        assert bool(found["reasons"]) is (code == UNTRUSTED) and err == ""
        for gain in found["gains"].values():
            assert 0 < gain < np.inf if gain is not None else code == UNTRUSTED
    else:
        assert code in (UNUSABLE, WRONG) and out == "", (code, err)
        assert re.fullmatch(r"error: [^\n]+\n", err), (code, err)


@pytest.mark.parametrize("name", FLAGS)
@given(edits=EDITS)
@example(edits=[("column", 1, "")])
@example(edits=[("column", 0, "1e308")])
@example(edits=[("cell", 200, 2, "1e308")])
@example(edits=[("cell", 200, 1, "inf")])
@example(edits=[("drop", 0, 1)])
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_logs_never_give_a_traceback(name, edits, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(edited(edits))
    answers_or_refuses(path, name)


@given(
    changes=st.dictionaries(st.integers(0, 10**6), st.integers(1, 255), min_size=1, max_size=4),
    cut=st.none() | st.integers(0, 1600),
)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_tuners_are_refused(changes, cut, tmp_path):
    content = bytearray(shipped("ts-ff").read_bytes())
    for position, change in changes.items():
        content[position % len(content)] ^= change
    path = tmp_path / "damaged.tuner"
    path.write_bytes(content[:cut])
    assert re.search(
        "tuner file|damaged|version", refused(UNUSABLE, "tune", EXAMPLE, "--tuner", path)
    )


@given(text=st.text(max_size=200), position=st.integers(0, len(paper())), cut=st.booleans())
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_vehicles_are_refused_or_used(text, position, cut, tmp_path):
    path = tmp_path / "car.toml"
    whole = paper()
    damaged = whole[:position] + text + whole[position:] * (not cut)
    path.write_bytes(damaged.encode("utf-8", "replace"))
    code, _, err = call("excite", "--vehicle", path, "-o", tmp_path / "prbs.csv")
    assert (code, err) == (0, "") or (code == UNUSABLE and re.fullmatch(r"error: [^\n]+\n", err))
