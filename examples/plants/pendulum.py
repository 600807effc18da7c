"""An inverted pendulum, which falls over without a controller: recorded in a loop that holds it.

    python scripts/compare_plant.py examples/plants/pendulum.py

Length and drive are known to about a third.  A cautious PD holds every such pendulum upright; the
experiment switches its reference by two degrees either way.  The sensor's noise goes round that
loop.  From the recording a tuner reads the PD that gives the loop a natural frequency of 2 Hz and a
damping of 0.7 (Franklin, Powell and Emami-Naeini, Feedback Control of Dynamic Systems, 2015).
"""

import numpy as np

from yawrate_env.loop.discretisation import DiscretePlant, zoh
from yawrate_env.loop.simulation import simulate as simulated
from yawrate_env.plant import Plant
from yawrate_env.plant.responses import ClosedLoop, Response
from yawrate_env.signals.excitation import prbs

TS = 0.01
FREQUENCY, DAMPING = 2.0, 0.7  # Hz, and of the loop that is wanted
CAUTIOUS = 5.0, 0.8  # V/rad, V s/rad: the PD that holds the pendulum while it is recorded


def loops(theta, kp, kd):
    """Loops (B) of a sampled PD around ``angle'' = a angle + b voltage``; reference to angle.

    States: angle, its rate, the last error.
    """
    a, b = theta.T
    zero, one = np.zeros_like(a), np.ones_like(a)
    A = np.stack([np.stack([zero, one], -1), np.stack([a, zero], -1)], 1)
    open_ = zoh(A, np.stack([zero, b], -1), np.array([1.0, 0.0]), TS)
    closed, column = np.zeros((len(a), 3, 3)), np.zeros((len(a), 3))
    of_error = kp + kd / TS  # u = kp e + kd (e - last e) / TS
    closed[:, :2, :2] = open_.A
    closed[:, :2, 0] -= open_.B * np.broadcast_to(of_error, len(a))[:, None]
    closed[:, :2, 2] = -open_.B * np.broadcast_to(kd / TS, len(a))[:, None]
    closed[:, 2, 0] = -1.0
    column[:, :2] = open_.B * np.broadcast_to(of_error, len(a))[:, None]
    column[:, 2] = 1.0
    return DiscretePlant(closed, column, np.array([1.0, 0.0, 0.0]), TS)


def simulate(theta, reference, rng):
    """Angles (B, N) of the loop that holds the pendulum."""
    return simulated(loops(theta, *CAUTIOUS), reference)


def design(theta):
    """The PD (B, 2) by pole placement: ``s^2 + b kd s + (b kp - a)``."""
    a, b = theta.T
    omega = 2 * np.pi * FREQUENCY
    return np.stack([(omega**2 + a) / b, 2 * DAMPING * omega / b], axis=1)


def evaluate(theta, gains):
    """Natural frequency [Hz] and damping (B, 2) of the sampled loop's slow poles, and stability."""
    poles = np.linalg.eigvals(loops(theta, *gains.T).A)
    order = np.argsort(-np.abs(poles), axis=1)
    poles = np.take_along_axis(poles, order, axis=1)
    s = np.log(poles[:, 0]) / TS
    metrics = np.stack([np.abs(s) / (2 * np.pi), -s.real / np.abs(s)], axis=1)
    return metrics, np.abs(poles[:, 0]) < 1


def loop(theta, gains):
    """A step of the reference by two degrees, for reports to draw."""
    given = np.full(200, 2.0)
    angle = simulated(loops(theta[None], *gains[:, None]), given)[0]
    title = "Step of the reference by 2 deg"
    response = Response(title, TS * np.arange(len(angle)), angle, setpoint=2.0, label="angle [deg]")
    return ClosedLoop((response,))


plant = Plant(
    prior={"a": (15.0, 30.0), "b": (12.0, 24.0)},
    simulate=simulate,
    design=design,
    evaluate=evaluate,
    loop=loop,
    gains=("kp", "kd"),
    metrics={"frequency [Hz]": 0.2, "damping": 0.1},
    u=prbs(N=2000, Ts=TS, bit_time=0.2, amplitude=np.radians(2.0))[0],
    Ts=TS,
    noise=np.radians(0.1),
    linear=True,
    in_loop=True,
    crossover=FREQUENCY,
    signals=("reference [rad]", "angle [rad]"),
    entry="pendulum:plant",
)
