"""What an actuator with a curve, or one that saturates, would add to a fitted plant's output.

In front of the plant the command becomes ``u + a u^2 + b u^3``, u its distance from the mean: a is
of a valve's characteristic, b of saturation at both ends (a Hammerstein model; Ljung, System
Identification, 1999, section 5.2).  The plant's answers to both powers are two more slopes; beside
them its gain is that of small signals.  An input of two levels tells none of it: its powers are
that input again, and a constant.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_SMALL = 1e-2  # of the largest input
_TWO_LEVELS = 1e-3  # of the cube: what is left of it beside the input and a constant


def actuator_curves(plant: Plant, theta: Array, model: BlackBox) -> Array | None:
    """Answers (B, 2 m, N) of fitted plants to powers of their inputs, start and offsets taken out.

    None where the inputs have two levels, or are references of a loop.
    """
    if plant.in_loop:
        return None
    centred = model.u - model.u.mean(axis=-1, keepdims=True)
    largest = np.abs(centred).max(axis=-1, keepdims=True)
    shape = centred / np.where(largest > 0, largest, 1.0)
    powers = shape**2, shape**3
    if (np.abs(_beside(powers[1], shape)).max(axis=-1) < _TWO_LEVELS).any():
        return None
    base, found = plant.answers(theta, model.u), []
    for power in powers:
        for change in _one_by_one(_SMALL * largest * power):
            found.append(plant.answers(theta, model.u + change) - base)
    return model.projected(np.stack(found, axis=1))


def _beside(power: Array, shape: Array) -> Array:
    """Powers (..., N) of inputs without what a constant and the input itself explain."""
    left = power - power.mean(axis=-1, keepdims=True)
    energy = (shape**2).sum(axis=-1, keepdims=True)
    along = (left * shape).sum(axis=-1, keepdims=True)
    return np.asarray(left - along / np.where(energy > 0, energy, 1.0) * shape)


def _one_by_one(change: Array) -> list[Array]:
    """Changes (B, m, N) of several inputs, each of one of them; (B, N) of one input."""
    if change.ndim == 2:
        return [change]
    apart = np.eye(change.shape[1])[:, None, :, None]
    return list(change * apart)
