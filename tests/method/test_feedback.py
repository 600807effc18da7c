"""Recordings in a closed loop: projection on the reference, and what tuners make of it."""

from functools import cache

import numpy as np
import pytest
from families import reference as rival

import tuners
from tuners.features.laguerre import Laguerre
from tuners.trust.feedback import projected_on, rebuilt, share
from tuners.tuner.recording import Recording
from tuners.tuner.rivals import Nominal
from yawrate_env.loop.closed_loop import time_response
from yawrate_env.loop.loops import Loops
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import Context, Vehicle

TS, N = 0.01, 2000
FUNCTIONS = Laguerre(24, 16.0)
TARGET = Target()


@cache
def driven(disturbance=0.0):
    """Six vehicles under a slow PI: their loops, steps of the reference, yaw rates, commands."""
    rng = np.random.default_rng(5)
    context = Context.of(np.linspace(0.35, 1.05, 6), np.full(6, 100.0), np.full(6, 20.0))
    loops = Loops.of(plants(Vehicle(), context, TS), TARGET)
    kp, Ti = np.full(6, 0.1), np.full(6, 0.06)
    assert loops.evaluate(kp, Ti).stable.all()
    reference = np.radians(3) * np.repeat(rng.uniform(-1, 1, N // 100), 100)
    lag, noise = np.exp(-10 * np.pi * TS), rng.standard_normal(N)
    for k in range(1, N):
        noise[k] = lag * noise[k - 1] + np.sqrt(1 - lag**2) * noise[k]
    added = np.radians(disturbance) * noise
    y, u = time_response(loops.plant, kp, Ti, TARGET, reference, added)
    return loops, reference, y, u


def test_the_projection_is_the_response_to_the_reference():
    _, reference, _, u = driven()
    found = projected_on(reference[None], u, TS, FUNCTIONS)
    settled = slice(300, None)  # what began before may have been there before
    assert ((found - u)[:, settled].std(axis=1) < 0.1 * u.std(axis=1)).all()
    assert (share(found, u) > 0.99).all()


def test_of_noise_the_projection_keeps_as_much_as_it_has_functions():
    _, reference, _, _ = driven()
    noise = np.random.default_rng(2).standard_normal((20, N))
    found = projected_on(reference[None], noise, TS, FUNCTIONS)
    assert (found**2).mean() < 2 * 40 / N


def test_a_reference_that_is_the_input_explains_it_and_another_does_not():
    rng = np.random.default_rng(1)
    r, other = np.repeat(rng.standard_normal((2, N // 20)), 20, axis=1)
    found = projected_on(np.stack([r, other]), np.stack([r, r]), TS, FUNCTIONS)
    explained = share(found, np.stack([r, r]))
    assert explained[0] > 0.97 and explained[1] < 0.4


@pytest.mark.parametrize("rounding", [0.0, 1e-4, 1e-3])
def test_rounding_of_a_slow_weave_explains_no_noise(rounding):
    rng, time = np.random.default_rng(4), TS * np.arange(N)
    weave = np.sin(2 * np.pi * 0.25 * time)
    logged = weave + rounding * rng.uniform(-0.5, 0.5, N)
    noise = 0.1 * rng.standard_normal((8, N))
    clean, found = (
        projected_on(logged[None], weave + e, TS, FUNCTIONS) for e in (0 * noise, noise)
    )
    settled = slice(300, None)  # what began before is not explained
    assert share(clean[:, settled], np.tile(weave[settled], (8, 1))).min() > 0.98
    assert ((found - clean) ** 2).mean() < 3 * 0.1**2 * 2 / N  # a sine has two numbers


@pytest.mark.parametrize("kind", ["weave", "steps"])
def test_the_start_of_a_rebuilt_reference_is_what_nothing_before_foretells(kind):
    loops, steps, _, _ = driven()
    weave = 0.1 * np.sin(2 * np.pi * 0.25 * TS * np.arange(N))
    reference = {"weave": weave, "steps": steps}[kind]
    kp, Ti = np.full(6, 0.1), np.full(6, 0.06)
    y, u = time_response(loops.plant, kp, Ti, TARGET, reference, np.zeros(N))
    begun = 110  # in motion, so that the controller's integral is not known
    found = rebuilt(u[0, begun:], y[0, begun:], TS, (0.1, 0.06), TARGET)
    np.testing.assert_allclose(found, reference[begun:], atol=1e-9)


def test_with_the_reference_disturbed_loops_are_tuned_as_open_ones():
    loops, reference, y, u = driven(0.2)
    tuner, known = tuners.load("ts-ff-lag"), np.tile([np.nan, np.nan, 20.0], (6, 1))

    def misses(reference):
        given = Recording(u, y, TS, known, reference=reference)
        gains, found = tuner.assess(given)
        reached = loops.evaluate(*gains.values.T).margins
        off = np.abs(reached.phase_margin - 60) / 3, np.abs(reached.crossover - 1.5) / 0.15
        return ~(np.maximum(*off) < 1), found

    blind, _ = misses(None)
    seeing, found = misses(reference[None])
    assert blind.sum() >= 2 and not seeing.any()
    one = tuner.tune(u[3], y[3], TS, v_x=20.0, reference=reference)
    np.testing.assert_allclose(found.metrics[3, 0], one.phase_margin.value, rtol=1e-6)


@pytest.mark.parametrize("reference", [np.zeros(3), np.full(N, np.nan)])
def test_a_reference_that_does_not_belong_to_the_recording_is_refused(reference):
    _, _, y, u = driven()
    with pytest.raises(ValueError, match="reference"):
        tuners.load("ts-ff-lag").tune(u[0], y[0], TS, v_x=20.0, reference=reference)


def test_a_plant_whose_responses_do_not_add_up_has_no_part_of_an_input():
    tuner, still = rival("nonlinear vehicle", Nominal), np.zeros(N)
    with pytest.raises(ValueError, match="reference"):
        tuner.tune(still, still, tuner.plant.Ts, reference=still)
