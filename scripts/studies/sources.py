"""Where a printed number comes from: a stored result, or a name in the code.

    rows/0/usable                    steps to a number: keys, indices, attributes
    rows/tuner=gb&episodes=1500/rms  the one row of a list with these values
    rows/#                           how many

A source is such a path behind a file of results/, ``robustness.json: …``, or behind a name,
``code: module:name/…`` or ``code: module:name(parameter)/…`` for a default.  Sources and numbers
are multiplied and divided with ``*`` and ``/`` between blanks; a path alone is in the file before
it, and ``degrees`` turns radians to degrees.
"""

import dataclasses
import inspect
import json
import math
import pkgutil
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

_TERM = re.compile(r"(code|[\w./-]+\.json): (.+)")
_NAME = re.compile(r"([\w.]+:[\w.]+)(?:\((\w+)\))?(?:/(.+))?")


def value_of(source: str, root: Path) -> float:
    """The number that a source leads to.

    Parameters
    ----------
    source : str
        What stands in an anchor.
    root : Path
        The project's folder.

    Raises
    ------
    LookupError, AttributeError, ImportError, ValueError
        If the source leads nowhere.
    """
    found, where = 1.0, ""
    first, *rest = re.split(r" ([*/]) ", source)
    for sign, term in zip(["*", *rest[::2]], [first, *rest[1::2]], strict=True):
        if named := _TERM.fullmatch(term):
            where, term = named.groups()
        value = _term(term, where, root)
        found = found * value if sign == "*" else found / value
    return found


def _term(term: str, where: str, root: Path) -> float:
    if re.fullmatch(r"-?[\d.]+", term):
        return float(term)
    if term == "degrees":
        return math.degrees(1.0)
    if where == "code":
        return float(_of_code(term))
    return float(_followed(_stored(root / "results" / where), term))


def _of_code(term: str) -> Any:
    named = _NAME.fullmatch(term)
    if named is None:
        raise ValueError(f"{term!r} is not module:name, module:name(parameter) or a path behind it")
    name, parameter, path = named.groups()
    found = pkgutil.resolve_name(name)
    if parameter:
        found = _default(found, parameter)
    return _followed(found, path) if path else found


def _default(function: Any, parameter: str) -> Any:
    """Default of a function's parameter or of a record's field."""
    if dataclasses.is_dataclass(function):
        (field,) = (f for f in dataclasses.fields(function) if f.name == parameter)
        if field.default_factory is not dataclasses.MISSING:
            return field.default_factory()
    return inspect.signature(function).parameters[parameter].default


def _followed(value: Any, path: str) -> Any:
    for step in path.split("/"):
        if step == "#":
            value = len(value)
        elif isinstance(value, Mapping):
            value = value[step]
        elif isinstance(value, Sequence):
            value = value[int(step)] if step.isdecimal() else _chosen(value, step)
        else:
            value = getattr(value, step)
    return value


def _chosen(rows: Sequence[Any], step: str) -> Any:
    """The one row with these values, as in ``tuner=gb&episodes=1500``."""
    wanted = dict(pair.split("=", 1) for pair in step.split("&"))
    (row,) = (r for r in rows if all(f"{r.get(k)}" == v for k, v in wanted.items()))
    return row


@cache
def _stored(file: Path) -> Any:
    return json.loads(file.read_text())
