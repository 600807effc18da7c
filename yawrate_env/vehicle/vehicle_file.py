"""One's own vehicle: a TOML file to a `Task`.

    [vehicle]    every value of `Vehicle`
    [prior]      every range of `Prior`; a number is a range of one point
    [experiment] values of `Experiment` that differ from the paper's
    [target]     values of `Target` that differ from the paper's

What the vehicle is must be said in full: a value left out would silently be another car's.
"""

import os
import re
import tomllib
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import Any

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
    """Read a vehicle's file, or raise `VehicleFileError` with the place and the reason."""
    try:
        text = Path(path).read_text(encoding="utf-8")
        content = tomllib.loads(text)
    except OSError as error:
        raise VehicleFileError(f"{path}: {error.strerror}.") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise VehicleFileError(f"{path} is not TOML: {error}.") from None
    try:
        return task_of(content)
    except VehicleFileError as error:
        place = _line(text, str(error).split(":")[0])
        raise VehicleFileError(f"{path}{place}: {error}") from None


def task_of(content: dict[str, Any]) -> Task:
    """Build a task from the sections; errors begin with ``section.key:``."""
    for name, section in content.items():
        if name not in SECTIONS or not isinstance(section, dict):
            known = ", ".join(SECTIONS)
            raise VehicleFileError(f"{name}: unknown section; there are {known}.")
    for name in COMPLETE:
        if name not in content:
            raise VehicleFileError(f"{name}: the section is missing. See `yawrate init`.")
    parts = {name: _part(name, content.get(name, {})) for name in SECTIONS}
    try:
        return Task(**parts)
    except ValueError as error:
        raise VehicleFileError(f"vehicle.M_0: {error}") from None


def _part(section: str, values: dict[str, Any]) -> Any:
    record = SECTIONS[section]
    known = [field.name for field in fields(record)]
    for key, value in values.items():
        if key not in known:
            raise VehicleFileError(f"{section}.{key}: unknown key; there are {', '.join(known)}.")
        if isinstance(value, dict):
            raise VehicleFileError(f"{section}.{key}: wanted a value, not a section.")
    missing = [key for key in known if key not in values]
    if section in COMPLETE and missing:
        raise VehicleFileError(f"{section}.{missing[0]}: missing. See `yawrate init`.")
    try:
        return record(**values)
    except (ValueError, TypeError) as error:
        raise VehicleFileError(f"{_culprit(section, values)}: {error}") from None


def _culprit(section: str, values: dict[str, Any]) -> str:
    """The key that is refused even on its own, or else the section."""
    for key, value in values.items():
        try:
            SECTIONS[section](**{key: value})
        except (ValueError, TypeError):
            return f"{section}.{key}"
    return section


def _line(text: str, path: str) -> str:
    """Where a key or a section stands, as ``, line 3``; empty if it is nowhere."""
    section, _, key = path.partition(".")
    inside = False
    for number, line in enumerate(text.splitlines(), 1):
        if re.match(rf"\s*\[\s*{re.escape(section)}\s*\]", line):
            if not key:
                return f", line {number}"
            inside = True
        elif re.match(r"\s*\[", line):
            inside = False
        elif inside and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line):
            return f", line {number}"
    return ""
