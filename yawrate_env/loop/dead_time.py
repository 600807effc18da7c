r"""Plants behind a dead time that is no whole number of samples, exact at the samples.

The output of a plant from rest is late by the dead time, ``y(t) = y_0(t - T)``, and with d
samples, the first whole number that is not below T/Ts, and what is left, ``m = d Ts - T``,

    y[k] = y_0((k - d) Ts + m) = C e^{A m} x[k - d] + C \int_0^m e^{A s} ds B u[k - d]

for an input that is held between samples (the modified z-transform of Jury, 1958).  In the states
``e^{A m} x`` the output row is C again: the input column is ``e^{A m} Bd`` and the rest of the last
equation is D.  A dead time adds no states, and one of whole samples leaves all numbers as they are.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.batch import take
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.loop.discretisation import (
    DiscretePlant,
    augmented,
    expm,
    zoh,
)
from yawrate_env.loop.observer_form import ObserverForm
from yawrate_env.loop.output_lag import observer_form
from yawrate_env.loop.simulation import simulate, simulate_into

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # of a sample: dead times this little above a whole one are that one


def zoh_late(A: Array, B: Array, C: Array, Ts: float, dead_time: Array) -> DiscretePlant:
    """Discretise (B, n, n), (B, n), (n,) continuous plants behind dead times (B,) [s]."""
    plant = zoh(A, B, C, Ts)
    delay = np.maximum(np.ceil(dead_time / Ts - _ROUNDING), 0.0)
    rest = delay * Ts - dead_time
    rest[np.abs(rest) <= _ROUNDING * Ts] = 0.0
    E = expm(augmented(A, B, 1.0) * rest[:, None, None])
    late = np.einsum("bij,bj->bi", E[:, :-1, :-1], plant.B)
    return DiscretePlant(plant.A, late, C, Ts, E[:, :-1, -1] @ C, delay.astype(np.int64))


def respond(plant: DiscretePlant, u: Array) -> Array:
    """Outputs (B, N) from rest of plants with or without dead time, for inputs (N,) or (B, N)."""
    if plant.delay is None:
        return simulate(plant, u)
    inputs = np.ascontiguousarray(np.atleast_2d(u), dtype=np.float64)
    form, y = observer_form(plant), np.empty((len(plant), inputs.shape[1]))

    def one_block(i: int, j: int) -> None:
        simulate_late(y[i:j], plant, form, inputs, i, j)

    over_blocks(one_block, len(plant), LANES)
    return y


def simulate_late(
    y: Array, plant: DiscretePlant, form: ObserverForm, u: Array, start: int, stop: int
) -> Array:
    """`simulate_into` for plants with dead time, from rest.

    Returns
    -------
    (stop - start,) float64
        Each response's sum of squares.
    """
    D, delay = plant.D, plant.delay
    assert D is not None and delay is not None
    rows, N = range(start, stop), u.shape[1]
    late = np.zeros((len(rows), N))
    for i, row in enumerate(rows):
        d = min(int(delay[row]), N)
        late[i, d:] = u[row if len(u) > 1 else 0, : N - d]
    simulate_into(y, take(form, slice(start, stop)), late, 0, len(rows))
    squares = np.empty(len(rows))
    for i, row in enumerate(rows):  # one by one, so that the sum is the same in any batch
        y[i] += D[row] * late[i]
        squares[i] = np.square(y[i]).sum()
    return squares
