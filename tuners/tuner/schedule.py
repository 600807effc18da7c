"""Gains over a measured parameter, such as a speed, from several recordings of one plant.

The plant fitted to all recordings has gains at every value of the parameter, by the design rule;
each value is answered as `Tuner.pool` answers it.  Where the recordings contradict the fitted plant
only their own gains are left, at the values where they were taken; between those, nothing but a
straight line is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners.tuner.method import Rung
from tuners.tuner.recording import Recording
from tuners.tuner.result import Result
from tuners.tuner.tuner import Tuner
from yawrate_env import validation
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

POINTS = 9
"""Values of the parameter, by default."""

_EDGE = 1e-9
_LINES = (
    "The gains are those of recordings at their own values; between these only a straight line "
    "can be drawn."
)
_CONTRADICTED = "No plant fitted to all recordings reproduces them."
_ALONE = "This tuner asks recordings alone, and fits no plant to all of them."


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """Gains over one measured parameter.

    Attributes
    ----------
    parameter : str
        Its name in the plant.
    values : NDArray
        (S,) increasing.
    results : tuple of Result
        One for each value.
    alone : bool
        Whether the results are those of recordings at their own values, and not of a plant
        fitted to all.
    interpolation : dict
        By the name of a counted metric: how far gains on a straight line between two values are
        off the design rule's, at most; ``nan`` where no fitted plant tells.
    notes : tuple of str
        What a user should know, in words.
    """

    parameter: str
    values: Array
    results: tuple[Result, ...]
    alone: bool
    interpolation: dict[str, float]
    notes: tuple[str, ...]

    @property
    def trusted(self) -> bool:
        """Whether the gains at every value are usable, with care or without."""
        return all(result.trusted for result in self.results)

    @property
    def gains(self) -> Array:
        """(S, k)."""
        return np.array([list(result.gains.values()) for result in self.results])


def schedule(
    tuner: Tuner,
    recordings: Sequence[Recording],
    values: ArrayLike | None = None,
    *,
    parameter: str | None = None,
    names: Sequence[str] = (),
    start: str = "auto",
) -> Schedule:
    """Gains over a measured parameter from several recordings of one plant.

    Parameters
    ----------
    tuner, recordings : Tuner, sequence of Recording
        For the plant; one recording each, with its measured parameters.
    values : (S,), optional
        Increasing values of the parameter; by default nine from the least to the largest of the
        recordings.
    parameter : str, optional
        Name of the measured parameter, where the plant has several.
    names : sequence of str, optional
        Of the recordings.
    start : str
        As for `Tuner.tune`.

    Raises
    ------
    ValueError
        A recording cannot be used, or does not know the parameter.
    """
    plant = tuner.plant
    validation.count("number of recordings", len(recordings), remedy="Give one or more.")
    chosen = _parameter(plant, parameter)
    taken = _taken(plant, recordings, chosen)
    names = list(names) or [f"recording {i + 1}" for i in range(len(recordings))]
    if Rung.FITTED_PLANT in tuner.method.rungs:
        grid = _grid(tuner, chosen, values, taken)
        ats = [{chosen: float(value)} for value in grid]
        results = tuner.pools(recordings, ats, names=names, start=start)
        if plant.loop_target is None or all(r.rung == Rung.FITTED_PLANT for r in results):
            notes = _beyond(plant, chosen, grid, taken)
            between = _interpolation(plant, chosen, grid, results)
            return Schedule(chosen, grid, results, False, between, notes)
        why = (_CONTRADICTED, *dict.fromkeys(w for r in results for w in r.left))
    else:
        why = (_ALONE,)
    return _of_recordings(tuner, recordings, chosen, taken, names, start, why)


def _parameter(plant: Plant, given: str | None) -> str:
    if not plant.measured:
        raise ValueError(
            "The plant has no measured parameters, so nothing to schedule over. Use "
            "`yawrate tune` with all logs."
        )
    if given is not None:
        return validation.one_of("parameter", given, tuple(plant.measured))
    if len(plant.measured) > 1 and len(plant.measured_names) != 1:
        raise ValueError(
            f"parameter is missing: the plant measures {', '.join(plant.measured)}. Choose one."
        )
    return (plant.measured_names or tuple(plant.measured))[0]


def _taken(plant: Plant, recordings: Sequence[Recording], name: str) -> Array:
    """Values (L,) of a parameter at which recordings were taken."""
    (i,) = plant.indices((name,))
    known = [np.nan if each.known is None else float(each.known[0, i]) for each in recordings]
    taken = np.array(known)
    if np.isnan(taken).any():
        first = int(np.flatnonzero(np.isnan(taken))[0])
        label = split(plant.label(name))[0]
        raise ValueError(
            f"recordings[{first}] has no {label}, and gains are wanted over it. Give what was "
            "measured with every recording."
        )
    return taken


def _grid(tuner: Tuner, name: str, values: ArrayLike | None, taken: Array) -> Array:
    """Values that the tuner was made for."""
    plant = tuner.plant
    (i,), slack = plant.indices((name,)), plant.measured[name]
    low, high = (float(end[i]) for end in plant.ranges)
    if values is None:
        first, last = (float(np.clip(end, low, high)) for end in (taken.min(), taken.max()))
        return np.unique(np.linspace(first, last, POINTS))
    grid = validation.finite_array("values", values, shape=(None,))
    if not len(grid) or (np.diff(grid) <= 0).any():
        raise ValueError(f"values = {grid.tolist()} must increase. Sort them, each once.")
    for end in grid[[0, -1]]:
        remedy = "The tuner was made for these: train one for more."
        validation.number(name, end, at_least=low - slack, at_most=high + slack, remedy=remedy)
    return grid


def _beyond(plant: Plant, name: str, grid: Array, taken: Array) -> tuple[str, ...]:
    """A note on values that no recording comes near."""
    low, high = taken.min() - plant.measured[name], taken.max() + plant.measured[name]
    outside = grid[(grid < low) | (grid > high)]
    label, unit = split(plant.label(name))
    if not len(outside):
        return ()
    run = f"{taken.min():.3g} to {taken.max():.3g} {unit}".rstrip()
    return (
        f"The recordings were taken at {label}s of {run}: beyond, at "
        f"{', '.join(f'{value:.3g}' for value in outside)} {unit}, the gains rest on the plant's "
        f"data alone for how it depends on the {label}.",
    )


def _interpolation(
    plant: Plant, name: str, grid: Array, results: Sequence[Result]
) -> dict[str, float]:
    """The most that straight lines between gains cost, in the counted metrics."""
    if len(grid) < 2:
        return dict.fromkeys(plant.counted, 0.0)
    gains = np.array([list(result.gains.values()) for result in results])
    theta = np.array([list(result.fit.parameters.values()) for result in results])
    middle = (theta[1:] + theta[:-1]) / 2
    middle[:, plant.indices((name,))[0]] = (grid[1:] + grid[:-1]) / 2
    reached = plant.metric_values(middle, (gains[1:] + gains[:-1]) / 2)
    right = plant.metric_values(middle, plant.oracle(middle))
    off = np.abs(reached - right).max(axis=0)
    return dict(zip(plant.counted, off.tolist(), strict=True))


def _of_recordings(
    tuner: Tuner,
    recordings: Sequence[Recording],
    name: str,
    taken: Array,
    names: Sequence[str],
    start: str,
    why: tuple[str, ...],
) -> Schedule:
    """Gains of recordings at their own values; those of one operating point are pooled."""
    plant, slack = tuner.plant, tuner.plant.measured[name]
    order = np.argsort(taken, kind="stable")
    breaks = np.flatnonzero(np.diff(taken[order]) > 2 * slack + _EDGE) + 1
    values, results = [], []
    for group in np.split(order, breaks):
        some = [recordings[k] for k in group]
        values.append(float(taken[group].mean()))
        results.append(tuner.pool(some, names=[names[k] for k in group], start=start))
    nothing = dict.fromkeys(plant.counted, float("nan"))
    return Schedule(name, np.array(values), tuple(results), True, nothing, (_LINES, *why))
