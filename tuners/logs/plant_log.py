"""A plant's recording from a log file in any format that `tuners.logs` reads.

What a vehicle's signals are called and what a car can do is not known of a plant's; all else is
done to its log as to a vehicle's.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tuners.logs.columns import Choice, Quantity, listed, named, of_role
from tuners.logs.excitation import band_around
from tuners.logs.formats import read_table
from tuners.logs.log import best_excited, between
from tuners.logs.plant_columns import Wanted, column_of, plain, quantity
from tuners.logs.sampling import Plan, sampled
from tuners.logs.table import LogError, SelectionError, Table
from tuners.logs.time_base import Pace, TimeBase
from tuners.tuner.plant_tuner import slowest
from yawrate_env import validation
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.plausible import STEADY, UNSTEADY

Array = NDArray[np.float64]

SIGNALS = "input", "output"

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
        Columns and units of ``input``, ``output`` and ``time``.
    input_scale, output_scale : float
        What a column is multiplied by, once it is in the plant's unit.
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

    Parameters
    ----------
    path : Path
        CSV, MATLAB, Parquet or MDF, told apart by their first bytes.
    plant : Plant
        That of the tuner, in whose units the recording is wanted.
    options : PlantOptions, optional
        What the log does not say.

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
    found, converted = _found(table, plant, options, given)
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
    measured = means | {n: v for n, v in given.items() if not isinstance(v, str)}
    _check_complete(plant, measured)
    return PlantLog(
        path.name, float(base.grid[part.start]), base.Ts, u, y, measured,
        (*table.notes, *lost, *converted, *base.notes, *chosen, *varied),
    )  # fmt: skip


def _given(plant: Plant, measured: Mapping[str, float | str]) -> dict[str, float | str]:
    """What the user measured, its unit named or not; only what the plant calls measured can be."""
    whole = {plain(name): name for name in plant.measured}
    given: dict[str, float | str] = {}
    for name, value in measured.items():
        if not plant.measured:
            raise SelectionError(f"--measured {name}: nothing is measured beside this plant.")
        meant = name if name in plant.measured else whole.get(plain(name), name)
        if meant in given:
            raise SelectionError(f"--measured {meant} is given twice.")
        try:
            given[validation.one_of("--measured", meant, tuple(plant.measured))] = value
        except ValueError as error:
            raise SelectionError(str(error)) from None
    return given


def _found(
    table: Table, plant: Plant, options: PlantOptions, given: Mapping[str, float | str]
) -> tuple[dict[str, Quantity], list[str]]:
    """Quantities by role, in the plant's units, and notes; measured parameters by their names."""
    time = of_role("time", table, options.choice)
    found, notes = {} if time is None else {"time": time}, []
    scales = options.input_scale, options.output_scale
    for role, signal, short, scale in zip(SIGNALS, plant.signals, "uy", scales, strict=True):
        name = _column(table, role, (signal, short), options.choice)
        wanted = Wanted(signal, f"--{role}", options.choice.units.get(role, ""), scale)
        found[role], words = quantity(table, name, wanted)
        notes += words
    if found["input"].name == found["output"].name:
        raise SelectionError(f"Input and output are both column {found['input'].name}.")
    for parameter in plant.measured:
        meant = given[parameter] if parameter in given else column_of(parameter, table)
        if isinstance(meant, str):
            column = named(meant, parameter, table.names)
            found[parameter], words = quantity(table, column, Wanted(parameter))
            notes += words
    return found, notes


def _column(table: Table, role: str, names: tuple[str, str], choice: Choice) -> str:
    """The column that the user chose, or that has one of the names."""
    chosen = choice.columns.get(role)
    if chosen is not None:
        return named(chosen, role, table.names)
    found = next((column for column in (column_of(n, table) for n in names) if column), None)
    if found is None:
        words = " or ".join(dict.fromkeys(split(name)[0] for name in names))
        raise LogError(
            f"No column is called {words}; there are {listed(table.names)}. Name one with "
            f"--{role}-column."
        )
    return found


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
    for name in plant.measured_names:
        if name not in measured:
            (low, high), (words, unit) = plant.prior[name], split(name)
            made = f"{low:g} to {high:g} {unit}".rstrip()
            raise LogError(
                f"No column is called {words}, and this tuner covers {made}. "
                f"Give what was measured, as in --measured {words}={high:g}."
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
