"""How far the margins of the gains of `bank` may be from those that are wanted, and a verdict.

Near the crossover, coordinates that are off by d move the plant's response by ``s d`` (complex, of
its logarithm).  With ``l`` the slope of the loop's response by the logarithm of the frequency, the
crossover moves by ``-Re(s d) / Re(l)`` of itself, and the phase margin by
``Im(s d) + Im(l) (that shift)``.  Each hypothesis has a deviation of its own, and the largest one
counts of all that the windows do not speak strongly against, whatever their prior.  So
intervals hold for vehicle data that are right, or wrong as one of the bank's hypotheses has it; of
other errors they may know nothing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.recalibration.bank import Bank
from tuners.recalibration.hypotheses import Knowledge
from tuners.trust.intervals import GAUSSIAN
from tuners.trust.verdict import Verdict
from yawrate_env.plant.pi_loop import CROSSOVER_SCALE, PHASE_SCALE

Array = NDArray[np.float64]

LIMITS = np.array([0.3 * PHASE_SCALE, 0.6 * CROSSOVER_SCALE])
"""Distance from what the rule reaches, 3 deg and 0.15 Hz, from which gains should change."""

_CARE = 2.0  # times the limits
_STRONG = np.log(20.0)  # evidence against a hypothesis, beyond which it does not count
ORDER = tuple(Verdict)


@dataclass(frozen=True, slots=True, eq=False)
class Doubt:
    """Intervals and verdicts of B answers.

    Attributes
    ----------
    half : NDArray
        (B, 2) half widths of 90 % intervals of phase margin [deg] and crossover [Hz], around what
        the rule reaches, in the next window if friction does not jump.
    verdict : NDArray
        (B,) int, index in `ORDER`.
    """

    half: Array
    verdict: NDArray[np.intp]


def doubt(bank: Bank, known: Knowledge, gains: Array) -> Doubt:
    """Intervals and verdicts of gains (B, 2) that `Bank.gains` gave.

    Usable are gains whose intervals reach no further than 3 deg and 0.15 Hz, usable with care those
    within twice that.  They are refused before the first window, beyond that, and where the noise
    is one that the bank cannot represent.
    """
    target = bank.drives.target
    s = np.append(known.response[:, :-1], np.zeros((len(known), 1)), axis=1)
    turn = 2j * np.pi * target.crossover * gains[:, 1]
    slope = known.response[:, -1] - 1 / (1 + turn)
    shift = -s.real / slope.real[:, None]
    moved = np.stack([np.degrees(s.imag + slope.imag[:, None] * shift),
                      target.crossover * shift], axis=1)  # fmt: skip
    own = moved[:, :, bank.index]  # (B, 2, H, q)
    centre = (moved[:, :, :-1] * bank.point(known)[:, None]).sum(axis=2)
    off = (own * known.mean[:, None]).sum(axis=3) - centre[..., None]
    walk = (bank.drives.conditions.walk_rms[0] / np.exp(known.mean[..., 0])) ** 2
    spread = np.einsum("bmhi,bhij,bmhj->bmh", own, known.covariance, own)
    spread += own[..., 0] ** 2 * walk[:, None]
    evidence = known.weight - bank.prior
    counts = evidence > evidence.max(axis=1, keepdims=True) - _STRONG
    deviation = np.sqrt(np.where(counts[:, None], spread + off**2, 0.0).max(axis=2))
    times = GAUSSIAN * deviation / LIMITS
    worst = np.where(np.isfinite(times), times, np.inf).max(axis=1)
    worst[bank.foreign(known) | (known.response == 0).all(axis=1)] = np.inf
    verdict = np.searchsorted([1.0, _CARE], worst)
    return Doubt(GAUSSIAN * deviation, verdict)
