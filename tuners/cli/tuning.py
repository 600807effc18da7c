"""From logs to results: what `yawrate tune` and `yawrate schedule` share."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TypeVar

import click

from tuners.cli.log_files import logs_of, recordings, wanted
from tuners.cli.sources import load_tuner, plant_from
from tuners.cli.target_options import Changes, changed
from tuners.logs import Log, MissingParameterError, Options, Table, log_of, read_table
from tuners.trust.black_box import STARTS
from tuners.tuner.result import Result
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.plant import Plant

T = TypeVar("T")

DEFAULT = "ts-ff-lag-vx"
WITHOUT = "bb"
FITTED = "gb"
"""What tunes by default, what does without a measured parameter, and what any plant has."""

start_option = click.option(
    "--start",
    type=click.Choice(STARTS),
    default="auto",
    show_default=True,
    help="Whether the recording starts from rest without offsets, at an operating point (offset), "
    "or anyhow; auto decides by the data.",
)
tuner_option = click.option(
    "--tuner",
    metavar="NAME|FILE",
    help="A tuner that the package ships, or a file of `yawrate train`; by default "
    f"{DEFAULT}, or {WITHOUT} where the log gives no speed.",
)


def loading(vehicle: Path | None) -> Callable[[str], Tuner]:
    """What loads a tuner by its name, for the plant of a file if one is given."""
    if vehicle is None:
        return load_tuner
    plant = plant_from(vehicle)
    return lambda name: load_tuner(name, plant)


def tuner_and_log(
    path: Path, options: Options, name: str | None, load: Callable[[str], Tuner] = load_tuner
) -> tuple[str, Tuner, Log]:
    """The tuner's name, the tuner and a log; by default the one that the log suffices for."""
    load = cache(load)
    load(name or DEFAULT)  # a wrong name is told before the file, which may be long, is read
    return tuner_for(read_table(path, options.dbc), options, name, load)


def tuner_for(
    table: Table, options: Options, name: str | None, load: Callable[[str], Tuner] = load_tuner
) -> tuple[str, Tuner, Log]:
    """The same for a log that was read."""
    return _sufficient(name, load, lambda plant: log_of(table, plant, options))


def several_logs(
    paths: Sequence[Path],
    options: Options,
    name: str | None,
    load: Callable[[str], Tuner] = load_tuner,
) -> tuple[str, Tuner, list[Log]]:
    """The tuner's name, the tuner, and all logs; by default one for which all of them suffice."""
    load = cache(load)
    load(name or DEFAULT)
    tables = [read_table(path, options.dbc) for path in paths]
    return _sufficient(name, load, lambda plant: logs_of(tables, plant, options))


def _sufficient(
    name: str | None, load: Callable[[str], Tuner], read: Callable[[Plant], T]
) -> tuple[str, Tuner, T]:
    """A tuner and what is read for its plant; by default the one that the logs suffice for."""
    chosen = name or DEFAULT
    trained = load(chosen)
    try:
        return chosen, trained, read(trained.plant)
    except MissingParameterError:
        if name is not None:
            raise
    trained = load(WITHOUT)
    return WITHOUT, trained, read(trained.plant)


def pooled(
    tuner: Tuner, logs: Sequence[Log], options: Options, start: str, validated: bool
) -> Result:
    """The result for several logs, their notes included; the last one may validate."""
    given = recordings(tuner.plant, logs)
    further = given.pop() if validated else None
    result = tuner.pool(
        given,
        wanted(tuner.plant, options),
        names=[log.source for log in logs],
        validate=further,
        start=start,
    )
    notes = tuple(f"{log.source}: {note}" for log in logs for note in log.notes)
    return replace(result, notes=(*notes, *result.notes))


def for_loop(tuner: Tuner, changes: Changes, answered: Callable[[Tuner], Result]) -> Result:
    """A tuner's result, or with changes that for another loop, which is no more certain."""
    if not changes:
        return answered(tuner)
    target = changed(tuner.plant, changes)
    before = answered(tuner)
    return answered(tuner.for_target(target, before.rung)).after(before)


def tuned(tuner: Tuner, log: Log, start: str, input_scale: float) -> Result:
    """The result for a log, its notes and hints included."""
    from tuners.cli.hints import Array, hints

    def tune(u: Array, y: Array, measured: dict[str, Array]) -> Result:
        return tuner.tune(u, y, log.Ts, measured, start, log.input)

    try:
        if log.reference is None:
            result = tune(log.u, log.y, log.measured)
            advice = hints(tune, log, result, input_scale)
        else:
            result = tuner.tune(log.u, log.y, log.Ts, log.measured, start, log.input, log.reference)
            advice = ()
    except ValueError as error:
        raise ValueError(f"{log.source}: {error}") from None
    return replace(result, notes=(*log.notes, *result.notes, *advice))
