"""The page's own script against Python, at 200 positions of its sliders."""

import json
import re
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
from tuners.tuner.method import Rung
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.design import design_from_response
from yawrate_env.loop.loops import Loops
from yawrate_env.loop.state_feedback import StateFeedback
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction
from yawrate_env.plant.control_loop import ControlLoop
from yawrate_env.plants import sopdt
from yawrate_env.vehicle.task import Experiment

SCRIPT = ROOT / "tuners" / "cli" / "report" / "templates" / "loop.js"
COUNT, HORIZON = 200, 600
ASK = """
const Loop = require(process.argv[1]);
const {model, positions, samples} = JSON.parse(require("fs").readFileSync(0));
console.log(JSON.stringify(positions.map((position) => {
  const C = Loop.design(model, position), {delay} = position;
  if (C === null) return null;
  const found = Loop.margins(model, C, delay), drawn = Loop.responses(model, C, delay, samples);
  return {gains: C.gains, limited: C.limited, found, stable: Loop.stable(model, C, found, drawn),
          step: [...drawn.step], spread: Loop.spread(model, C, delay, found)};
})));
"""

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="needs node")


@cache
def answer(tuner):
    log = log_of("vehicle")
    result = tuners.load(tuner).tune(log.u, log.y, log.Ts, log.measured)
    return result, live(result, log, tuner)


def asked(model, kinds, samples=HORIZON):
    """Positions, and what the page's script makes of them."""
    rng, of = np.random.default_rng(0), {one["name"]: one for one in model["sliders"]}
    crossover = of.get("crossover", {"min": 0.0, "max": 0.0})
    positions = [
        {"kind": str(rng.choice(kinds)), "margin": rng.uniform(30.0, 80.0),
         "crossover": np.exp(rng.uniform(crossover["min"], crossover["max"])),
         "delay": int(rng.integers(0, 8)),
         "asked": int(rng.integers(0, of["asked"]["max"] + 1)) if "asked" in of else 0}
        for _ in range(COUNT)
    ]  # fmt: skip
    return positions, told(ASK, {"model": model, "positions": positions, "samples": samples})


def told(script, sent):
    """What a script prints."""
    done = subprocess.run(
        ["node", "-e", script, str(SCRIPT)], input=json.dumps(sent), capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def fitted_loops(result, target):
    vehicles = result.plant.simulate.__self__
    theta = np.array([list(result.fit.parameters.values())])
    return Loops.of(vehicles.discrete(theta, target.Ts), target)


def test_around_the_fitted_plant_gains_and_margins_are_those_of_rule_r():
    result, model = answer("ts-ff-lag-vx")
    reached = 0
    for at, told in zip(*asked(model, ["PI"]), strict=True):
        target = Target(at["margin"], at["crossover"], 0.01, at["delay"])
        loops = fitted_loops(result, target)
        design = loops.design()
        assert (told is None) == np.isnan(design.kp[0])
        if told is None:
            continue
        reached += 1
        gains, found = told["gains"], loops.evaluate(design.kp, design.Ti)
        of_Ti = 1e-6 * max(1, design.Ti[0] * target.omega_c / 100)  # as its phase goes to 0
        assert gains["kp"] == pytest.approx(design.kp[0], rel=1e-6)
        assert gains["Ti"] == pytest.approx(design.Ti[0], rel=of_Ti)
        same_margins(told["found"], found.margins)
        assert told["stable"] == found.stable[0]
    assert reached > COUNT // 2


def same_margins(told, margins):
    """The page's margins are Python's."""
    names = {"phaseMargin": "phase_margin", "crossover": "crossover",
             "delayMargin": "delay_margin"}  # fmt: skip
    for name, python in names.items():
        value, expected = told[name], getattr(margins, python)[0]
        assert (np.nan if value is None else value) == pytest.approx(
            expected, rel=1e-6, nan_ok=True
        ), name
    turn = np.inf if told["gainMargin"] is None else told["gainMargin"]
    expected = 10 ** (-margins.gain_margin[0] / 20)
    assert 10 ** (-turn / 20) == pytest.approx(expected, rel=1e-6, abs=1e-6)
    modulus = margins.modulus_margin[0]  # the grid ends a little before half the rate
    assert told["modulusMargin"] == pytest.approx(modulus, abs=1e-5)


def test_around_the_recordings_own_response_gains_are_those_of_rule_r():
    """Request anew for another crossover it may weight coloured noise a little otherwise."""
    result, model = answer("bb")
    shown = result.response
    for at, told in zip(*asked(model, ["PI"]), strict=True):
        target = Target(at["margin"], at["crossover"], 0.01, at["delay"])
        kp, Ti = ruled(shown, target)
        assert (told is None) == np.isnan(kp)
        if told is None:
            continue
        assert [told["gains"]["kp"], told["gains"]["Ti"]] == pytest.approx([kp, Ti], rel=1e-6)
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
    result, model = answer("ts-ff-lag-vx")
    plant = fitted_loops(result, Target()).plant
    kinds = ["P", "PD", "PID", "PIDF"]
    for at, told in list(zip(*asked(model, kinds), strict=True))[::5]:
        z = control.tf([1], [1] + at["delay"] * [0], 0.01)
        system = control.ss(plant.A[0], plant.B[0][:, None], plant.C[None], 0, 0.01) * z
        with np.errstate(divide="ignore", invalid="ignore"):
            C, info = pidtune(system, at["kind"], wc=2 * np.pi * at["crossover"], pm=at["margin"])
        assert (told is None) == (C is None)
        if told is None:
            continue
        gains = {"kp": info.Kp, "Ti": info.Kp / info.Ki if info.Ki else np.inf,
                 "Td": info.Kd / info.Kp, "Tf": info.Tf}  # fmt: skip
        gains = {name: gains[name] for name in told["gains"]}
        assert told["gains"] == pytest.approx(gains, rel=1e-6)


@cache
def loop_of(rule, controller="2DOF"):
    """A loop around a process, and one of its plants."""
    aim = {"phase_margin": 60, "crossover": 0.008}
    given = {"target": aim} if rule == "loop-shaping" else {}
    plant = sopdt(controller=controller, rule=rule, metrics=["phase_margin [deg]"], **given)
    return plant, np.array([1.2, 22.0, 5.0, 6.3])


@cache
def servo():
    """A state feedback of an unstable plant, and one of its plants."""
    loop = ControlLoop.of(
        lambda theta: control.ss([[0.8, 1], [0, -theta[0]]], [[0], [-theta[1]]], [[1, 0]], 0),
        0.01, Target(60, 1, 0.01), ("force", "position"),
        controller=StateFeedback(("k1", "k2")), rule="lqr", weight=0.02,
        metrics=("phase_margin [deg]",),
    )  # fmt: skip
    prior = {"friction": (0.5, 3.0), "gain": (0.5, 2.0)}
    return loop.plant(prior=prior, u=np.ones(300), check=False), np.array([1.4, 1.1])


@cache
def cart():
    """A double integrator behind a lag, one of its plants, in the loop of a lead."""
    loop = ControlLoop.of(
        lambda theta: control.tf(theta[0], [theta[1], 1, 0, 0]), 0.01, Target(45, 1, 0.01),
        ("force", "position"), controller="lead-lag", metrics=("phase_margin [deg]",),
    )  # fmt: skip
    prior = {"gain": (0.5, 2.0), "lag": (0.02, 0.1)}
    plant = loop.plant(prior=prior, u=np.ones(300), integrating=True, check=False)
    return plant, np.array([1.0, 0.05])


ODD = {"servo": servo, "cart": cart}


def case_of(case):
    """A plant and one of its parameter sets."""
    return ODD[case]() if isinstance(case, str) else loop_of(*case)


def answered(plant, theta):
    """What the page gets for one plant with the gains of its rule."""
    result, _ = answer("ts-ff-lag-vx")
    gains = dict(zip(plant.gains, plant.oracle(theta[None])[0], strict=True))
    parameters = dict(zip(plant.prior, theta, strict=True))
    made = replace(
        result,
        plant=plant,
        gains=gains,
        intervals={},
        rung=Rung.FITTED_PLANT,
        response=None,
        open_loop=None,
        fit=replace(result.fit, parameters=parameters),
    )
    return json.loads(json.dumps(live(made, log_of("vehicle"), "any"), allow_nan=False))


def moved(loop, model, at):
    """The loop at a position, by Python."""
    settings = {"target": replace(loop.target, delay_samples=at["delay"])}
    if loop.controller.name != at["kind"]:
        settings["controller"] = CONTROLLERS[at["kind"]]
    if model["pace"] is None:
        return replace(loop, **settings)
    if model["pace"]["slider"] == "crossover":
        settings["target"] = replace(settings["target"], phase_margin=at["margin"],
                                     crossover=at["crossover"])  # fmt: skip
        return replace(loop, **settings)
    values = next(one["values"] for one in model["sliders"] if one["name"] == "asked")
    name = {"simc": "tau_c", "lambda": "tau_c", "ms": "Ms", "lqr": "weight"}[loop.rule]
    return replace(loop, **settings, **{name: values[at["asked"]]})


@pytest.mark.parametrize("case, kinds", [
    *((("loop-shaping", "2DOF"), [kind])
      for kind in ("P", "PI", "PD", "PID", "PIDF", "PI-D", "2DOF", "lead-lag")),
    (("simc", "2DOF"), ["PI", "PID", "PIDF", "PI-D", "2DOF"]),
    (("amigo", "PI-D"), ["PI", "PID", "PIDF", "PI-D", "2DOF"]),
    pytest.param(("ms", "PIDF"), ["PI", "PID", "PIDF", "PI-D", "2DOF"], marks=pytest.mark.slow),
    ("servo", ["state feedback"]),
    ("cart", ["PD", "PIDF", "lead-lag"]),
], ids=str)  # fmt: skip
def test_every_controllers_gains_and_margins_are_those_of_its_rule(case, kinds):
    plant, theta = case_of(case)
    loop, model = plant.design.__self__, answered(plant, theta)
    assert set(kinds) <= set(model["kinds"])
    reached = 0
    for at, told in zip(*asked(model, kinds, 400), strict=True):
        made = moved(loop, model, at)
        gains, ok = made.design(theta[None])
        assert (told is None) == np.isnan(gains).any(), at
        if told is None:
            continue
        reached += 1
        expected = dict(zip(made.controller.gains, gains[0], strict=True))
        assert told["gains"] == pytest.approx(expected, rel=1e-6), at
        assert told["limited"] in (False, not ok[0])
        closed = made.closed(theta[None], gains)
        same_margins(told["found"], closed.margins)
        assert told["stable"] == closed.feedback.stable[0], at
    assert reached > COUNT // 5  # a PD and a lead-lag must lead


STEPS = """
const Loop = require(process.argv[1]);
const {model, positions, samples} = JSON.parse(require("fs").readFileSync(0));
console.log(JSON.stringify(positions.map((position) => {
  const C = Loop.design(model, position);
  if (C === null) return null;
  const drawn = Loop.responses(model, C, position.delay, samples);
  return [[...drawn.step], [...drawn.disturbance], [...drawn.command]];
})));
"""


@pytest.mark.parametrize("case", [("loop-shaping", "2DOF"), ("simc", "PI-D"), "servo"], ids=str)
def test_steps_of_every_controller_are_the_closed_loops(case):
    plant, theta = case_of(case)
    loop, model, samples = plant.design.__self__, answered(plant, theta), 300
    kinds = list(model["kinds"])
    positions = [{"kind": kind, "margin": 60.0, "crossover": loop.target.crossover, "delay": 1,
                  "asked": model["start"]["asked"], "b": 0.4} for kind in kinds]  # fmt: skip
    drawn = told(STEPS, {"model": model, "positions": positions, "samples": samples})
    assert sum(one is not None for one in drawn) >= len(kinds) - 2  # a PD and a lead-lag lead
    for at, told_of in zip(positions, drawn, strict=True):
        made = moved(loop, model, at)
        gains = made.design(theta[None])[0]
        if told_of is None:
            continue
        step, disturbance, command = told_of
        if "b" in made.controller.gains:
            gains[0, made.controller.gains.index("b")] = 0.4
        feedback = made.closed(theta[None], gains).feedback
        one, none = np.ones(samples), np.zeros(samples)
        (y,), (u,) = feedback.respond(one)
        np.testing.assert_allclose(step, y, atol=1e-7, err_msg=at["kind"])
        np.testing.assert_allclose(command, u, rtol=1e-7, atol=1e-7, err_msg=at["kind"])
        np.testing.assert_allclose(disturbance, feedback.respond(none, one)[0][0], atol=1e-7)


MATLAB = """
globalThis.Loop = require(process.argv[1]);
const Texts = require(process.argv[1].replace("loop.js", "texts.js"));
const model = JSON.parse(require("fs").readFileSync(0)), {matlab} = Texts(model);
console.log(JSON.stringify(Object.keys(model.kinds).map((kind) => {
  const C = Loop.design(model, {...model.start, kind, b: 0.4});
  return C && [kind, C.gains, matlab({...C, kind})];
})));
"""


@pytest.mark.parametrize("case", [("loop-shaping", "2DOF"), "servo"], ids=str)
def test_copied_matlab_is_the_controller(case):
    plant, theta = case_of(case)
    loop, model = plant.design.__self__, answered(plant, theta)
    z, Ts = np.exp(1j * np.geomspace(0.01, 3.0, 30)), loop.target.Ts
    for kind, gains, text in filter(None, told(MATLAB, model)):
        found = [
            np.polyval(json.loads(top), z) / np.polyval(json.loads(bottom), z)
            for top, bottom, _ in re.findall(r"tf\((\[.*?\]), (\[.*?\]), (.*?)\)", text)
        ]
        if kind in CONTROLLERS:
            row = np.array([list(gains.values())])
            made = CONTROLLERS[kind].parallel(row, Ts).compensator(Ts)
            of_r, of_y = (TransferFunction(p, made.denominator, Ts)(np.angle(z) / Ts)[0]
                          for p in (made.reference, made.output))  # fmt: skip
            expected = [of_r, -of_y] if kind in ("PI-D", "2DOF") else [of_y]
        else:
            *K, kr = gains.values()
            expected = [np.full_like(z, value) for value in (kr, *(-k for k in K))]
        np.testing.assert_allclose(found, expected, rtol=1e-8, err_msg=kind)


def test_the_step_is_the_closed_loops_own():
    result, model = answer("ts-ff-lag-vx")
    ask = """
    const Loop = require(process.argv[1]), model = JSON.parse(require("fs").readFileSync(0));
    const C = Loop.controller(model.kinds.PI, model.start.gains, model.Ts);
    const drawn = Loop.responses(model, C, 0, 250);
    console.log(JSON.stringify([[...drawn.step], [...drawn.disturbance]]));
    """
    for told_of, response in zip(told(ask, model), result.loop.responses, strict=True):
        assert told_of == pytest.approx(response.value[:250], abs=1e-8)


BANDS = """
const Loop = require(process.argv[1]);
const {models, delay, samples} = JSON.parse(require("fs").readFileSync(0));
console.log(JSON.stringify(models.map((model) => {
  const C = Loop.controller(model.kinds.PI, model.start.gains, model.Ts);
  const given = [model, C, delay, samples];
  const found = Loop.responses(...given), half = Loop.halfWidths(...given);
  return ["step", "disturbance"].map((name) => [[...found[name]], [...half[name]]]);
})));
"""


def banded(models, delay, samples):
    """Responses and half widths of their bands, (models, 2, 2, samples)."""
    return np.array(told(BANDS, {"models": models, "delay": delay, "samples": samples}))


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


def test_a_rule_of_ones_own_has_no_sliders():
    loop = cart()[0].design.__self__
    assert (
        loop.plant(
            prior={"gain": (0.5, 2.0), "lag": (0.02, 0.1)},
            u=np.ones(300),
            check=False,
            design=lambda theta: np.ones((len(theta), 3)),
        ).sliders
        is None
    )


def test_without_a_pi_loop_nothing_can_be_moved():
    result, _ = answer("ts-ff-lag-vx")
    none = dict.fromkeys(result.gains, np.nan)
    log = log_of("vehicle")
    assert live(replace(result, gains=none, open_loop=None), log, "bb") is None
    assert live(replace(result, plant=replace(result.plant, loop=None)), log, "bb") is None
    handmade = replace(result.plant, sliders=None)
    assert set(live(replace(result, plant=handmade), log, "bb")["kinds"]) > {"PI", "PIDF"}


def test_a_page_has_no_bands_where_nothing_is_known_or_they_would_be_too_large(monkeypatch):
    result, model = answer("bb")
    log = log_of("vehicle")
    assert np.shape(model["doubt"])[1] == len(model["pulse"])
    several = replace(result.response, coefficients=result.response.coefficients * np.nan)
    assert live(replace(result, response=several), log, "bb")["doubt"] is None
    monkeypatch.setattr("tuners.cli.report.live._MOST_NUMBERS", 1000)
    assert live(result, log, "bb")["doubt"] is None
