"""Which column of a log is which: by its name, by the user's choice, or refused."""

from dataclasses import replace

import numpy as np
import pytest
from log_files import CASES, check_same, read, write

from tuners.logs import LogError, SelectionError
from tuners.logs.columns import find
from tuners.logs.options import Options
from tuners.logs.table import Column, Table

VEHICLE, LAG = CASES["vehicle"], CASES["lag"]


@pytest.mark.parametrize(
    "role, name",
    [("input", "Steering_Cmd [deg]"), ("input", "log.delta_f_cmd"), ("input", "steering command"),
     ("output", "YawRate"), ("output", "psi_dot"), ("output", "y_rad_s"), ("v_x", "v_x"),
     ("v_x", "v_mps"), ("v_x", "Vehicle Speed (km/h)"), ("time", "Timestamp_ms")],
)  # fmt: skip
def test_names_that_a_vehicle_has(role, name):
    rest = {"time": "t", "input": "steer", "output": "yaw_rate", "v_x": "speed"}
    del rest[role]
    table = Table(("other", name, *rest.values()), lambda _: Column(np.ones(9)))
    assert find(table, VEHICLE.plant, Options()).quantities[role].name == name


@pytest.mark.parametrize(
    "names",
    ["tuyK", ("Time", "Valve", "FLOW", "k"), ("t", "valve_%", "y", "K"),
     ("zeit", "log.valve [%]", "flow_l/s", "K (-)")],
)  # fmt: skip
def test_names_that_a_lag_has(path, names):
    columns = dict(zip(names, LAG.columns.values(), strict=True))
    check_same(read(write(path, columns), LAG.plant), LAG)


def test_the_first_of_the_plants_names_wins(path):
    columns = VEHICLE.columns | {"u": 0 * VEHICLE.u, "y": 0 * VEHICLE.y, "v": 0 * VEHICLE.u}
    check_same(read(write(path, columns), VEHICLE.plant), VEHICLE)


def test_columns_are_given_by_name_or_number(path, case):
    write(path, dict(zip("abcd", case.columns.values(), strict=True)))
    roles = "time", "input", "output", case.measured
    for header, given in ((True, "abcd"), (True, "1234"), (False, "1234")):
        if not header:
            path.write_text(path.read_text().partition("\n")[2])
        check_same(read(path, case.plant, columns=dict(zip(roles, given, strict=True))), case)


@pytest.mark.parametrize(
    "options, error, message",
    [
        ({"columns": {"input": "zork"}}, SelectionError, "zork.*there are t"),
        ({"columns": {"input": "3", "output": "3"}}, SelectionError, "both column"),
        ({"columns": {"zork": "3"}}, SelectionError, "'zork' is unknown"),
        ({"values": {"T": 1.0}}, SelectionError, "'T' is unknown"),
        ({"values": {"input": 1.0}}, SelectionError, "input"),
        ({"input_is": "measured"}, SelectionError, "input_is.*actuator"),
        ({"start": 20.0, "stop": 30.0}, SelectionError, r"20 and 30 s"),
    ],
)
def test_choices_that_a_log_does_not_have(path, options, error, message):
    with pytest.raises(error, match=message):
        read(write(path, LAG.columns), LAG.plant, **options)
    with pytest.raises(SelectionError, match="'K'.*no measured parameters"):
        read(path, replace(LAG.plant, measured={}), values={"K": 1.0})


@pytest.mark.parametrize(
    "change, message",
    [
        ({"synonyms": {"input": "steer"}}, "synonyms input"),
        ({"synonyms": {"zork": ("steer",)}}, "synonyms.*zork"),
        ({"cautions": {"swa": 1}}, "cautions swa"),
    ],
)
def test_a_plants_names_for_logs_are_checked(change, message):
    with pytest.raises(ValueError, match=message):
        replace(LAG.plant, **change)


def test_a_measured_parameter_is_a_column_or_a_value(path, case):
    name, value = case.measured, case.value
    write(path, case.columns | {case.names[3]: 0 * case.u, "other": 0 * case.u + value})
    check_same(read(path, case.plant, values={name: value}), case)
    check_same(read(path, case.plant, columns={name: "other"}), case)
    label = case.names[3].upper()  # what the plant calls it, in any case
    check_same(read(path, case.plant, values={label: value}), case)
    for double in ({"values": {name: value, f"{name} ": value}}, {"values": {name: value},
                   "columns": {label: "other"}}):  # fmt: skip
        with pytest.raises(SelectionError, match="given twice"):
            read(path, case.plant, **double)


def test_a_measured_parameter_that_is_missing(path, case):
    columns = case.columns
    del columns[case.names[3]]
    low, high = case.plant.prior[case.measured]
    with pytest.raises(LogError, match=f"{low:g} to {high:g}.*--measured {case.names[3]}={high:g}"):
        read(write(path, columns), case.plant)
    known = replace(case.plant, prior=case.plant.prior | {case.measured: (case.value,) * 2})
    log = read(path, known)
    check_same(log, case)
    assert case.names[3] in log.notes[0]


def test_a_parameter_that_is_recorded_less_often_is_interpolated(path, case):
    values = case.value + 1e-5 * np.arange(len(case.u))
    text = [x if k % 10 == 0 else "" for k, x in enumerate(values.tolist())]
    log = read(write(path, case.changed(measured=text)), case.plant)
    assert log.notes == () and len(log.u) == len(values)
    np.testing.assert_allclose(log.measured[case.measured][:-10], values[:-10])
