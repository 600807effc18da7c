"""Suspects: what may be wrong with a plant's description or with a log, as one number each.

Where a recording contradicts the plant, these are tried one by one; the one that explains it is
named in the plant's words.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Suspect:
    """One number that may differ from what the description says.

    Attributes
    ----------
    name : str
        Of what it is a value.
    respond : callable
        ``respond(theta, value, u)``: parameters (B, p), values (B,) and an input (1, N) to
        outputs (B, N) from rest, without noise.
    nominal : float
        The value of the description.
    limits : tuple of float
        Least and largest value that is believed.
    step : float
        A change that is small and yet shows.
    sentence : callable
        ``sentence(value)``: what an engineer reads where this value explains the recording.
    logged : bool
        Whether the plant itself may be as described, and only the log another: the sentence
        then asks what would settle it.
    """

    name: str
    respond: Callable[[Array, Array, Array], Array]
    nominal: float
    limits: tuple[float, float]
    step: float
    sentence: Callable[[float], str]
    logged: bool = False


def later(outputs: Array, samples: Array) -> Array:
    """Outputs (B, N) so many samples (B,) later, earlier where negative, joined by lines."""
    at = np.arange(outputs.shape[1])
    pairs = zip(outputs, samples, strict=True)
    return np.stack([np.interp(at - late, at, row) for row, late in pairs])


def zeroed(outputs: Array, pole: Array) -> Array:
    """Outputs (B, N) without a running mean of first order, with discrete poles (B,)."""
    left = np.empty_like(outputs)
    _zero(np.ascontiguousarray(outputs), pole, left)
    return left


@kernel
def _zero(outputs: Array, pole: Array, left: Array) -> None:
    for b in range(len(outputs)):
        mean = 0.0
        for k in range(outputs.shape[1]):
            mean = pole[b] * mean + (1.0 - pole[b]) * outputs[b, k]
            left[b, k] = outputs[b, k] - mean


def slowed(inputs: Array, most: Array) -> Array:
    """An input (1, N) that changes by `most` (B,) a sample at most, (B, N)."""
    out = np.empty((len(most), inputs.shape[1]))
    _slow(np.ascontiguousarray(inputs[0]), most, out)
    return out


@kernel
def _slow(wanted: Array, most: Array, out: Array) -> None:
    for b in range(len(most)):
        at = wanted[0]
        for k in range(len(wanted)):
            at += min(max(wanted[k] - at, -most[b]), most[b])
            out[b, k] = at
