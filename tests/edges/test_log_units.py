"""Units in a plant's names and in a log's columns: what is converted, and what is refused."""

import sys

import numpy as np
import pytest
from first_order import TS, U, described, simulate
from hypothesis import given, settings
from hypothesis import strategies as st

from tuners.logs import LogError, Options, SelectionError, read_log, units
from tuners.logs.units import UnitError, alike, conversion, stated

Y = simulate(np.array([[1.25, 0.5]]), U, None)[0] + 0.01
DRIVEN = described(
    prior={"K [rad/(V s)]": (0.5, 2.0), "T": (0.2, 1.0), "load [N m]": (0.0, 5.0)},
    simulate=lambda theta, u, rng: simulate(theta[:, :2], u, rng),
    design=lambda theta: theta[:, :2].copy(),
    measured={"load [N m]": 0.1},
    signals=("motor voltage [V]", "speed [rad/s]"),
)


@pytest.fixture
def read(tmp_path):
    """Read a log of these columns, with a row of units or without."""

    def reading(table, row="", plant=DRIVEN, **options):
        rows = np.stack(list(table.values()), axis=1).tolist()
        lines = [",".join(table), *([row] if row else []), *(",".join(map(repr, r)) for r in rows)]
        (tmp_path / "log.csv").write_text("\n".join(lines))
        return read_log(tmp_path / "log.csv", plant, Options(**options))

    return reading


def logged(voltage="motor voltage", speed="speed", load="load [Nm]", u=U, y=Y):
    return {"t": TS * np.arange(len(U)), voltage: u, speed: y, load: np.full(len(U), 2.0)}


def same(log):
    np.testing.assert_allclose(log.u, U, rtol=1e-12)
    np.testing.assert_allclose(log.y, Y, rtol=1e-12)
    np.testing.assert_allclose(log.measured["load [N m]"], 2.0)


# Units


SPELLINGS = {
    "s": {"s sec seconds": 1.0, "ms": 1e-3, "us µs": 1e-6, "ns": 1e-9, "min minutes": 60.0,
          "h hours": 3600.0},
    "rad": {"rad radians": 1.0, "deg ° degrees degree grad Grad Deg": np.pi / 180},
    "rad/s": {"rad/s rads radps rad_s rad/sec": 1.0,
              "deg/s degs degps deg_s °/s deg/sec dps": np.pi / 180},
    "m/s": {"m/s mps m_s ms-1 meterspersecond m·s-1": 1.0, "km/h kmh kph km_h": 1 / 3.6,
            "mph mi/h": 0.44704, "kn": 1852 / 3600},
}  # fmt: skip


def test_units_that_logs_of_vehicles_have():
    for si, names in SPELLINGS.items():
        for spellings, factor in names.items():
            for spelling in spellings.split():
                expected = pytest.approx(factor, rel=1e-12), 0.0
                assert conversion(spelling, si) == expected, spelling


@pytest.mark.parametrize(
    "unit, wanted, factor, offset",
    [
        ("mV", "V", 1e-3, 0), ("MV", "V", 1e6, 0), ("Volt", "V", 1, 0), ("µV", "V", 1e-6, 0),
        ("rpm", "rad/s", np.pi / 30, 0), ("RPM", "rad/s", np.pi / 30, 0),
        ("U/min", "rad/s", np.pi / 30, 0), ("rev/min", "deg/s", 6, 0), ("min-1", "1/s", 1 / 60, 0),
        ("%", "1", 0.01, 0), ("%", "-", 0.01, 0), ("°C", "K", 1, 273.15),
        ("°F", "°C", 5 / 9, -160 / 9), ("mNm", "N m", 1e-3, 0),
        ("Nm/rad", "N·m/deg", np.pi / 180, 0),
        ("kg m2", "kg m²", 1, 0), ("m3/h", "l/s", 1 / 3.6, 0), ("l/min", "cm^3/s", 1e3 / 60, 0),
        ("mbar", "kPa", 0.1, 0), ("cm3/(s V)", "cm3/s/V", 1, 0), ("kOhm", "Ω", 1e3, 0),
    ],
)  # fmt: skip
def test_a_unit_is_brought_to_another(unit, wanted, factor, offset):
    assert conversion(unit, wanted) == pytest.approx((factor, offset), rel=1e-9)
    assert alike(unit, wanted)


@pytest.mark.parametrize(
    "unit, wanted, said",
    [
        ("Hz", "rad/s", "measure different things"),
        ("1/min", "rad/s", "measure different things"),
        ("C", "°C", "measure different things"),
        ("°C", "V", "°C and V measure different things"),
        ("zork", "V", "'zork' is no unit"),
        ("V", "zork", "'zork' is no unit"),
        ("NM", "N m", "'NM' is no unit"),
        ("dB", "1", "no matter of factors"),
        ("1^9^9^9", "1", "is no unit"),
        ("10 V", "V", "is no unit"),
    ],
)
def test_what_is_no_unit_or_another_kind_is_said(unit, wanted, said):
    with pytest.raises(UnitError, match=said):
        conversion(unit, wanted)
    assert not alike(unit, wanted)
    assert conversion("zork", "zork") == (1.0, 0.0)  # a unit that is unknown to all is itself


@given(st.text(max_size=40) | st.from_regex(units._FORM, fullmatch=True))
@settings(max_examples=60)
def test_any_text_is_a_unit_or_none(text):
    try:
        factor, offset = conversion(text, "V")
    except UnitError:
        return
    assert np.isfinite([factor, offset]).all()


@pytest.mark.parametrize(
    "name, unit, said",
    [("x [kg/(m s)]", "", "kg/(m s)"), ("x (V)", "", "V"), ("x", "[mV]", "mV"),
     ("x [V]", "mV", "mV"), ("x (raw) [°]", "", "°"), ("x [-]", "", ""), ("x", "-", ""),
     ("x [1]", "", "1")],
)  # fmt: skip
def test_what_a_column_states(name, unit, said):
    assert stated(name, unit) == said


# Logs


NOTES = (
    "Column {} was converted from mV to V.",
    "Column {} was converted from rpm to rad/s.",
)


@pytest.mark.parametrize("form", ["{} [{}]", "{} ({})", "{}_{}", "{}"])
def test_columns_are_converted_and_that_is_said(read, form):
    names = form.format("motor_voltage", "mV"), form.format("Speed", "rpm")
    row = "s,mV,rpm,Nm" if form == "{}" else ""
    log = read(logged(*names, u=1e3 * U, y=30 / np.pi * Y), row)
    same(log)
    assert log.notes == tuple(n.format(name) for n, name in zip(NOTES, names, strict=True))


@pytest.mark.parametrize("scale", [1.0, -1.0])
def test_a_scale_of_one_goes_with_units_that_differ_by_an_offset(read, scale):
    warm = described(signals=("heater [kW]", "temperature [degC]"))
    columns = {"t": TS * np.arange(len(U)), "heater [W]": 1e3 * U, "temperature (K)": Y + 273.15}
    log = read(columns, plant=warm, output_scale=scale)
    np.testing.assert_allclose(log.y, scale * Y, atol=1e-12)


def test_a_unit_that_cannot_be_looked_at_is_said(read):
    columns = {"t": TS * np.arange(len(U)), "u [%]": U, "y": Y}
    log = read(columns, plant=described(signals=("u", "y")))
    np.testing.assert_allclose(log.u, U)
    assert log.notes == (
        "Column u [%] was taken as it is: the plant does not say what unit its u has.",
    )


def test_columns_are_chosen_with_their_units_or_without(read):
    columns = {"input": "pump", "output": "flow (raw)"}
    named = logged("pump [mV]", "flow (raw) [rpm]", "torque [mNm]", 1e3 * U, 30 / np.pi * Y)
    named["torque [mNm]"] *= 1e3
    with pytest.raises(SelectionError, match=r"No column 'flow \(raw\)'"):
        read(named, columns=columns)
    columns["output"] = "flow (raw) [rpm]"
    same(read(named, columns=columns | {"load": "torque"}))
    with pytest.raises(SelectionError, match="No column 'pump'"):  # two of a name
        read(named | {"pump [V]": U}, columns=columns)


def test_slow_plants_have_logs_in_hours(read):
    columns = logged("motor_voltage", "speed")
    log = read({"time [h]": columns.pop("t") / 3600.0} | columns)
    assert log.Ts == pytest.approx(TS)
    same(log)


def test_channels_of_mdf_state_theirs(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    channels = {"u": ("mV", 1e3 * U), "y": ("rad/s", Y), "load": ("mNm", 0 * U + 2e3)}
    with asammdf.MDF(version="4.10") as file:
        for name, (unit, values) in channels.items():
            file.append(asammdf.Signal(values, TS * np.arange(len(U)), name=name, unit=unit))
        file.save(tmp_path / "log.mf4")
    log = read_log(tmp_path / "log.mf4", DRIVEN)
    same(log)
    assert log.notes == (NOTES[0].format("u"), "Column load was converted from mNm to N m.")


@pytest.fixture
def without_pint(monkeypatch):
    caches = units._registry, units._parsed
    for cache in caches:
        cache.cache_clear()
    monkeypatch.setitem(sys.modules, "pint", None)
    yield
    for cache in caches:
        cache.cache_clear()


@pytest.mark.parametrize(
    "names",
    [("motor voltage", "speed", "load"), ("u", "y", "load [-]"),
     ("Motor Voltage [V]", "speed (rad/s)", "load [N m]")],
)  # fmt: skip
def test_only_a_conversion_needs_pint(read, without_pint, names):
    log = read(logged(*names))
    same(log)
    assert log.notes == ()
    with pytest.raises(LogError, match=r'units are converted by Pint: pip install "yawrate\[tune'):
        read(logged("motor voltage [mV]"))


def test_measured_parameters_are_converted(read):
    log = read(logged(load="load [mNm]"))
    np.testing.assert_allclose(log.measured["load [N m]"], 2e-3)
    assert log.notes == ("Column load [mNm] was converted from mNm to N m.",)
    for name in ("load", "load [N m]"):
        given = read(logged(load="other"), values={name: 3.0}).measured["load [N m]"]
        np.testing.assert_array_equal(given, 3.0)
    given = read(logged(load="other"), values={"load": 3e3}, units={"load": "mNm"}).measured
    np.testing.assert_allclose(given["load [N m]"], 3.0)
    with pytest.raises(
        LogError, match="No column looks like load, .* 0 to 5 N m.* --measured load=5"
    ):
        read(logged(load="other"))
    with pytest.raises(
        LogError, match="'A', but the plant's load is in N m.*--measured load=VALUE"
    ):
        read(logged(load="load [A]"))
    with pytest.raises(ValueError, match="at most 7.5. Give it in N m, or describe"):
        DRIVEN.check_value("load [N m]", 2000.0)


@pytest.mark.parametrize(
    "name, said",
    [
        ("speed [zork]", "Column speed .zork. says 'zork', but the plant's speed is in rad/s, and "
         "'zork' is no unit that is known. Give --output-unit."),
        ("speed [°C]", "°C and rad/s measure different things. Give --output-unit."),
        ("speed (filtered)", "'filtered' is no unit that is known. Give --output-unit"),
        ("speed_zork", "No column looks like speed"),
    ],
)  # fmt: skip
def test_what_the_log_says_and_cannot_be_is_refused(read, name, said):
    with pytest.raises(LogError, match=said):
        read(logged(speed=name))


def test_the_users_unit_wins(read):
    log = read(logged("motor voltage [zork]", u=1e3 * U), units={"input": "mV"})
    same(log)
    assert read(logged(speed="speed [zork]"), units={"output": "rad/s"}).notes == ()
    for unit, said in (
        ("zork", "--input-unit zork: .* 'zork' is no unit"),
        ("K", "different things"),
    ):
        with pytest.raises(SelectionError, match=said):
            read(logged(), units={"input": unit})
    with pytest.raises(
        SelectionError, match="does not say what unit its u has. Give --input-scale"
    ):
        nameless = described(signals=("u", "y"))
        read(logged("u", "y"), plant=nameless, units={"input": "mV"})


def test_a_scale_comes_after_the_unit(read):
    log = read(logged("motor voltage [mV]", u=-1e3 * U), input_scale=-1.0)
    same(log)
    assert log.notes == (
        "Column motor voltage [mV] was converted from mV to V.",
        "Column motor voltage [mV] was then multiplied by -1.",
    )
    same(read(logged(speed="speed [rad/s]", y=2 * Y), output_scale=0.5))


@pytest.mark.parametrize("scale, remedy", [(0.001, "Leave it out"), (-0.00101, "Give -1")])
def test_no_conversion_is_made_twice(read, scale, remedy):
    said = rf"--input-scale {scale:g}: column .* is converted from mV to V without that. {remedy}\."
    with pytest.raises(SelectionError, match=said):
        read(logged("motor voltage [mV]"), input_scale=scale)
