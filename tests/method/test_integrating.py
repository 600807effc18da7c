"""Plants with an integrator: levels, offsets and loads that drift, PRBS and closed loops."""

import numpy as np
import pytest
from scipy.signal import lfilter

import tuners
from tuners.export import export
from tuners.features.integrated import Integrated
from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import black_box, free_responses
from tuners.tuner.recording import Recording
from yawrate_env import plants
from yawrate_env.plant.plant import Plant

PLANT = plants.integrator()
TUNER = tuners.load("gb", PLANT)
N, SIGMA = len(PLANT.u), PLANT.noise
T = np.arange(N)
THETA = np.array([[0.05, 6.25]])
FUNCTIONS = Integrated(4, 0.3)


def noise(seed=0):
    return SIGMA * np.random.default_rng(seed).standard_normal(N)


def test_functions_are_those_of_the_integral():
    u = np.random.default_rng(0).standard_normal((3, 200))
    plain = Laguerre(4, 0.3)
    integral = 0.5 * np.cumsum(u, axis=1)
    expected = plain.regressors(integral, 0.5)
    np.testing.assert_allclose(FUNCTIONS.regressors(u, 0.5), expected, rtol=1e-12)
    y, extra = np.random.default_rng(1).standard_normal((3, 200)), np.ones((1, 200))
    own, shared = FUNCTIONS.normal_equations(u, y, 0.5, extra), plain.normal_equations(
        integral, y, 0.5, extra)  # fmt: skip
    for one, other in zip(own, shared, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_their_response_is_that_of_their_filters():
    """(1 - q^-1) times the impulse response decays, and has a Fourier transform."""
    impulse = np.zeros((1, 400))
    impulse[0, 0] = 1.0
    h = np.diff(FUNCTIONS.regressors(impulse, 0.5)[0], prepend=0.0, axis=1)
    omega = np.array([0.05, 0.4, 2.0])
    z = np.exp(-1j * np.outer(np.arange(400), 0.5 * omega))
    expected = h @ z / (1 - np.exp(-0.5j * omega))
    np.testing.assert_allclose(FUNCTIONS.frequency_response(omega, 0.5), expected, rtol=1e-8)


def test_a_load_in_each_window_adds_a_bend():
    Z, straight = free_responses(FUNCTIONS, N, 1.0)
    assert Z.shape == (4 + 7 + 2, N) and straight.shape == (2, 13)
    np.testing.assert_allclose(Z @ Z.T, np.eye(len(Z)), atol=1e-9)
    load = np.where(T < N / 4, 0.3, -0.2)
    drift = 2.0 + np.concatenate([[0.0], np.cumsum(load)[:-1]])
    some = Z[:9]
    np.testing.assert_allclose(some.T @ (some @ drift), drift, atol=1e-9 * np.abs(drift).max())


def drifting(kind):
    """A recording, and how many signals it needs beside the response."""
    load = {"rest": 0.0, "level": 0.0, "offset": 0.1}.get(kind, np.where(T < 225, 0.1, -0.15))
    y = PLANT.respond(THETA, PLANT.u + load)[0] + noise()
    return y + (0.0 if kind == "rest" else 3.0), {"rest": 0, "level": 1, "offset": 2}.get(kind, 9)


@pytest.mark.parametrize("kind", ["rest", "level", "offset", "load"])
def test_no_more_drift_is_estimated_than_there_is(kind):
    y, extra = drifting(kind)
    model = black_box(PLANT, TUNER.inspection.black_box, PLANT.u[None], y[None], "auto")
    assert model.extra[0] == extra
    assert model.residual[0] / N == pytest.approx(SIGMA**2, rel=0.15)


@pytest.mark.parametrize("kind", ["rest", "level", "offset", "load"])
def test_a_drifting_plant_is_tuned_and_trusted(kind):
    y, _ = drifting(kind)
    found = TUNER.tune(PLANT.u, y)
    assert found.trusted
    right = dict(zip(PLANT.gains, PLANT.oracle(THETA)[0], strict=True))
    assert found.gains == pytest.approx(right, rel=0.03)


def test_a_recording_of_a_closed_loop_is_tuned():
    """A proportional controller holds the level; its noise runs through the loop."""
    K, late = 0.05, 6
    kp, e = 0.3 / (K * late), noise(1)
    reference = 0.5 / kp * PLANT.u
    u, y, level = np.zeros(N), np.zeros(N), 0.0
    for k in range(N):
        y[k] = level + e[k]
        u[k] = kp * (reference[k] - y[k])
        level += K * (u[k - late] if k >= late else 0.0)
    found = TUNER.tune(u, y, reference=reference)
    right = PLANT.oracle(np.array([[K, late]]))[0]
    assert found.trusted
    assert [found.gains["kp"], found.gains["Ti"]] == pytest.approx(right, rel=0.05)


def test_a_wrong_plant_is_refused():
    """A lag of 15 s in front of the tank, which no plant of the prior has."""
    lagged = lfilter([1 - np.exp(-1 / 15)], [1, -np.exp(-1 / 15)], PLANT.u)
    y = PLANT.respond(THETA, lagged)[0] + noise()
    result = TUNER.tune(PLANT.u, y)
    assert not result.trusted or result.verdict == "usable_with_care"


def test_only_a_linear_plant_is_said_to_integrate():
    settings = {name: getattr(PLANT, name) for name in ("prior", "simulate", "design", "gains")}
    with pytest.raises(ValueError, match="integrating"):
        Plant(**settings, u=PLANT.u, Ts=1.0, integrating=True)


def test_features_of_integrals_are_not_exported_as_others(tmp_path):
    tuner = tuners.train(PLANT, episodes=60, calibration=0)
    tuner.save(tmp_path / "tank.tuner")
    again = tuners.load(tmp_path / "tank.tuner")
    assert again.method.features == tuner.method.features
    assert isinstance(again.method.features, Integrated)
    y, _ = drifting("rest")
    recording = Recording.of(PLANT, PLANT.u, y)
    np.testing.assert_array_equal(again.gains(recording).values, tuner.gains(recording).values)
    with pytest.raises(ValueError, match="Integrated"):
        export(tuner, "c", tmp_path / "c")
