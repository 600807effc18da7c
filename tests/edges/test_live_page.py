"""The page's own script against Python, at 200 positions of its sliders."""

import json
import shutil
import subprocess
from dataclasses import replace
from functools import cache

import control
import numpy as np
import pytest
from command import log_of
from recordings import ROOT, recorded

import tuners
from tuners.cli.report.live import live
from tuners.pidtune import pidtune
from tuners.trust.response import Response
from yawrate_env.loop.design import design_from_response
from yawrate_env.loop.loops import Loops
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.task import Experiment

SCRIPT = ROOT / "tuners" / "cli" / "report" / "templates" / "loop.js"
COUNT, HORIZON = 200, 600
ASK = """
const Loop = require(process.argv[1]);
const {model, positions, samples} = JSON.parse(require("fs").readFileSync(0));
console.log(JSON.stringify(positions.map(([kind, crossover, margin, delay]) => {
  const C = Loop.design(model, kind, crossover, margin, delay);
  if (C === null) return null;
  const found = Loop.margins(model, C, delay), drawn = Loop.responses(model, C, delay, samples);
  return {gains: Loop.gains(C), found, stable: Loop.stable(found, drawn), step: [...drawn.step],
          spread: Loop.spread(model, C, delay, found)};
})));
"""

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="needs node")


@cache
def answer(tuner):
    log = log_of("vehicle")
    result = tuners.load(tuner).tune(log.u, log.y, log.Ts, log.measured)
    return result, live(result, log, tuner)


def asked(tuner, kinds):
    """Positions, and what the page's script makes of them."""
    _, model = answer(tuner)
    rng, reach = np.random.default_rng(0), model["range"]
    positions = [
        (str(rng.choice(kinds)), rng.uniform(reach["slowest"], reach["fastest"]),
         rng.uniform(30.0, 80.0), int(rng.integers(0, 8)))
        for _ in range(COUNT)
    ]  # fmt: skip
    sent = json.dumps({"model": model, "positions": positions, "samples": HORIZON})
    done = subprocess.run(
        ["node", "-e", ASK, str(SCRIPT)], input=sent, capture_output=True, text=True, check=True
    )
    return positions, json.loads(done.stdout)


def fitted_loops(result, target):
    vehicles = result.plant.simulate.__self__
    theta = np.array([list(result.fit.parameters.values())])
    return Loops.of(vehicles.discrete(theta, target.Ts), target)


def test_around_the_fitted_plant_gains_and_margins_are_those_of_rule_r():
    result, _ = answer("ts-ff-lag-vx")
    reached = 0
    for (_, crossover, margin, delay), told in zip(*asked("ts-ff-lag-vx", ["PI"]), strict=True):
        target = Target(margin, crossover, 0.01, delay)
        loops = fitted_loops(result, target)
        design = loops.design()
        assert (told is None) == np.isnan(design.kp[0])
        if told is None:
            continue
        reached += 1
        gains, found = told["gains"], loops.evaluate(design.kp, design.Ti)
        assert [gains["Kp"], gains["Ti"]] == pytest.approx([design.kp[0], design.Ti[0]], rel=1e-6)
        names = {"phaseMargin": "phase_margin", "crossover": "crossover",
                 "delayMargin": "delay_margin"}  # fmt: skip
        for name, python in names.items():
            expected = getattr(found.margins, python)[0]
            assert told["found"][name] == pytest.approx(expected, rel=1e-6), name
        loop_at_turn = 10 ** (-found.margins.gain_margin[0] / 20)
        assert 10 ** (-told["found"]["gainMargin"] / 20) == pytest.approx(loop_at_turn, rel=1e-6)
        modulus = found.margins.modulus_margin[0]
        assert told["found"]["modulusMargin"] == pytest.approx(modulus, abs=1e-6)
        assert told["stable"] == found.stable[0]
    assert reached > COUNT // 2


def test_around_the_recordings_own_response_gains_are_those_of_rule_r():
    """Asked anew for another crossover it may weight coloured noise a little otherwise."""
    result, _ = answer("bb")
    shown = result.response
    for (_, crossover, margin, delay), told in zip(*asked("bb", ["PI"]), strict=True):
        target = Target(margin, crossover, 0.01, delay)
        kp, Ti = ruled(shown, target)
        assert (told is None) == np.isnan(kp)
        if told is None:
            continue
        assert [told["gains"]["Kp"], told["gains"]["Ti"]] == pytest.approx([kp, Ti], rel=1e-6)
        anew = Response.of(shown.model, target)
        gains = np.array([[kp, Ti]])
        spread = anew.spread(gains)[0]
        assert (np.abs(anew.metrics(gains) - anew.reached)[0] <= 2 * spread).all()
        assert told["spread"] == pytest.approx(spread, rel=0.3)  # interpolated between nine


def ruled(response, target):
    """Gains of the design rule for a response's own coefficients."""
    omega = target.omega_c * np.append(np.geomspace(1e-3, 1, 200)[:-1], 1.0)
    functions = response.model.functions
    G = response.coefficients[0] @ functions.held_response(omega, response.model.Ts, target.Ts)
    phase = np.unwrap(np.angle(G))[-1] - omega[-1] * target.delay_samples * target.Ts
    needed = np.radians(target.phase_margin) - np.pi - phase
    found = design_from_response(-np.log(np.abs(G[-1:])), np.array([needed]), target)
    return found.kp[0], found.Ti[0]


def test_other_kinds_are_those_of_pidtune():
    result, _ = answer("ts-ff-lag-vx")
    plant = fitted_loops(result, Target()).plant
    told_of = asked("ts-ff-lag-vx", ["P", "PID"])
    for (kind, crossover, margin, delay), told in list(zip(*told_of, strict=True))[::5]:
        z = control.tf([1], [1] + delay * [0], 0.01)
        system = control.ss(plant.A[0], plant.B[0][:, None], plant.C[None], 0, 0.01) * z
        C, info = pidtune(system, kind + "F" * (kind == "PID"), wc=2 * np.pi * crossover, pm=margin)
        assert (told is None) == (C is None)
        if told is None:
            continue
        gains = {"Kp": info.Kp, "Ki": info.Ki, "Kd": info.Kd}
        assert {n: told["gains"][n] for n in gains} == pytest.approx(gains, rel=1e-6)


def test_the_step_is_the_closed_loops_own():
    result, model = answer("ts-ff-lag-vx")
    kp, Ti = result.gains.values()
    ask = """
    const Loop = require(process.argv[1]), model = JSON.parse(require("fs").readFileSync(0));
    const {kp, Ti} = model.start, drawn = Loop.responses(model, Loop.pi(kp, Ti), 0, 250);
    console.log(JSON.stringify([[...drawn.step], [...drawn.disturbance]]));
    """
    done = subprocess.run(["node", "-e", ask, str(SCRIPT)], input=json.dumps(model),
                          capture_output=True, text=True, check=True)  # fmt: skip
    for told, response in zip(json.loads(done.stdout), result.loop.responses, strict=True):
        assert told == pytest.approx(response.value[:250], abs=1e-8)


BANDS = """
const Loop = require(process.argv[1]);
const {models, delay, samples} = JSON.parse(require("fs").readFileSync(0));
console.log(JSON.stringify(models.map((model) => {
  const C = Loop.pi(model.start.kp, model.start.Ti);
  const given = [model, C, delay, samples];
  const found = Loop.responses(...given), half = Loop.halfWidths(...given);
  return ["step", "disturbance"].map((name) => [[...found[name]], [...half[name]]]);
})));
"""


def banded(models, delay, samples):
    """Responses and half widths of their bands, (models, 2, 2, samples)."""
    sent = json.dumps({"models": models, "delay": delay, "samples": samples})
    done = subprocess.run(
        ["node", "-e", BANDS, str(SCRIPT)], input=sent, capture_output=True, text=True, check=True
    )
    return np.array(json.loads(done.stdout))


def test_bands_are_the_responses_derivatives():
    _, model = answer("bb")
    step = 1e-3
    turned = [
        model | {"pulse": list(np.add(model["pulse"], sign * step * np.array(direction)))}
        for direction in model["doubt"]
        for sign in (1, -1)
    ]
    found = banded([model, *turned], 2, 200)
    slopes = (found[1::2, :, 0] - found[2::2, :, 0]) / (2 * step)
    expected = np.sqrt((slopes**2).sum(axis=0))
    np.testing.assert_allclose(found[0, :, 1], expected, rtol=1e-4, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("tuner, least, most", [("bb", 0.88, 0.96), ("ts-ff-lag", 0.95, 1.0)])
def test_bands_hold_the_true_responses(tuner, least, most):
    """Points of 32 episodes' responses; the simulator knows more than the recording alone."""
    recording = recorded(32, Experiment(snr_db=20.0))
    results = tuners.load(tuner).results(recording)
    models = [live(result, log_of("vehicle"), tuner) for result in results]
    found = banded(models, 0, 250)
    true = np.array([
        [response.value[:250] for response in result.plant.closed_loop(theta, gains).responses]
        for result, theta in zip(results, recording.known, strict=True)
        for gains in [np.array(list(result.gains.values()))]
    ])  # fmt: skip
    inside = np.abs(true - found[:, :, 0]) <= found[:, :, 1] + 1e-12
    assert least < inside.mean() <= most


def test_without_a_pi_loop_nothing_can_be_moved():
    result, _ = answer("ts-ff-lag-vx")
    none = dict.fromkeys(result.gains, np.nan)
    log = log_of("vehicle")
    assert live(replace(result, gains=none, open_loop=None), log, "bb") is None
    assert live(replace(result, plant=replace(result.plant, loop=None)), log, "bb") is None


def test_a_page_has_no_bands_where_nothing_is_known_or_they_would_be_too_large(monkeypatch):
    result, model = answer("bb")
    log = log_of("vehicle")
    assert np.shape(model["doubt"])[1] == len(model["pulse"])
    several = replace(result.response, coefficients=result.response.coefficients * np.nan)
    assert live(replace(result, response=several), log, "bb")["doubt"] is None
    monkeypatch.setattr("tuners.cli.report.live._MOST_NUMBERS", 1000)
    assert live(result, log, "bb")["doubt"] is None
