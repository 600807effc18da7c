"""What would bring a tuner nearer to the bound, as its errors on simulated plants show."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.against_bound import ENOUGH, Errors
from tuners.tuner.recipes import Candidate
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_HELPS = 0.9  # times the error: less is no help
_DECADE = 10.0  # ends of a uniform prior that leave few plants at the low one
_MOST = 32  # times the plants: more is no advice
_OTHER = "excite more strongly, or record for longer"


def remedy(plant: Plant, errors: Errors, grown: Sequence[Candidate]) -> str:
    """What helps, in a clause.

    Parameters
    ----------
    errors : Errors
        Of who answers.
    grown : sequence of Candidate
        Those of a search, whose plants became more.
    """
    if _random(plant):
        return (
            "the simulator is random in itself, which the bound does not count and no recipe can "
            "undo"
        )
    found = [said for said in (_narrower(plant, errors), _more(grown)) if said]
    same = len({each.sizes.plants for each in grown}) == 1  # nothing tells whether more would help
    return ", or ".join(found) or ("simulate more plants (--episodes), " * same + _OTHER)


def _random(plant: Plant) -> bool:
    """Whether the simulator uses random numbers."""
    quiet, loud = (plant.respond(plant.middle, rng=r) for r in (None, np.random.default_rng(0)))
    return not np.array_equal(quiet, loud)


def _narrower(plant: Plant, errors: Errors) -> str:
    """Which end of a parameter's prior to leave out, or to draw more plants from; else nothing."""
    largest = errors.ratio().max()
    least, said = _HELPS * largest, ""
    for i in plant.unknown.tolist():
        name = list(plant.prior)[i]
        low, high = plant.prior[name]
        values = errors.theta[:, i]
        ends = {"below": np.quantile(values, 0.25), "above": np.quantile(values, 0.75)}
        for where, end in ends.items():
            rows = np.flatnonzero(values >= end if where == "below" else values <= end)
            ratio = errors.ratio(rows).max()
            if not ratio < least:
                continue
            bare, unit = split(plant.label(name))
            if not plant.shapes[i].kind and where == "below" and high >= _DECADE * low > 0:
                said = f"give {bare} a log-uniform prior: of its low end a uniform one draws few"
            else:
                limit = f"{bare} {where} {end:.2g} {unit}".rstrip()
                said = f"narrow the prior: without {limit} it is {ratio:.2f}"
            least = ratio
    return said


def _more(grown: Sequence[Candidate]) -> str:
    """How many plants to simulate, as the candidates' errors fall with their number."""
    first, last = grown[0], grown[-1]
    fewer, more = first.sizes.plants or 0, last.sizes.plants or 0
    excess = [each.worst**2 - 1 for each in (first, last)]
    if fewer >= more or not 0 < excess[1] < _HELPS * excess[0]:
        return ""
    rate = np.log(excess[0] / excess[1]) / np.log(more / fewer)
    times = (excess[1] / (ENOUGH**2 - 1)) ** (1 / rate)
    if times > _MOST:
        return ""
    count = float(f"{more * max(times, 2.0):.1g}")
    return f"simulate more plants, about {count:.0f} (--episodes {count:.0f})"
