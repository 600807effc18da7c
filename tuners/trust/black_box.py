"""The reference model: a black box fitted to the recording, with its initial state and offsets.

The output of a plant that does not start from rest contains its free response, and offsets of
either channel add a constant to it.  For a linear plant both are linear in their unknowns, so
one least-squares fit of the output on

    the input through many Laguerre functions,   their free responses,   a constant

separates them without knowing the plant, and they are subtracted for every tuner.  The last two
cost information, so they are left out where an F test finds that the recording starts from rest.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre, lifted
from tuners.features.regularised import Regularised, regularised
from yawrate_env import validation
from yawrate_env.plant.episodes import sample
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]

STARTS = ("auto", "rest", "unknown")
ORDERS = (16, 24, 32)

_PLANTS, _MORE_PLANTS, _MOST_PLANTS, _POLES = 16, 64, 512, 25
_SEED = 21
_HIDDEN = 4.0  # of the noise's variance, where a start has some twenty unknowns
_SAMPLES = 10  # for each function, at least
_SIGNIFICANT = 4.0  # standard deviations of the statistic under rest
_LARGEST_KEPT = 20_000  # samples: 3 MB
_NEGLIGIBLE = 3e-6  # of the output's energy: the functions themselves may leave out as much


@dataclass(frozen=True, slots=True, eq=False)
class BlackBox:
    """Laguerre models of B recordings, without use of the simulator.

    Attributes
    ----------
    functions : Laguerre
        The model's.
    u : NDArray
        (1, N) or (B, N) inputs.
    y : NDArray
        (B, N) outputs, without the effect of initial state and offsets where that was found.
    Ts : float
        Sampling time [s].
    oversampled : float
        Samples for each independent one.
    unknown : NDArray
        (B,) whether start and offsets were estimated.
    free : NDArray
        (B, N) what was subtracted: free response and offset.
    offset : NDArray
        (B,) constant part of the output.
    coefficients : NDArray
        (B, n) on the functions.
    information : NDArray
        (B or 1, n, n) inverse of their covariance for noise of variance one.
    residual : NDArray
        (B,) sum of squares that is left.
    """

    functions: Laguerre
    u: Array
    y: Array
    Ts: float
    oversampled: float
    unknown: NDArray[np.bool_]
    free: Array
    offset: Array
    coefficients: Array
    information: Array
    residual: Array


def functions_for(plant: Plant) -> Laguerre:
    """Laguerre basis of the reference model; chosen automatically if the plant names none.

    For a linear plant the basis grows until its truncation error is hidden by the noise: a free
    response would explain the rest, and a recording from rest would look like a start in motion.
    """
    if plant.black_box is not None:
        order, pole = plant.black_box
        return Laguerre(order, pole)
    for order in ORDERS:
        functions = suited(plant, min(order, len(plant.u) // _SAMPLES))
        if not plant.linear or functions.order < order or _hidden(plant, functions):
            break
    return functions


def _hidden(plant: Plant, functions: Laguerre) -> bool:
    """Whether noise hides the part of clean outputs that free responses would explain."""
    y = plant.respond(sample(plant, _MORE_PLANTS))
    fits = (black_box(plant, functions, plant.u[None], y, start) for start in ("rest", "unknown"))
    rest, moving = (fit.residual for fit in fits)
    return bool((rest - moving <= _HIDDEN * plant.sigma(y) ** 2).all())


def suited(plant: Plant, order: int) -> Laguerre:
    """Laguerre basis with the pole that explains the prior's noise-free outputs best."""
    y = plant.respond(sample(plant, _PLANTS))
    energy = (y**2).sum(axis=1)
    slowest, fastest = 2 / (len(plant.u) * plant.Ts), 1 / plant.Ts
    models = [Laguerre(order, float(pole)) for pole in np.geomspace(slowest, fastest, _POLES)]
    fits = (black_box(plant, model, plant.u[None], y, "rest") for model in models)
    left = [(fit.residual / energy).mean() for fit in fits]
    return models[int(np.argmin(left))]


def suited_to_any_input(plant: Plant, order: int) -> Regularised:
    """The same basis, regularised by the coefficients of simulated plants, for any input."""
    functions = suited(plant, order)
    u = plant.inputs(stream(_SEED, 0, _MOST_PLANTS, 1)[:, 0])
    y = plant.respond(sample(plant, _MOST_PLANTS), u)
    equations = functions.normal_equations(u, y, plant.Ts, np.empty((0, y.shape[1])))
    return regularised(functions, *equations, plant.sigma(y) ** 2)


def free_responses(functions: Laguerre, N: int, Ts: float) -> tuple[Array, float]:
    """Free responses and a constant, as orthonormal signals.

    Returns
    -------
    signals : (n + 1, N) float64
        They span the decays of the basis' states; the last completes them by a constant.
    constant : float
        Constant whose coefficient on the last signal is one.
    """
    return (_kept if N <= _LARGEST_KEPT else _free_responses)(functions, N, Ts)


def _free_responses(functions: Laguerre, N: int, Ts: float) -> tuple[Array, float]:
    impulse = np.zeros((1, N + 1))
    impulse[0, 0] = 1.0
    decays = functions.regressors(impulse, Ts)[0, :, 1:]
    Q, R = np.linalg.qr(np.concatenate([decays, np.ones((1, N))]).T)
    return np.ascontiguousarray(Q.T), float(1 / R[-1, -1])


_kept = lru_cache(maxsize=4)(_free_responses)


def black_box(
    plant: Plant, functions: Laguerre, u: Array, y: Array, start: str, oversampled: float = 1.0
) -> BlackBox:
    """Fit recordings (1 or B, N), (B, N) and subtract the effect of initial state and offsets.

    Parameters
    ----------
    start : {"auto", "rest", "unknown"}
        Whether recordings start from rest without offsets; decided by the data if "auto".  For a
        nonlinear plant the data cannot decide, and rest is assumed.
    """
    validation.one_of("start", start, STARTS)
    start = "rest" if start == "auto" and not plant.linear else start
    n, N, Ts = functions.order, y.shape[1], plant.Ts
    if N < _SAMPLES * n:
        raise ValueError(
            f"{N} samples are too few, at least {_SAMPLES * n} are needed. Record for longer."
        )
    Z, constant = (np.empty((0, N)), 0.0) if start == "rest" else free_responses(functions, N, Ts)
    gram, right = functions.normal_equations(u, y, Ts, Z)
    G, P, b, d = gram[:, :n, :n], gram[:, :n, n:], right[:, :n], right[:, n:]
    energy = np.einsum("bn,bn->b", y, y)

    G = lifted(G)
    rest = _solve(G, b)
    residual_rest = energy - _inner(b, rest)
    information = lifted(G - P @ P.transpose(0, 2, 1))
    moving = _solve(information, b - (P @ d[..., None])[..., 0])
    z = d - (P.transpose(0, 2, 1) @ moving[..., None])[..., 0]
    residual_moving = energy - _inner(b, moving) - _inner(d, z)

    unknown = np.full(len(y), start == "unknown")
    if start == "auto":
        independent = (N - len(gram[0])) / oversampled
        with np.errstate(divide="ignore", invalid="ignore"):  # an output of zeros
            statistic = (residual_rest / residual_moving - 1) * independent
        unknown = statistic > len(Z) + _SIGNIFICANT * np.sqrt(2 * len(Z))
        unknown &= residual_rest - residual_moving > _NEGLIGIBLE * energy
    free = np.where(unknown[:, None], z @ Z, 0.0)
    return BlackBox(
        functions,
        u,
        y - free,
        Ts,
        oversampled,
        unknown,
        free,
        np.where(unknown, z[:, -1:].sum(axis=1) * constant, 0.0),
        np.where(unknown[:, None], moving, rest),
        np.where(unknown[:, None, None], information, G),
        np.where(unknown, residual_moving, residual_rest),
    )


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


def _inner(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=1))
