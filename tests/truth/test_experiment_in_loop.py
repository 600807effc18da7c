"""Experiments in a closed loop: noise goes round it, and the bound knows what it becomes."""

import sys

import numpy as np
import pytest
from recordings import ROOT
from scipy.linalg import solve_triangular, toeplitz
from scipy.signal import lfilter

from tuners.trust.bound import cramer_rao, parameter_covariance
from tuners.trust.fit import search
from tuners.trust.identification import output_slopes
from yawrate_env.plant.entry import find
from yawrate_env.plant.episodes import Draw, integers_of
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.noise import standard_normal
from yawrate_env.signals.streams import stream

N, TS, GAIN, SIGMA = 400, 0.05, 3.0, 0.02
THETA = np.array([[1.0, 0.5], [1.4, 0.8]])


def lag_in_loop(theta, reference, rng):
    """A lag K/(T s + 1) behind a proportional controller of the error."""
    K, T = theta
    a = np.exp(-TS / T)
    b = K * (1 - a) * GAIN
    return lfilter([0.0, b], [1.0, b - a], reference)


def design(theta):
    K, T = theta
    return (T / K,)


@pytest.fixture(scope="module")
def lag():
    u = np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], N // 10), 10)
    return Plant(
        prior={"K": (0.5, 2.0), "T": (0.2, 1.0)}, simulate=lag_in_loop, design=design,
        gains=("k",), batched=False, u=u, Ts=TS, noise=SIGMA, linear=True, in_loop=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def pendulum():
    plant = find("pendulum:plant", ROOT / "examples" / "plants")
    return plant, sys.modules["pendulum"]


def test_noise_goes_round_the_loop(lag):
    draw = Draw.of(lag, stream(0, 0, 2, integers_of(lag)))
    measured = lag.measure(THETA, draw.u, draw.keys)
    for (K, T), noise, found in zip(
        THETA, SIGMA * standard_normal(draw.keys, N), measured, strict=True
    ):
        a, x = np.exp(-TS / T), 0.0
        for k in range(N):
            y = x + noise[k]
            assert found[k] == pytest.approx(y, abs=1e-9)
            x = a * x + K * (1 - a) * GAIN * (lag.u[k] - y)
    out = np.empty((2, N), dtype=np.float32)
    assert lag.measure(THETA, draw.u, draw.keys, out=out) is out
    np.testing.assert_allclose(out, measured, atol=1e-5)


def test_the_bound_is_that_of_noise_with_the_covariance_it_has(lag):
    covariance = parameter_covariance(lag, THETA)
    impulse = np.eye(N)[0]
    for i, theta in enumerate(THETA):
        S = toeplitz(impulse - lag_in_loop(theta, impulse, None), np.zeros(N))
        slopes = solve_triangular(S, output_slopes(lag, THETA)[i].T, lower=True)
        exact = SIGMA**2 * np.linalg.inv(slopes.T @ slopes)
        np.testing.assert_allclose(covariance[i], exact, rtol=0.05)


def test_the_pendulum_falls_alone_and_stands_in_the_loop(pendulum):
    plant, module = pendulum
    low, high = plant.ranges
    corners = np.array([[a, b] for a in (low[0], high[0]) for b in (low[1], high[1])])
    assert (np.abs(np.linalg.eigvals(module.loops(corners, 0.0, 0.0).A)).max(axis=1) > 1).all()
    held = module.loops(corners, *module.CAUTIOUS)
    assert (np.abs(np.linalg.eigvals(held.A)).max(axis=1) < 0.98).all()
    with np.errstate(all="ignore"):
        metrics, stable = plant.evaluation(corners, plant.oracle(corners))
    assert stable.all()  # sampled every 10 ms, the loop is somewhat faster than s^2 + ... says
    assert (np.abs(metrics[:, 0] - module.FREQUENCY) < 0.4).all()
    assert (np.abs(metrics[:, 1] - module.DAMPING) < 0.1).all()


def test_the_pendulums_parameters_are_found_near_the_bound(pendulum):
    plant, _ = pendulum
    draw = Draw.of(plant, stream(5, 0, 64, integers_of(plant)))
    y = plant.measure(draw.theta, draw.u, draw.keys)
    found = search(plant, draw.u, y, np.tile(plant.middle, (64, 1)))
    error = plant.errors(draw.theta, plant.oracle(found.theta))
    bound = cramer_rao(plant, draw.theta)
    ratio = np.sqrt((error**2).mean(axis=0) / (bound**2).mean(axis=0))
    assert (ratio > 0.8).all() and (ratio < 1.4).all()
