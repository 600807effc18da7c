"""Read a log file as a recording that a tuner can use."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tuners.logs import excitation, measured
from tuners.logs.actuator import through_actuator
from tuners.logs.columns import Quantity, find
from tuners.logs.excitation import Excitation
from tuners.logs.formats import read_table
from tuners.logs.options import Options
from tuners.logs.sampling import Plan, sampled
from tuners.logs.stretch import Whole, choose
from tuners.logs.table import Array, LogError, SelectionError, Table
from tuners.logs.time_base import pace_of
from yawrate_env.plant.plant import Plant


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """An evenly sampled stretch of a recording, in the plant's units.

    Attributes
    ----------
    source : str
        Name of the file.
    t0 : float
        Time of the first sample, as the recording counts it [s].
    u, y : NDArray
        (N,) input, held over a sampling time, and measured output.
    Ts : float
        Sampling time [s].
    measured : dict
        Measured parameters, (N,) each; their means count.
    notes : tuple of str
        What was found out or had to be done, in words.
    excitation : Excitation
        How the input excites the plant.
    recorded_Ts : float
        Sampling time of the file [s]; `Ts` is shorter after `through_actuator`.
    whole : Whole or None
        The whole recording, where this is a part of it.
    """

    source: str
    t0: float
    u: Array
    y: Array
    Ts: float
    measured: dict[str, Array]
    notes: tuple[str, ...]
    excitation: Excitation
    recorded_Ts: float
    whole: Whole | None = None

    @property
    def time(self) -> Array:
        """(N,) as the recording counts it [s]."""
        return np.asarray(self.t0 + self.Ts * np.arange(len(self.u), dtype=np.float64))

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.u) * self.Ts


def read_log(path: Path, plant: Plant, options: Options | None = None) -> Log:
    """Read a recording of a plant, in its units.

    Parameters
    ----------
    path : Path
        In any known format, which its first bytes tell; a pipe is read once.
    plant : Plant
        Columns are recognised by the names of its signals and measured parameters, their labels
        and synonyms.
    options : Options, optional
        What the file does not say.

    Raises
    ------
    LogError
        The recording cannot be used; the message says why.
    SelectionError
        It has no such column or stretch, or the plant no such parameter.
    """
    options = options or Options()
    return log_of(read_table(path, options.dbc), plant, options)


def log_of(table: Table, plant: Plant, options: Options) -> Log:
    """The recording of a plant in a table that was read; errors name its file."""
    try:
        return _log(table, plant, options)
    except (LogError, SelectionError) as error:
        raise type(error)(f"{table.source}: {error}") from None


def _log(table: Table, plant: Plant, options: Options) -> Log:
    found = find(table, plant, options)
    base, signals, lost = sampled(found.quantities, _plan(found.quantities, plant, options))
    chosen = choose(base, signals, plant, options)
    part = chosen.part
    signals = {role: values[part] for role, values in signals.items()}
    u, y = signals.pop("input"), signals.pop("output")
    parameters, assumed = measured.parameters(plant, signals, found.values, len(u))
    excited = excitation.check(plant, u, y, parameters, base.Ts)
    notes = (
        *table.notes,
        *lost,
        *found.notes,
        *base.notes,
        *chosen.notes,
        *assumed,
        *excited.notes,
    )
    t0 = float(base.grid[part.start])
    log = Log(
        table.source.name, t0, u, y, base.Ts, parameters, notes, excited, base.Ts, chosen.whole
    )
    return log if options.input_is == "command" else _whole_plant(log, plant)


def _plan(found: dict[str, Quantity], plant: Plant, options: Options) -> Plan:
    """How the quantities come to one grid; a nonlinear plant's recording starts at rest."""
    return Plan(
        clock="output",
        least=excitation.SHORTEST * len(plant.u) * plant.Ts,
        pace=pace_of(plant),
        held=("input",) if options.input_is == "command" else (),
        slow=tuple(name for name in plant.measured if name in found),
        Ts=options.Ts,
        begin=None if plant.linear else -np.inf if options.start is None else options.start,
    )


def _whole_plant(log: Log, plant: Plant) -> Log:
    """A log of commands from one of measured actuator positions."""
    u, y, Ts, parts = through_actuator(log.u, log.y, log.Ts, plant)
    note = f"Measured {plant.signals[0]}: the output was filtered through the actuator."
    return replace(
        log,
        u=u,
        y=y,
        Ts=Ts,
        measured={name: np.repeat(values[:-1], parts) for name, values in log.measured.items()},
        notes=(*log.notes, note),
    )
