"""Remarks on each of several recordings: shares and disagreements."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tuners.trust.fit import Fit
from tuners.trust.intervals import GAUSSIAN
from tuners.trust.suspects import explanations
from tuners.tuner import notes as of_one
from tuners.tuner.ladder import differs
from tuners.tuner.look import Look
from tuners.tuner.method import Rung
from tuners.tuner.pooling.agreement import CHANCE, Estimates
from tuners.tuner.pooling.pool import DISAGREE, Pool
from tuners.tuner.pooling.share import Share
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_NONE_AGREE = (
    "No two recordings show one plant: it changed between them, or its data are wrong in a way "
    "that differs over their operating points."
)
_TELLING = 3.0  # standard deviations by which a parameter differs


def shares(plant: Plant, looks: Sequence[Look], pool: Pool, alone: bool) -> tuple[Share, ...]:
    """What each recording of the first set adds, and how far it agrees.

    Parameters
    ----------
    alone : bool
        Whether nobody asked about the plant's parameters.
    """
    found = []
    for i, look in enumerate(looks):
        apart = bool(pool.apart[i, 0])
        among = ~pool.apart[:, 0] & (np.arange(len(looks)) != i)
        others = [one.fit for one, agrees in zip(looks, among, strict=True) if agrees]
        found.append(
            Share(
                name=look.name,
                measured=measured(plant, look),
                share=float(pool.shares[i, 0]),
                chi_square=float(pool.chi_square[i, 0]),
                freedom=pool.freedom,
                chance=float(pool.chance[i, 0]),
                agrees=not apart,
                shift=dict(zip(plant.counted, pool.shift[i, 0].tolist(), strict=True)),
                parameters={} if alone else parameters(plant, look),
                causes=causes(plant, look, others) if apart and not alone else (),
            )
        )
    return tuple(found)


def measured(plant: Plant, look: Look) -> dict[str, float]:
    """Measured parameters of a recording, by name."""
    return {name: float(look.theta[0, plant.indices((name,))[0]]) for name in plant.measured}


def parameters(plant: Plant, look: Look) -> dict[str, float]:
    """Parameters of the plant fitted to a recording alone, by name."""
    return dict(zip(plant.prior, look.fit.theta[0].tolist(), strict=True))


def causes(plant: Plant, look: Look, others: Sequence[Fit]) -> tuple[str, ...]:
    """Why a recording differs from others, in words: unknown parameters, or what is suspected."""
    said: list[str] = []
    if others and look.fit.converged[0]:
        found = Estimates.of_fits([look.fit, *others], plant.unknown, plant.width)
        (own, G), (all_, H) = (
            (found.right[0, 0], found.information[0, 0]),
            (found.right[1:, 0].sum(axis=0), found.information[1:, 0].sum(axis=0)),
        )
        P, Q = np.linalg.pinv(G, hermitian=True), np.linalg.pinv(H, hermitian=True)
        apart = np.abs(P @ own - Q @ all_) / np.sqrt(np.maximum(np.diag(P + Q), 1e-300))
        for k, i in enumerate(plant.unknown):
            if apart[k] > _TELLING:
                label, unit = split(plant.label(list(plant.prior)[i]))
                values = ((P @ own)[k] * plant.width[k], (Q @ all_)[k] * plant.width[k])
                here, there = (f"{value:.3g}" for value in values)
                said.append(f"{label} {here} instead of {there} {unit}".rstrip())
    words = [f"Fitted alone it has {' and '.join(said)}."] if said else []
    if look.response is not None and not look.still[0] and _contradicted(look):
        words += explanations(plant, look.model, look.fit, 0)
    return tuple(words)


def _contradicted(look: Look) -> bool:
    """Whether the plant does not reproduce even this recording alone, beyond chance."""
    from scipy.stats import chi2

    model, residual = look.model, look.fit.residual[0]
    noise = max(float(model.residual[0]) / len(residual) * model.oversampled, 1e-300)
    excess = (float((residual**2).sum()) - float(model.residual[0])) / noise
    return excess > float(chi2.isf(CHANCE, model.functions.order))


def left(plant: Plant, looks: Sequence[Look], pool: Pool) -> tuple[str, ...]:
    """Why the fitted plant does not answer, in words."""
    climbed, found = pool.climbed, pool.assessment
    if climbed.rung[0] < Rung.BLACK_BOX or found.response is None:
        return ()
    if not (GAUSSIAN * found.spread[0] <= plant.metric_setting("widest")).all():
        return ()  # so little is known that no difference means anything
    excess = [
        float((fit.residual[0] ** 2).sum() / max(float(look.model.residual[0]), 1e-300))
        for look, fit in zip(looks, pool.joint.fits, strict=True)
    ]
    worst = int(np.argmax(excess))
    words = explanations(plant, looks[worst].model, pool.joint.fits[worst], 0)
    return tuple(f"{looks[worst].name}: {word}" for word in words) or differs(
        plant, climbed, found.response, 0
    )


def notes(
    plant: Plant,
    looks: Sequence[Look],
    pool: Pool,
    found: Sequence[Share],
    any_experiment: bool,
) -> tuple[str, ...]:
    """Notes on the recordings; those that hold for all are said once.

    A disagreement that matters is a reason, any other a note.
    """
    every = [
        of_one.notes(plant, look.given, fit, 0, any_experiment)
        for look, fit in zip(looks, pool.joint.fits, strict=True)
    ]
    common = [note for note in every[0] if all(note in each for each in every)]
    own = [
        f"{look.name}: {note}"
        for look, each in zip(looks, every, strict=True)
        for note in each
        if note not in common
    ]
    (check,) = (c for c in pool.assessment.checks(0) if c.name == DISAGREE)
    differ = disagreements(found) if check.passed else ()
    return (*differ, *common, *own)


def disagreements(found: Sequence[Share]) -> tuple[str, ...]:
    """Which recordings differ, and how, in words; of two both do."""
    apart = [share for share in found if not share.agrees]
    if len(apart) == len(found) > 2:
        return (_NONE_AGREE,)
    if len(found) == 2:
        return tuple(each.sentence(found[1].name) for each in apart[:1])
    return tuple(share.sentence() for share in apart)
