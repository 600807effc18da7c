"""A vehicle's TOML file, read into a `Task`.

    [vehicle]    every value of `Vehicle`
    [prior]      ranges of `Prior`; a number is a range of one point, and ``{log = [low, high]}``
                 and ``{normal = [mean, deviation]}`` are other distributions
    [experiment] values of `Experiment` that differ from the paper's
    [target]     values of `Target` that differ from the paper's

The first two must be complete, but for delays, which are otherwise none, and for priors over
parameters of [vehicle]: a value left out would silently be another car's.
"""

import os
import tomllib
from dataclasses import fields
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, get_type_hints

from yawrate_env.loop.target import Target
from yawrate_env.plant.distributions import Spread
from yawrate_env.vehicle.single_track import Vehicle
from yawrate_env.vehicle.task import Experiment, Prior, Task

SECTIONS: dict[str, Any] = {
    "vehicle": Vehicle,
    "prior": Prior,
    "experiment": Experiment,
    "target": Target,
}
COMPLETE = ("vehicle", "prior")


class VehicleFileError(ValueError):
    """A file that does not describe a vehicle."""


def example() -> str:
    """The paper's vehicle, with a comment on every value."""
    return (files("yawrate_env.vehicle") / "vehicle.toml").read_text(encoding="utf-8")


def read(path: str | os.PathLike[str]) -> Task:
    """Read a vehicle's file, or raise `VehicleFileError` with file, section and key."""
    import msgspec

    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
        return task_of(content)
    except OSError as error:
        raise VehicleFileError(f"{path}: {error.strerror}.") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise VehicleFileError(f"{path} is not TOML: {error}.") from None
    except msgspec.ValidationError as error:
        text = str(error).replace("`$.", "`").replace("Object", "Section")
        raise VehicleFileError(f"{path}: {text}. See `yawrate init`.") from None
    except ValueError as error:
        raise VehicleFileError(f"{path}: {error}") from None


def task_of(content: dict[str, Any]) -> Task:
    """Build a task from the file's sections."""
    import msgspec

    found = msgspec.convert(content, _sections())
    parts = {}
    for name, record in SECTIONS.items():
        try:
            parts[name] = record(**msgspec.structs.asdict(getattr(found, name)))
        except ValueError as error:
            raise ValueError(f"[{name}] {error}") from None
    return Task(**parts)


@lru_cache(maxsize=1)
def _sections() -> Any:
    """Type of the whole file for msgspec: no other sections and keys, none missing."""
    import msgspec

    def section(name: str, record: Any) -> Any:
        hints = get_type_hints(record)
        keys: list[Any] = []
        for key in sorted(fields(record), key=lambda key: not _needed(name, key)):
            default = () if _needed(name, key) else (key.default,)
            keys.append((key.name, _type(hints[key.name]), *default))
        return msgspec.defstruct(name, keys, forbid_unknown_fields=True)

    types = {name: section(name, record) for name, record in SECTIONS.items()}
    whole: list[Any] = [(name, types[name]) for name in COMPLETE]
    whole += [
        (name, types[name], msgspec.field(default_factory=types[name]))
        for name in SECTIONS
        if name not in COMPLETE
    ]
    return msgspec.defstruct("File", whole, forbid_unknown_fields=True)


def _needed(section: str, key: Any) -> bool:
    """Whether a file must have it: a default other than nothing is the paper's."""
    return section in COMPLETE and key.default not in (None, 0.0)


def _type(hint: Any) -> Any:
    """A number, two, or a named distribution may stand for a prior."""
    if hint not in (Spread, Spread | None):
        return hint
    ends = tuple[float, float]
    return ends | float | dict[str, ends] | (None if hint == Spread | None else float)
