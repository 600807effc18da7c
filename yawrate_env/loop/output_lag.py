"""The observer form of plants behind a first-order lag, such as a sensor's, without loss of digits.

Leverrier's recursion cancels where one pole is much faster than the others: with a lag of 0.1 ms it
leaves two digits at a sampling time of 0.1 ms.  The lag ``y+ = p y + C' x + b u`` is therefore
multiplied onto the polynomials of the plant in front of it,

    y = (numerator' + b denominator') u / ((z - p) denominator')

which adds no error of its own.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.observer_form import ObserverForm, polynomials


def observer_form(plant: DiscretePlant, centre: float | None = None) -> ObserverForm:
    """`ObserverForm.of`, in this way where the output is the last state and no other sees it."""
    A, n = plant.A, plant.A.shape[1]
    if plant.C.ndim > 1 or n < 2 or plant.C[-1] != 1 or plant.C[:-1].any() or A[:, :-1, -1].any():
        return ObserverForm.of(plant, centre)
    c = np.trace(A[:, :-1, :-1], axis1=1, axis2=2) / (n - 1)
    if centre is not None:
        c = np.full_like(c, centre)
    alpha, beta, _ = polynomials(A[:, :-1, :-1], plant.B[:, :-1], A[:, -1, :-1], c)
    denominator = np.ones((len(plant), n))
    denominator[:, 1:] = alpha
    whole = np.zeros((len(plant), n + 1))
    whole[:, :-1] = denominator
    whole[:, 1:] += (c - A[:, -1, -1])[:, None] * denominator
    numerator = plant.B[:, -1:] * denominator
    numerator[:, 1:] += beta
    return ObserverForm(c, whole[:, 1:].copy(), numerator, _rows(plant, c, whole[:, 1:]))


def _rows(
    plant: DiscretePlant, c: NDArray[np.float64], alpha: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rows (B, n, n) whose product with x is w: the output's, and one from another."""
    rows = np.empty_like(plant.A)
    rows[:, 0] = plant.C
    for i in range(1, rows.shape[1]):
        rows[:, i] = np.einsum("bi,bij->bj", rows[:, i - 1], plant.A)
        rows[:, i] += alpha[:, i - 1, None] * plant.C - c[:, None] * rows[:, i - 1]
    return rows
