"""The reference model: a black box fitted to the recording, with its initial state and offsets.

The output of a plant that does not start from rest contains its free response, and offsets of
either channel add a constant to it.  For a linear plant both are linear in their unknowns, so
one least-squares fit of the output on

    the input through many Laguerre functions,   a constant,   a trend,   their free responses

separates them without knowing the plant, and they are subtracted for every tuner.  All but the
first cost information, so F tests decide how many of them a recording needs: none from rest, the
constant at an operating point, the trend where a sensor drifts, all of them in motion.  The output
of a plant with an integrator drifts under a load, and bends where the load changes; between the
trend and the free responses it may bend at a few times that are always the same.
"""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.features.integrated import Integrated
from tuners.features.laguerre import Laguerre, combined, lifted, products
from tuners.features.regularised import Regularised, regularised
from tuners.trust.octaves import along, energies
from yawrate_env import validation
from yawrate_env.plant.episodes import sample
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]

STARTS = ("auto", "rest", "offset", "unknown")
ORDERS = (16, 24, 32)

SAMPLES = 10
"""For each function, at least."""

_PLANTS, _MORE_PLANTS, _MOST_PLANTS, _POLES = 16, 64, 512, 25
_SEED = 21
_HIDDEN = 4.0  # of the noise's variance, where a start has some twenty unknowns
_RARE = 3.72  # standard deviations of a normal number: beyond it is one in 10 000
_SIGNIFICANT = 4.0  # standard deviations of the statistic under rest
_SHARES = (4, 2, 1)  # of the functions: an n-th of the decays is tried first
_DECIDED = 1000.0  # times what is significant in white noise: no colour explains it
_LARGEST_KEPT = 20_000  # samples: 3 MB
_TOGETHER = 16  # recordings
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
    extra : NDArray
        (B,) how many of the signals of `free_responses` were estimated: 0 from rest, 1 at an
        operating point, 2 with a trend, more under loads that change, all in motion.
    free : NDArray
        (B, N) what was subtracted: offset, trend and free response.
    offset, trend : NDArray
        (B,) constant part of the output, and the straight one at the recording's end.
    coefficients : NDArray
        (B, n) on the functions.
    information : NDArray
        (B or 1, n, n) inverse of their covariance for noise of variance one.
    residual : NDArray
        (B,) sum of squares that is left.
    rows : BlackBox, optional
        Of q outputs their B q models, those of one recording after each other; here, all outputs
        are stacked (`yawrate_env.plant.channels`).
    kept : int
        How many of the signals of `free_responses` were fitted and not subtracted, since the plant
        is nonlinear.
    """

    functions: Laguerre
    u: Array
    y: Array
    Ts: float
    oversampled: float
    extra: NDArray[np.int64]
    free: Array
    offset: Array
    trend: Array
    coefficients: Array
    information: Array
    residual: Array
    kept: int = 0
    rows: "BlackBox | None" = None

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Whether start or offsets were estimated, (B,)."""
        return self.extra > 0

    def part(self, i: int) -> "BlackBox":
        """Recording `i` alone."""
        return self.some(np.array([i]))

    def some(self, rows: NDArray[np.intp]) -> "BlackBox":
        """Some of the recordings."""
        batch = {f.name: getattr(self, f.name) for f in fields(self)}
        of: dict[str, Any] = {
            k: v if len(v) == 1 else v[rows] for k, v in batch.items() if isinstance(v, np.ndarray)
        }
        if self.rows is None:
            return replace(self, **of)
        each = len(self.rows.y) // len(self.y)
        within = (each * rows[:, None] + np.arange(each)).ravel()
        return replace(self, **of, rows=self.rows.some(within))

    def projected(self, signals: Array) -> Array:
        """Signals (B, m, N) without what offset, trend and free response could explain."""
        if not self.unknown.any():
            return signals
        if self.rows is not None:
            B, m, each = *signals.shape[:2], len(self.rows.y) // len(self.y)
            apart = signals.reshape(B, m, each, -1).swapaxes(1, 2).reshape(B * each, m, -1)
            left = self.rows.projected(apart).reshape(B, each, m, -1)
            return left.swapaxes(1, 2).reshape(signals.shape)
        left = signals.copy()
        for count in np.unique(self.extra[self.unknown]).tolist():
            of = np.flatnonzero(self.extra == count)
            for rows in np.split(of, range(_TOGETHER, len(of), _TOGETHER)):
                some = self._without(count, signals[rows].reshape(-1, signals.shape[2]))
                left[rows] = some.reshape(-1, *signals.shape[1:])
        return left

    def projected_like(self, i: int, signals: Array) -> Array:
        """Signals (m, N) without what offset, trend and free response of recording `i` could."""
        return self._without(int(self.extra[i]), signals)

    def _without(self, count: int, signals: Array) -> Array:
        """Signals (m, N) without their projection on the first of the free responses."""
        Z, _ = free_responses(self.functions, signals.shape[1], self.Ts)
        some = Z[:count]
        return signals - combined(products(signals, some), some) if count else signals


def basis(plant: Plant) -> type[Laguerre]:
    """Kind of functions that a plant's response to its input is a sum of."""
    return Integrated if plant.integrating else Laguerre


def functions_for(plant: Plant) -> Laguerre:
    """Laguerre basis of the reference model; chosen automatically if the plant names none.

    For a linear plant the basis grows until its truncation error is hidden by the noise: a free
    response would explain the rest, and a recording from rest would look like a start in motion.
    """
    if plant.black_box is not None:
        return basis(plant)(*plant.black_box)
    inputs = len(plant.inputs_named)
    for order in (order // inputs for order in ORDERS):
        functions = suited(plant, min(order, plant.samples // SAMPLES // inputs))
        if not plant.linear or functions.order < order or _hidden(plant, functions):
            break
    return functions


def _hidden(plant: Plant, functions: Laguerre) -> bool:
    """Whether noise hides the part of clean outputs that free responses would explain."""
    y = plant.respond(sample(plant, _MORE_PLANTS))
    sigma = plant.sigma(plant.stacked(y))
    fits = (black_box(plant, functions, plant.u[None], y, start) for start in ("rest", "unknown"))
    rest, moving = (fit.residual for fit in fits)
    return bool((rest - moving <= _HIDDEN * sigma**2).all())


def left_over(plant: Plant, functions: Laguerre) -> float:
    """Share of the prior's noise-free outputs that black boxes do not explain, root mean squares.

    Where a plant is so nonlinear, a misfit smaller than this cannot be seen.
    """
    y = plant.respond(sample(plant, _PLANTS))
    start = "rest" if plant.linear else "auto"
    left = black_box(plant, functions, plant.u[None], y, start).residual
    y = plant.stacked(y)
    return float(np.sqrt(left / (y.var(axis=1) * y.shape[1])).mean())


def suited(plant: Plant, order: int, pole: float | None = None) -> Laguerre:
    """Laguerre basis with a pole, or the one that explains the prior's noise-free outputs best."""
    if pole is not None:
        return basis(plant)(order, pole)
    y = plant.respond(sample(plant, _PLANTS))
    energy = (plant.stacked(y) ** 2).sum(axis=1)
    slowest, fastest = 2 / (plant.samples * plant.Ts), 1 / plant.Ts
    models = [basis(plant)(order, float(pole)) for pole in np.geomspace(slowest, fastest, _POLES)]
    fits = (black_box(plant, model, plant.u[None], y, "rest") for model in models)
    left = [(fit.residual / energy).mean() for fit in fits]
    return models[int(np.argmin(left))]


def suited_to_any_input(plant: Plant, order: int, pole: float | None = None) -> Regularised:
    """The same basis, regularised by the coefficients of simulated plants, for any input."""
    functions = suited(plant, order, pole)
    gram, right, y = equations_of_any_input(plant, functions)
    return regularised(functions, gram, right, plant.sigma(y) ** 2)


def equations_of_any_input(plant: Plant, functions: Laguerre) -> tuple[Array, Array, Array]:
    """Normal equations (B, n, n) and (B, n) of the prior's noise-free outputs (B, N), and these."""
    u = plant.inputs(stream(_SEED, 0, _MOST_PLANTS, 1)[:, 0])
    y = plant.respond(sample(plant, _MOST_PLANTS), u)
    gram, right = functions.normal_equations(u, y, plant.Ts, np.empty((0, y.shape[1])))
    return gram, right, y


def free_responses(functions: Laguerre, N: int, Ts: float) -> tuple[Array, Array]:
    """A constant, a trend and free responses, as orthonormal signals.

    Returns
    -------
    signals : (n + l + 2, N) float64
        A constant; with it a straight line; of a plant with an integrator, whose loads change on
        the way, l signals with a bend each; with all the decays of the basis' states.
    straight : (2, n + l + 2) float64
        Constant and trend in a sum of the signals are this times their coefficients.
    """
    return (_kept if N <= _LARGEST_KEPT else _free_responses)(functions, N, Ts)


def _free_responses(functions: Laguerre, N: int, Ts: float) -> tuple[Array, Array]:
    straight = [np.ones(N), np.linspace(-1.0, 1.0, N), *functions.loads(N)]
    Q, R = np.linalg.qr(np.concatenate([straight, decays(functions, N, Ts)]).T)
    return np.ascontiguousarray(Q.T), np.linalg.inv(R)[:2]


def decays(functions: Laguerre, N: int, Ts: float) -> Array:
    """Impulse responses of the functions, (n, N), which are their states' free responses too."""
    impulse = np.zeros((1, N + 1))
    impulse[0, 0] = 1.0
    return functions.regressors(impulse, Ts)[0, :, 1:]


_kept = lru_cache(maxsize=4)(_free_responses)


def black_box(
    plant: Plant, functions: Laguerre, u: Array, y: Array, start: str, oversampled: float = 1.0
) -> BlackBox:
    """Fit recordings (1 or B, N), (B, N) and subtract the effect of initial state and offsets.

    Of several channels, (1 or B, m, N) and (B, q, N), each output is fitted on all inputs.

    Parameters
    ----------
    start : {"auto", "rest", "offset", "unknown"}
        Whether recordings start from rest without offsets, at an operating point, whose output is
        an unknown constant, or anyhow; decided by the data if "auto".  For a nonlinear plant the
        data cannot decide: nothing is subtracted, but the reference model has the constant, or
        all of them if the plant names initial states.
    """
    validation.one_of("start", start, STARTS)
    if y.ndim == 3:
        return _of_each_output(plant, functions, u, y, start, oversampled)
    N, Ts, inputs = y.shape[1], plant.Ts, 1 if u.ndim == 2 else u.shape[1]
    if plant.loop_target is None:  # its recordings may be shorter than the experiment
        fewer = min(functions.order, max(N // SAMPLES // inputs, min(ORDERS) // inputs))
        functions = replace(functions, order=fewer)
    n = functions.order * inputs
    if N < SAMPLES * n:
        raise ValueError(
            f"{N} samples are too few, at least {SAMPLES * n} are needed. Record for longer."
        )
    Z, straight = free_responses(functions, N, Ts)
    states = functions.order
    loads = len(Z) - states
    moving = (loads + states // k for k in _SHARES if states // k > 1)
    steps = sorted({0, 1, 2, loads, *moving})
    levels = {"rest": (0,), "offset": (1,), "unknown": (len(Z),)}.get(start, tuple(steps))
    if not plant.linear and start == "auto":
        levels = (len(Z),) if plant.initial else (1,)
    Z = Z[: levels[-1]]
    gram, right = functions.normal_equations(u, y, Ts, Z, orthonormal=True)
    energy = np.einsum("bn,bn->b", y, y)
    equations = _Equations(gram, right, n)
    best, spectra = _level(equations, energy, levels[0]), None
    extra = np.full(len(y), levels[0])
    for level in levels[1:]:
        found = _level(equations, energy, level)
        independent = (N - n - level) / oversampled
        with np.errstate(divide="ignore", invalid="ignore"):  # an output of zeros
            statistic = (best.residual / found.residual - 1) * independent
        more = level - extra
        least = _rare(more) if level > loads else more + _SIGNIFICANT * np.sqrt(2 * more)
        needed = statistic > least
        needed &= best.residual - found.residual > _NEGLIGIBLE * energy
        doubted = needed & (statistic <= _DECIDED * least)
        for before in np.unique(extra[doubted]).tolist():
            rows = np.flatnonzero(doubted & (extra == before))
            spectra = energies(Z) if spectra is None else spectra
            own = u if len(u) == 1 else u[rows]
            explained = functions.outputs(own, found.coefficients[rows, None], Ts)[:, 0]
            explained += combined(found.extra[rows, :level], Z[:level])
            white = found.residual[rows] / independent
            noise = along(spectra[before:level], y[rows] - explained, white)
            needed[rows] = statistic[rows] * white > least[rows] * noise
        extra = np.where(needed, level, extra)
        best = best.where(needed, found)
    removed = extra if plant.linear or start != "auto" else np.zeros_like(extra)
    z = np.where(np.arange(len(Z)) < removed[:, None], best.extra, 0.0)
    free = combined(z, Z)
    constant, trend = straight[:, : len(Z)] @ z.T
    return BlackBox(
        functions, u, y - free, Ts, oversampled, removed, free, constant, trend,
        best.coefficients, best.information, best.residual,
        levels[-1] if plant.initial and start == "auto" else 0,
    )  # fmt: skip


def _of_each_output(
    plant: Plant, functions: Laguerre, u: Array, y: Array, start: str, oversampled: float
) -> BlackBox:
    """Models of every output (B, q, N) from all inputs (1 or B, m, N)."""
    B, q, N = y.shape
    own = u if len(u) == 1 else u.repeat(q, axis=0)
    apart = plant.stacked(y).reshape(B * q, N)
    rows = black_box(plant, functions, own, apart, start, oversampled)

    def together(values: Array) -> Array:
        return values.reshape(B, -1)

    straight = (together(values) / plant.weights[:, 0] for values in (rows.offset, rows.trend))
    offset, trend = (v[np.arange(B), np.abs(v).argmax(axis=1)] for v in straight)
    return replace(
        rows, u=u, y=together(rows.y), extra=rows.extra.reshape(B, q).max(axis=1),
        free=together(rows.free), offset=offset, trend=trend,
        coefficients=together(rows.coefficients), information=rows.information[:1],
        residual=together(rows.residual).sum(axis=1), rows=rows,
    )  # fmt: skip


def _rare(freedom: NDArray[np.int64]) -> Array:
    """What chi-squared exceeds once in 10 000 times (Wilson and Hilferty, 1931)."""
    share = 2 / (9 * freedom)
    return np.asarray(freedom * (1 - share + _RARE * np.sqrt(share)) ** 3)


@dataclass(frozen=True, slots=True, eq=False)
class _Equations:
    """Normal equations of B recordings on n functions, then on orthonormal signals."""

    gram: Array
    right: Array
    n: int


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """Least-squares fits of B recordings with some of the signals."""

    coefficients: Array
    information: Array
    extra: Array
    residual: Array

    def where(self, needed: NDArray[np.bool_], other: "_Level") -> "_Level":
        """These, and `other` where it is needed (B,)."""
        pairs = ((getattr(other, name), getattr(self, name)) for name in self.__slots__)
        parts = (np.where(needed.reshape(-1, *(1,) * (a.ndim - 1)), a, b) for a, b in pairs)
        return _Level(*parts)


def _level(of: _Equations, energy: Array, level: int) -> _Level:
    """Fits with the first `level` signals."""
    n, end = of.n, of.n + level
    G, P = of.gram[:, :n, :n], of.gram[:, :n, n:end]
    b, d = of.right[:, :n], of.right[:, n:end]
    information = lifted(G - P @ P.transpose(0, 2, 1))
    coefficients = _solve(information, b - (P @ d[..., None])[..., 0])
    z = d - (P.transpose(0, 2, 1) @ coefficients[..., None])[..., 0]
    residual = energy - _inner(b, coefficients) - _inner(d, z)
    extra = np.zeros((len(b), of.gram.shape[1] - n))
    extra[:, :level] = z
    return _Level(coefficients, np.broadcast_to(information, (len(b), n, n)), extra, residual)


def _solve(matrix: Array, right: Array) -> Array:
    if len(matrix) == 1:
        return np.asarray(np.linalg.solve(matrix[0], right.T).T)
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


def _inner(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=1))
