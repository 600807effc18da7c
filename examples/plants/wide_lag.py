"""A lag of which little is known: gains over two decades, time constants over one and a half.

    python scripts/process_plants.py --plant examples/plants/wide_lag.py --corners 400

G(s) = K/(T s + 1), sampled every 20 ms.  The rule cancels the lag, and the loop becomes 1/(0.3 s).
Logarithms of both parameters are uniform: small values are as frequent as large ones.
"""

import numpy as np
from scipy.signal import lfilter

from yawrate_env.plant import LogRange, Plant
from yawrate_env.signals.excitation import prbs

TS, LOOP = 0.02, 0.3  # s


def simulate(theta, u, rng):
    """Output (N,) of one plant (2,)."""
    K, T = theta
    a = np.exp(-TS / T)
    return lfilter([0, K * (1 - a)], [1, -a], u)


def design(theta):
    """Gains of a PI that cancels the lag."""
    K, T = theta
    return T / (LOOP * K), T


plant = Plant(
    prior={"K": LogRange(0.1, 10.0), "T": LogRange(0.05, 2.0)},
    simulate=simulate,
    design=design,
    gains=("kp", "Ti"),
    batched=False,
    u=prbs(N=500, Ts=TS, bit_time=0.5, amplitude=1.0)[0],
    Ts=TS,
    noise=0.02,
    labels={"T": "T [s]"},
    entry="wide_lag:plant",
)
