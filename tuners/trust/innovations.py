"""Test whether a signal answers the output, as the input does in a closed loop.

In an open loop what is new in the output, which no earlier sample of either channel foretells,
has nothing to do with what is new in the input at that sample or later.  A controller answers it at
once.  Both are whitened, the output's part that the earlier input does not explain and the input
itself, by autoregressive filters; their correlation times the root of their length is then a
standard normal number in an open loop, whatever the input (Haugh, JASA 71, 1976; Ljung, System
Identification, 1999, section 13.5, on residuals and future inputs).

Feedback that stabilises answers against the plant's sign.  Where a log has the input late, the
output seems to come before it, with the plant's sign, and that is not taken for feedback.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre, combined, lifted, products
from tuners.trust.black_box import free_responses

Array = NDArray[np.float64]

_FUNCTIONS, _OF_RESIDUAL, _OF_INPUT = 16, 10, 3  # orders of the models
_REFINEMENTS = 2  # a second projection removes what rounding has left of the first
_LAGS = 3  # samples by which a log may have the input later than the controller gave it
_OUTLIERS = 4.0  # standard deviations: steps of the reference are no noise
_NOTHING = 1e-3  # of the output's standard deviation
_STEPS = 1e-3  # of the standard deviation: an input that hardly changes but in steps


def answers(asked: Array, u: Array, y: Array, Ts: float, functions: Laguerre) -> Array:
    """Correlations (B, 3) of what is new in outputs with what is new in signals soon after.

    In standard deviations, at the same sample and the two that follow.

    Parameters
    ----------
    asked : (1 or B, N) float64
        Signals that may answer: the inputs, or references.
    u, y : (1 or B, N) and (B, N) float64
        Inputs and measured outputs.
    Ts : float
        Sampling time [s], of the controller or about it.
    functions : Laguerre
        Whose pole the plant's model has.
    """
    N = y.shape[1]
    basis = replace(functions, order=max(min(_FUNCTIONS, N // 10), 1))
    known, _ = free_responses(basis, N, Ts)
    found = np.zeros((len(y), _LAGS))
    whitened = [_new(own - own.mean(), _OF_INPUT) for own in asked]
    for k in range(len(u)):
        phi = np.concatenate([basis.regressors(u[[k]], Ts)[0], known])
        rows = np.arange(k, len(y), len(u))
        for i, left in zip(rows.tolist(), _unexplained(y[rows], phi), strict=True):
            residual = _new(left, _OF_RESIDUAL)
            if np.sqrt((residual**2).mean()) <= _NOTHING * y[i].std():
                continue  # without noise nothing is new but what the functions leave over
            new = whitened[i % len(asked)][-len(residual) :]
            found[i] = [_correlation(residual[: len(residual) - j], new[j:]) for j in range(_LAGS)]
    return found


def _unexplained(signals: Array, by: Array) -> Array:
    """Signals (B, N) without their projection on others (m, N)."""
    gram, left = lifted(products(by, by)), signals
    for _ in range(_REFINEMENTS):
        share = np.asarray(np.linalg.solve(gram, products(by, left)), np.float64)
        left = left - combined(share.T, by)
    return left


def _new(x: Array, order: int) -> Array:
    """What an autoregressive model of a signal (N,) does not foretell, without outliers."""
    r = np.array([x[: len(x) - k] @ x[k:] for k in range(order + 1)])
    if not r[0] > 0:
        return np.zeros(len(x) - order)
    r[0] *= 1 + 1e-8
    lags = np.arange(order)
    weights = np.linalg.solve(r[np.abs(lags[:, None] - lags)], r[1:])
    new = np.convolve(x, np.concatenate([[1.0], -weights]), "valid")
    size = float(np.median(np.abs(new))) / 0.6745
    if size > _STEPS * new.std():
        new = np.clip(new, -_OUTLIERS * size, _OUTLIERS * size)
    return new


def _correlation(a: Array, b: Array) -> float:
    """Of two white signals, in its standard deviations if they are independent."""
    size = np.sqrt((a @ a) * (b @ b) / len(a))
    return float(a @ b / size) if size > 0 else 0.0
