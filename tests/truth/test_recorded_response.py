"""What a recording says itself: against exact plants, and against repeats of the experiment."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, freqz, lfilter

import tuners
from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import black_box
from tuners.trust.likely_prior import most_likely
from tuners.trust.response import Response
from yawrate_env.loop.design import required_response
from yawrate_env.plant.episodes import recorded
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import Vehicles, yaw_rate

EVERY_SPEED = Task(prior=Prior(v_x=(10.0, 33.0)), experiment=Experiment(register="random"))
VEHICLES = yaw_rate(EVERY_SPEED)
TARGET = EVERY_SPEED.target


def response_of(u, y, start="auto", target=TARGET):
    model = black_box(VEHICLES, Laguerre(24, 16.0), np.atleast_2d(u), np.atleast_2d(y), start)
    return Response.of(model, target)


def test_energy_that_rounding_made_negative_costs_its_own_row_only():
    gram, right = np.stack([np.eye(3)] * 2), np.array([[1.0, 0.5, 0.1]] * 2)
    found = most_likely(gram, right, np.array([1.3, -1e16]), np.array([0.01, 0.01]))
    alone = most_likely(gram[:1], right[:1], np.array([1.3]), np.array([0.01]))
    np.testing.assert_array_equal(found.coefficients[0], alone.coefficients[0])
    assert found.coefficients[0].any() and not found.coefficients[1].any()


def test_the_first_function_is_a_first_order_lag_that_any_clock_samples_exactly():
    omega, pole = np.array([0.5, 9.4, 40.0]), 16.0
    for hold in (0.001, 0.01, 0.02):
        found = Laguerre(1, pole).held_response(omega, 0.001, hold)[0]
        num, den, _ = cont2discrete(([pole], [1.0, pole]), hold, "zoh")
        _, exact = freqz(np.squeeze(num), den, worN=omega * hold)
        a = np.exp(-pole * 0.001)
        np.testing.assert_allclose(found * (1 - a) / np.sqrt(1 - a * a), exact, rtol=1e-9)
    # Clocks that are no multiples of each other: without what sampling folds back.
    found = Laguerre(1, pole).held_response(omega[:2], 0.001, 0.0095)[0]
    num, den, _ = cont2discrete(([pole], [1.0, pole]), 0.0095, "zoh")
    _, exact = freqz(np.squeeze(num), den, worN=omega[:2] * 0.0095)
    np.testing.assert_allclose(found * (1 - a) / np.sqrt(1 - a * a), exact, rtol=2e-2)


@pytest.mark.parametrize("delay", [0, 3])
def test_clean_recordings_show_what_the_controller_must_supply(delay):
    target = replace(TARGET, delay_samples=delay)
    block = recorded(VEHICLES, "test", 0, 16)
    clean = VEHICLES.respond(block.theta, block.u)
    found = response_of(block.u, clean, target=target)
    loops = Vehicles(replace(EVERY_SPEED, target=target)).loops(block.theta)
    exact = np.stack(required_response(loops.transfer_function, target), axis=1)
    np.testing.assert_allclose(found.required[:, 0], exact[:, 0], atol=2e-3)
    np.testing.assert_allclose(found.required[:, 1], exact[:, 1], atol=np.radians(0.15))
    # Other gains than the design's: what the loop then has.
    gains = found.gains * [1.2, 0.8]
    evaluated = loops.evaluate(*gains.T)
    known = np.isfinite(gains).all(axis=1)
    metrics = np.stack([evaluated.margins.phase_margin, evaluated.margins.crossover], axis=1)
    assert (np.abs(found.metrics(gains) - metrics)[known] < [0.15, 0.003]).all()


def test_the_design_reaches_the_target_on_its_own_response():
    block = recorded(VEHICLES, "test", 1, 32)
    found = response_of(block.u, block.y)
    reached = found.reached[found.within_reach]
    assert len(reached) > 20
    np.testing.assert_allclose(reached, np.tile([60.0, 1.5], (len(reached), 1)), atol=0.02)


@pytest.mark.parametrize("colour, seconds", [(None, 10), (0.03, 10), (0.3, 10), (0.3, 5)])
def test_repeats_of_one_experiment_scatter_as_the_interval_says(colour, seconds):
    plant = yaw_rate(Task(experiment=Experiment(N=1000 * seconds)))
    rng, count = np.random.default_rng(3), 100
    clean = plant.respond(plant.middle)
    noise = rng.standard_normal((count, plant.u.size))
    if colour is not None:
        a = np.exp(-plant.Ts / colour)
        noise = 0.05 * noise + lfilter([np.sqrt(1 - a * a)], [1, -a], noise, axis=1)
    found = response_of(plant.u, clean + 0.03 * clean.std() * noise)
    gains = np.tile(plant.oracle(plant.middle), (count, 1))
    scatter = found.metrics(gains).std(axis=0)
    claimed = np.sqrt((found.spread(gains) ** 2).mean(axis=0))
    low, high = (1 / 1.5, 1.5) if seconds > 5 or colour is None else (1 / 1.5, 8.0)
    assert ((low < claimed / scatter) & (claimed / scatter < high)).all(), claimed / scatter


@pytest.mark.parametrize("bend", [-0.15, 0.0, 0.15])
def test_a_response_that_bends_is_noticed(bend):
    block = recorded(VEHICLES, "test", 2, 8)
    clean = VEHICLES.respond(block.theta, block.u)
    rms = np.sqrt((clean**2).mean(axis=1, keepdims=True))
    found = response_of(block.u, clean * (1 + bend * (clean / rms) ** 2 / 3) + block.y - clean)
    sensor = found.curvature.sizes[:, 1] > 4
    assert sensor.all() if bend else not (found.curvature.sizes > 4).any()
    # The slope at no amplitude is smaller by as much as the response has grown.
    without = np.exp(-found.curvature.shifts[:, 1, 0])
    grown = 1 + bend * (clean**4).mean(axis=1) / (clean**2).mean(axis=1) ** 2 / 3
    assert not bend or np.median(without * grown) == pytest.approx(1.0, abs=0.03)


def test_a_change_at_half_time_is_noticed():
    block = recorded(VEHICLES, "test", 3, 8)
    half = block.y.shape[1] // 2
    changed = np.concatenate([block.y[:, :half], 1.2 * block.y[:, half:]], axis=1)
    for y, noticed in ((block.y, False), (changed, True)):
        found = response_of(block.u, y)
        moved, distance = found.moved(found.gains)
        assert np.median(distance) > 4 if noticed else (distance < 4).all()
    # Gains that suit the whole are 10 % too high for one half, as many hertz as the slope gives.
    assert np.median(moved[:, 1]) > 0.05


def test_a_dead_output_has_no_gains_and_no_warnings():
    found = response_of(VEHICLES.u, np.zeros_like(VEHICLES.u))
    assert np.isnan(found.gains).all() and not found.within_reach.any()


def test_the_black_box_alone_needs_neither_vehicle_nor_speed():
    tuner = tuners.load("bb")
    block = recorded(VEHICLES, "test", 4, 64)
    errors = VEHICLES.errors(block.theta, tuner.act(tuners.Recording(block.u, block.y, 0.001)))
    assert (np.sqrt((errors**2).mean(axis=0)) < [0.15, 0.002]).all()
    with pytest.raises(ValueError, match="no loop target"):
        tuners.load("bb", replace(VEHICLES, linear=False, check=False)).predict(
            np.stack([VEHICLES.u, VEHICLES.u])
        )


def test_an_unknown_dead_time_costs_no_margin():
    task = Task(prior=Prior(dead_time=(0.0, 0.04)))
    late = yaw_rate(task, check=False)
    block = recorded(late, "test", 0, 32)
    _, reached = late.designs(block.theta)
    gains = tuners.load("bb").act(tuners.Recording(block.u, block.y, late.Ts))
    metrics = late.metric_values(block.theta, gains)[reached]
    assert reached.sum() > 15 and (np.abs(metrics[:, 0] - 60) < 1).all()


def test_long_registers_of_another_length_work_too():
    u = prbs(15_000, 0.001, 0.07, 0.01)[0]
    theta = np.array([[0.7, 100.0, 25.0]])
    found = response_of(u, VEHICLES.respond(theta, u) + 1e-6 * np.sin(np.arange(15_000)))
    errors = np.abs(VEHICLES.metric_values(theta, found.gains) - [60.0, 1.5])
    assert (errors < [0.1, 0.003]).all()
