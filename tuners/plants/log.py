"""A plant's recording from a log file in any format that `tuners.logs` reads.

What is known of a vehicle's signals, their names and units and what a car can do, is not known
of a plant's; all else is done to its log as to a vehicle's.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tuners.logs import columns
from tuners.logs.columns import Choice, Quantity
from tuners.logs.excitation import band_around
from tuners.logs.formats import read_table
from tuners.logs.log import best_excited, between
from tuners.logs.sampling import Plan, sampled
from tuners.logs.table import LogError, SelectionError, Table
from tuners.logs.time_base import Pace, TimeBase
from tuners.plants.plant import Plant
from tuners.plants.tuner import slowest
from tuners.plausible import STEADY, UNSTEADY
from yawrate_env import validation

Array = NDArray[np.float64]

SHORTEST, LONGEST = 0.3, 2.0
"""How much of a recording is used at least and, unless a stretch is chosen, at most, in lengths
of the experiment."""

_FASTEST = 1 / 500  # sampling time, in the plant's
_BRIDGED = 0.5  # a step that is interpolated over, in the slowest sampling time


@dataclass(frozen=True, slots=True)
class PlantOptions:
    """What the user says about a plant's recording; what is not said is found out.

    Attributes
    ----------
    choice : Choice
        Columns of ``input``, ``output`` and ``time``, and the unit of time.
    input_scale, output_scale : float
        What a column is multiplied by to be in the plant's unit and sign.
    measured : dict
        Measured parameters to their values, or to the columns whose means they are.
    Ts : float or None
        Sampling time [s], where there is no time column or it is not to be used.
    start, stop : float or None
        Stretch to use, in the recording's own time [s].
    """

    choice: Choice = field(default_factory=Choice)
    input_scale: float = 1.0
    output_scale: float = 1.0
    measured: Mapping[str, float | str] = field(default_factory=dict)
    Ts: float | None = None
    start: float | None = None
    stop: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlantLog:
    """An evenly sampled stretch of a recording, in the plant's units.

    Attributes
    ----------
    source : str
        Name of the file.
    t0 : float
        Time of the first sample, as the recording counts it [s].
    Ts : float
        Sampling time [s].
    u, y : NDArray
        (N,) input, held over a sampling time, and measured output.
    measured : dict
        Parameters that were measured beside them.
    notes : tuple of str
        What was found out or had to be done, in words.
    """

    source: str
    t0: float
    Ts: float
    u: Array
    y: Array
    measured: dict[str, float]
    notes: tuple[str, ...]

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.u) * self.Ts


def read_log(path: Path, plant: Plant, options: PlantOptions | None = None) -> PlantLog:
    """Read a recording for a plant's tuner.

    Columns are called as the plant calls its signals and parameters, or u and y.

    Raises
    ------
    LogError
        It cannot be used; the message says why.
    SelectionError
        It has no such column or stretch, or the plant no such parameter.
    """
    options = options or PlantOptions()
    given = _given(plant, options.measured)
    table = read_table(path)
    found = _found(table, plant, options)
    beside = tuple(name for name in plant.measured if name in found)
    length = len(plant.u) * plant.Ts
    limit = slowest(plant)
    pace = Pace(_FASTEST * plant.Ts, limit, _BRIDGED * limit)
    begin = None if plant.linear else -np.inf if options.start is None else options.start
    plan = Plan("output", SHORTEST * length, ("input",), beside, options.Ts, pace, begin)
    base, signals, lost = sampled(found, plan)
    part, chosen = _stretch(base, signals, beside, plant, options, LONGEST * length)
    u, y = signals["input"][part], signals["output"][part]
    _check_moving(u, y, plant)
    means, varied = _means(plant, {n: signals[n][part] for n in beside})
    measured = means | given
    _check_complete(plant, measured)
    return PlantLog(
        path.name, float(base.grid[part.start]), base.Ts, u, y, measured,
        (*table.notes, *lost, *base.notes, *chosen, *varied),
    )  # fmt: skip


def _given(plant: Plant, measured: Mapping[str, float | str]) -> dict[str, float]:
    """Numbers that the user measured; only what the plant calls measured can be."""
    for name in measured:
        if not plant.measured:
            raise SelectionError(f"--measured {name}: nothing is measured beside this plant.")
        try:
            validation.one_of("--measured", name, tuple(plant.measured))
        except ValueError as error:
            raise SelectionError(str(error)) from None
    return {name: value for name, value in measured.items() if not isinstance(value, str)}


def _found(table: Table, plant: Plant, options: PlantOptions) -> dict[str, Quantity]:
    """Quantities by role, in the plant's units; measured parameters by their names."""
    names = {_plain(name): name for name in reversed(table.names)}
    scales = {"input": options.input_scale, "output": options.output_scale}
    wanted = {role: (_plain(signal), short) for role, signal, short in
              zip(scales, plant.signals, "uy", strict=True)}  # fmt: skip
    time = columns.of_role("time", table, options.choice)
    found = {} if time is None else {"time": time}
    for role, called in wanted.items():
        chosen = options.choice.columns.get(role)
        name = next((names[n] for n in called if n in names), None)
        name = name if chosen is None else columns.named(chosen, role, table.names)
        if name is None:
            raise LogError(
                f"No column is called {' or '.join(dict.fromkeys(called))}; there are "
                f"{columns.listed(table.names)}. Name one with --{role}-column."
            )
        found[role] = _quantity(table, name, scales[role])
    if found["input"].name == found["output"].name:
        raise SelectionError(f"Input and output are both column {found['input'].name}.")
    for parameter in plant.measured:
        given = options.measured.get(parameter)
        if isinstance(given, str):
            found[parameter] = _quantity(table, columns.named(given, parameter, table.names))
        elif given is None and _plain(parameter) in names:
            found[parameter] = _quantity(table, names[_plain(parameter)])
    return found


def _quantity(table: Table, name: str, scale: float = 1.0) -> Quantity:
    column = table.column(name)
    return Quantity(name, "", scale * column.values, column.time)


def _stretch(
    base: TimeBase,
    signals: dict[str, Array],
    beside: tuple[str, ...],
    plant: Plant,
    options: PlantOptions,
    longest: float,
) -> tuple[slice, list[str]]:
    """What was chosen, or the best-excited part; a plant that starts from rest starts there."""
    if options.start is not None or options.stop is not None:
        return between(base.grid, options.start, options.stop), []
    if not plant.linear:
        return slice(0, len(base.grid)), []
    band = None if plant.crossover is None else band_around(plant.crossover)
    return best_excited(base, signals["input"], [signals[n] for n in beside], band, longest)


def _check_moving(u: Array, y: Array, plant: Plant) -> None:
    """Refuse what can tell nothing; a constant input is a step if that is the experiment."""
    still = np.ptp(u) == 0 and (u[0] == 0 or np.ptp(plant.u) > 0)
    if still:
        raise LogError(f"{plant.signals[0]} is constant ({u[0]:.3g}): nothing moves.")
    if np.ptp(y) == 0:
        raise LogError(f"{plant.signals[1]} is constant ({y[0]:.3g}): is it the right one?")


def _check_complete(plant: Plant, measured: dict[str, float]) -> None:
    for name in plant.shown_names:
        if name not in measured:
            low, high = plant.prior[name]
            raise LogError(
                f"No column is called {name}, and this tuner covers {low:g} to {high:g}. "
                f"Give what was measured, as in --measured {name}={high:g}."
            )


def _means(plant: Plant, signals: dict[str, Array]) -> tuple[dict[str, float], list[str]]:
    """Means of measured parameters, and notes on those that are not quite steady."""
    means, notes = {}, []
    for name, values in signals.items():
        low, high = plant.prior[name]
        mean = float(values.mean())
        whole, words = (abs(mean), "its mean") if low > 0 else (high - low, "the prior's range")
        variation = float(np.ptp(values)) / whole if whole > 0 else 0.0
        if variation > UNSTEADY:
            raise LogError(
                f"{name} varies from {values.min():.3g} to {values.max():.3g}, more than "
                f"{UNSTEADY:.0%} of {words}. Choose a steadier stretch with --from and --to."
            )
        if variation > STEADY:
            notes.append(f"{name} varies by {variation:.0%} of {words}, which counts.")
        means[name] = mean
    return means, notes


def _plain(signal: str) -> str:
    """A name without its unit, in lower case."""
    return re.sub(r"[\[(].*?[\])]", "", signal).strip().lower()
