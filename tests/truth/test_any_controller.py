"""Controllers against their formulas and python-control, and rule R for all of them."""

import control
import numpy as np
import pytest

from tuners.pidtune import pidtune
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.dead_time import zoh_late
from yawrate_env.loop.design import Status, required_response
from yawrate_env.loop.discretisation import zoh
from yawrate_env.loop.margins import margins
from yawrate_env.loop.shaping import lqr
from yawrate_env.loop.state_feedback import StateFeedback, reference_gain
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction
from yawrate_env.plant.control_loop import ControlLoop

TS, DELAY = 0.1, 2
A, B, C = np.array([[-1.0, 1.0], [0.0, -3.0]]), np.array([0.0, 6.0]), np.array([1.0, 0.0])
GAINS = {"kp": 0.8, "Ki": 0.5, "Ti": 1.4, "Td": 0.3, "Tf": 0.12, "b": 0.6, "T_lead": 0.9,
         "T_lag": 0.25}  # fmt: skip


def plants(*dead_times):
    count = len(dead_times)
    stacked = (np.repeat(M[None], count, axis=0) for M in (A, B))
    return zoh_late(*stacked, C, TS, np.array(dead_times))


def gains_of(name):
    return np.array([[GAINS[gain] for gain in CONTROLLERS[name].gains]])


def formulas(name):
    """Transfer functions of reference and output, by python-control's Tustin."""
    s, of = control.tf("s"), GAINS
    rate = s / (1 + (of["Tf"] if "Tf" in CONTROLLERS[name].gains else TS / 2) * s)
    if name == "lead-lag":
        both = of["kp"] * (1 + of["T_lead"] * s) / (1 + of["T_lag"] * s), None
    elif name == "I":
        both = of["Ki"] / s, None
    else:
        kp, gains = of["kp"], CONTROLLERS[name].gains
        rest = kp / (of["Ti"] * s) if "Ti" in gains else 0
        output = kp + rest + (kp * of["Td"] * rate if "Td" in gains else 0)
        both = {"2DOF": (kp * of["b"] + rest, output), "PI-D": (kp + rest, output)}.get(
            name, (output, None)
        )
    reference, output = both[0], both[1] or both[0]
    if name == "P":
        return (control.tf(output, 1, TS),) * 2
    return tuple(control.sample_system(control.tf(F), TS, "tustin") for F in (reference, output))


@pytest.mark.parametrize("name", CONTROLLERS)
def test_open_and_closed_loop_are_python_controls(name):
    """A dead time of two samples as two more poles; time responses and poles of the whole loop."""
    reference, output = formulas(name)
    G = control.sample_system(control.ss(A, B[:, None], C[None], 0), TS, "zoh")
    G = G * control.ss(control.tf([1], [1, 0, 0], TS))
    omega = np.geomspace(0.02, 25.0, 40)
    plant = zoh(A[None], B[None], C, TS)
    found = CONTROLLERS[name].open_loop(plant, gains_of(name), DELAY)(omega)[0]
    z = np.exp(1j * omega * TS)
    np.testing.assert_allclose(found, G(z) * output(z), rtol=1e-9)
    closed = CONTROLLERS[name].close(plant, gains_of(name), DELAY)
    loop = control.feedback(G, control.ss(output))
    assert closed.stable[0] == (np.abs(loop.poles()) < 1).all()
    r = np.random.default_rng(0).standard_normal(80)
    u = control.forced_response(control.ss(reference), inputs=r).outputs
    expected = control.forced_response(loop, inputs=u).outputs
    y, _ = closed.respond(r)
    np.testing.assert_allclose(y[0], expected, atol=1e-8 * np.abs(expected).max())


KINDS = ["P", "I", "PI", "PD", "PDF", "PID", "PIDF", "PI-D", "2DOF", "lead-lag"]


@pytest.mark.parametrize("name", KINDS)
def test_rule_r_meets_the_target_behind_fractional_dead_times(name):
    """One batch with dead times of its own each; at the crossover magnitude 1, and the phase."""
    pm = {"I": 80.0, "PD": 70.0, "PDF": 70.0}.get(name, 55.0)
    target = Target(phase_margin=pm, crossover=0.25, Ts=TS)
    plant = plants(0.0, 0.13, 0.25, 0.31)
    needed = required_response(TransferFunction.of(plant, 0), target)
    gains, status = CONTROLLERS[name].shape(*needed, target)
    has = np.isfinite(gains).all(axis=1)
    assert has.any()
    L = CONTROLLERS[name].open_loop(plant, gains, 0)(np.array([target.omega_c]))[has, 0]
    np.testing.assert_allclose(np.abs(L), 1.0, rtol=1e-9)
    reached = np.degrees(np.angle(-L))
    if name not in ("P", "I"):
        met = status[has] == Status.OK
        assert met.any()
        np.testing.assert_allclose(reached[met], pm, rtol=1e-9)
        assert (reached[~met] < pm).all()
    else:
        np.testing.assert_array_equal(reached >= pm, status[has] == Status.OK)


@pytest.mark.parametrize("kind", ["P", "I", "PI", "PD", "PDF", "PID", "PIDF"])
def test_pidtune_and_loops_have_one_rule(kind):
    target = Target(phase_margin=60.0, crossover=0.3, Ts=TS, delay_samples=DELAY)
    plant = zoh(A[None], B[None], C, TS)
    needed = required_response(TransferFunction.of(plant, DELAY), target)
    gains, status = CONTROLLERS[kind].shape(*needed, target)
    sys = control.sample_system(control.ss(A, B[:, None], C[None], 0), TS, "zoh")
    _, info = pidtune(sys, kind, wc=target.omega_c, pm=60.0, delay=DELAY * TS)
    if info.status == Status.UNREACHABLE:
        assert status[0] == Status.UNREACHABLE
        return
    expected = [getattr(info, {"kp": "Kp"}.get(name, name)) for name in CONTROLLERS[kind].gains]
    np.testing.assert_allclose(gains[0], expected, rtol=1e-9)


def test_a_state_feedback_is_the_plants_own_poles():
    plant, K = zoh(A[None], B[None], C, TS), np.array([[0.7, -0.2]])
    of = StateFeedback(("k1", "k2"))
    kr = reference_gain(plant, K)
    closed = of.close(plant, np.column_stack([K, kr]), 0)
    expected = np.linalg.eigvals(plant.A[0] - np.outer(plant.B[0], K[0]))
    np.testing.assert_allclose(np.sort(closed.poles[0]), np.sort(expected), rtol=1e-9)
    y, u = closed.respond(np.ones(400))
    assert y[0, -1] == pytest.approx(1.0, rel=1e-9) and u[0, 0] == pytest.approx(kr[0])
    z = np.exp(1j * TS * np.array([0.5, 4.0]))
    L = of.open_loop(plant, np.column_stack([K, kr]), 0)(np.array([0.5, 4.0]))[0]
    direct = [K[0] @ np.linalg.solve(x * np.eye(2) - plant.A[0], plant.B[0]) for x in z]
    np.testing.assert_allclose(L, direct, rtol=1e-10)


def test_lqr_is_scipys_riccati_equation_with_its_guaranteed_margins():
    from scipy.linalg import solve_discrete_are

    scale = np.array([1.0, -4.0, 0.02])
    plant = zoh(np.repeat(A[None], 3, axis=0), scale[:, None] * B, C, 0.001)
    K = lqr(plant, 0.01)
    for b in range(3):
        one = plant.B[b][:, None]
        X = solve_discrete_are(plant.A[b], one, np.outer(C, C), [[0.01]])
        expected = np.linalg.solve(0.01 + one.T @ X @ one, one.T @ X @ plant.A[b])[0]
        np.testing.assert_allclose(K[b], expected, rtol=1e-7)
    assert (K[1] < 0).all()
    of = StateFeedback(("k1", "k2"))
    found = margins(of.open_loop(plant, np.column_stack([K, np.ones(3)]), 0))
    assert (found.phase_margin[:2] > 59.5).all()  # 60 degrees in continuous time (Kalman)
    assert (found.modulus_margin > 0.99).all()


def test_a_state_feedback_of_models_is_of_their_own_states():
    def model(theta):
        return control.ss(A, theta[0] * B[:, None], C[None], 0)

    of = StateFeedback(("k1", "k2"))
    loop = ControlLoop.of(model, TS, Target(Ts=TS, crossover=0.3), controller=of, rule="lqr")
    gains, _ = loop.design(np.array([[1.0], [-2.0]]))
    np.testing.assert_allclose(gains[:, :2], lqr(loop.sampled(np.array([[1.0], [-2.0]])), 1.0))
    np.testing.assert_allclose(
        loop.sampled(np.ones((1, 1))).A[0], zoh(A[None], B[None], C, TS).A[0]
    )
    other = ControlLoop.of(lambda theta: control.tf([theta[0]], [1, 1]), TS, loop.target,
                           controller=StateFeedback(("k",)), rule="lqr")  # fmt: skip
    with pytest.raises(ValueError, match="output row"):
        other.design(np.array([[1.0], [2.0]]))
