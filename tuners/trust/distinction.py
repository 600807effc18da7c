"""Parameters of a prior that an experiment does not tell apart, or does not show at all.

The Fisher information of the unknown parameters, in widths of their ranges, is set against what
the prior knows already: a uniform density of width one has the precision 12.  Along directions
with less information than that a recording says less than the prior.  A parameter whose own
information is less, all others known, does not show; of the others those that such a direction
mixes cannot be told apart.  Both may hold for some plants of the prior and not for others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.bound import PRECISION
from tuners.trust.identification import output_slopes
from yawrate_env.plant.episodes import sample
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PLANTS = 64
"""Plants of the prior that are looked at."""

_SEED = 23
_AT_ONCE = 4_000_000  # samples in memory
_MIXED = 0.1  # share of a direction by which a parameter belongs to it
_FEW, _OFTEN, _ALMOST = 0.1, 0.25, 0.95  # shares of the prior's plants
_NOISELESS = 1e-6  # of the output: smaller noise is that of rounding and differences


@dataclass(frozen=True, slots=True)
class Distinction:
    """What an experiment does not say of a plant's q unknown parameters.

    Attributes
    ----------
    names : tuple of str
        Labels of the parameters, without units.
    hidden : NDArray
        (q,) share of the prior's plants for which the parameter does not show.
    mixed : NDArray
        (q, q) share for which two parameters that show cannot be told apart.
    """

    names: tuple[str, ...]
    hidden: Array
    mixed: Array

    def sentences(self) -> tuple[str, ...]:
        """What to say of it, in the plant's words; nothing where all can be found."""
        return (*self._of_mixed(), *self._of_hidden())

    def _of_mixed(self) -> list[str]:
        said = []
        for group in _groups(self.mixed > _OFTEN):
            pairs = self.mixed[np.ix_(group, group)]
            share = float(pairs.max())
            found = "combination is found" if len(group) == 2 else "combinations are found"
            said.append(
                f"{_listed(self._named(group))} cannot be told apart by this experiment"
                f"{_for(share)}: only their {found}."
            )
        return said

    def _of_hidden(self) -> list[str]:
        said = []
        never = np.flatnonzero(self.hidden > _ALMOST)
        if len(never):
            verb = "does" if len(never) == 1 else "do"
            said.append(
                f"{_listed(self._named(never))} {verb} not show in this experiment: a recording "
                "says less than the prior does."
            )
        for i in np.flatnonzero((self.hidden > _FEW) & (self.hidden <= _ALMOST)):
            share = f"{1 - self.hidden[i]:.0%}"
            said.append(f"{self.names[i]} shows in some plants only: in {share} of the prior's.")
        return said

    def _named(self, indices: Sequence[int] | NDArray[np.intp]) -> list[str]:
        return [self.names[i] for i in indices]


def distinction(plant: Plant) -> Distinction:
    """What the plant's experiment does not say, by the information of some of its plants."""
    names = list(plant.prior)
    labels = tuple(split(plant.label(names[i]))[0] for i in plant.unknown)
    hidden, mixed = [], []
    for F in information(plant, sample(plant, PLANTS)):
        shows = np.diag(F) >= PRECISION
        hidden.append(~shows)
        mixed.append(_mixed(F, shows))
    return Distinction(labels, np.mean(hidden, axis=0), np.mean(mixed, axis=0))


def information(plant: Plant, theta: Array) -> Array:
    """Fisher information (B, q, q) of the unknown parameters in widths of their ranges."""
    u, q = plant.inputs(stream(_SEED, 0, len(theta), 1)[:, 0]), len(plant.unknown)
    size = max(_AT_ONCE // (max(2 * q, 1) * u.shape[1]), 1)
    found = []
    for i in range(0, len(theta), size):
        some, given = theta[i : i + size], u if len(u) == 1 else u[i : i + size]
        clean, slopes = plant.respond(some, given), output_slopes(plant, some, given)
        least = _NOISELESS * np.sqrt((clean**2).mean(axis=1))
        sigma = np.maximum(plant.sigma(clean), np.maximum(least, np.finfo(np.float64).tiny))
        scaled = slopes / sigma[:, None, None]
        found.append(scaled @ scaled.swapaxes(1, 2))
    return np.concatenate(found)


def _mixed(F: Array, shows: Flags) -> Flags:
    """Which pairs (q, q) of the parameters that show a direction of little information mixes.

    Directions are compared in units of the parameters' own information: those of a product are
    mixed in equal parts, however wide their ranges are.
    """
    pairs = np.zeros(F.shape, np.bool_)
    at = np.flatnonzero(shows)
    values, vectors = np.linalg.eigh(F[np.ix_(at, at)])
    weak = vectors[:, values < PRECISION] * np.sqrt(np.diag(F)[at])[:, None]
    if weak.shape[1]:
        basis, _ = np.linalg.qr(weak)
        together = np.abs(basis @ basis.T) > _MIXED
        for group in _groups(together):
            pairs[np.ix_(at[group], at[group])] = True
        np.fill_diagonal(pairs, False)
    return pairs


def _groups(linked: Flags) -> list[list[int]]:
    """Sets of two or more that are linked (q, q), directly or by others, in order."""
    left, found = set(range(len(linked))), []
    while left:
        group, new = set(), {min(left)}
        while new:
            group |= new
            new = {int(j) for i in new for j in np.flatnonzero(linked[i])} - group
        left -= group
        if len(group) > 1:
            found.append(sorted(group))
    return found


def _listed(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def _for(share: float) -> str:
    return "" if share > _ALMOST else f" in up to {share:.0%} of the prior's plants"
