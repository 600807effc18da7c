"""Metrics of loops by name against closed forms."""

import numpy as np
import pytest

from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.discretisation import zoh
from yawrate_env.loop.margins import margins
from yawrate_env.loop.metrics import METRICS, Closed

TS = 0.001
ZETA, OMEGA = np.array([0.3, 0.5, 0.8]), np.array([2.0, 3.0, 4.0])


def loops():
    """``omega^2/(s (s + 2 zeta omega))`` under a gain of one: the standard second order."""
    A = np.zeros((3, 2, 2))
    A[:, 0, 1], A[:, 1, 1] = 1.0, -2 * ZETA * OMEGA
    B = np.stack([0 * OMEGA, OMEGA**2], axis=1)
    return closed(zoh(A, B, np.array([1.0, 0.0]), TS), "P", np.ones((3, 1)))


def closed(plant, name, gains):
    of = CONTROLLERS[name]
    return Closed(margins(of.open_loop(plant, gains, 0)), of.close(plant, gains, 0), plant.Ts)


def test_a_second_order_loop_overshoots_as_the_textbook_says():
    root = np.sqrt(1 - ZETA**2)
    found = METRICS["overshoot [%]"](loops())
    np.testing.assert_allclose(found, 100 * np.exp(-np.pi * ZETA / root), rtol=0.02)
    square = np.sqrt(np.sqrt(1 + 4 * ZETA**4) - 2 * ZETA**2)
    expected = np.degrees(np.arctan(2 * ZETA / square))
    np.testing.assert_allclose(METRICS["phase_margin [deg]"](loops()), expected, atol=0.3)
    delay = METRICS["delay_margin [s]"](loops())
    np.testing.assert_allclose(delay, np.radians(expected) / (OMEGA * square), rtol=5e-3)


def test_settling_is_when_the_response_stays_within_two_percent():
    t = np.arange(0, 12, TS)[:, None]
    root = np.sqrt(1 - ZETA**2)
    decay = np.exp(-ZETA * OMEGA * t) / root
    error = decay * np.sin(OMEGA * root * t + np.arccos(ZETA))
    last = np.array([np.flatnonzero(np.abs(e) > 0.02)[-1] for e in error.T])
    np.testing.assert_allclose(METRICS["settling_time [s]"](loops()), last * TS, atol=0.01)


def test_integrated_errors_of_a_pi_are_one_over_its_integral_gain():
    A, B = np.full((2, 1, 1), -0.5), np.full((2, 1), 0.7)
    gains = np.array([[1.0, 2.0], [0.3, 1.5]])
    of = closed(zoh(A, B, np.ones(1), 0.01), "PI", gains)
    expected = gains[:, 1] / gains[:, 0]
    np.testing.assert_allclose(METRICS["IE"](of), expected, rtol=1e-9)
    np.testing.assert_allclose(METRICS["IAE"](of), expected, rtol=2e-3)  # they do not change sign
    assert np.isinf(METRICS["IE"](loops())).all()


def test_the_largest_sensitivity_is_one_over_the_modulus_margin():
    of = loops()
    s = 1j * np.geomspace(0.01, 100, 20_000)[:, None]
    L = OMEGA**2 / (s * (s + 2 * ZETA * OMEGA))
    np.testing.assert_allclose(METRICS["Ms"](of), np.abs(1 / (1 + L)).max(axis=0), rtol=2e-3)


def test_unstable_loops_have_no_steps():
    plant = zoh(np.array([[[0.5]]]), np.ones((1, 1)), np.ones(1), 0.1)
    found = METRICS["overshoot [%]"](closed(plant, "P", np.array([[0.1]])))
    assert np.isnan(found).all()
    with pytest.raises(KeyError):
        METRICS["beauty"]
