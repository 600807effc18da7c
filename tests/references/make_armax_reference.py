"""Make ``armax_reference.npz``: ARMAX fits by pysib of episodes simulated with SciPy.

Nothing here comes from this repository's packages. To run it, in a separate environment (pysib
prints its progress on stdout, this script its own report on stderr)::

    python3 -m venv /tmp/pysibenv
    /tmp/pysibenv/bin/pip install pysib==0.2.5 numpy==2.4.6 scipy==1.17.1
    /tmp/pysibenv/bin/python tests/references/make_armax_reference.py > /dev/null

Notes
-----
*Data.* Ten episodes of 10 s from rest: a bicycle model with tyre relaxation and a second-order
actuator at 20 m/s, driven by the first 100 bits of an order-7 maximum-length sequence (+-1 degree,
0.1 s a bit), with an exact zero-order hold at 1 kHz. White Gaussian noise at 30 dB is added to the
yaw rate. ``y`` is rounded to float32, and the rounded numbers are the data.

*Model.* ``y[k] = -a1 y[k-1] - a2 y[k-2] + b1 u[k-1] + b2 u[k-2] + e[k] + c1 e[k-1] + c2 e[k-2]``,
at 1 kHz and on averages of ``u`` and ``y`` over blocks of 10 samples (100 Hz).

*Initial conditions.* pysib minimises the root mean square of ``e = (A y - B u) / C`` over all
samples, with ``u``, ``y`` and ``e`` zero before the first: its filters skip terms of negative
time, and no sample is left out. The costs stored are that mean square, by `lfilter`.

The file holds ``mu_s`` (10,), ``M_delta`` (10,) in kg, ``y`` (10, 10000) float32 in rad/s, the
string ``pysib_version``, and at each rate, * being 1khz or 100hz, ``theta_*`` (10, 6), ordered
a1, a2, b1, b2, c1, c2 for ``u`` in rad, and ``cost_*`` (10,) in (rad/s)^2.
"""

import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pysib
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, dlsim, lfilter, max_len_seq

EPISODES, RATE, BLOCK = 10, 1000, 10  # episodes; samples per second; samples averaged at 100 Hz


def vehicle(mu_s, M_delta):
    """Return A, B, C, D of the vehicle: states beta, r, a_f, a_r, z, d, input d_cmd, output r."""
    M, v, lf, lr, Jz, Lf, Lr = 1895 + M_delta, 20.0, 1.18, 1.53, 2400.0, 0.4, 0.8
    Cf, Cr, wn, xi = 124.9e3 * mu_s, 166e3 * mu_s, 2 * np.pi * 5, 0.9
    beta, r, a_f, a_r, z, d, d_cmd = np.eye(7)  # unit vectors turn the equations into [A B]
    rates = [
        -r - Cf * a_f / (M * v) - Cr * a_r / (M * v),
        (-lf * Cf * a_f + lr * Cr * a_r) / Jz,
        -(v / Lf) * (a_f - (-d + beta + lf * r / v)),
        -(v / Lr) * (a_r - (beta - lr * r / v)),
        -(wn**2) * d + wn**2 * d_cmd,
        z - 2 * xi * wn * d,
    ]
    return *np.split(np.stack(rates), [6], axis=1), np.eye(1, 6, 1), np.zeros((1, 1))


def errors(theta, u, y):
    """Return the one-step prediction errors from zero initial conditions."""
    a1, a2, b1, b2, c1, c2 = theta
    return lfilter([1, a1, a2], [1, c1, c2], y) - lfilter([0, b1, b2], [1, c1, c2], u)


def fit(u, y, label):
    """Return pysib's coefficients and cost; report the cost and what polishing would gain."""
    start = time.perf_counter()
    theta = pysib.armax(u, y, na=2, nb=2, nc=2, nz=1)[0]
    seconds = time.perf_counter() - start
    cost = np.mean(errors(theta, u, y) ** 2)
    tight = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-15)
    polished = least_squares(errors, theta, "3-point", x_scale="jac", args=(u, y), **tight)
    gain, root = 1 - np.mean(polished.fun**2) / cost, abs(np.roots([1, *theta[4:]])).max()
    report = f"{label}: {seconds:.1f} s, cost {cost:.9e}, C's largest root {root:.4f}"
    print(f"{report}, polishing lowers the cost by {gain:.0e} of it", file=sys.stderr)
    return theta, cost


def main():
    """Simulate, fit and save."""
    rng = np.random.default_rng(2024)
    mu_s, M_delta = rng.uniform(0.3, 1.1, EPISODES), rng.uniform(0, 300, EPISODES)
    u = np.deg2rad(2.0 * np.repeat(max_len_seq(7)[0][:100], 100) - 1)
    y = np.empty((EPISODES, u.size), np.float32)
    fits = {"1khz": [], "100hz": []}
    for i in range(EPISODES):
        r = dlsim(cont2discrete(vehicle(mu_s[i], M_delta[i]), 1 / RATE), u)[1][:, 0]
        variance = np.mean(r**2) / 1000
        y[i] = r + np.sqrt(variance) * rng.standard_normal(u.size)
        print(f"{i} mu_s {mu_s[i]:.4f}, noise variance {variance:.6e}", file=sys.stderr)
        data = np.stack([u, y[i].astype(float)])
        fits["1khz"].append(fit(*data, "  1 kHz "))
        fits["100hz"].append(fit(*data.reshape(2, -1, BLOCK).mean(axis=2), "  100 Hz"))
    arrays = {f"theta_{rate}": np.stack([f[0] for f in fits[rate]]) for rate in fits}
    arrays |= {f"cost_{rate}": np.array([f[1] for f in fits[rate]]) for rate in fits}
    arrays |= {"mu_s": mu_s, "M_delta": M_delta, "y": y, "pysib_version": version("pysib")}
    np.savez_compressed(Path(__file__).with_name("armax_reference.npz"), **arrays)


if __name__ == "__main__":
    main()
