"""Recordings in a closed loop: the part of the input that the reference explains.

Under feedback ``u = C (r - y)`` noise and disturbances come back through the controller, and a
fit of y on u sees the controller's inverse beside the plant.  The reference r knows nothing of
them.  In two stages (Van den Hof and Schrama, Automatica 29, 1993): the input's projection on the
reference,

    u' = F r,   F by least squares on Laguerre functions of r,

takes the place of the input, and since ``y = G u' + G (u - u') + v`` with a remainder that is not
correlated with u', the recording is an open-loop one of (u', y).  Where a model of G is known well
enough, ``G (u - u')`` is subtracted: what is left is the disturbance itself and not what the loop
makes of it, and what F leaves over of the reference does no harm any more (u' is then an
instrument).  Any model subtracts something that is not correlated with u', so that a bad one biases
nothing; the one that leaves least is taken.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import BlackBox, black_box, free_responses
from tuners.trust.fit import fit
from tuners.trust.octaves import energies, octaves
from yawrate_env.loop.controller import coefficients
from yawrate_env.loop.target import Target
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_ORDER, _RADIANS, _SAMPLES = 40, 8.0, 40  # at most; of the pole for each function, and samples
_SINGULAR = 1e-7  # of the largest singular value: directions that the reference does not excite
_FAINT = 1e-3  # of it: directions that need not be excited by more than rounding
_CERTAIN = 4.0  # standard deviations of what noise explains along a direction
_FORETOLD = 4  # order of a reference's autoregressive model
_ROUNDED = 1e-3  # of a sampling time


def projected_on(reference: Array, u: Array, Ts: float, functions: Laguerre) -> Array:
    """Part (B, N) of inputs that references explain.

    Parameters
    ----------
    reference, u : (1 or B, N) and (B, N) float64
        Sampled together: the controller knows a sample of the reference when it gives its input.
    Ts : float
        Sampling time [s].
    functions : Laguerre
        Whose pole the closed loop's model has; its order is chosen by the recording's length.
        What began before the recording is explained by their free responses, and left out.
    """
    N = u.shape[1]
    order = min(_ORDER, int(N * Ts * functions.pole / _RADIANS), N // _SAMPLES)
    if order < 1:
        raise ValueError(f"{N} samples are too few to project on a reference. Record for longer.")
    basis = replace(functions, order=order)
    Z, _ = free_responses(basis, N, Ts)
    ahead = np.concatenate([reference[:, 1:], reference[:, -1:]], axis=1)
    found = np.empty(u.shape)
    for i, row in enumerate(u):
        if i == 0 or len(reference) > 1:
            phi = basis.regressors(ahead[i : i + 1], Ts)[0]
            left, sizes, directions = np.linalg.svd(phi - (phi @ Z.T) @ Z, full_matrices=False)
            kept = sizes > _SINGULAR * sizes[0]
            left, sizes, directions = left[:, kept] / sizes[kept], sizes[kept], directions[kept]
        along = directions @ row
        strong = int((sizes > _FAINT * sizes[0]).sum())
        certain = max(strong, _certain(along, row - (row @ Z.T) @ Z, directions))
        found[i] = (left[:, :certain] @ along[:certain]) @ phi
    return found


def _certain(along: Array, row: Array, directions: Array) -> int:
    """How many of the directions (k, N) that a reference excites explain an input, not its noise.

    All after the last one that explains more than noise does explain noise: a slow weave excites
    two, and rounding, or the start of a reference that was rebuilt, the others.
    """
    rest = row - along @ directions
    white = np.atleast_1d(rest @ rest / max(len(row) - len(along), 1))
    energy = energies(directions)
    spectrum = octaves(energies(rest[None]) / len(row), len(along), white)[0]
    noise = energy @ spectrum / energy.sum(axis=1)
    return int(np.flatnonzero(along**2 > _CERTAIN**2 * noise).max(initial=0)) + 1


def share(explained: Array, u: Array) -> Array:
    """Share (B,) of the inputs' variance that the reference explains."""
    left = (u - explained).var(axis=1)
    variance = u.var(axis=1)
    return np.asarray(1 - left / np.where(variance > 0, variance, 1.0))


def opened(
    plant: Plant,
    functions: Laguerre,
    explained: Array,
    u: Array,
    y: Array,
    theta: Array,
    start: str,
    oversampled: float,
) -> Array:
    """Outputs (B, N) without what the unexplained part of the input caused, as models tell.

    Parameters
    ----------
    explained, u, y : (B, N) float64
        The input's projection, the whole input, and the output, at the plant's sampling time.
    theta : (B, p) float64
        Where the search for the plant starts.
    start, oversampled
        As of `black_box`.
    """
    model = black_box(plant, functions, explained, y, start, oversampled)
    rest = u - explained
    best, left = y, model.residual
    for caused in _caused(plant, model, y, theta, rest):
        known = np.isfinite(caused).all(axis=1, keepdims=True)
        without = np.where(known, y - caused, y)
        found = black_box(plant, functions, explained, without, start, oversampled).residual
        better = found < left
        best, left = np.where(better[:, None], without, best), np.where(better, found, left)
    return best


def _caused(plant: Plant, model: BlackBox, y: Array, theta: Array, rest: Array) -> list[Array]:
    """What inputs (B, N) cause, by the black box and by the fitted plant."""
    weights = model.coefficients[:, None]
    by_box = model.functions.outputs(rest, weights, model.Ts)[:, 0]
    return [by_box, plant.respond(fit(plant, model, y, theta).theta, rest)]


def controller_samples(u: Array, step: int) -> slice:
    """Which samples of an input (N,) a controller gave that acts at every `step`-th: the changes.

    An input that is held between them changes at these alone.
    """
    changes = np.abs(np.diff(u, prepend=u[:1]))
    sums = [changes[k::step].sum() for k in range(step)]
    return slice(int(np.argmax(sums)), None, step)


def rebuilt(u: Array, y: Array, Ts: float, gains: tuple[float, float], target: Target) -> Array:
    """The reference (N,) of a PI's loop from its input and output: ``r = y + C^-1 u``.

    Exact where `y` is what the controller saw; where it saw other noise, the difference is in the
    reference, too.  The controller's integral at the start is unknown, and what it adds to the
    reference, which decays with Ti, is what an autoregressive model of its second half does not
    foretell.

    Parameters
    ----------
    u, y : (N,) float64
        Recorded at the controller's sampling time, or so many times as often.
    Ts : float
        Sampling time of these [s].
    gains : tuple of float
        (kp, Ti) of the controller that drove.
    target : Target
        Its sampling time and form.
    """
    from scipy.signal import lfilter

    step = round(target.Ts / Ts)
    if step < 1 or abs(step * Ts - target.Ts) > _ROUNDED * target.Ts:
        raise ValueError(
            f"Ts = {Ts:g} s: the reference of a controller that acts every {target.Ts:g} s needs "
            "its samples, or so many times as many. Record at its rate, or give the reference."
        )
    own = controller_samples(u, step)
    kp, Ti = (np.atleast_1d(np.float64(gain)) for gain in gains)
    n1, n0, d0 = (float(c[0]) for c in coefficients(kp, Ti, target))
    integral, pole = n0 - d0 * n1, 1 - d0 * target.Ts
    # e = (u - integral w) / n1,   w+ = pole w + Ts e
    decay = pole - target.Ts * integral / n1
    command = u[own]
    state = lfilter([0.0, target.Ts / n1], [1.0, -decay], command)
    reference = y[own] + (command - integral * state) / n1
    started = decay ** np.arange(len(command), dtype=np.float64)
    reference = reference - _share(reference, started) * started
    held = np.repeat(reference, step)[: len(u) - own.start]
    return np.concatenate([np.full(own.start, reference[0]), held])


def _share(signal: Array, decay: Array) -> float:
    """By how much a decay is in a signal (N,), whose later half tells how it moves otherwise.

    The median of what each sample says: that it turns or steps a few times does no harm.
    """
    bends, known = np.diff(signal, 2), np.diff(decay, 2)
    half = len(bends) // 2
    if half <= 2 * _FORETOLD:
        return 0.0
    past = np.stack([bends[half - k : len(bends) - k] for k in range(1, _FORETOLD + 1)], axis=1)
    usual = np.append(1.0, -np.linalg.lstsq(past, bends[half:], rcond=None)[0])
    new, decaying = (np.convolve(x, usual, "valid") for x in (bends, known))
    weights = np.abs(decaying)
    if not weights.max() > 0:
        return 0.0
    tells = weights > _SINGULAR * weights.max()
    shares, weights = new[tells] / decaying[tells], weights[tells]
    order = np.argsort(shares)
    sums = weights[order].cumsum()
    return float(shares[order][np.searchsorted(sums, sums[-1] / 2)])
