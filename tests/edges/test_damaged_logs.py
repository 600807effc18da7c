"""Whatever a file holds, it is read or refused in one line."""

from dataclasses import replace

import numpy as np
import pytest
from damaged import EDITS, EXAMPLE, HEADS, edited
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from log_files import CASES, read

from tuners.logs import LogError, SelectionError

FEW = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
COLUMNS = {
    "vehicle": {},
    "lag": {"columns": {"input": "2", "output": "3"}, "values": {"K": 1.0}},
}


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


@pytest.mark.parametrize("name", CASES)
@given(edits=EDITS)
@example(edits=[("column", 1, "")])
@example(edits=[("column", 0, "1e308")])
@example(edits=[("cell", 200, 2, "1e308")])
@example(edits=[("cell", 200, 1, "inf")])
@example(edits=[("drop", 0, 1)])
@FEW
def test_damaged_text_is_read_or_refused(edits, name, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(edited(edits))
    read_or_refused(path, name)


@given(
    content=st.binary(max_size=300),
    head=st.sampled_from(HEADS),
    suffix=st.sampled_from(["csv", "mat"]),
)
@FEW
def test_noise_is_refused(content, head, suffix, tmp_path):
    path = tmp_path / f"noise.{suffix}"
    path.write_bytes(head + content)
    assert not read_or_refused(path, "vehicle")
