"""The ladder: whose gains answer, what is said where a rung is left, and the verdict."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import tuners
from tuners.trust.verdict import Verdict
from tuners.tuner.method import Rung
from tuners.tuner.recording import Recording
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.suspect import later, zeroed
from yawrate_env.vehicle.single_track import Vehicle
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())
TUNER = tuners.load("ts-ff-lag")
COUNT = 24


def drives(seed=0, **constants):
    """Vehicles, the plant that they are, and their recordings; with other constants, factors."""
    changed = {name: factor * getattr(Vehicle(), name) for name, factor in constants.items()}
    true = yaw_rate(Task(vehicle=replace(Vehicle(), **changed)))
    block = recorded(true, "test", seed, COUNT)
    return block.theta, true, Recording(block.u, block.y, true.Ts)


def test_exact_plants_are_answered_by_the_learner_and_lose_nothing():
    theta, true, recording = drives()
    climbed, found = TUNER.climb(recording)
    assert (climbed.rung <= Rung.FITTED_PLANT).all() and (found.verdicts == 0).all()
    alone, ladder = (
        np.sqrt((true.errors(theta, gains) ** 2).mean(axis=0))
        for gains in (TUNER.act(recording), climbed.gains.values)
    )
    assert (ladder < 1.05 * alone).all()


@pytest.mark.parametrize("name", ["C_f", "C_r", "l_r", "l_rel_r", "omega_n"])
@pytest.mark.parametrize("factor", [0.75, 1.25])
def test_one_wrong_constant_costs_no_margin_and_takes_care(name, factor):
    theta, true, recording = drives(**{name: factor})
    climbed, found = TUNER.climb(recording)
    reached = true.designs(theta)[1]
    errors = np.abs(true.errors(theta, climbed.gains.values))[reached]
    wrong = np.abs(true.errors(theta, TUNER.act(recording)))[reached]
    assert (errors < [1.5, 0.075]).all() and found.trusted.all()
    missed = (wrong > [3.0, 0.15]).any(axis=1)
    assert (found.verdicts[reached][missed] == 1).all()
    assert (climbed.rung == Rung.BLACK_BOX).mean() > 0.5


SAID = {
    "C_f": (0.8, "front stiffness about 20% smaller"),
    "l_r": (1.2, "rear axle distance about 20% larger"),
    "omega_n": (0.8, "actuator bandwidth about 20% smaller"),
    "l_rel_r": (0.05, "rear relaxation length looks absent"),
}


@pytest.mark.parametrize("name", SAID)
def test_what_the_recording_asks_to_change_is_named(name):
    factor, words = SAID[name]
    _, _, recording = drives(**{name: factor})
    results = [r for r in TUNER.results(recording) if r.rung is Rung.BLACK_BOX]
    named = sum(any(words in why for why in r.left) for r in results)
    assert named > 0.7 * len(results) > 5
    careful = [r for r in results if r.verdict is Verdict.USABLE_WITH_CARE]
    assert careful and all(set(r.left) <= set(r.reasons) for r in careful)


FAULTS = {
    "early": (lambda y: later(y, np.full(len(y), -20.0)), "answers 20 ms sooner", "command"),
    "late": (lambda y: later(y, np.full(len(y), 30.0)), "late by 30 ms", "dead time"),
    "scaled": (lambda y: 1.15 * y, "15% stronger", "scale"),
    "re-zeroed": (lambda y: zeroed(y, np.full(len(y), np.exp(-1e-3))), "at 0.16 Hz", "AC-coupled"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_may_be_wrong_with_the_log_is_asked(fault):
    change, words, asked = FAULTS[fault]
    _, _, recording = drives()
    results = TUNER.results(replace(recording, y=change(recording.y)))
    assert all(r.verdict is not Verdict.USABLE for r in results)
    questions = [[why for why in r.reasons if "?" in why and asked in why] for r in results]
    careful = [r.verdict is Verdict.USABLE_WITH_CARE for r in results]
    asking = [bool(q) for q, care in zip(questions, careful, strict=True) if care]
    assert np.mean(asking) > 0.9
    assert np.mean([any(words in why for why in q) for q in questions]) > 0.5


def test_a_reversed_sign_and_other_units_are_refused():
    _, _, recording = drives()
    for factor in (-1.0, 57.3):
        found = TUNER.assess(replace(recording, y=factor * recording.y))[1]
        assert not found.trusted.any()


def test_a_neutral_steer_car_hides_its_mass_and_is_answered():
    neutral = replace(Vehicle(), l_f=1.4, l_r=1.4, C_f=1.4e5, C_r=1.4e5)
    plant = yaw_rate(Task(vehicle=neutral))
    block = recorded(plant, "test", 0, 50)
    gains, found = tuners.load("gb", plant).assess(Recording(block.u, block.y, plant.Ts))
    asked = plant.designs(block.theta)[1]
    assert found.trusted[asked].mean() >= 0.98
    errors = np.abs(plant.errors(block.theta, gains.values))[asked]
    assert (errors < [1.5, 0.075]).all()


def test_a_loop_that_a_resonance_makes_cross_once_more_is_refused():
    """A lightly damped mode above the crossover: the rule's gains reach the target below it."""
    _, _, recording = drives()
    w, damping = 2 * np.pi * 2.3, 0.05
    num, den, _ = cont2discrete(([w**2], [1, 2 * damping * w, w**2]), 0.001, "zoh")
    clean = PLANT.respond(PLANT.middle)
    moded = clean + 0.5 * lfilter(np.squeeze(num), den, clean)
    noise = recording.y[:1] - PLANT.respond(drives()[0][:1])
    found = tuners.load("bb").tune(recording.u[0], (moded + noise)[0])
    assert found.verdict is Verdict.REFUSE
    assert "phase_margin_error" in [check.name for check in found.checks if not check.passed]


def test_too_short_a_recording_takes_care_and_a_shorter_one_is_refused():
    short = yaw_rate(Task(experiment=Experiment(N=2000, snr_db=10.0)))
    block = recorded(short, "test", 0, COUNT)
    found = TUNER.assess(Recording(block.u, block.y, short.Ts))[1]
    assert (found.verdicts > 0).all()
    results = TUNER.results(Recording(block.u, block.y, short.Ts).part(slice(0, 4)))
    for spread, result in zip(found.spread, results, strict=False):
        factor = (spread / short.metric_setting("spread")).max()
        assert any(f"or {factor:.1f} times as strong" in why for why in result.reasons)
    half = 1.645 * found.spread
    assert (found.verdicts[(half > [5.0, 0.25]).any(axis=1)] == 2).all()


def test_a_slow_integral_is_noted():
    theta = np.array([[0.36, 0.0, 20.0]])
    limited = yaw_rate(Task(target=replace(PLANT.loop_target, phase_margin=85.0)), check=False)
    y = limited.respond(theta)[0]
    noisy = y + 0.02 * y.std() * np.random.default_rng(0).standard_normal(len(y))
    found = tuners.load("bb", limited).tune(limited.u, noisy)
    assert any("Integral action is very slow" in note for note in found.notes) == (found.Ti > 5.0)
    assert found.Ti > 5.0


def test_the_batch_and_one_by_one_agree():
    _, _, recording = drives(C_r=1.2)
    few = recording.part(slice(0, 4))
    for i, result in enumerate(TUNER.results(few)):
        one = TUNER.tune(recording.u[0], recording.y[i])
        assert (one.rung, one.verdict, one.left) == (result.rung, result.verdict, result.left)
        assert list(one.gains.values()) == pytest.approx(list(result.gains.values()), rel=1e-6)
        for name, interval in one.intervals.items():
            assert interval.low == pytest.approx(result.intervals[name].low, rel=1e-6)


def test_the_black_box_alone_reports_no_vehicle():
    _, _, recording = drives()
    found = tuners.load("bb").tune(recording.u[0], recording.y[0])
    assert found.verdict is Verdict.USABLE and found.notes == ()
    assert np.isnan([*found.fit.parameters.values(), *found.fit.deviations.values()]).all()
    assert np.isnan([interval.low for interval in found.exact_intervals.values()]).all()
    assert found.loop.open is not None


def test_a_suspect_that_fails_is_named():
    def broken():
        raise KeyError("mass")

    _, _, recording = drives(C_r=1.25)
    tuner = tuners.load("gb", replace(PLANT, suspects=broken, check=False))
    assert tuner.tune(recording.u[0], recording.y[0]).left == ()
    learner = type(TUNER)(tuner.plant, TUNER.method)
    with pytest.raises(ValueError, match="suspects failed: KeyError"):
        learner.results(recording)


def test_no_episodes_are_refused():
    _, _, recording = drives()
    with pytest.raises(ValueError, match="number of episodes"):
        TUNER.results(recording.part(slice(0, 0)))


def test_a_contradiction_that_is_too_weak_or_disturbed_is_refused():
    changed = replace(Vehicle(), C_r=0.7 * Vehicle().C_r)
    weak = yaw_rate(Task(vehicle=changed, experiment=Experiment(N=3000, snr_db=12.0)))
    block = recorded(weak, "test", 0, COUNT)
    found = TUNER.assess(Recording(block.u, block.y, weak.Ts))[1]
    vague = found.findings["vague"].values > found.findings["vague"].limit
    assert vague.mean() > 0.3 and (found.verdicts[vague] == 2).all()
    _, _, recording = drives(C_r=0.7)
    t = 0.001 * np.arange(recording.y.shape[1])
    tone = 0.1 * recording.y.std(axis=1, keepdims=True) * np.sin(2 * np.pi * 1.5 * t)
    found = TUNER.assess(replace(recording, y=recording.y + tone))[1]
    contrast = found.findings["phase_margin_contrast"]
    assert (found.verdicts[contrast.values > contrast.limit] == 2).mean() > 0.9
    assert (contrast.values > contrast.limit).mean() > 0.5


def test_recordings_without_noise_are_usable_from_rest_and_in_motion():
    theta, _, recording = drives()
    clean = PLANT.respond(theta, recording.u)
    for first in (0, 2000):
        cut = replace(recording, u=recording.u[:, first:], y=np.ascontiguousarray(clean[:, first:]))
        assert (TUNER.assess(cut)[1].verdicts == 0).all()
