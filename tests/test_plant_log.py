"""`yawrate tune` with a plant's tuner: what a log may look like, and the report."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import first_order
import numpy as np
import pytest
from first_order import SIGMA, TAU, TS, U, gauged
from hypothesis import HealthCheck, given, settings
from test_cli import EDITS, EXAMPLE, UNTRUSTED, UNUSABLE, WRONG, call, edited, refused
from test_plant_closed_loop import integrator
from test_report import Checked, check_whole

import tuners
from tuners import logs, plants
from tuners.cli import main
from tuners.cli.grouped import PLANT, VEHICLE, Flag
from tuners.cli.report import render_plant
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.logs.plant_log import PlantOptions, read_log
from tuners.tuner.stages import Recipe
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

K, T = 1.25, 0.5
FEW = Recipe(
    Laguerre(4, 3.0), FeedForwardSettings(neurons=8, epochs=200, max_fail=20), noise_draws=2
)
RNG = np.random.default_rng(0)
Y = gauged.respond(np.array([[K, T]]))[0] + SIGMA * RNG.standard_normal(len(U))
COLUMNS = {"t": TS * np.arange(len(U)), "valve [%]": U, "flow": Y, "K": np.full(len(U), K)}


@pytest.fixture(scope="module")
def tuner(tmp_path_factory):
    path = tmp_path_factory.mktemp("tuner") / "my.tuner"
    plants.train(gauged, FEW, count=300, calibration=128).save(path)
    return path


@pytest.fixture
def written(tmp_path):
    """Write the recording, some columns changed or, if None, left out."""

    def write(columns=None, rows=slice(None), **changes):
        columns = (columns or COLUMNS) | changes
        kept = {name: values[rows] for name, values in columns.items() if values is not None}
        lines = [",".join(f"{v:.9g}" for v in row) for row in zip(*kept.values(), strict=True)]
        (tmp_path / "log.csv").write_text("\n".join([",".join(kept), *lines]))
        return tmp_path / "log.csv"

    return write


@pytest.fixture
def tuned(tuner, tmp_path):
    """Tune from a log: the JSON answer, of a status that fits it."""

    def tune(log, *flags):
        code, out, err = call("tune", log, "--tuner", tuner, "--json", *flags)
        assert err == "" and code in (0, UNTRUSTED), err
        found = json.loads(out)
        assert found["trusted"] is (code == 0)
        return found

    return tune


def test_the_answer_has_what_a_vehicles_has(tuned, written, tuner):
    found = tuned(written())
    assert found["gains"] == pytest.approx({"kp": T / (K * TAU), "Ti": T}, rel=0.02)
    assert found["trusted"] and found["reasons"] == [] and found["notes"] == []
    assert found["parameters"] == pytest.approx({"K": K, "T": T}, rel=0.02)
    assert found["log"] == {
        "file": "log.csv", "start": 0.0, "samples": 500, "Ts": TS, "measured": {"K": K},
    }  # fmt: skip
    assert found["fit"]["from_rest"] and found["fit"]["offset"] == 0
    assert set(found["fit"]["deviations"]) == {"T"} and 20 < found["fit"]["snr_db"] < 40
    assert {check["name"] for check in found["checks"]} > {"K", "misfit", "response"}
    assert found["tuner"] == str(tuner)


def test_in_words(written, tuner):
    code, out, _ = call("tune", written(), "--tuner", tuner, "--from", 2)
    assert code == 0 and out.startswith("log.csv: 2.00 to 10.00 s, every 20 ms, K 1.25\n")
    assert re.search(r"kp +1\.\d+\n", out) and re.search(r"of Ti .* between .* \(90 %\)", out)
    assert "Trusted" in out and "Notes\n  - The input is not that of the experiment" in out


# Columns, units and signs


def test_columns_and_scales_are_the_users(tuned, written):
    plain = tuned(written())
    renamed = {"time_ms": 1e3 * COLUMNS["t"], "a": -10 * U, "b": 2 * Y, "K": COLUMNS["K"]}
    log = written(renamed)
    scales = ("--input-scale", -0.1, "--output-scale", 0.5)
    for names in (("a", "b"), ("2", "3")):
        flags = ("--input-column", names[0], "--output-column", names[1], *scales)
        found = tuned(log, *flags)
        assert found["gains"] == pytest.approx(plain["gains"], rel=1e-6)
        assert found["trusted"]


def test_units_are_the_logs_or_the_users(tuned, written):
    plain = tuned(written())
    stated = {"t": COLUMNS["t"], "valve [1]": U / 100, "flow": 1e3 * Y, "K": COLUMNS["K"]}
    found = tuned(written(stated), "--output-unit", "ml/s")
    assert found["gains"] == pytest.approx(plain["gains"], rel=1e-6)
    assert found["notes"] == [
        "Column valve [1] was converted from 1 to %.",
        "Column flow was converted from ml/s to l/s.",
    ]


def test_columns_that_are_not_there(written, tuner):
    log = written({"t": COLUMNS["t"], "u": U, "level": Y})
    of = ("tune", log, "--tuner", tuner)
    line = refused(UNUSABLE, *of)
    assert "No column is called flow or y; there are t, u, level" in line
    assert "--output-column" in line
    assert "No column 'z' for input" in refused(WRONG, *of, "--input-column", "z")
    both = refused(WRONG, *of, "--output-column", "u")
    assert "Input and output are both column u" in both
    assert "leaves nothing over" in refused(WRONG, *of, "--input-scale", 0)


# What is measured beside the recording


def test_a_measured_parameter_is_a_column_or_a_flag(tuned, written):
    swinging = K * (1 + 0.04 * np.sin(COLUMNS["t"]))
    found = tuned(written(K=swinging))
    assert found["log"]["measured"]["K"] == pytest.approx(np.mean(swinging), rel=1e-6)
    assert any("K varies by 8% of its mean, which counts" in note for note in found["notes"])
    missing = written(K=None)
    flagged = tuned(missing, "--measured", "K=1.25")
    assert flagged["log"]["measured"] == {"K": 1.25} and flagged["trusted"]
    assert tuned(written(K=0 * Y), "--measured", "K=1.25")["trusted"]  # the flag wins
    assert not tuned(missing, "--measured", "K=1.6")["trusted"]


def test_a_measured_parameter_is_the_mean_of_any_column(tuned, written):
    swinging = K * (1 + 0.005 * np.sin(COLUMNS["t"]))
    log = written(K=0 * Y, **{"gain (filtered)": swinging, "1.5": swinging})
    mean = pytest.approx(np.mean(swinging), rel=1e-6)
    for named in ("gain (filtered)", "'gain (filtered)'", '"1.5"', '"5"'):  # or a place, from 1
        assert tuned(log, "--measured", f"K={named}")["log"]["measured"]["K"] == mean
    found = tuned(log, "--measured", "K=1.5")  # what reads as a number is one
    assert found["log"]["measured"] == {"K": 1.5}


def test_a_column_that_the_log_lacks_is_refused_with_those_it_has(written, tuner):
    of = ("tune", written(), "--tuner", tuner, "--measured")
    assert "No column 'speed' for K; there are t, valve [%], flow, K." in refused(
        WRONG, *of, "K=speed"
    )
    assert "No column '1.25' for K; there are t" in refused(WRONG, *of, 'K="1.25"')
    assert "K varies from" in refused(UNUSABLE, *of, "K=flow")


def test_a_measured_parameter_that_cannot_be_used(written, tuner):
    of = ("tune", written(K=None), "--tuner", tuner)
    assert "covers 0.5 to 2. Give what was measured, as in --measured K=2" in refused(UNUSABLE, *of)
    unknown = refused(WRONG, *of, "--measured", "T=1")
    assert "--measured = 'T' is unknown. Choose one of K" in unknown
    assert "not of the form NAME=VALUE" in refused(WRONG, *of, "--measured", "K")
    assert "not a finite number" in refused(WRONG, *of, "--measured", "K=nan")
    twice = refused(WRONG, *of, "--measured", "K=1", "--measured", "K=2")
    assert "--measured K is given twice" in twice
    again = refused(WRONG, *of, "--measured", "K=1", "--measured", "k=2")
    assert "--measured K is given twice" in again
    written(K=np.linspace(1.0, 1.5, len(U)))
    assert "K varies from 1 to 1.5, more than 25% of its mean" in refused(UNUSABLE, *of)


def test_outside_the_prior_is_not_trusted(tuned, written):
    found = tuned(written(K=np.full(len(U), 2.4)))
    assert any(reason.startswith("K is not within") for reason in found["reasons"])


# Time


@pytest.mark.parametrize("every", [2, 4])
def test_slower_samples_give_the_same_within_the_intervals(tuned, tmp_path, written, every):
    u = np.repeat(np.sin(np.cumsum(np.linspace(0.05, 0.4, len(U) // every))), every)
    y = gauged.respond(np.array([[K, T]]), u)[0] + SIGMA * RNG.standard_normal(len(u))
    log = {"t": TS * np.arange(len(u)), "u": u, "y": y, "K": np.full(len(u), K)}
    whole, part = tuned(written(log)), tuned(written(log, slice(None, None, every)))
    assert part["log"]["Ts"] == pytest.approx(every * TS) and part["trusted"]
    note = f"Ts is {every * TS:g} s: resampled to the plant's 0.02 s."
    assert note in part["notes"] and note not in whole["notes"]
    for figure, interval in part["metrics"].items():
        assert interval["low"] < whole["metrics"][figure]["value"] < interval["high"]


def test_time_stamps_are_judged_as_a_vehicles_are(tuned, written):
    jitter = RNG.uniform(-0.2, 0.2, len(U)) * TS
    found = tuned(written(t=COLUMNS["t"] + jitter))
    assert re.match(r"Time stamps are off an even grid by up to .* resampled", found["notes"][0])
    gap = tuned(written(rows=np.r_[0:20, 60 : len(U)]), "--start", "unknown")
    assert "A gap of 0.82 s at t = 0.38 s" in gap["notes"][0] and gap["log"]["samples"] == 440
    assert gap["trusted"]


def test_without_a_time_column_the_sampling_time_is_given(tuned, written, tuner):
    log = written(t=None)
    assert "No column looks like time" in refused(UNUSABLE, "tune", log, "--tuner", tuner)
    given, stamped = tuned(log, "--Ts", TS), tuned(written())
    assert given == stamped
    slow = refused(UNUSABLE, "tune", log, "--tuner", tuner, "--Ts", 0.5)
    assert "sampling time is 0.5 s; it must lie between 4e-05 and 0.188496 s" in slow


def test_a_stretch_is_chosen_or_found(tuned, written, tuner):
    found = tuned(written(), "--from", 3, "--to", 9.5)
    assert (found["log"]["start"], found["log"]["samples"]) == (3.0, 326) and found["trusted"]
    outside = refused(WRONG, "tune", written(), "--tuner", tuner, "--from", 30)
    assert "Nothing between 30 and 9.98 s" in outside
    quiet = np.zeros(1500)
    u = np.concatenate([quiet, U, U, quiet])
    y = gauged.respond(np.array([[K, T]]), u)[0] + SIGMA * RNG.standard_normal(len(u))
    log = {"t": TS * np.arange(len(u)), "u": u, "y": y, "K": np.full(len(u), K)}
    found = tuned(written(log))
    assert found["log"]["samples"] == 1000 and 25 < found["log"]["start"] < 35
    assert any("Best-excited stretch used" in note for note in found["notes"])


def test_start_and_offset_are_estimated_or_not(tuned, written):
    log = written(flow=Y + 0.3)
    for start in ("auto", "unknown"):
        found = tuned(log, "--start", start)
        assert found["trusted"] and found["fit"]["offset"] == pytest.approx(0.3, abs=0.03)
        assert not found["fit"]["from_rest"]
    found = tuned(log, "--start", "rest")
    assert not found["trusted"] and found["fit"]["from_rest"]


def test_a_reversed_sign_and_a_late_channel_are_found(tuned, written):
    reversed_log = written(**{"valve [%]": -U})
    found = tuned(reversed_log)
    assert "With the input's sign reversed a plant fits: try --input-scale -1." in found["notes"]
    assert tuned(reversed_log, "--input-scale", -1)["trusted"]
    late = 4
    log = {"t": COLUMNS["t"][late:], "u": U[late:], "y": Y[:-late], "K": COLUMNS["K"][late:]}
    found = tuned(written(log))
    assert any("logged 0.08 s late" in note for note in found["notes"]), found["notes"]
    assert not any("earlier" in note for note in tuned(written())["notes"])


def test_what_stands_still_is_refused(written, tuner):
    of = ("--tuner", tuner)
    assert "valve [%] is constant (0): nothing moves" in refused(
        UNUSABLE, "tune", written(**{"valve [%]": 0 * U}), *of
    )
    assert "flow [l/s] is constant (1)" in refused(UNUSABLE, "tune", written(flow=0 * Y + 1), *of)
    assert "samples are too few" in refused(
        UNUSABLE, "tune", written(), *of, "--from", 3.4, "--to", 4
    )


# Flags


def flags_of(kind):
    command = main.get_command(None, "tune")
    return [flag for flag in command.params if isinstance(flag, Flag) and flag.kind == kind]


@pytest.mark.parametrize("flag", flags_of(VEHICLE), ids=lambda flag: flag.name)
def test_a_vehicles_flags_are_not_a_plants(written, tuner, flag):
    value = () if flag.is_flag else (getattr(flag.type, "choices", ["1"])[0],)
    line = refused(WRONG, "tune", written(), "--tuner", tuner, flag.opts[0], *value)
    assert f"{flag.opts[0]} is for a vehicle's log" in line and "--input-column" in line


@pytest.mark.parametrize("flag", flags_of(PLANT), ids=lambda flag: flag.name)
def test_a_plants_flags_are_not_a_vehicles(flag):
    value = "v=1" if flag.name == "measured" else "1"
    line = refused(WRONG, "tune", EXAMPLE, "--tuner", "gb", flag.opts[0], value)
    assert f"{flag.opts[0]} is for a plant's log, and gb is a vehicle's tuner" in line


def test_the_help_shows_them_apart():
    _, out, _ = call("tune", "--help")
    shared, vehicle, plant = re.split(r"\nOptions for a (?:vehicle|plant)'s log:\n", out)
    for part, flag in ((shared, "--from"), (shared, "--start"), (vehicle, "--steer-ratio"),
                       (plant, "--measured")):  # fmt: skip
        assert [flag in text for text in (shared, vehicle, plant)].count(True) == 1
        assert flag in part


@given(edits=EDITS)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_logs_never_give_a_traceback(edits, tmp_path, tuner):
    path = tmp_path / "log.csv"
    path.write_bytes(edited(edits))
    columns = ("--input-column", "2", "--output-column", "3", "--measured", "K=1")
    code, out, err = call("tune", path, "--tuner", tuner, "--json", *columns)
    if code in (0, UNTRUSTED):
        assert json.loads(out)["trusted"] is (code == 0) and err == ""
    else:
        assert code in (UNUSABLE, WRONG) and out == "" and re.fullmatch(r"error: [^\n]+\n", err)


# A vehicle is a plant


def test_a_vehicles_log_gives_the_same_through_a_plants_door():
    """The example's twelve seconds in mid-drive, every 10 ms, for tuners of one recipe."""
    task = Task(prior=Prior(v_x=(10.0, 33.0)), experiment=Experiment(Ts=0.004, N=2500))
    recipe = Recipe(Laguerre(8, 12.0), FeedForwardSettings(neurons=6, epochs=40))
    own, plant = tuners.train(recipe, task, episodes=150), yaw_rate(task)
    generic = plants.train(plant, recipe, count=150, calibration=0)
    vehicle = logs.read_log(EXAMPLE, task, logs.Options())
    signals = logs.Choice({"input": "steer", "output": "yaw_rate"})
    log = read_log(EXAMPLE, plant, PlantOptions(signals, measured={"v_x": vehicle.speed.mean()}))
    np.testing.assert_array_equal(log.u, vehicle.steer)
    np.testing.assert_array_equal(log.y, vehicle.yaw_rate)
    expected = own.tune(vehicle.steer, vehicle.yaw_rate, vehicle.Ts, vehicle.speed)
    found = generic.tune(log.u, log.y, log.Ts, log.measured)
    assert list(found.gains.values()) == [expected.kp, expected.Ti]
    assert list(found.metrics.values()) == [expected.phase_margin, expected.crossover]
    assert found.trusted == expected.trusted and not found.fit.from_rest
    assert found.fit.offset == expected.fit.offset
    np.testing.assert_array_equal(found.fit.simulated, expected.fit.simulated)


# The report


@pytest.fixture(scope="module")
def answered(tuner, tmp_path_factory):
    """An answer for a log, or for its reverse, with all that a page needs."""
    made = plants.load(tuner)

    def answer(sign=1):
        path = tmp_path_factory.mktemp("log") / "log.csv"
        table = np.stack([COLUMNS["t"], sign * U, Y, COLUMNS["K"]], axis=1)
        np.savetxt(path, table, "%.9g", ",", header="t,u,y,K", comments="")
        log = read_log(path, gauged)
        return made.tune(log.u, log.y, log.Ts, log.measured), log, made, "my.tuner"

    return answer


@pytest.fixture(scope="module")
def page(answered):
    return render_plant(*answered())


def test_the_page_is_whole_and_loads_nothing(page):
    check_whole(page, pictures=4)


def test_figures_name_the_signals_with_their_units(page):
    words = set(re.findall(r"<text[^>]*>([^<]*)</text>", page))
    assert {"valve", "[%]", "flow", "[l/s]", "fitted model", "Residual with the valve"} <= words


SAID = """
    Gains from log.csv|Trusted|>kp<|Relative error of Ti|between |found, with a standard deviation|
    prior 0.2 to 1|measured; the tuner was made for 0.5 to 2|passed, limit 0.01|K 1.25|
    first_order:gauged|valve [%] to flow [l/s]|of the flow's power|that with the valve|
    Output that no plant explains|K outside what the tuner was made for|from rest, without offset
"""


def test_the_page_says_everything(page):
    for words in SAID.replace("\n    ", "").strip().split("|"):
        assert words in page, words


def test_every_check_has_a_name_for_people(page, answered):
    result, *_ = answered()
    table = page.partition("<h2>Checks</h2>")[2]
    for check in result.checks:
        assert f"<th>{check.name.replace('_', ' ')}<" not in table, check.name
    assert table.count("passed, limit") == len(result.checks)


@pytest.mark.parametrize("whole", [True, False])
def test_the_loop_is_drawn_where_the_plant_has_one(whole, answered):
    """Bode and a step beside it, or the step alone for wide and for narrow pages."""
    result, log, made, name = answered()
    asked = []

    def loop(theta, gains):
        asked.append((theta, gains))
        drawn = integrator(theta, gains)
        return drawn if whole else replace(drawn, open=None, stable=False)

    page = render_plant(result, log, SimpleNamespace(plant=replace(made.plant, loop=loop)), name)
    check_whole(page, pictures=6)
    theta, gains = asked[-1]
    assert dict(zip(gauged.prior, theta, strict=True)) == result.parameters
    assert dict(zip(gauged.gains, gains, strict=True)) == result.gains
    assert "Step of the flow by 1 l/s" in page
    assert ("Delay margin" in page and "0.53 Hz" in page) is whole
    assert ("the loop is unstable" in page) is not whole


def test_reasons_against_are_said(answered):
    page = render_plant(*answered(sign=-1))
    assert "Not trusted" in page and "class=failed" in page
    assert "Best for every plant of the prior: kp " in page
    Checked(page)


def test_a_report_is_written(written, tuner, tmp_path):
    log, path = written(), tmp_path / "out.html"
    code, out, _ = call("tune", log, "--tuner", tuner, "--report", path)
    assert code == 0 and "Trusted" in out and "Gains from log.csv" in path.read_text()
    assert "would be written over" in refused(
        WRONG, "tune", path, "--tuner", tuner, "--report", path
    )


# A plant whose responses do not add up starts where its log does


def read(path, **options):
    return read_log(path, first_order.plant, PlantOptions(**options))


def test_a_nonlinear_plant_is_used_from_its_start_to_the_first_gap(written):
    log = read(written(rows=np.r_[0:200, 240 : len(U)]))
    assert (log.t0, len(log.u)) == (0.0, 200)
    assert any("A gap of 0.82 s" in n and "the part before it is used" in n for n in log.notes)
    np.testing.assert_allclose(log.y, Y[:200], atol=1e-6)
    whole = read(written())
    assert len(whole.u) == len(U) and whole.notes == ()


@pytest.mark.parametrize(
    "rows, options, words",
    [
        (np.r_[0:20, 60 : len(U)], {}, "0.38 s before it are too short: at least 3 s .* --from"),
        (np.r_[0:20, 60 : len(U)], {"start": 0.0}, "0.38 s before it are too short"),
        (np.r_[0:20, 60 : len(U)], {"stop": 9.0}, "0.38 s before it are too short"),
        (slice(None), {"start": 30.0}, "Nothing between 30"),
    ],
)
def test_never_in_mid_drive(written, rows, options, words):
    with pytest.raises(ValueError, match=words):
        read(written(rows=rows), **options)


def test_a_start_is_the_users_to_choose(written):
    log = read(written(rows=np.r_[0:20, 60 : len(U)]), start=1.2)
    assert log.t0 == pytest.approx(1.2) and len(log.u) == len(U) - 60


def test_a_first_row_without_a_number_is_no_start(written):
    y = Y.copy()
    y[0] = np.nan
    with pytest.raises(logs.LogError, match="first row lacks a number.*--from"):
        read(written(flow=y))
    assert read(written(flow=y), start=0.02).t0 == pytest.approx(0.02)
