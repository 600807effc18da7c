"""Faults, what they do to recordings and to the truth, and the study of who breaks where."""

import json
from dataclasses import replace

import numpy as np
import pytest
from recordings import recorded

import tuners
from studies import degree, drives, faulty, log_steps, plots, robustness_page, robustness_plot
from studies.drives import Drive, Fault, record
from studies.players import CLIMBER, LADDER, Ladder, Remembering, alone, named
from studies.robustness import PLAYERS, Condition, measure, pooled, study
from studies.robustness_kinds import ACTUATOR, GROUPS, LOG, LOG_ONLY, SIGNAL, VEHICLE
from studies.vehicle_steps import NAMES, wrong
from tuners.tuner.method import Rung
from yawrate_env.loop.simulation import simulate
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.task import Task

SHORT = Condition(30.0, 4.0)
TASK = SHORT.of(Task())
TUNER = tuners.load(CLIMBER)
COUNT = 3
ALL = {kind: fault for kinds in GROUPS.values() for kind, fault in kinds.items()}
FEW = {
    "nothing wrong": GROUPS["nothing wrong"],
    "the vehicle's data are wrong": {"C_f ± 30 %": VEHICLE["C_f ± 30 %"]},
    LOG_ONLY: {"command late": LOG["command late"]},
}


def made(fault, seed=0, count=COUNT, task=TASK):
    return record(fault, task, np.random.default_rng(seed), count)


@pytest.fixture(scope="module")
def rows():
    conditions = SHORT, Condition(20.0, 4.0)
    return study(TUNER, Task(), count=COUNT, groups=FEW, conditions=conditions)


@pytest.fixture(scope="module")
def levels():
    return degree.sweep(TUNER, Task(), count=COUNT, degrees=(0.0, 20.0))


@pytest.mark.parametrize("kind", ALL)
def test_every_kind_is_recorded_and_changes_something(kind):
    usual, found = made(Fault()), made(ALL[kind])
    assert len(found.recording) == COUNT == len(found.context)
    assert np.isfinite(found.recording.y).all() and np.isfinite(found.recording.u).all()
    goal, _ = found.reachable(TASK)
    assert goal.shape == (COUNT, 2)
    if kind != "nothing":
        signals = [np.broadcast_to(x.recording.u, x.recording.y.shape) for x in (usual, found)]
        same = signals[0].shape == signals[1].shape and np.array_equal(*signals)
        assert not (
            same
            and np.array_equal(usual.recording.y, found.recording.y)
            and np.array_equal(usual.recording.known, found.recording.known, equal_nan=True)
        )


@pytest.mark.parametrize("kind", LOG)
def test_what_only_the_log_has_does_not_change_the_vehicle(kind):
    usual, found = made(Fault()), made(LOG[kind])
    np.testing.assert_array_equal(found.context.mu_s, usual.context.mu_s)
    np.testing.assert_array_equal(found.reachable(TASK)[0], usual.reachable(TASK)[0])


def test_vehicles_that_do_not_change_on_the_way_drive_as_usual():
    rng = np.random.default_rng(0)
    context, u = faulty.of_prior(TASK, rng, COUNT), faulty.commands(TASK, rng, COUNT)
    nothing = np.zeros((COUNT, 1))
    drive = Drive(
        TASK, context, ((1000, context), (2500, context)), u, u, np.zeros_like(u), nothing,
        context.v_x, np.ones(COUNT),
    )  # fmt: skip
    alike = simulate(plants(TASK.vehicle, context, TASK.experiment.Ts), u)
    np.testing.assert_allclose(drives.driven(drive), alike, atol=1e-10)
    np.testing.assert_allclose(drives.driven(replace(drive, later=())), alike, atol=1e-10)


def test_the_design_rule_reaches_what_is_reachable_with_the_true_vehicle():
    for kind in ("sensor gain ± 3 %", "dead time up to 40 ms", "all ± 30 %, another car"):
        found = made(VEHICLE[kind])
        goal, reachable = found.reachable(TASK)
        target = TASK.target.phase_margin, TASK.target.crossover
        np.testing.assert_allclose(goal[reachable] - target, 0.0, atol=1e-6)
    gains = np.tile([0.2, 0.2], (COUNT, 1))
    stronger = replace(found, gain=np.full(COUNT, 1.1))
    scaled = gains * [1.1, 1.0]
    np.testing.assert_array_equal(stronger.reached(TASK, gains)[0], found.reached(TASK, scaled)[0])


def test_errors_of_no_size_are_none_and_masses_shift():
    usual, exact = made(Fault()), made(Fault(vehicle=(wrong(*NAMES, by=0.0),)))
    np.testing.assert_allclose(
        faulty.driven(TASK, exact.context, faulty.commands(TASK, np.random.default_rng(0), COUNT)),
        faulty.driven(TASK, usual.context, faulty.commands(TASK, np.random.default_rng(0), COUNT)),
        atol=1e-10,
    )
    heavier = faulty.scaled(TASK.vehicle, usual.context, "M_0", np.full(COUNT, 1.1))
    shift = heavier.M_delta - usual.context.M_delta
    np.testing.assert_allclose(shift, 0.1 * TASK.vehicle.M_0)


def test_masking_keeps_the_sum_of_the_delays():
    found = made(VEHICLE["omega_n and l_rel_f mask each other"])
    own, vehicle = found.context.others, TASK.vehicle
    delay = 2 * vehicle.xi / own["omega_n"] + own["l_rel_f"] / found.context.v_x
    usual = 2 * vehicle.xi / vehicle.omega_n + vehicle.l_rel_f / found.context.v_x
    np.testing.assert_allclose(delay, usual)


def test_commands_come_late_and_samples_are_held():
    late = made(LOG["command late"]).recording.u
    command = faulty.commands(TASK, np.random.default_rng(0), 1)[0]
    for row in late:
        shifts = [k for k in range(5, 60) if np.array_equal(row[k:], command[:-k])]
        assert len(shifts) == 1
    held = made(Fault(log=(log_steps.held(both=False),))).recording.y
    steps = np.diff(np.flatnonzero(np.diff(held[0])))
    assert len(set(steps.tolist())) == 1 and 20 <= steps[0] < 60


def test_two_faults_add_up():
    both = SIGNAL["drift"] + VEHICLE["C_f ± 30 %"] + ACTUATOR["deadband"]
    assert len(both.vehicle) == 2 and len(both.signal) == 1 and both.log == ()
    assert "C_f" in made(both).context.others


def test_counts_add_up(rows):
    assert len(rows) == 6
    for r in (*rows, pooled(rows)):
        assert sum(r.verdicts.values()) == sum(r.rungs.values()) == r.recordings
        assert sum(r.missed.values()) == r.misses["ladder"] <= r.recordings
        assert all(r.missed[v] <= r.verdicts[v] for v in r.verdicts)
        assert r.trusted == r.recordings - r.verdicts["refuse"]
        assert r.good == r.trusted - r.missed["usable"] - r.missed["usable_with_care"]
        assert max(r.covered) <= r.trusted and set(r.misses) == set(PLAYERS)
        assert (r.asked is not None) == (r.group == LOG_ONLY or r.condition == "together")
    everything = pooled(rows)
    assert everything.recordings == 6 * COUNT
    square = sum(r.good * r.rms[0] ** 2 for r in rows) / everything.good
    assert everything.rms[0] == pytest.approx(np.sqrt(square))


def test_without_a_fault_nobody_misses(rows):
    for r in (r for r in rows if r.kind == "nothing"):
        assert set(r.misses.values()) == {0} and r.reachable == r.recordings == r.trusted
        assert r.rms[0] < 1 and r.rms[1] < 0.05


def test_seeds_reproduce_whatever_else_is_measured(rows):
    which, fault = ("the vehicle's data are wrong", "C_f ± 30 %"), VEHICLE["C_f ± 30 %"]
    expected = next(r for r in rows if r.kind == which[1] and r.condition == SHORT.name)
    assert measure(TUNER, Task(), which, fault, SHORT, COUNT, 0) == expected
    assert measure(TUNER, Task(), which, fault, SHORT, COUNT, 1) != expected


def test_page_and_numbers_say_the_same(rows, levels, tmp_path):
    given = {"tuner": CLIMBER, "recordings": COUNT, "seed": 0}
    robustness_page.write(rows, levels, given, tmp_path)
    text = (tmp_path / "robustness.md").read_text()
    stored = json.loads((tmp_path / "robustness.json").read_text(), parse_constant=pytest.fail)
    assert robustness_page.page(*robustness_page.read(stored)) == text
    for group, kinds in FEW.items():
        assert f"| {group} | {2 * COUNT * len(kinds)} |" in text
        assert all(f"| {kind} | {2 * COUNT} |" in text for kind in kinds)
    assert f"Of {4 * COUNT} recordings with a fault" in text and "nan" not in text


def test_picture_has_a_row_a_kind_and_bars_of_all_answers(rows):
    who, what = robustness_plot.kinds(rows).axes
    labels = [label.get_text() for label in who.get_yticklabels()]
    assert labels == [kind for kinds in FEW.values() for kind in kinds]
    ends = {round(bar.get_y(), 6): bar.get_x() + bar.get_width() for bar in what.patches}
    np.testing.assert_allclose(list(ends.values()), 100)


def test_wrong_data_break_the_learner_and_not_the_ladder(levels, tmp_path, monkeypatch):
    assert [(x.degree, x.player) for x in levels] == [(d, p) for d in (0.0, 20.0) for p in PLAYERS]
    exact, off = ({x.player: x for x in levels if x.degree == d} for d in (0.0, 20.0))
    assert all(x.misses == 0 for x in exact.values())
    assert off["learner"].rms > 10 * exact["learner"].rms and off["ladder"].misses == 0
    monkeypatch.setattr(plots, "DPI", 20)
    figure = robustness_plot.degrees(levels)
    assert len(figure.axes) == 3
    plots.save(figure, tmp_path / "degrees.png")


def test_a_learner_alone_gives_its_own_gains_and_the_ladder_those_of_tune():
    recording = recorded(4)
    own, found = alone(TUNER).climb(recording)
    rested = replace(recording, y=found.model.y)
    np.testing.assert_array_equal(own.gains.values, TUNER.gains(rested).values)
    assert set(own.rung.tolist()) == {Rung.METHOD}
    climbed = TUNER.assess(recording)[0].values
    np.testing.assert_array_equal(Ladder(TUNER).act(recording), climbed)
    asked = Remembering(TUNER)
    assert asked.climb(recording)[0] is asked.climb(recording)[0]
    other = recording.part(slice(0, 2))
    assert len(asked.climb(other)[0].rung) == 2 and len(asked.climb(recording)[0].rung) == 4
    assert named(LADDER).method.rungs == TUNER.method.rungs != named(CLIMBER).method.rungs
    assert alone(tuners.load("gb")).method.kind == "gray-box"
