"""Two tanks in series: a PI level loop for a nonlinear process with unknown outlets.

    python scripts/compare_plant.py examples/plants/two_tanks.py

Water is pumped into the upper tank, runs through its outlet into the lower one, and
through that one's outlet away (Torricelli's law, flow a sqrt(2 g h)).  The outlets' areas and
the pump's gain are unknown.  The tanks are filled from empty, by a switched pump, and a
trained tuner reads the gains of the level loop off the lower tank's level.  `plant_at_work` is for
recordings of tanks at work, which begin at levels that are unknown, too.
"""

from math import sqrt

import numpy as np
from numba import njit

from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import ClosedLoop, Response
from yawrate_env.signals.excitation import prbs

AREA, G = 30.0, 981.0  # cross sections [cm2], gravity [cm/s2]
LEVEL, RISE = 10.0, 2.0  # lower tank, where the loop shall work, and be evaluated by a step [cm]
TS, N = 2.0, 600
TAU_C = 20.0  # wanted time constant of the closed loop [s]
SIGNALS = "pump [V]", "lower level [cm]"


@njit
def rates(h1, h2, inflow, a1, a2):
    """Of both levels [cm/s]."""
    between, out = a1 * sqrt(2 * G * max(h1, 0.0)), a2 * sqrt(2 * G * max(h2, 0.0))
    return (inflow - between) / AREA, (between - out) / AREA


@njit
def step(h1, h2, inflow, a1, a2):
    """Levels one sample later, by two Runge-Kutta steps."""
    dt = TS / 2
    for _ in range(2):
        k1, l1 = rates(h1, h2, inflow, a1, a2)
        k2, l2 = rates(h1 + dt / 2 * k1, h2 + dt / 2 * l1, inflow, a1, a2)
        k3, l3 = rates(h1 + dt / 2 * k2, h2 + dt / 2 * l2, inflow, a1, a2)
        k4, l4 = rates(h1 + dt * k3, h2 + dt * l3, inflow, a1, a2)
        h1 = max(h1 + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4), 0.0)
        h2 = max(h2 + dt / 6 * (l1 + 2 * l2 + 2 * l3 + l4), 0.0)
    return h1, h2


@njit
def simulate(theta, u, rng):
    """Level of the lower tank [cm] at each sample of pump voltage [V].

    Tanks (a1, a2, pump) are empty at first; of (a1, a2, pump, h1, h2) the levels are given.
    """
    y = np.empty((len(theta), len(u)))
    for i in range(len(theta)):
        a1, a2, pump = theta[i, 0], theta[i, 1], theta[i, 2]
        h1 = h2 = 0.0
        if theta.shape[1] > 3:
            h1, h2 = theta[i, 3], theta[i, 4]
        for k, volts in enumerate(u):
            y[i, k] = h2
            h1, h2 = step(h1, h2, pump * volts, a1, a2)
    return y


def design(theta):
    """SIMC rule (Skogestad, 2003) for the process linearised at the wanted level.

    Two lags T1 > T2 count as one of T1 + T2/2 with a delay of T2/2 (the half rule).
    """
    a1, a2, pump = theta.T[:3]
    h = np.stack([LEVEL * (a2 / a1) ** 2, np.full_like(a1, LEVEL)])
    lags = AREA / np.stack([a1, a2]) * np.sqrt(2 * h / G)
    T1, T2 = lags.max(axis=0), lags.min(axis=0)
    gain = pump * lags[1] / AREA  # cm a volt: every inflow leaves through the second outlet
    lag, delay = T1 + T2 / 2, T2 / 2
    kp = lag / (gain * (TAU_C + delay))
    return np.stack([kp, np.minimum(lag, 4 * (TAU_C + delay))], axis=1)


@njit
def raised(theta, gains):
    """Lower level [cm] and pump voltage [V] as the loop raises the level by `RISE`, one plant's."""
    (a1, a2, pump), (kp, Ti) = theta[:3], gains
    level, volts = np.empty(150), np.empty(150)
    h1, h2, integral = LEVEL * (a2 / a1) ** 2, LEVEL, a2 * sqrt(2 * G * LEVEL) / pump
    for k in range(len(level)):
        e = LEVEL + RISE - h2
        level[k], volts[k] = h2, min(max(kp * e + integral, 0.0), 12.0)
        integral += kp * TS / Ti * e
        h1, h2 = step(h1, h2, pump * volts[k], a1, a2)
    return level, volts


@njit
def evaluate(theta, gains):
    """Rise time [s] and integrated error [cm s] after that step, with the nonlinear tanks."""
    metrics = np.empty((len(theta), 2))
    for i in range(len(theta)):
        level, _ = raised(theta[i], gains[i])
        before, rise, area = RISE, np.inf, 0.0
        for k, h2 in enumerate(level):
            e = LEVEL + RISE - h2
            if e < 0.1 * RISE and rise == np.inf:  # passed 90 % since the sample before
                rise = TS * (k - (0.1 * RISE - e) / (before - e))
            before, area = e, area + TS * abs(e)
        metrics[i] = rise, area
    return metrics


def loop(theta, gains):
    """That step, for reports to draw."""
    level, volts = raised(theta, gains)
    t = TS * np.arange(len(level))
    return ClosedLoop(
        (
            Response(f"Step of the level by {RISE:g} cm", t, level, setpoint=LEVEL + RISE),
            Response("What the pump does for it", t, volts, label=SIGNALS[0]),
        )
    )


TANKS = {"a1": (0.3, 0.5), "a2": (0.3, 0.5), "pump": (8.0, 12.0)}  # cm2, cm2, cm3/(s V)


def described(entry, **changes):
    """The tanks as a plant, whatever level they begin at."""
    settings = {
        "prior": TANKS,
        "simulate": simulate,
        "design": design,
        "evaluate": evaluate,
        "gains": ("kp", "Ti"),
        "metrics": {"rise_time [s]": 5.0, "integrated_error [cm s]": 5.0},
        "u": 5.0 + prbs(N, TS, bit_time=40.0, amplitude=2.0)[0],
        "Ts": TS,
        "noise": 0.1,  # cm
        "signals": SIGNALS,
        "loop": loop,
        "entry": entry,
    }
    return Plant(**(settings | changes))


plant = described("two_tanks:plant")
plant_at_work = described(
    "two_tanks:plant_at_work",
    prior={**TANKS, "h1": (0.0, 25.0), "h2": (0.0, 25.0)},  # cm
    initial=("h1", "h2"),
)
