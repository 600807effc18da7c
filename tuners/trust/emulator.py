"""Emulator of a slow simulator: outputs interpolated between plants that were simulated.

Outputs of n plants, the nodes, are written on a few principal axes, and the scores on these are
interpolated over the parameters by radial functions of fifth degree (Wendland, *Scattered Data
Approximation*, 2005, chapter 8).  Of a linear plant the response to a step is emulated, from which
that to any input follows; of any other the output of the experiment, and only that.

It serves where small errors do not matter: a search begins where one on the emulator ends, and
takes its slopes.  What is fitted in the end is the simulator's own output.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.emulator import Emulator
from yawrate_env.plant.plant import Plant
from yawrate_env.validation import finite_array

if TYPE_CHECKING:
    from scipy.interpolate import RBFInterpolator

Array = NDArray[np.float64]

NODES, OF_STEPS, BEYOND = 1024, 512, 128
"""Nodes at most, those of a linear plant, and those outside the prior, where searches may lead."""

PREFIX = "emulator."
"""Of its arrays in a tuner's file."""

_SEED = 29
_AXES, _LEAST = 64, 1e-6  # principal axes at most; of the largest singular value
_SAME = 1e-9  # of the largest input


class OutputEmulator:
    """Outputs of plants between those that were simulated.

    Parameters
    ----------
    plant : Plant
        Whose outputs they are.
    nodes : (n, m) float64
        Parameters that the prior leaves open, in widths of their ranges from the low end; of
        logarithmic priors the logarithms.
    scores : (n, k) float64
        Of the nodes' outputs on the axes.
    mean : (N,) float64
        Of the nodes' outputs.
    axes : (k, N) float64
        Orthonormal.
    """

    batched = True

    def __init__(self, plant: Plant, nodes: Array, scores: Array, mean: Array, axes: Array) -> None:
        self._nodes, self._scores, self._mean, self._axes = nodes, scores, mean, axes
        self._plant = plant
        self._surface: RBFInterpolator[Any, Any] | None = None

    @classmethod
    def of(cls, plant: Plant, theta: Array) -> "OutputEmulator":
        """Simulate plants (B, p) of the prior, some of them, and others beyond it."""
        theta = nodes_of(plant, theta)
        y = plant.respond(theta, probe(plant))
        known = np.isfinite(y).all(axis=1)
        theta, y = theta[known], y[known]
        mean = y.mean(axis=0)
        U, S, axes = np.linalg.svd(y - mean, full_matrices=False)
        kept = min(int((S > _LEAST * S[0]).sum()), _AXES)
        return cls(plant, coordinates(plant, theta), U[:, :kept] * S[:kept], mean, axes[:kept])

    @classmethod
    def from_arrays(cls, plant: Plant, arrays: dict[str, NDArray[Any]]) -> "OutputEmulator":
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        n, k = np.shape(finite_array("scores", arrays["scores"], shape=(None, None)))
        nodes = finite_array("nodes", arrays["nodes"], shape=(n, len(_open(plant))))
        mean = finite_array("mean", arrays["mean"], shape=(len(plant.u),))
        axes = finite_array("axes", arrays["axes"], shape=(k, len(mean)))
        return cls(plant, nodes, arrays["scores"], mean, axes)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        return {
            "nodes": self._nodes,
            "scores": self._scores,
            "mean": self._mean,
            "axes": self._axes,
        }

    def knows(self, u: Array) -> bool:
        """Whether it answers inputs (1, N) or (B, N): of a linear plant any."""
        if self._plant.linear:
            return True
        own = self._plant.u[: u.shape[1]]
        return u.shape[1] == len(own) and bool((np.abs(u - own) <= _SAME * np.abs(own).max()).all())

    def __call__(self, theta: Array, u: Array, rng: Any = None) -> Array:
        """Outputs (B, N) of plants (B, p) for an input (N,), or (B, N)."""
        scores = self._interpolated(coordinates(self._plant, theta))
        y = np.asarray(self._mean + scores @ self._axes)
        if not self._plant.linear:
            return y[:, : u.shape[-1]]
        return _superposed(y, u / np.abs(self._plant.u).max())

    def _interpolated(self, x: Array) -> Array:
        return np.asarray(self._interpolator()(x), dtype=np.float64)

    def _interpolator(self) -> "RBFInterpolator[Any, Any]":
        if self._surface is None:
            from scipy.interpolate import RBFInterpolator

            self._surface = RBFInterpolator(self._nodes, self._scores, kernel="quintic", degree=2)
        return self._surface


def with_emulator(plant: Plant, emulator: Emulator | None) -> Plant:
    """A plant with the emulator that was made of it in a training, if any was."""
    if emulator is None:
        return plant
    return plant.with_simulator(
        plant.simulate, OutputEmulator.from_arrays(plant, emulator.arrays())
    )


def probe(plant: Plant) -> Array:
    """Input (N,) to which the emulated outputs answer: the experiment's, or a step as large."""
    return np.full(len(plant.u), np.abs(plant.u).max()) if plant.linear else plant.u


def nodes_of(plant: Plant, theta: Array) -> Array:
    """Plants to simulate: some (B, p) of the prior, and others beyond it."""
    inside = theta[: OF_STEPS if plant.linear else NODES]
    return np.concatenate([inside, _beyond(plant)])


def coordinates(plant: Plant, theta: Array) -> Array:
    """Parameters (B, p) that the prior leaves open, in widths from the low end, (B, m)."""
    low, high = plant.ranges
    x = []
    for i in _open(plant):
        values, ends = theta[:, i], np.array([low[i], high[i]])
        if plant.shapes[i].kind == "log":
            values, ends = np.log(values), np.log(ends)
        x.append((values - ends[0]) / np.ptp(ends))
    return np.stack(x, axis=1)


def _open(plant: Plant) -> list[int]:
    """Indices of the parameters that are no points."""
    low, high = plant.ranges
    return np.flatnonzero(low < high).tolist()


def _beyond(plant: Plant) -> Array:
    """Plants (BEYOND, p) as far as searches go."""
    (low, high), (least, most) = plant.ranges, plant.limits
    known = plant.known
    least[known], most[known] = low[known], high[known]
    unit = np.random.default_rng(_SEED).uniform(size=(BEYOND, len(low)))
    return np.asarray(least + (most - least) * unit)


def _superposed(step: Array, u: Array) -> Array:
    """Outputs of linear plants with step responses (B, N) for an input (M,), or (B, M).

    Beyond its end a step response goes on as it ended, at rest or on a straight line.
    """
    from scipy.signal import fftconvolve

    M, N = u.shape[-1], step.shape[1]
    if M > N:
        more = np.arange(1, M - N + 1) * (step[:, -1:] - step[:, -2:-1])
        step = np.concatenate([step, step[:, -1:] + more], axis=1)
    changes = np.diff(np.atleast_2d(u), prepend=0.0)
    return np.asarray(fftconvolve(step[:, :M], changes, axes=1)[:, :M])
