"""Read a log file as a recording that a tuner can use."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tuners.logs import excitation, measured
from tuners.logs.actuator import through_actuator
from tuners.logs.columns import channels, find
from tuners.logs.excitation import Excitation
from tuners.logs.formats import read_table
from tuners.logs.options import Options
from tuners.logs.quantities import Quantity
from tuners.logs.sampling import Plan, sampled
from tuners.logs.stretch import Whole, anytime, choose
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
        (N,) input and measured output; a row for each of several.
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
    input : {"held", "lines"}
        How the input runs between its samples.
    reference : NDArray or None
        (N,) reference of the loop, where a column was named, or the gains of its controller.
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
    input: str = "held"
    reference: Array | None = None
    whole: Whole | None = None

    @property
    def time(self) -> Array:
        """(N,) as the recording counts it [s]."""
        return np.asarray(self.t0 + self.Ts * np.arange(self.u.shape[-1], dtype=np.float64))

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.u.shape[-1] * self.Ts)


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
    """The recording of a plant in a table that was read; errors name its file.

    Parameters
    ----------
    table, plant : Table, Plant
        Columns, and whose signals are looked for in them.
    options : Options
        What the columns' names and units do not say.
    """
    try:
        return _log(table, plant, options)
    except (LogError, SelectionError) as error:
        raise type(error)(f"{table.source}: {error}") from None


def _log(table: Table, plant: Plant, options: Options) -> Log:
    _check_reference(options)
    if plant.channels is not None and (options.drove or "reference" in options.columns):
        raise SelectionError("--reference is for plants with one input and one output.")
    found = find(table, plant, options)
    base, signals, lost = sampled(found.quantities, _plan(found.quantities, plant, options))
    chosen = choose(base, signals, plant, options)
    part = chosen.part
    signals = {role: values[part] for role, values in signals.items()}
    reference = signals.pop("reference", None)
    u, y = (_rows(plant, role, signals) for role in ("input", "output"))
    parameters, assumed = measured.parameters(plant, signals, found.values, u.shape[-1])
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
    hold = "held" if options.input_is == "measured" else options.between or plant.input
    log = Log(
        table.source.name, t0, u, y, base.Ts, parameters, notes, excited, base.Ts, hold, reference,
        chosen.whole,
    )  # fmt: skip
    if options.drove is not None:
        log = replace(log, reference=_rebuilt(log, plant, options.drove))
    return log if options.input_is == "command" else _whole_plant(log, plant)


def _rows(plant: Plant, role: str, signals: dict[str, Array]) -> Array:
    """Input or output (N,), or a row for each of several, taken out of the signals."""
    rows = [signals.pop(key) for key in channels(plant, role)]
    return rows[0] if plant.channels is None else np.stack(rows)


def _held(plant: Plant, options: Options) -> bool:
    """Whether the input's column keeps its value until the next row."""
    return options.input_is == "command" and (options.between or plant.input) == "held"


def _check_reference(options: Options) -> None:
    """Refuse options of a closed loop that contradict each other."""
    named = "reference" in options.columns
    if not named and options.drove is None:
        return
    flag = "--reference" if named else "--old-kp"
    if named and options.drove is not None:
        raise SelectionError(
            f"--reference {options.columns['reference']} and --old-kp contradict each other: the "
            "reference need not be rebuilt. Leave out one of the two."
        )
    if options.input_is != "command":
        raise SelectionError(
            f"{flag} and --input-is measured contradict each other: in a closed loop the "
            "controller's command is needed. Name its column with --input-column."
        )


def _rebuilt(log: Log, plant: Plant, gains: tuple[float, float]) -> Array:
    """The reference of a log, from the gains of the controller that drove."""
    from tuners.trust.feedback import rebuilt

    target = plant.parametrisation.target
    if target is None:
        raise SelectionError("--old-kp: this tuner's plant has no PI. Give --reference COLUMN.")
    return rebuilt(log.u, log.y, log.Ts, gains, target)


def _plan(found: dict[str, Quantity], plant: Plant, options: Options) -> Plan:
    """How the quantities come to one grid; some plants' recordings start at rest."""
    return Plan(
        clock="output",
        least=excitation.SHORTEST * plant.samples * plant.Ts,
        pace=pace_of(plant),
        held=(*channels(plant, "input"), "reference") if _held(plant, options) else (),
        slow=tuple(name for name in plant.measured if name in found),
        Ts=options.Ts,
        begin=None if anytime(plant) else -np.inf if options.start is None else options.start,
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
