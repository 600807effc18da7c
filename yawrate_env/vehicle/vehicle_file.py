"""A vehicle's TOML file, read into a `Task`.

    [vehicle]    every value of `Vehicle`
    [prior]      every range of `Prior`; a number is a range of one point
    [experiment] values of `Experiment` that differ from the paper's
    [target]     values of `Target` that differ from the paper's

The first two must be complete: a value left out would silently be another car's.
"""

import os
import tomllib
from dataclasses import fields
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, get_type_hints

from yawrate_env.loop.target import Target
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
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        return task_of(content)
    except OSError as error:
        raise VehicleFileError(f"{path}: {error.strerror}.") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
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
        keys: list[Any] = [(key.name, _type(hints[key.name])) for key in fields(record)]
        if name not in COMPLETE:
            defaults = [field.default for field in fields(record)]
            keys = [(*key, default) for key, default in zip(keys, defaults, strict=True)]
        return msgspec.defstruct(name, keys, forbid_unknown_fields=True)

    types = {name: section(name, record) for name, record in SECTIONS.items()}
    whole: list[Any] = [(name, types[name]) for name in COMPLETE]
    whole += [
        (name, types[name], msgspec.field(default_factory=types[name]))
        for name in SECTIONS
        if name not in COMPLETE
    ]
    return msgspec.defstruct("File", whole, forbid_unknown_fields=True)


def _type(hint: Any) -> Any:
    """A number may stand for a range."""
    return hint | float if hint == tuple[float, float] else hint
