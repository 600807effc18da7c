import control
import numpy as np
import pytest
from systems import CASES, contexts, control_plant, random_loops

from yawrate_env.batch import take
from yawrate_env.loop.closed_loop import poles, stable
from yawrate_env.loop.discretisation import zoh
from yawrate_env.loop.margins import margins
from yawrate_env.loop.transfer_function import TransferFunction, open_loop
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import Vehicle

TS = 0.01


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}-delay{case[1]}")
def loops(request):
    return random_loops(*request.param)


def integrators(k, Ts=TS, delay=0):
    """k/s behind a zero-order hold: k/delta."""
    k = np.atleast_1d(k).astype(float)
    return TransferFunction(
        np.stack([0 * k, k], axis=1), np.stack([1 + 0 * k, 0 * k], axis=1), Ts, delay
    )


@pytest.mark.parametrize("Ts", [0.001, 0.01, 0.1])
def test_transfer_function_is_the_plants_frequency_response(Ts):
    context = contexts(20, seed=0)
    G = TransferFunction.of(plants(Vehicle(), context, Ts), delay_samples=2)
    omega = np.pi / Ts * np.logspace(-6, 0, 40)
    z = np.exp(1j * omega * Ts)
    for b, response in enumerate(G(omega)):
        expected = control_plant(Vehicle(), context, b, Ts)(z) / z**2
        # Relative to the largest: near 20 Hz at 1 kHz the sixth-order roll-off costs digits.
        np.testing.assert_allclose(response, expected, rtol=1e-7)
        np.testing.assert_allclose(response, expected, rtol=0, atol=1e-10 * abs(expected).max())


def test_crossover_and_phase_margin_agree_with_python_control(loops):
    omega = 2 * np.pi * loops.found.crossover
    crossing = np.isfinite(omega)
    assert crossing.sum() >= 50
    L = loops.response(np.where(crossing, omega, 1.0))
    np.testing.assert_allclose(np.abs(L[crossing]), 1, rtol=1e-9)
    expected = np.degrees(np.angle(-L[crossing]))
    np.testing.assert_allclose(loops.found.phase_margin[crossing], expected, rtol=1e-9, atol=1e-9)
    assert np.isnan(loops.found.phase_margin[~crossing]).all()


def test_beyond_the_crossover_the_loop_stays_below_one(loops):
    # Where there is no crossover, it stays below one everywhere.
    start = np.nan_to_num(2 * np.pi * loops.found.crossover, nan=1e-6)
    omega = np.geomspace(start * (1 + 1e-6), np.pi / TS, 60)
    for b, L in enumerate(loops.control_loops):
        z = np.exp(1j * omega[:, b] * TS)[:, None, None]
        response = L.C @ np.linalg.solve(z * np.eye(L.nstates) - L.A, L.B) + L.D
        assert (np.abs(response) < 1).all()


def scaled_poles(loops, decibels):
    """Poles with the loop's gain changed: both forms are proportional to kp."""
    return poles(loops.plant, loops.kp * 10 ** (decibels / 20), loops.Ti, loops.target)


def test_gain_margin_puts_a_pole_on_the_unit_circle(loops):
    found = loops.found
    crossing = np.isfinite(found.phase_crossover)
    assert crossing.sum() > 150
    z = np.exp(2j * np.pi * found.phase_crossover * TS)
    distance = np.abs(scaled_poles(loops, found.gain_margin) - z[:, None]).min(axis=1)
    assert distance[crossing].max() < 1e-7
    assert np.isinf(found.gain_margin[~crossing]).all()


def test_gain_margin_is_where_a_stable_loop_loses_stability(loops):
    found = loops.found
    was_stable = stable(loops.plant, loops.kp, loops.Ti, loops.target)
    usable = was_stable & np.isfinite(found.gain_margin)
    assert usable.sum() > 20
    for part, is_stable in ((0.999, True), (1.001, False)):
        modulus = np.abs(scaled_poles(loops, part * found.gain_margin)).max(axis=1)
        np.testing.assert_array_equal(modulus[usable] < 1, is_stable)


def test_modulus_margin_is_the_least_distance_from_minus_one(loops):
    series = open_loop(loops.transfer_function, loops.kp, loops.Ti, loops.target)
    low = np.logspace(-9.5, -3, 1000, endpoint=False)
    L = series(np.pi / TS * np.append(low, np.linspace(1e-3, 1, 4000)))
    squared = np.abs(1 + L) ** 2
    nearest, least = squared.argmin(axis=1), squared.min(axis=1)
    # A parabola whose neighbouring grid points lie up to s higher falls at most s/4 lower.
    neighbours = np.stack([nearest - 1, nearest + 1], axis=1).clip(0, L.shape[1] - 1)
    rise = np.take_along_axis(squared, neighbours, axis=1).max(axis=1) - least
    found = loops.found.modulus_margin**2
    assert (found <= least * (1 + 1e-9)).all()
    assert (found >= least * (1 - 1e-9) - rise / 2).all()


def test_delay_margin_takes_up_the_phase_margin(loops):
    found = loops.found
    crossing = np.isfinite(found.crossover)
    lag = 360 * found.crossover * found.delay_margin
    np.testing.assert_allclose(
        lag[crossing], (found.phase_margin % 360)[crossing], rtol=1e-12, atol=1e-9
    )
    assert (found.delay_margin[crossing] >= 0).all()


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_sampled_integrator_in_closed_form(delay):
    # |delta| = 2/Ts sin(omega Ts/2) and arg delta = 90 deg + omega Ts/2.
    k = np.array([0.01, 1.0, 20.0, 150.0])
    found = margins(integrators(k, delay=delay))
    omega = 2 / TS * np.arcsin(k * TS / 2)
    np.testing.assert_allclose(found.crossover, omega / (2 * np.pi), rtol=1e-12)
    phase_margin = 90 - np.degrees(omega * TS * (0.5 + delay))
    wrapped = (phase_margin + 180) % 360 - 180
    np.testing.assert_allclose(found.phase_margin, wrapped, rtol=1e-11)
    # The phase is -180 deg (modulo 360) at omega Ts (1/2 + d) = pi/2 + 2 pi m.
    phase_crossover = (np.pi / 2 + 2 * np.pi * np.arange(delay // 2 + 1)) / (0.5 + delay) / TS
    gain_margin = 20 * np.log10(2 / (k[:, None] * TS) * np.sin(phase_crossover * TS / 2))
    nearest = np.abs(gain_margin).argmin(axis=1)
    expected = phase_crossover[nearest] / (2 * np.pi)
    np.testing.assert_allclose(found.phase_crossover, expected, rtol=1e-9)
    expected = gain_margin[np.arange(4), nearest]
    np.testing.assert_allclose(found.gain_margin, expected, rtol=1e-9)
    if delay == 0:  # Re L = -k Ts/2 at every frequency, and the rest vanishes at Nyquist
        np.testing.assert_allclose(found.modulus_margin, 1 - k * TS / 2, rtol=1e-12)


def test_last_of_several_crossovers_is_reported():
    # An undamped-looking resonance at 5 rad/s lifts k/s over one again.
    A = np.array([[[0.0, 1, 0], [-25, -0.2, 25], [0, 0, 0]]])
    plant = zoh(A, np.array([[0.0, 0, 1]]), np.array([1.0, 0, 0]), TS)
    found = margins(TransferFunction.of(plant))
    G = control.ss(plant.A[0], plant.B[0][:, None], plant.C[None], 0, TS)
    omega = np.linspace(0.1, 20, 20_000)
    above = np.abs(G(np.exp(1j * omega * TS))) >= 1
    assert np.count_nonzero(np.diff(above)) == 3
    last = omega[np.flatnonzero(above)[-1]]
    assert found.crossover[0] * 2 * np.pi == pytest.approx(last, abs=2 * (omega[1] - omega[0]))


@pytest.mark.parametrize("count", [1, 17, 150])
def test_one_loop_does_not_depend_on_the_batch(count):
    loops = random_loops("pi", 1)
    part = slice(7, 7 + count)
    context = take(contexts(200, seed=1), part)
    alone = TransferFunction.of(plants(Vehicle(), context, TS), 1)
    found = margins(open_loop(alone, loops.kp[part], loops.Ti[part], loops.target))
    for name in found.__slots__:
        np.testing.assert_array_equal(getattr(found, name), getattr(loops.found, name)[part])
