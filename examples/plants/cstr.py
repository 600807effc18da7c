"""A stirred-tank reactor with an exothermic reaction: nonlinear, recorded at its operating point.

    python scripts/compare_plant.py examples/plants/cstr.py

A feeds a tank of 100 l and reacts, k = k0 e^(-8750 K/T); a jacket takes the heat away (Seborg,
Edgar, Mellichamp and Doyle, Process Dynamics and Control, 2016, example 2.5),

    dc/dt = (c_in - c) q/V - k c
    dT/dt = (T_in - T) q/V + H k c + a (T_jacket - T).

The catalyst's activity and the jacket's heat transfer are known to a fifth.  Operators hold the
tank at 325 K; the experiment moves the jacket from there by up to 2 K, in four levels, since two
would not show that heat speeds the reaction up by more than cold slows it down.  The rule is loop
shaping for the linearised reactor; overshoot and rise time are those of a step of 3 K with the
nonlinear one.
"""

import numpy as np
from numba import njit

from yawrate_env.loop.design import design_from_response
from yawrate_env.loop.target import Target
from yawrate_env.plant import Metric, Plant
from yawrate_env.plant.responses import ClosedLoop, Response
from yawrate_env.signals.excitation import multilevel

TS, N = 6.0, 600  # s
FLOW, IN, FEED = 1.0 / 60, 350.0, 1.0  # 1/s, K, mol/l
HEAT, RATE, ENERGY = 5e4 / 239, 7.2e10 / 60, 8750.0  # K l/mol, 1/s, K
JACKET = 5e4 / (100 * 239) / 60  # 1/s
POINT, RISE = 325.0, 3.0  # K
TARGET = Target(phase_margin=60.0, crossover=1.5 / 60 / (2 * np.pi), Ts=TS, delay_samples=1)


@njit(cache=True)
def speed(activity, T):
    """Of the reaction [1/s]; beyond 380 K, where feed runs out, no faster."""
    return activity * RATE * np.exp(-ENERGY / min(T, 380.0))


@njit(cache=True)
def held(activity, transfer):
    """Concentration and jacket temperature with which the tank rests at its operating point."""
    c = FLOW * FEED / (FLOW + speed(activity, POINT))
    away = FLOW * (IN - POINT) + HEAT * speed(activity, POINT) * c
    return c, POINT - away / (transfer * JACKET)


@njit(cache=True)
def moved(c, T, jacket, activity, transfer):
    """Concentration and temperature a sample later, by Runge and Kutta's steps."""
    dt = TS / 2
    for _ in range(2):
        ks, ls, x, z = np.zeros(4), np.zeros(4), c, T
        for i in range(4):
            k = speed(activity, z) * x
            ks[i] = FLOW * (FEED - x) - k
            ls[i] = FLOW * (IN - z) + HEAT * k + transfer * JACKET * (jacket - z)
            part = dt if i == 2 else dt / 2
            x, z = c + part * ks[i], T + part * ls[i]
        c += dt / 6 * (ks[0] + 2 * ks[1] + 2 * ks[2] + ks[3])
        T += dt / 6 * (ls[0] + 2 * ls[1] + 2 * ls[2] + ls[3])
    return c, T


@njit(cache=True)
def simulate(theta, u, rng):
    """Temperatures (B, N) above the operating point for those of the jacket above its own (N,)."""
    y = np.empty((len(theta), len(u)))
    for i in range(len(theta)):
        activity, transfer = theta[i]
        (c, jacket), T = held(activity, transfer), POINT
        for k in range(len(u)):
            y[i, k] = T - POINT
            c, T = moved(c, T, jacket + u[k], activity, transfer)
    return y


def response(theta, omega):
    """Response (B,) of the linearised reactor at a frequency [rad/s], its input held."""
    activity, transfer = theta.T
    k = activity * RATE * np.exp(-ENERGY / POINT)
    c = FLOW * FEED / (FLOW + k)
    slope, a = k * c * ENERGY / POINT**2, transfer * JACKET
    s = 1j * omega
    own = s + FLOW + k
    G = a * own / (own * (s + FLOW + a - HEAT * slope) + slope * HEAT * k)
    return G * -np.expm1(-s * TS) / (s * TS)


def design(theta):
    """(kp, Ti) (B, 2) by loop shaping, and whether they reach the target."""
    G = response(theta, TARGET.omega_c)
    lag = TARGET.delay_samples * TS * TARGET.omega_c
    phase = np.radians(TARGET.phase_margin) - np.pi - np.angle(G) + lag
    found = design_from_response(-np.log(np.abs(G)), phase, TARGET)
    return np.stack([found.kp, found.Ti], axis=1), found.status == 0


@njit(cache=True)
def stepped(theta, gains, N):
    """Temperature and jacket (N,) above the operating point, after a step by `RISE`."""
    activity, transfer = theta
    kp, Ti = gains
    (c, jacket), T = held(activity, transfer), POINT
    y, u, integral, last = np.empty(N), np.empty(N), 0.0, 0.0
    for k in range(N):
        y[k] = T - POINT
        e = RISE - y[k]
        now = kp * (e + integral / Ti)
        integral += TS * e
        u[k] = min(max(last, -40.0), 40.0)
        last = now
        c, T = moved(c, T, jacket + u[k], activity, transfer)
    return y, u


@njit(cache=True)
def evaluate(theta, gains):
    """Overshoot [%] and rise time [s] (B, 2) of that step, with the nonlinear reactor."""
    metrics = np.empty((len(theta), 2))
    for i in range(len(theta)):
        y, _ = stepped(theta[i], gains[i], 150)
        rise = np.inf
        for k in range(1, len(y)):
            if y[k] >= 0.9 * RISE and rise == np.inf:
                rise = TS * (k - (y[k] - 0.9 * RISE) / (y[k] - y[k - 1]))
        metrics[i] = 100 * (y.max() / RISE - 1), rise
    return metrics


def loop(theta, gains):
    """The step, for reports to draw."""
    (y, u), t = stepped(theta, gains, 150), TS * np.arange(150)
    return ClosedLoop((
        Response(f"Step of the temperature by {RISE:g} K", t, y, setpoint=RISE),
        Response("What the jacket does for it", t, u, label="jacket [K]"),
    ))  # fmt: skip


plant = Plant(
    prior={"activity": (0.75, 1.15), "transfer": (0.85, 1.25)},
    simulate=simulate,
    design=design,
    evaluate=evaluate,
    loop=loop,
    gains=("kp", "Ti"),
    metrics={"overshoot [%]": Metric(8.0), "rise_time [s]": Metric(10.0)},
    u=multilevel(N, TS, 120.0, 2.0, 4)[0],
    Ts=TS,
    noise=0.1,
    signals=("jacket [K]", "temperature [K]"),
    entry="cstr:plant",
)
