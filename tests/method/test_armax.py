"""ARMAX fits against pysib (see references/make_armax_reference.py), SciPy and statistics."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from tuners.features.armax import Armax, FitStatus, armax, cost, simulated
from yawrate_env.signals.excitation import prbs

REFERENCE = np.load(Path(__file__).parents[1] / "references" / "armax_reference.npz")
RATES = {"1khz": 1, "100hz": 10}  # averaged over so many samples
U = prbs(10_000, 0.001, 0.1, np.radians(1))
TRUTH = np.array([-1.5, 0.7, 0.05, 0.03, -0.6, 0.25])  # poles 0.75 +- 0.37j, zeros of C 0.3 +- 0.4j


def blocks(x, size):
    return np.asarray(x, dtype=float).reshape(len(x), -1, size).mean(axis=2)


def reference_data(rate):
    return blocks(U, RATES[rate]), blocks(REFERENCE["y"], RATES[rate]), 0.001 * RATES[rate]


def errors(theta, u, y):
    """One-step prediction errors by SciPy."""
    a1, a2, b1, b2, c1, c2 = theta
    C = [1, c1, c2]
    return lfilter([1, a1, a2], C, y) - lfilter([0, b1, b2], C, u)


def sensitivities(theta, u, y):
    """Derivatives of the errors by SciPy, (6, N): every one is a delayed, filtered signal."""
    C = [1, *theta[4:]]
    signals = (y, -u, -errors(theta, u, y))
    delays = ([0, 1], [0, 0, 1])
    return np.array([lfilter(d, C, s) for s in signals for d in delays])


def deviations(theta, u, y):
    """Standard deviations of a prediction-error estimate (Ljung, section 9.4)."""
    J = sensitivities(theta, u, y)
    return np.sqrt(np.diag(np.linalg.inv(J @ J.T)) * np.mean(errors(theta, u, y) ** 2))


def simulate_armax(rng, theta, u):
    """The system itself, driven by NumPy's noise."""
    a1, a2, b1, b2, c1, c2 = theta
    e = 0.02 * rng.standard_normal(len(u))
    return lfilter([0, b1, b2], [1, a1, a2], u) + lfilter([1, c1, c2], [1, a1, a2], e)


def largest_root(theta):
    return max(abs(np.roots([1, *theta[4:]])))


@pytest.mark.parametrize("rate", RATES)
def test_costs_and_coefficients_are_pysibs(rate):
    u, y, Ts = reference_data(rate)
    fit = armax(u, y, Ts)
    assert (fit.status == FitStatus.CONVERGED).all()
    # Both ways: pysib's results were polished to 1e-9 of the cost, so less is another minimum.
    np.testing.assert_allclose(fit.cost, REFERENCE[f"cost_{rate}"], rtol=1e-5)
    # Sums over 10 000 samples in another order.
    np.testing.assert_allclose(cost(fit.theta, np.repeat(u, len(y), axis=0), y), fit.cost, 1e-11)
    for theta, expected, out in zip(fit.theta, REFERENCE[f"theta_{rate}"], y, strict=True):
        # A hundredth of a deviation is what the stopping rule promises; pysib stops too.
        assert (abs(theta - expected) < 0.05 * deviations(expected, u[0], out)).all()


def test_a_root_of_c_on_the_unit_circle_is_held_inside():
    # Differenced white noise: the best C is 1 - q^-1.
    y = np.diff(np.random.default_rng(0).standard_normal((4, 2001)), axis=1)
    fit = armax(U[:, ::5], y, 0.01)
    roots = np.array([largest_root(theta) for theta in fit.theta])
    assert (roots < 1).all() and (roots > 0.98).all()


def test_recovers_a_system_of_its_own_structure():
    rng = np.random.default_rng(3)
    u = rng.choice([-1.0, 1.0], (16, 3000))
    y = np.array([simulate_armax(rng, TRUTH, row) for row in u])
    fit = armax(u, y, 0.01)
    deviation = [deviations(TRUTH, *data) for data in zip(u, y, strict=True)]
    z = (fit.theta - TRUTH) / deviation
    assert (fit.status == FitStatus.CONVERGED).all()
    # 96 standard normal numbers: beyond 4.5 with probability 7e-4; their root mean square,
    # correlated as they are, strays from 1 by about 0.1.
    assert abs(z).max() < 4.5
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.3
    np.testing.assert_allclose(fit.cost, 0.02**2, rtol=0.1)  # 4 deviations of a variance


def test_simulated_is_the_filter():
    u = np.random.default_rng(2).standard_normal((2, 300))
    theta = np.array([TRUTH, [-0.9, 0.0, 1.0, -2.0, 0.0, 0.0]])
    expected = [lfilter([0, *t[2:4]], [1, *t[:2]], row) for t, row in zip(theta, u, strict=True)]
    np.testing.assert_allclose(simulated(theta, u), expected, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(
        simulated(theta, u[:1]), simulated(theta, np.repeat(u[:1], 2, axis=0))
    )


@pytest.mark.parametrize("count", [1, 3, 17])
def test_an_episodes_fit_does_not_depend_on_the_batch(count):
    u, y, Ts = reference_data("100hz")
    y = np.concatenate([y, 2 * y + 0.001 * y[::-1]])
    whole, part = armax(u, y, Ts), armax(u, y[:count], Ts)
    for name in ("theta", "cost", "status", "passes"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[:count])


def test_every_episode_is_fitted_to_its_own_input():
    u, y, Ts = reference_data("100hz")
    # Signs and powers of two are exact: the model stays, and the cost scales.
    scale = np.resize([1.0, -1.0, 4.0, -0.5], (len(y), 1))
    fit, scaled = armax(u, y, Ts), armax(scale * u, scale * y, Ts)
    np.testing.assert_array_equal(scaled.theta, fit.theta)
    np.testing.assert_array_equal(scaled.cost, fit.cost * scale[:, 0] ** 2)


N = 250
NOISE = np.random.default_rng(0).standard_normal(N)
BITS = U[0, ::40]
HOPELESS = {
    "zero output": (BITS, np.zeros(N)),
    "constant output": (BITS, np.full(N, 0.1)),
    "zero input": (np.zeros(N), NOISE),
    "constant input": (np.full(N, 0.017), NOISE),
    "nothing": (np.zeros(N), np.zeros(N)),
    "not a number": (BITS, np.where(np.arange(N) == 100, np.nan, NOISE)),
    "infinite": (BITS, np.where(np.arange(N) == 100, np.inf, NOISE)),
    "overflow": (1e200 * BITS, 1e200 * NOISE),
    "underflow": (1e-200 * BITS, 1e-200 * NOISE),
}


@pytest.mark.parametrize("case", HOPELESS)
def test_hopeless_data_are_not_called_converged(case):
    u, y = HOPELESS[case]
    assert armax(u[None], y[None], 0.04).status[0] != FitStatus.CONVERGED
    features, usable = Armax()(u[None], y[None], 0.04)
    assert features.shape == (1, 6) and not usable[0]


def test_hopeless_episodes_leave_their_neighbours_alone():
    u = np.array([u for u, _ in HOPELESS.values()])
    y = np.array([y for _, y in HOPELESS.values()])
    good_u, good_y = BITS[None], simulated(TRUTH[None], BITS[None]) + 1e-4 * NOISE
    alone = armax(good_u, good_y, 0.04)
    among = armax(np.concatenate([u, good_u]), np.concatenate([y, good_y]), 0.04)
    assert alone.status[0] == FitStatus.CONVERGED and (among.status[:-1] > 0).all()
    np.testing.assert_array_equal(among.theta[-1:], alone.theta)


def test_features_average_blocks_and_drop_the_rest():
    y = np.asarray(REFERENCE["y"], dtype=float)
    features, usable = Armax()(U, y, 0.001)
    fit = armax(blocks(U, 40), blocks(y, 40), 0.04)
    assert usable.all()
    np.testing.assert_array_equal(features, fit.theta)
    longer = np.pad(y, ((0, 0), (0, 39)), constant_values=99.0)
    again, _ = Armax()(np.pad(U, ((0, 0), (0, 39))), longer, 0.001)
    np.testing.assert_array_equal(again, features)


def test_features_take_episodes_at_its_own_sampling_time():
    u, y, Ts = reference_data("100hz")
    features, usable = Armax(Ts=0.01)(u, y, Ts)
    assert usable.all()
    np.testing.assert_array_equal(features, armax(u, y, Ts).theta)


@pytest.mark.parametrize("Ts", [0.003, 0.016, 0.05, 0.0400001 * 2])
def test_a_sampling_time_that_does_not_fit_is_refused(Ts):
    with pytest.raises(ValueError, match=rf"Ts = {Ts:g} s"):
        Armax()(U, np.ones_like(U), Ts)


def test_a_recording_that_is_too_short_is_refused():
    u = U[:, :2399]  # 59 samples of 0.04 s, one fewer than ten a coefficient
    with pytest.raises(ValueError, match="2399 samples"):
        Armax()(u, u, 0.001)
    noisy = u + 1e-3 * np.random.default_rng(0).standard_normal((2, 2400))[:, : u.shape[1]]
    assert Armax()(U[:, :2400], np.pad(noisy, ((0, 0), (0, 1))), 0.001)[0].shape == (2, 6)
