"""Inputs joined by lines: SciPy's response to them, from a plant that holds its input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

import tuners
from tuners.tuner.recording import Recording
from yawrate_env.loop.discretisation import zoh
from yawrate_env.loop.simulation import simulate
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.hold import held_like_lines

TS, N = 1 / 610.0, 2000
NOISE = 1e-3


def matrices(theta):
    """An electronic oscillator near 70 Hz, under nine samples a period."""
    f, damping, gain = theta.T
    w = 2 * np.pi * f
    A = np.zeros((len(w), 2, 2))
    A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = 1.0, -(w**2), -2 * damping * w
    return A, np.stack([0 * w, gain * w**2], axis=1), np.array([1.0, 0.0])


def respond(theta, u, rng):
    return simulate(zoh(*matrices(theta), TS), u)


def oscillator(**changes):
    settings = {
        "prior": {"f": (60.0, 80.0), "damping": (0.2, 0.5), "gain": (0.5, 2.0)},
        "simulate": respond,
        "design": lambda theta: 1 / theta[:, 2:],
        "gains": ("kp",),
        "u": noise_below(120.0),
        "Ts": TS,
        "noise": NOISE,
        "linear": True,
        "black_box": (24, 440.0),
    }
    return Plant(**(settings | changes))


def noise_below(frequency, seed=0):
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(N))
    spectrum[np.fft.rfftfreq(N, TS) > frequency] = 0
    return 0.1 * np.fft.irfft(spectrum, N)


THETA = np.array([[68.0, 0.3, 1.1]])


def by_lines(u, Ts=TS):
    """SciPy's response to an input that is linear between samples."""
    A, B, C = matrices(THETA)
    system = A[0], B[0][:, None], C[None], np.zeros((1, 1))
    return lsim(system, u, Ts * np.arange(len(u)))[1]


def relative(error, of):
    return np.sqrt(np.mean(error**2) / np.mean(of**2))


@pytest.mark.parametrize("times, at_most", [(1, 0.006), (5, 0.0006)])
def test_a_held_input_acts_as_lines_do_also_on_a_finer_grid(times, at_most):
    u = noise_below(120.0)
    hold, at = TS / times, TS / times * np.arange((N - 1) * times + 1)
    v = held_like_lines(u[None], TS, at, hold)
    y = simulate(zoh(*matrices(THETA), hold), v)[0, ::times]
    assert relative(y - by_lines(u), by_lines(u)) < at_most
    held = simulate(zoh(*matrices(THETA), TS), u[None])[0]
    assert relative(held - by_lines(u), by_lines(u)) > 0.3


def test_lines_stay_lines_and_areas_stay_areas():
    t = TS * np.arange(50)
    v = held_like_lines((3 * t + 1)[None], TS, t, TS)[0]
    np.testing.assert_allclose(v[:-1], 3 * (t + TS / 2)[:-1] + 1, rtol=1e-12)
    assert v[-1] == 3 * t[-1] + 1  # nothing follows
    slow = held_like_lines((3 * t + 1)[None], TS, 4 * TS * np.arange(12), 4 * TS)[0]
    np.testing.assert_allclose(slow, 3 * TS * (4 * np.arange(12) + 2) + 1, rtol=1e-12)


def test_fit_black_box_and_gains_know_how_the_input_ran():
    plant, u = oscillator(), noise_below(120.0, 5)
    y = by_lines(u) + NOISE * np.random.default_rng(1).standard_normal(N)
    tuner = tuners.load("gb", plant)
    held, lines = (tuner.tune(u, y, input=each) for each in ("held", "lines"))
    left = [np.sqrt(np.mean(each.fit.residual**2)) for each in (held, lines)]
    assert left[0] > 10 * left[1] and left[1] < 1.4 * NOISE
    assert lines.trusted and lines.gains["kp"] == pytest.approx(1 / 1.1, rel=2e-3)
    assert tuners.load("gb", oscillator(input="lines")).tune(u, y).gains == lines.gains
    given = Recording.of(plant, u, y, between="lines")
    assert tuner.gains(given).values[0] == pytest.approx(lines.gains["kp"], rel=1e-3)
    box = tuner.assess(given)[1].model
    assert box.residual[0] / N < (1.4 * NOISE) ** 2


def test_a_fast_recording_of_lines_keeps_its_areas_at_a_slow_sampling_time():
    u = np.random.default_rng(0).standard_normal(400)
    recording = Recording(u[None], u[None], 0.01, input="lines")
    slow = recording.resampled(0.05)
    means = [np.trapezoid(u[5 * k : 5 * k + 6]) / 5 for k in range(1, 78)]
    np.testing.assert_allclose(slow.u[0, 1:78], means, atol=0.2)  # of a curve, not of lines
    assert slow.input == "held" and slow.u.shape == slow.y.shape


def test_what_is_no_way_of_running_is_refused():
    with pytest.raises(ValueError, match="input = 'steps'"):
        Recording(np.ones((1, 5)), np.ones((1, 5)), 0.1, input="steps")
    with pytest.raises(ValueError, match="input = 'steps'"):
        oscillator(input="steps")
    with pytest.raises(ValueError, match="too few"):
        replace(Recording(np.ones((1, 3)), np.ones((1, 3)), 0.1), input="lines").resampled(0.1)
