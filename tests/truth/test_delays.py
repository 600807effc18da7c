"""Dead time and sensor lag, at the samples and in the loop, against other ways to the answer."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.linalg import expm

from yawrate_env.loop.closed_loop import poles, time_response
from yawrate_env.loop.dead_time import zoh_late
from yawrate_env.loop.simulation import simulate
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction, open_loop
from yawrate_env.vehicle.discrete import plants
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context, Vehicle, context_of, state_space
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

DEAD = (0.0, 0.004, 0.01, 0.0137, 0.0399, 0.2, 0.5)
CONTEXT = Context.of(np.linspace(0.4, 1.0, len(DEAD)), 100.0, 20.0, dead_time=DEAD)
UNDELAYED = replace(CONTEXT, others={})
TASK = Task(experiment=Experiment(N=3000), prior=Prior(dead_time=(0.0, 0.5)))
GAINS = np.full(len(DEAD), 0.15), np.full(len(DEAD), 0.12)


def columns(dead_time, Ts, A, B):
    """d, old and new of ``x+ = Ad x + old u[k - d - 1] + new u[k - d]``, each piece by ``expm``."""
    d, f = divmod(dead_time, Ts)
    joined = np.zeros((len(A) + 1, len(A) + 1))
    joined[:-1, :-1], joined[:-1, -1] = A, B
    first, rest = expm(joined * f)[:-1], expm(joined * (Ts - f))[:-1]
    return int(d), rest[:, :-1] @ first[:, -1], rest[:, -1]


def late_responses(Ts, u):
    """Outputs of every vehicle, with the command that changes within the sample."""
    A, B, C = state_space(Vehicle(), UNDELAYED)
    y = np.zeros((len(DEAD), len(u)))
    for b, dead_time in enumerate(DEAD):
        d, old, new = columns(dead_time, Ts, A[b], B[b])
        Ad, x = expm(A[b] * Ts), np.zeros(6)
        padded = np.concatenate([np.zeros(d + 1), u])
        for k in range(len(u)):
            y[b, k] = C @ x
            x = Ad @ x + old * padded[k] + new * padded[k + 1]
    return y


def test_fractions_of_a_sample_are_the_command_that_changes_within_it():
    plant, u = yaw_rate(TASK, check=False), np.random.default_rng(0).standard_normal(400)
    theta = np.stack([UNDELAYED.mu_s, UNDELAYED.M_delta, UNDELAYED.v_x, DEAD], axis=1)
    coarse = yaw_rate(replace(TASK, experiment=Experiment(Ts=0.0075, N=400)), check=False)
    for each, Ts in ((plant, 0.001), (coarse, 0.0075)):
        expected = late_responses(Ts, u)
        np.testing.assert_allclose(each.respond(theta, u), expected, atol=1e-10)


def test_whole_samples_are_a_shift_bit_for_bit():
    u, N = np.random.default_rng(1).standard_normal(400), 400
    straight = simulate(plants(Vehicle(), UNDELAYED, 0.001), u)
    y = yaw_rate(TASK, check=False).respond(np.array([[*row, 0.037] for row in context_rows()]), u)
    np.testing.assert_array_equal(y[:, 37:], straight[:, : N - 37])
    assert not y[:, :37].any()


def context_rows():
    return np.stack([UNDELAYED.mu_s, UNDELAYED.M_delta, UNDELAYED.v_x], axis=1)


def test_a_dead_time_beyond_the_recording_leaves_nothing():
    plant = yaw_rate(replace(TASK, experiment=Experiment(N=300)), check=False)
    assert not plant.respond(np.array([[0.5, 0.0, 20.0, 0.4]])).any()


def test_rows_do_not_depend_on_the_batch():
    plant, rows = yaw_rate(TASK, check=False), np.column_stack([context_rows(), DEAD])
    keys = np.arange(4 * len(rows), dtype=np.uint64).reshape(-1, 4)
    together = plant.measure(rows, plant.u[None], keys)
    for b in range(len(rows)):
        alone = plant.measure(rows[b : b + 1], plant.u[None], keys[b : b + 1])
        np.testing.assert_array_equal(alone[0], together[b])


@pytest.mark.parametrize("delay", [0, 2])
def test_the_open_loop_has_the_modified_z_transform(delay):
    target = Target(delay_samples=delay)
    A, B, C = state_space(Vehicle(), UNDELAYED)
    L = open_loop(TransferFunction.of(plants(Vehicle(), CONTEXT, target.Ts), delay), *GAINS, target)
    omega = np.geomspace(0.1, 300.0, 40)
    found, z = L(omega), np.exp(1j * omega * target.Ts)
    C_z = GAINS[0][0] * (1 + target.Ts / (2 * GAINS[1][0]) * (z + 1) / (z - 1))
    for b, dead_time in enumerate(DEAD):
        d, old, new = columns(dead_time, target.Ts, A[b], B[b])
        Ad = expm(A[b] * target.Ts)
        G = [C @ np.linalg.solve(s * np.eye(6) - Ad, new + old / s) / s ** (d + delay) for s in z]
        np.testing.assert_allclose(found[b], G * C_z, rtol=1e-9)


def test_at_low_frequency_the_dead_time_is_its_phase():
    # A hold and a dead time together: far below the sampling rate the plant is e^(-j w T) G_0.
    late, straight = (TransferFunction.of(plants(Vehicle(), c, 0.01)) for c in (CONTEXT, UNDELAYED))
    omega = np.array([0.5])
    ratio = (late(omega) / straight(omega))[:, 0]
    np.testing.assert_allclose(ratio, np.exp(-1j * omega * DEAD), atol=2e-6)


@pytest.mark.parametrize("delay", [0, 2])
def test_the_loop_in_time_and_its_poles_are_those_of_the_augmented_plant(delay):
    target = Target(delay_samples=delay)
    A, B, C = state_space(Vehicle(), UNDELAYED)
    plant = plants(Vehicle(), CONTEXT, target.Ts)
    one = np.ones(150)
    y, u = time_response(plant, *GAINS, target, one)
    pushed, _ = time_response(plant, *GAINS, target, 0 * one, one)
    zoomed = poles(plant, *GAINS, target)
    for b, dead_time in enumerate(DEAD):
        d, old, new = columns(dead_time, target.Ts, A[b], B[b])
        # States: the vehicle, d + 1 past inputs of the dead time, and the computation delay's.
        m = 6 + d + 1
        G = np.zeros((m, m))
        G[:6, :6] = expm(A[b] * target.Ts)
        inputs = np.zeros(m)
        inputs[6] = 1.0
        G[:6, m - 1] = old
        if d:
            G[:6, m - 2] = new
        else:
            inputs[:6] = new
        for k in range(7, m):
            G[k, k - 1] = 1.0
        late = control.ss(G, inputs[:, None], [[*C, *np.zeros(d + 1)]], 0, target.Ts)
        lag = control.ss(control.tf([1], [1] + [0] * delay, target.Ts))
        pi = control.ss(1, 1, target.Ts * GAINS[0][b] / GAINS[1][b],
                        GAINS[0][b] * (1 + target.Ts / (2 * GAINS[1][b])), target.Ts)  # fmt: skip
        closed = control.feedback(late * lag * pi, 1)
        expected = control.forced_response(closed, U=one).outputs
        np.testing.assert_allclose(y[b], expected, atol=1e-8)
        push = control.feedback(late, lag * pi)
        np.testing.assert_allclose(
            pushed[b], control.forced_response(push, U=one).outputs, atol=1e-8
        )
        np.testing.assert_allclose(np.abs(zoomed[b]).max(), np.abs(closed.poles()).max(), rtol=1e-7)


def test_the_design_reaches_the_target_behind_a_dead_time():
    task = replace(TASK, prior=Prior(dead_time=(0.0, 0.03), v_x=(15, 20)))
    plant = yaw_rate(task)
    theta = np.array([[0.8, 0.0, 18.0, late] for late in (0.0, 0.0042, 0.01, 0.0255)])
    gains, reached = plant.designs(theta)
    assert reached.all()
    np.testing.assert_allclose(plant.metric_values(theta, gains), [[60.0, 1.5]] * 4, rtol=1e-9)
    lag = loops(task, context_of(theta, ("dead_time",))).evaluate(*gains.T).margins
    # A delay more takes its phase at the crossover: 360 deg times 1.5 Hz times the delay.
    later = theta + [0.0, 0.0, 0.0, 0.01]
    found = plant.metric_values(later, gains)[:, 0]
    np.testing.assert_allclose(60 - found, 360 * 1.5 * 0.01, rtol=1e-9)
    np.testing.assert_allclose(lag.delay_margin, 60 / 360 / 1.5, rtol=1e-9)


def test_the_sensor_is_a_first_order_lag():
    lags = np.array([0.0, 0.002, 0.03, 0.5])
    context = Context.of([0.4, 0.6, 0.8, 1.0], 50.0, 20.0, sensor_lag=lags)
    u = np.random.default_rng(2).standard_normal(300)
    y = simulate(plants(Vehicle(), context, 0.005), u)
    A, B, C = state_space(Vehicle(), replace(context, others={}))
    for b, lag in enumerate(lags):
        series = control.ss(A[b], B[b][:, None], C[None], 0)
        if lag:
            series = control.ss(-1 / lag, 1 / lag, 1, 0) * series
        expected = control.forced_response(series.sample(0.005), U=u).outputs
        # Where vehicles differ a lag of zero counts as a microsecond.
        np.testing.assert_allclose(y[b], expected, atol=1e-9 if lag else 5e-5)
    known = simulate(plants(Vehicle(sensor_lag=0.03), replace(context, others={}), 0.005), u)
    np.testing.assert_allclose(known[2], y[2], rtol=1e-12)


@pytest.mark.parametrize("Ts", [0.0001, 0.001, 0.02])
def test_fast_and_slow_sensors_cost_no_digits(Ts):
    lags = np.array([0.0, 1e-5, 1e-4, 0.003, 0.5])
    context = Context.of(0.7, 50.0, np.linspace(10, 33, 5), sensor_lag=lags)
    u, x0 = np.random.default_rng(3).standard_normal(2000), np.full((5, 7), 0.01)
    y = simulate(plants(Vehicle(), context, Ts), u, x0)
    A, B, C = state_space(Vehicle(), context)
    for b in range(len(lags)):
        joined = np.zeros((8, 8))
        joined[:7, :7], joined[:7, 7] = A[b], B[b]
        E, x, expected = expm(joined * Ts), x0[b], []
        for command in u:
            expected.append(C @ x)
            x = E[:7, :7] @ x + E[:7, 7] * command
        np.testing.assert_allclose(y[b], expected, atol=1e-10 * np.abs(expected).max())


def test_lag_and_dead_time_together_are_both():
    known = Vehicle(dead_time=0.0123, sensor_lag=0.02)
    context = Context.of(0.7, 0.0, 20.0)
    omega = np.array([0.3, 1.0])
    with_both, with_none = (
        TransferFunction.of(plants(each, context, 0.001))(omega) for each in (known, Vehicle())
    )
    expected = np.exp(-1j * omega * 0.0123) / (1 + 0.02j * omega)
    np.testing.assert_allclose(with_both / with_none, expected[None], atol=1e-7)


def test_a_relaxation_length_of_zero_is_a_tyre_without_lag():
    context = Context.of(0.7, 0.0, 20.0)
    quick = TransferFunction.of(plants(Vehicle(l_rel_f=0.0, l_rel_r=0.0), context, 0.001))
    v = Vehicle()  # the bicycle of two states with alpha = alpha_kin, and the actuator
    M, C_f, C_r = v.M_0, 0.7 * v.C_f, 0.7 * v.C_r
    A = np.array([
        [-(C_f + C_r) / (M * 20), (v.l_r * C_r - v.l_f * C_f) / (M * 400) - 1],
        [(v.l_r * C_r - v.l_f * C_f) / v.J_z, -(v.l_f**2 * C_f + v.l_r**2 * C_r) / (v.J_z * 20)],
    ])  # fmt: skip
    body = control.ss(A, [[C_f / (M * 20)], [v.l_f * C_f / v.J_z]], [[0, 1]], 0)
    actuator = control.tf([v.omega_n**2], [1, 2 * v.xi * v.omega_n, v.omega_n**2])
    omega = np.array([0.1, 1.0, 10.0])
    expected = (body * control.ss(actuator)).sample(0.001)(np.exp(1j * omega * 0.001))
    np.testing.assert_allclose(quick(omega)[0], expected, rtol=5e-4)


def test_a_dead_time_adds_no_states_and_zero_changes_nothing():
    A, B, C = state_space(Vehicle(), UNDELAYED)
    late = zoh_late(A, B, C, 0.01, np.zeros(len(DEAD)))
    straight = plants(Vehicle(), UNDELAYED, 0.01)
    np.testing.assert_array_equal(late.B, straight.B)
    assert not late.D.any() and not late.delay.any() and late.A.shape[1] == 6
