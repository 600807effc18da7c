"""Damaged files are refused in one line, or used: never a traceback."""

import json
import re

import numpy as np
import pytest
from command import EXAMPLE, TRUSTED, UNTRUSTED, UNUSABLE, WRONG, call, refused, tuner_of
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tuners.catalogue import shipped
from yawrate_env.vehicle.vehicle_file import example as paper

LINES = EXAMPLE.read_text().splitlines()[:402]
CELLS = st.sampled_from(
    ["", "nan", "inf", "-1e999", "1e308", "1e19", "x", "-", "0x10", "1,5", "1;2", '"', "\t",
     "999999", "-0.0", "12:00:01", "2024-01-01", "true", "µ"]
)  # fmt: skip
EDITS = st.lists(
    st.one_of(
        st.tuples(st.just("cell"), st.integers(0, 401), st.integers(0, 3), CELLS),
        st.tuples(st.just("column"), st.integers(0, 3), CELLS),
        st.tuples(st.just("drop"), st.integers(0, 401), st.integers(1, 300)),
        st.tuples(st.just("repeat"), st.integers(1, 401), st.integers(1, 50)),
        st.tuples(st.just("swap"), st.integers(0, 401), st.integers(0, 401)),
        st.tuples(st.just("cut"), st.integers(0, 12000)),
        st.tuples(st.just("insert"), st.integers(0, 12000), st.binary(min_size=1, max_size=20)),
    ),
    min_size=1,
    max_size=5,
)


def edited(edits):
    """The example's first 4 s with damage done to it."""
    lines, content = list(LINES), None
    for kind, *how in edits:
        if kind == "cell":
            row, column, text = how
            if row < len(lines):
                cells = lines[row].split(",")
                cells[min(column, len(cells) - 1)] = text
                lines[row] = ",".join(cells)
        elif kind == "column":
            column, text = how
            for k, line in enumerate(lines[1:], 1):
                cells = line.split(",")
                cells[min(column, len(cells) - 1)] = text
                lines[k] = ",".join(cells)
        elif kind == "drop":
            del lines[how[0] : sum(how)]
        elif kind == "repeat":
            lines[how[0] : how[0]] = lines[how[0] - 1 : how[0]] * how[1]
        elif kind == "swap":
            i, j = (min(k, len(lines) - 1) for k in how)
            if lines:
                lines[i], lines[j] = lines[j], lines[i]
    content = "\n".join(lines).encode()
    for kind, *how in edits:
        if kind == "cut":
            content = content[: how[0]]
        elif kind == "insert":
            content = content[: how[0]] + how[1] + content[how[0] :]
    return content


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
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_logs_never_give_a_traceback(name, edits, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(edited(edits))
    answers_or_refuses(path, name)


HEADS = [b"", b"t,steer,yaw_rate,speed\n", b"PAR1", b"MATLAB 5.0 MAT-file, ", b"\xff\xfe",
         b"\x89HDF\r\n\x1a\n", b"MDF     4.10    ", b"\xef\xbb\xbf"]  # fmt: skip


@given(
    content=st.binary(max_size=300),
    head=st.sampled_from(HEADS),
    suffix=st.sampled_from(["csv", "mat"]),
)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_files_of_noise_are_refused(content, head, suffix, tmp_path):
    path = tmp_path / f"noise.{suffix}"
    path.write_bytes(head + content)
    refused(UNUSABLE, "tune", path, "--tuner", "gb")


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
