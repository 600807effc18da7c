"""A distillation column with two PI loops: two inputs, two outputs, and each acts on both.

    python scripts/channels.py examples/plants/wood_berry.py

Reflux and steam of a column that separates methanol from water move the compositions at its top and
bottom (Wood and Berry, Chemical Engineering Science 28, 1973),

    top    = 12.8 e^(-1 s)/(16.7 s + 1) reflux - 18.9 e^(-3 s)/(21.0 s + 1) steam
    bottom =  6.6 e^(-7 s)/(10.9 s + 1) reflux - 19.4 e^(-3 s)/(14.4 s + 1) steam,

time in minutes.  Here gains are known to 15 % and lags to 20 %, dead times exactly; both inputs are
switched at the same time, by sequences that do not repeat each other.  The rule is the "biggest
log-modulus tuning" (Luyben, Industrial & Engineering Chemistry Process Design and Development 25,
1986): Ziegler and Nichols' settings of each loop alone, gains divided and integral times multiplied
by one factor F, so that the closed loops together, with L = -1 + det(I + G C), have a largest
|L/(1 + L)| of 4 dB.  Steam lowers both compositions: kp_bottom is negative.
"""

import numpy as np

from yawrate_env.loop.dead_time import respond, zoh_late
from yawrate_env.plant import Metric, Plant
from yawrate_env.plant.parametrisation import of_gains
from yawrate_env.plant.responses import ClosedLoop, Response
from yawrate_env.signals.excitation import prbs

TS = 30.0  # s
GAINS = np.array([[12.8, -18.9], [6.6, -19.4]])  # % over lb/min
LAGS = 60 * np.array([[16.7, 21.0], [10.9, 14.4]])  # s
LATE = 60 * np.array([[1.0, 3.0], [7.0, 3.0]])  # s
WANTED = 4.0  # dB
NAMES = ("11", "12", "21", "22")

_OMEGA = np.geomspace(0.003, 0.9, 160) / 60  # rad/s, of which the loops' peak is one
_NYQUIST = np.geomspace(1e-4, np.pi / TS * 0.999, 400)
_TWO = prbs(2000, TS, 300.0, 1.0, order=9)[0]
INPUTS = 0.05 * np.stack([_TWO[:1000], _TWO[1000:]])  # lb/min, reflux and steam


def parts(theta):
    """Gains and lags (B, 2, 2) of parameters (B, 8)."""
    return theta[:, :4].reshape(-1, 2, 2), theta[:, 4:].reshape(-1, 2, 2)


def simulate(theta, u, rng):
    """Compositions (B, 2, N) for reflux and steam, (2, N) or (B, 2, N)."""
    K, T = parts(theta)

    def channel(i, j):
        k, t, late = K[:, i, j], T[:, i, j], np.full(len(theta), LATE[i, j])
        plant = zoh_late(-1 / t[:, None, None], (k / t)[:, None], np.ones(1), TS, late)
        return respond(plant, u[..., j, :])

    return np.stack([channel(i, 0) + channel(i, 1) for i in range(2)], axis=1)


def response(theta, omega):
    """Responses (B, 2, 2, F) of the sampled column, its inputs held."""
    K, T = (each[..., None] for each in parts(theta))
    z, a = np.exp(1j * omega * TS), np.exp(-TS / T)
    return K * (1 - a) / (z - a) * z ** -np.round(LATE[..., None] / TS)


def modulus(G, gains, omega):
    """L (B, F) of both loops together, with sampled PI controllers of gains (B, 4)."""
    one, other = (
        gains[:, i, None] * (1 + TS / (2j * gains[:, i + 1, None] * np.tan(omega * TS / 2)))
        for i in (0, 2)
    )
    across = G[:, 0, 0] * G[:, 1, 1] - G[:, 0, 1] * G[:, 1, 0]
    return G[:, 0, 0] * one + G[:, 1, 1] * other + across * one * other


def largest(L):
    """Largest |L/(1 + L)| (B,) in dB."""
    return 20 * np.log10(np.abs(L / (1 + L)).max(axis=1))


def ultimate(K, T, late):
    """Gains and periods (B,) with which lags behind a dead time oscillate under P control."""
    low, high = np.full_like(T, 1e-9), np.pi / late + np.zeros_like(T)
    for _ in range(60):
        omega = (low + high) / 2
        below = omega * late + np.arctan(omega * T) < np.pi
        low, high = np.where(below, omega, low), np.where(below, high, omega)
    return np.sqrt(1 + (omega * T) ** 2) / K, 2 * np.pi / omega


def design(theta):
    """(kp, Ti) of both loops (B, 4) by biggest log-modulus tuning."""
    K, T = parts(theta)
    settings = []
    for i in range(2):
        gain, period = ultimate(K[:, i, i], T[:, i, i], LATE[i, i] + TS / 2)
        settings += [gain / 2.2, period / 1.2]
    G = response(theta, _OMEGA)
    low, high = np.zeros(len(theta)), np.full(len(theta), np.log(20.0))
    for _ in range(30):
        middle = (low + high) / 2
        gains = detuned(settings, np.exp(middle))
        tame = largest(modulus(G, gains, _OMEGA)) < WANTED
        low, high = np.where(tame, low, middle), np.where(tame, middle, high)
    return detuned(settings, np.exp(high))


def detuned(settings, F):
    """Gains divided and integral times multiplied by F (B,)."""
    return np.stack([each * F if i % 2 else each / F for i, each in enumerate(settings)], axis=1)


def evaluate(theta, gains):
    """Largest log modulus [dB], integrated errors of set-point steps [min], and stability."""
    K, _ = parts(theta)
    peak = largest(modulus(response(theta, _OMEGA), gains, _OMEGA))
    inverse = np.linalg.inv(K)
    errors = [gains[:, 2 * i + 1] / gains[:, 2 * i] * inverse[:, i, i] / 60 for i in range(2)]
    return np.stack([peak, *errors], axis=1), stable(theta, gains)


def stable(theta, gains):
    """By Nyquist's criterion for 1 + L, whose two integrators turn it by half a turn (B,)."""
    turned = 1 + modulus(response(theta, _NYQUIST), gains, _NYQUIST)
    angle = np.unwrap(np.angle(turned), axis=1)
    return np.abs(angle[:, -1] - angle[:, 0] - np.pi) < np.pi / 2


def stepped(theta, gains, setpoints, N=360):
    """Compositions and inputs (2, N) of the closed loops (8,), (4,) after steps of set points."""
    K, T = parts(theta[None])
    a, late = np.exp(-TS / T[0]), np.round(LATE / TS).astype(int)
    y, u, x = np.zeros((2, N)), np.zeros((2, N)), np.zeros((2, 2))
    kp, Ti = gains[::2], gains[1::2]
    integral, before = np.zeros(2), np.zeros(2)
    for k in range(N):
        y[:, k] = x.sum(axis=1)
        error = np.asarray(setpoints) - y[:, k]
        integral += TS / 2 * (error + before) if k else TS / 2 * error
        before = error
        u[:, k] = kp * (error + integral / Ti)
        held = np.array([[u[j, k - late[i, j]] if k >= late[i, j] else 0.0 for j in range(2)]
                         for i in range(2)])  # fmt: skip
        x = a * x + K[0] * (1 - a) * held
    return y, u


def loop(theta, gains):
    """Compositions after a step of the top's set point, then of the bottom's."""
    t, responses = TS * np.arange(360), []
    for setpoints, which in (((1.0, 0.0), "top"), ((0.0, 1.0), "bottom")):
        y, _ = stepped(theta, gains, setpoints)
        title = f"Step of the {which}'s set point by 1 %"
        for row, wanted, name in zip(y, setpoints, ("top [%]", "bottom [%]"), strict=True):
            responses.append(Response(title, t, row, setpoint=wanted, label=name))
    return ClosedLoop(tuple(responses))


def around(values, share):
    """Ranges of a share below and above, by channel."""
    return [tuple(sorted(((1 - share) * v, (1 + share) * v))) for v in values.ravel().tolist()]


plant = Plant(
    prior={
        **{f"K{name}": ends for name, ends in zip(NAMES, around(GAINS, 0.15), strict=True)},
        **{f"T{name} [s]": ends for name, ends in zip(NAMES, around(LAGS, 0.2), strict=True)},
    },
    simulate=simulate,
    design=design,
    evaluate=evaluate,
    loop=loop,
    gains=("kp_top", "Ti_top", "kp_bottom", "Ti_bottom"),
    metrics={
        "log_modulus [dB]": Metric(2.0),
        "top_error [min]": Metric(np.inf),  # follow from the plant's gains; no rule sets them
        "bottom_error [min]": Metric(np.inf),
    },
    parametrisation=of_gains(("log",) * 4, (1, 1, -1, 1)),
    u=INPUTS,
    Ts=TS,
    noise=(0.05, 0.05),
    linear=True,
    channels=(("reflux [lb/min]", "steam [lb/min]"), ("top [%]", "bottom [%]")),
    entry="wood_berry:plant",
)
