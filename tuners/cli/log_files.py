"""Logs that commands are given as files or folders, and several of them read for one tuner."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from tuners.logs import Log, MissingParameterError, Options, Table, log_of, read_table
from tuners.tuner.recording import Recording
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

ENDINGS = (
    ".csv", ".txt", ".tsv", ".dat", ".mat", ".parquet", ".pq", ".mf4", ".mdf", ".gz", ".bz2",
    ".xz", ".zip", ".xlsx", ".feather", ".h5", ".hdf5", ".mcap", ".blf", ".asc",
)  # fmt: skip
"""Files of a folder that are taken for logs."""

LOGS = click.Path(exists=True, path_type=Path)


def log_files(given: Sequence[Path]) -> list[Path]:
    """Files, and those in folders by name; each once."""
    found: list[Path] = []
    for path in given:
        found += _inside(path) if path.is_dir() else [path]
    seen: dict[Path, Path] = {}
    for path in found:
        real = path.resolve()
        if real in seen:
            raise click.UsageError(
                f"{path} is given twice: one log's information counts once. Leave one out."
            )
        seen[real] = path
    return found


def _inside(folder: Path) -> list[Path]:
    files = sorted(
        path
        for path in folder.iterdir()
        if path.is_file() and path.suffix.lower() in ENDINGS and not path.name.startswith(".")
    )
    if not files:
        raise click.UsageError(
            f"{folder} holds no logs: no file in it ends in {', '.join(ENDINGS[:7])} or similar. "
            "Name the files."
        )
    return files


def read_each(paths: Sequence[Path], plant: Plant, options: Options) -> list[Log]:
    """Several logs of one plant."""
    return logs_of([read_table(path, options.dbc) for path in paths], plant, options)


def logs_of(tables: Sequence[Table], plant: Plant, options: Options) -> list[Log]:
    """The same of logs that were read.

    A measured parameter that the user gave as a number is that of logs without a column of it.
    """
    return [_log_of(table, plant, options) for table in tables]


def _log_of(table: Table, plant: Plant, options: Options) -> Log:
    columns_first = replace(options, values={}) if plant.measured_names else options
    try:
        return log_of(table, plant, columns_first)
    except MissingParameterError:
        if not options.values:
            raise
        return log_of(table, plant, options)


def wanted(plant: Plant, options: Options) -> dict[str, float] | None:
    """Measured parameters that gains are for, as the user gave them in the plant's unit."""
    if not (options.values and plant.measured_names):
        return None
    names = {
        spelling: name
        for name in plant.measured
        for spelling in (name, split(name)[0], split(plant.label(name))[0])
    }
    units = {names.get(role, role): unit for role, unit in options.units.items()}
    found = {}
    for given, value in options.values.items():
        name = names.get(given)
        if name is None:
            raise click.UsageError(
                f"measured {given!r} is unknown. Choose one of {', '.join(plant.measured)}."
            )
        found[name] = converted(plant, name, value, units.get(name, ""))
    return found


def converted(plant: Plant, name: str, value: float, unit: str) -> float:
    """A value of a measured parameter in the plant's unit."""
    own = split(plant.label(name))[1]
    if not unit or unit == own:
        return value
    from tuners.logs.units import conversion

    factor, offset = conversion(unit, own)
    return factor * value + offset


def recordings(plant: Plant, logs: Sequence[Log]) -> list[Recording]:
    """As the tuner takes them."""
    return [
        Recording.of(plant, log.u, log.y, log.Ts, log.measured, log.input, log.reference)
        for log in logs
    ]
