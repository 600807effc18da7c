"""What a learner predicts, and how gains come back from it.

``loop``
    Log magnitude and phase [rad] of the controller at the target crossover.  A phase
    error there is the same error of phase margin for every vehicle, and the map to
    (kp, Ti) is exact (`yawrate_env.loop.controller`).
``gains``
    (kp, Ti) themselves, as the paper has it.  Ti runs from 0.07 s to beyond 2 s, so its
    squared error is ruled by a few low-friction vehicles for which Ti hardly matters.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop import controller
from yawrate_env.loop.design import Design, Status, design_from_response
from yawrate_env.loop.target import Target

COORDINATES = ("loop", "gains")

Array = NDArray[np.float64]


def encode(kp: Array, Ti: Array, target: Target, coordinates: str) -> Array:
    """Gains (B,) to targets (B, 2)."""
    validation.one_of("coordinates", coordinates, COORDINATES)
    if coordinates == "gains":
        return np.stack([kp, Ti], axis=1)
    return np.stack(controller.response(kp, Ti, target), axis=1)


def decode(values: Array, target: Target, coordinates: str) -> Design:
    """Predicted targets (B, 2) to gains, with a status each.

    A phase that no PI supplies is treated as the design rule treats it; gains that are
    not positive and finite are `Status.UNREACHABLE` and ``nan``.
    """
    validation.one_of("coordinates", coordinates, COORDINATES)
    if coordinates == "loop":
        with np.errstate(over="ignore"):  # far from all that was learned
            design = design_from_response(values[:, 0], values[:, 1], target)
    else:
        design = Design(values[:, 0], values[:, 1], np.full(len(values), int(Status.OK)))
    usable = (design.kp > 0) & (design.Ti > 0) & np.isfinite(design.kp) & np.isfinite(design.Ti)
    kp, Ti = (np.where(usable, x, np.nan) for x in (design.kp, design.Ti))
    return Design(kp, Ti, np.where(usable, design.status, int(Status.UNREACHABLE)))
