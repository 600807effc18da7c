"""Two tanks in series: a PI level loop for a nonlinear process with unknown outlets.

    python examples/plants/two_tanks.py

Water is pumped into the upper tank, runs through its outlet into the lower one, and
through that one's outlet away (Torricelli's law, flow a sqrt(2 g h)).  The outlets' areas and
the pump's gain are unknown.  The tanks are filled from empty, by a switched pump, and a
trained tuner reads the gains of the level loop off the lower tank's level.
"""

import numpy as np

from tuners import plants
from yawrate_env.excitation import prbs

AREA, G = 30.0, 981.0  # cross sections [cm2], gravity [cm/s2]
LEVEL = 10.0  # lower tank, where the loop shall work [cm]
TS, N = 2.0, 600
TAU_C = 20.0  # wanted time constant of the closed loop [s]


def tanks(h, q, theta):
    """Rates of both levels (2, B) [cm/s] for the pump's inflow q [cm3/s]."""
    a1, a2, _ = theta.T
    between, out = np.stack([a1, a2]) * np.sqrt(2 * G * np.maximum(h, 0.0))
    return np.stack([q - between, between - out]) / AREA


def step(h, q, theta):
    """Levels one sample later, by two Runge-Kutta steps."""
    dt = TS / 2
    for _ in range(2):
        k1 = tanks(h, q, theta)
        k2 = tanks(h + dt / 2 * k1, q, theta)
        k3 = tanks(h + dt / 2 * k2, q, theta)
        k4 = tanks(h + dt * k3, q, theta)
        h = np.maximum(h + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4), 0.0)
    return h


def simulate(theta, u, rng):
    """Level of the lower tank [cm] after each sample of pump voltage [V]."""
    h, y = np.zeros((2, len(theta))), np.empty((len(theta), len(u)))
    for k, volts in enumerate(u):
        y[:, k] = h[1]
        h = step(h, theta[:, 2] * volts, theta)
    return y


def design(theta):
    """SIMC rule (Skogestad, 2003) for the process linearised at the wanted level.

    Two lags T1 > T2 count as one of T1 + T2/2 with a delay of T2/2 (the half rule).
    """
    a1, a2, pump = theta.T
    h = np.stack([LEVEL * (a2 / a1) ** 2, np.full_like(a1, LEVEL)])
    lags = AREA / np.stack([a1, a2]) * np.sqrt(2 * h / G)
    T1, T2 = lags.max(axis=0), lags.min(axis=0)
    gain = pump * lags[1] / AREA  # cm a volt: every inflow leaves through the second outlet
    lag, delay = T1 + T2 / 2, T2 / 2
    kp = lag / (gain * (TAU_C + delay))
    return np.stack([kp, np.minimum(lag, 4 * (TAU_C + delay))], axis=1)


def judge(theta, gains):
    """Rise time [s] and integrated error [cm s] after a step of 2 cm, with the nonlinear tanks."""
    a1, a2, pump = theta.T
    kp, Ti = gains.T
    h = np.stack([LEVEL * (a2 / a1) ** 2, np.full_like(a1, LEVEL)])
    integral = a2 * np.sqrt(2 * G * LEVEL) / pump
    errors = []
    for _ in range(150):
        e = LEVEL + 2.0 - h[1]
        volts = kp * e + integral
        integral = integral + kp * TS / Ti * e
        h = step(h, pump * np.clip(volts, 0.0, 12.0), theta)
        errors.append(e)
    errors = np.array(errors)
    return np.stack([fall_time(errors, 0.2), TS * np.abs(errors).sum(axis=0)], axis=1)


def fall_time(e, below):
    """When errors (K, B) first fall below a value, between samples [s]."""
    k = np.maximum((e < below).argmax(axis=0), 1)
    before, after = (np.take_along_axis(e, i[None], 0)[0] for i in (k - 1, k))
    return TS * (k - 1 + (before - below) / (before - after))


plant = plants.Plant(
    prior={"a1": (0.3, 0.5), "a2": (0.3, 0.5), "pump": (8.0, 12.0)},  # cm2, cm2, cm3/(s V)
    simulate=simulate,
    design=design,
    judge=judge,
    gains=("kp", "Ti"),
    figures={"rise time [s]": 5.0, "integrated error [cm s]": 5.0},
    u=5.0 + prbs(N, TS, bit_time=40.0, amplitude=2.0)[0],
    Ts=TS,
    noise=0.1,  # cm
    signals=("pump [V]", "lower level [cm]"),
    entry="two_tanks:plant",
)

if __name__ == "__main__":
    from tuners.plants.report import main

    main(plant)
