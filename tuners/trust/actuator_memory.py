"""How far a fit is off where the actuator sticks, has a dead band, or follows late or slowly.

The actuator's position v is not logged; what it does to the output of a linear plant is the plant's
answer to ``v - u``.  Residuals are searched for two kinds of it (models of stiction: Choudhury,
Thornhill and Shah, Control Engineering Practice 13, 2005; Jelali and Huang, *Detection and
Diagnosis of Stiction in Control Loops*, 2010):

regular
    v follows from u and one width (`positions`).  Of several models and widths the one counts that
    explains most of the residual, as far as it exceeds what noise of the residual's own
    spectrum may explain, and what a lag of the input that the plant lacks would explain.  What the
    parameters make up for in its stead is their error.
irregular
    Each change of u arrives late by a time of its own.  The same changes at times when nothing
    changed, the placebo, must not explain the residual as well.  How late changes are in common is
    not seen beside the plant's own dead time; times that scatter evenly from zero by a standard
    deviation s have a mean of sqrt(3) s, which is taken for the error.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.discrepancy import unpatterned
from tuners.trust.fast_length import fast_length
from tuners.trust.octaves import octaves
from yawrate_env.compiled import kernel
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_DEAD_BAND, _STUCK, _HELD, _SLOW = range(4)
_WIDTHS = {  # of the largest input; of the recording, which a full stroke takes
    _DEAD_BAND: (0.05, 0.1, 0.2, 0.3, 0.45, 0.6),
    _STUCK: (0.05, 0.1, 0.2, 0.3, 0.45, 0.6),
    _HELD: (0.1, 0.2, 0.3, 0.45, 0.6, 0.8),
    _SLOW: (0.005, 0.01, 0.015, 0.02, 0.03),
}
_LAGS = (0.003, 0.006, 0.0125, 0.025, 0.05)  # of the recording
_MOST = 1.5  # times a model's answer: between two widths
_SURE, _GAIN = 4.0, 15.0  # standard deviations, and energy over the noise's variance
_BLOCKS, _OF_SAMPLES = 40, 16  # changes apart at most, and samples for each at least
_SCATTERED, _PLACEBO = 5.0, 2.5  # standard deviations, and times the placebo's energy
_EVENLY = np.sqrt(3.0)  # mean over standard deviation of what is evenly spread from zero
_SPARSE = 0.25  # of the samples: an input that changes more rarely is held between
_FARTHEST = 1.0  # of a range
_TOGETHER = 16  # recordings
_LONGEST = 20_000  # samples that are searched
_SILENT = 1e-12  # of the output's power: noise below it is rounding
_RIDGE = 1e-9  # of the largest energy: changes that cannot be told apart


@dataclass(frozen=True, slots=True)
class _Residual:
    """Residuals of B fitted plants, and how signals look beside the slopes.

    Attributes
    ----------
    error, quiet : NDArray
        (B, N) residuals, and (B,) the power of their white part.
    slopes, inverse : NDArray
        (B, q, N) of the outputs, and (B, q, q) of their normal equations.
    transfer : NDArray
        (B, outputs, F) Fourier transforms of the answers to an impulse of one input.
    model : BlackBox
        Which knows free responses.
    """

    error: Array
    quiet: Array
    slopes: Array
    inverse: Array
    transfer: NDArray[np.complex128]
    model: BlackBox

    def answers(self, inputs: Array) -> Array:
        """Of all plants to changes of the input (m, N): (B, m, N), free responses taken out."""
        B, outputs, _ = self.transfer.shape
        m, N = inputs.shape
        length = fast_length(2 * N)
        product = self.transfer[:, None] * np.fft.rfft(inputs, length)[:, None]
        y = np.fft.irfft(product, length)[..., :N]
        return np.asarray(self.model.projected(y.reshape(B, m, outputs * N)))

    def step(self, signals: Array) -> Array:
        """Parameters (B, m, q) that signals (B, m, N) look like."""
        return np.asarray(signals @ self.slopes.swapaxes(1, 2) @ self.inverse)

    def beside(self, signals: Array) -> Array:
        """What no parameter explains of signals (B, m, N)."""
        return np.asarray(signals - self.step(signals) @ self.slopes)

    def along(self, signals: Array) -> tuple[Array, Array, Array]:
        """Share (B, m) of each signal in the residual, product, and what it explains over noise."""
        product, energy = (signals @ self.error[..., None])[..., 0], (signals**2).sum(axis=2)
        share = np.clip(product / np.where(energy > 0, energy, 1.0), 0.0, _MOST)
        return share, product, share * (2 * product - share * energy) / self.quiet[:, None]

    def explained(self, signals: Array) -> tuple[Array, Array]:
        """Energy (B,) of the residual along signals (B, m, N), over noise, and its expectation."""
        gram = signals @ signals.swapaxes(1, 2)
        right = signals @ self.error[..., None]
        m = gram.shape[1]
        ridge = _RIDGE * np.einsum("bii->b", gram)[:, None, None] + 1e-300
        solved = np.linalg.solve(gram + ridge * np.eye(m), np.concatenate([right, gram], axis=2))
        energy = (right * solved[..., :1]).sum(axis=(1, 2)) / self.quiet
        return energy, np.einsum("bii->b", solved[..., 1:])


def sticking(
    plant: Plant,
    theta: Array,
    model: BlackBox,
    error: Array,
    slopes: Array,
    noise: Array,
    inverse: Array,
) -> Array | None:
    """How far parameters may be off, (B, 2 inputs, q) in widths of their ranges.

    The error under a regular actuator, and an irregular one, for each input; 0 where the residual
    shows none.  None for nonlinear plants, references of a loop, and very long recordings.

    Parameters
    ----------
    theta : (B, p) float64
        The fitted plants.
    error, slopes : (B, N) and (B, q, N) float64
        Residuals, and slopes of the outputs.
    noise : (B,) float64
        Power of the noise.
    inverse : (B, q, q) float64
        Inverse normal matrices.
    """
    B, samples, inputs = len(theta), model.u.shape[-1], len(plant.inputs_named)
    if not plant.linear or plant.in_loop or samples > _LONGEST:
        return None
    found = np.zeros((B, 2 * inputs, slopes.shape[1]))
    quiet = np.minimum(unpatterned(error, model.oversampled), noise)
    quiet = np.maximum(quiet, _SILENT * np.maximum((model.y**2).mean(axis=1), 1e-300))
    each = _TOGETHER if len(model.u) == 1 else 1
    for rows in np.split(np.arange(B), range(each, B, each)):
        part = model.some(rows)
        for i, u in enumerate(part.u.reshape(inputs, samples)):
            impulse = np.zeros(part.u.shape[1:])
            impulse.reshape(inputs, samples)[i, 0] = 1.0
            h = plant.emulated(impulse).answers(theta[rows], impulse)
            transfer = np.fft.rfft(h.reshape(len(rows), -1, samples), fast_length(2 * samples))
            seen = _Residual(error[rows], quiet[rows], slopes[rows], inverse[rows], transfer, part)
            found[rows, 2 * i] = _regular(seen, u)
            found[rows, 2 * i + 1] = _irregular(seen, u)
    return np.clip(np.where(np.isfinite(found), found, 0.0), -_FARTHEST, _FARTHEST)


def positions(u: Array) -> Array:
    """Positions (n, N) of actuators that would follow a command (N,) with a memory.

    With a dead band (backlash), sticking until the command is a width away and then jumping to it,
    sticking so at turns alone, and moving at a limited speed; those that differ from the command.
    """
    kinds = np.repeat(list(_WIDTHS), [len(widths) for widths in _WIDTHS.values()])
    widths = np.concatenate(list(_WIDTHS.values()))
    largest = np.abs(u).max(initial=0.0)
    widths = np.where(kinds == _SLOW, 2 / (widths * len(u)), widths) * largest
    v = np.empty((len(kinds), len(u)))
    _follow(np.ascontiguousarray(u), kinds, widths, v)
    return np.asarray(v[np.abs(v - u).max(axis=1, initial=0.0) > 1e-9 * largest])


@kernel
def _follow(u: Array, kinds: NDArray[np.int64], widths: Array, v: Array) -> None:
    for i in range(len(kinds)):
        kind, width = kinds[i], widths[i]
        at, last, direction, held, turn = u[0], u[0], 0.0, True, u[0]
        for k in range(len(u)):
            if kind == _DEAD_BAND:
                at = min(max(at, u[k] - width), u[k] + width)
            elif kind == _SLOW:
                at += min(max(u[k] - at, -width), width)
            elif kind == _STUCK:
                if abs(u[k] - at) > width:
                    at = u[k]
            else:
                if (u[k] - last) * direction <= 0 and u[k] != last:
                    held, turn, direction = True, last, u[k] - last
                held = held and abs(u[k] - turn) <= width
                at = turn if held else u[k]
            last = u[k]
            v[i, k] = at


def _regular(seen: _Residual, u: Array) -> Array:
    """Error (B, q) under the model of an actuator that explains most."""
    v = positions(u)
    if not len(v):
        return np.zeros(seen.inverse.shape[:2])
    answers = seen.answers(v - u)
    beside = seen.beside(answers)
    share, product, gain = seen.along(beside)
    row, best = np.arange(len(gain)), gain.argmax(axis=1)
    share, product, gain = share[row, best], product[row, best], gain[row, best]
    error = -share[:, None] * seen.step(answers[row, best][:, None])[:, 0]
    rivals = seen.along(seen.beside(seen.answers(_lagging(u) - u)))[2]
    found = gain > np.maximum(_GAIN, rivals.max(axis=1))
    if found.any():
        left = seen.error - share[:, None] * beside[row, best]
        found &= product > _SURE * _deviation(beside[row, best], left, seen.quiet)
    return np.where(found[:, None], error, 0.0)


def _lagging(u: Array) -> Array:
    """An input (N,) behind first-order lags (n, N)."""
    from scipy.signal import lfilter

    poles = [np.exp(-1 / (lag * len(u))) for lag in _LAGS]
    return np.asarray(u[0] + np.array([lfilter([1 - p], [1, -p], u - u[0]) for p in poles]))


def _deviation(signal: Array, residual: Array, quiet: Array) -> Array:
    """Standard deviation (B,) of products of signals (B, N) with noise of residuals' spectra."""
    length = fast_length(signal.shape[1])
    power = np.abs(np.fft.rfft(residual, length)) ** 2 / signal.shape[1]
    energy = 2 / length * np.abs(np.fft.rfft(signal, length)) ** 2
    energy[:, [0, -1]] /= 2
    return np.asarray(
        np.sqrt((energy * np.maximum(octaves(power, 1, quiet), quiet[:, None])).sum(1))
    )


def _irregular(seen: _Residual, u: Array) -> Array:
    """Error (B, q) where every change of the input arrives late by a time of its own."""
    changes, apart, placebo = _changes(u)
    none = np.zeros(seen.inverse.shape[:2])
    if len(changes) < 3 or not placebo:
        return none
    answers = seen.answers(-changes)
    own = seen.beside(answers)
    energy, expected = seen.explained(own)
    found = energy - expected > _SCATTERED * np.sqrt(2 * expected)
    if not found.any():
        return none
    shifted = np.pad(changes, ((0, 0), (placebo, 0)))[:, : len(u)]
    other = seen.beside(seen.answers(-shifted))
    both, of_both = seen.explained(np.concatenate([own, other], axis=1))
    of_other, expected_other = seen.explained(other)
    beside = (both - of_other) / np.maximum(of_both - expected_other, 1.0)
    chance = (both - energy) / np.maximum(of_both - expected, 1.0)
    found &= beside > _PLACEBO * chance
    gram = own @ own.swapaxes(1, 2)
    right = ((own @ seen.error[..., None]) ** 2).sum(axis=(1, 2))
    variance = (right - seen.quiet * np.einsum("bii->b", gram)) / (gram**2).sum(axis=(1, 2))
    late = _EVENLY * np.sqrt(apart * np.maximum(variance, 0.0))
    common = seen.step(answers.sum(axis=1, keepdims=True))[:, 0]
    return np.where(found[:, None], late[:, None] * common, 0.0)


def _changes(u: Array) -> tuple[Array, float, int]:
    """Changes of an input (N,) in blocks (m, N), how many of them in each, and a delay in samples.

    Blocks have equal shares of all changes; by the delay these come where little changes.  A block
    is what lateness by one sample takes away.
    """
    change = np.diff(u, prepend=u[:1])
    at = np.flatnonzero(change)
    most = min(_BLOCKS, len(u) // _OF_SAMPLES)
    if len(at) < 3 or not most:
        return np.empty((0, len(u))), 1.0, 0
    if len(at) <= most:
        block = np.arange(len(at))
    else:
        size = np.abs(change[at]).cumsum()
        block = np.minimum((most * size / size[-1]).astype(np.intp), most - 1)
    blocks = np.zeros((block[-1] + 1, len(u)))
    blocks[block, at] = change[at]
    sparse = len(at) < _SPARSE * len(u)
    moves = at if sparse else at[1:][np.diff(np.sign(change[at])) != 0]
    if len(moves) < 2:
        return blocks, 1.0, 0
    gaps = np.diff(moves)
    placebo = int(gaps.min() if sparse else np.median(gaps)) // 2
    return blocks, len(at) / len(blocks) if sparse else 1.0, placebo
