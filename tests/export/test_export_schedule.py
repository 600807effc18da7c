"""Gains over speed as a C table: interpolation, bounds, and what is refused."""

import numpy as np
import pytest
from c_programs import notices, passes, written

from tuners.export.schedule_program import (
    BEYOND,
    INVALID,
    WITHIN,
    GainTable,
    golden_values,
    schedule_program,
)

VALUES = np.array([10.0, 14.0, 22.0, 33.0])
TABLE = GainTable("speed [m/s]", VALUES, ("kp", "Ti"),
                  np.array([[0.2, 0.05], [0.17, 0.09], [0.15, 0.14], [0.14, 0.22]]))  # fmt: skip
NAME = "yawrate_schedule"


def test_between_two_values_it_is_a_straight_line_and_beyond_the_end():
    status, gains = TABLE.lookup(18.0)
    assert status == WITHIN and gains == pytest.approx([0.16, 0.115])
    assert [TABLE.lookup(v)[0] for v in (10.0, 33.0, 9.99, 34.0)] == [WITHIN, WITHIN] + [BEYOND] * 2
    assert TABLE.lookup(50.0)[1].tolist() == TABLE.gains[-1].tolist()
    assert TABLE.lookup(np.nan)[0] == TABLE.lookup(np.inf)[0] == INVALID


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_c_agrees_with_python(tmp_path, real, count):
    some = GainTable(TABLE.parameter, VALUES[:count], TABLE.names, TABLE.gains[:count])
    assert passes(written(tmp_path, schedule_program(some, real=real)), NAME)


def test_the_test_program_notices_mistakes(tmp_path):
    folder = written(tmp_path, schedule_program(TABLE))
    mistakes = {
        "share * (": "0.5 * (",
        "return YAWRATE_SCHEDULE_INVALID;": "return YAWRATE_SCHEDULE_WITHIN;",
        "before = after;\n        after++;": "after++;",
        "status = YAWRATE_SCHEDULE_BEYOND;": "status = YAWRATE_SCHEDULE_WITHIN;",
    }
    assert notices(folder, f"{NAME}.c", mistakes, NAME)


def test_golden_values_reach_every_status():
    assert {TABLE.lookup(value)[0] for value in golden_values(TABLE)} == {WITHIN, BEYOND, INVALID}


def test_what_is_no_table_is_refused():
    with pytest.raises(ValueError, match="values"):
        GainTable("speed", VALUES[::-1], ("kp",), np.ones((4, 1)))
    with pytest.raises(ValueError, match="gains"):
        GainTable("speed", VALUES, ("kp",), np.array([[1.0], [np.nan], [1.0], [1.0]]))
    close = GainTable("speed", np.array([1.0, 1.0 + 1e-9]), ("kp",), np.ones((2, 1)))
    with pytest.raises(ValueError, match="values"):
        schedule_program(close, real="float")
    with pytest.raises(ValueError, match="real"):
        schedule_program(TABLE, real="int")
