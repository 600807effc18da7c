"""Find a plant by its entry point ``module:attribute``, or by a TOML file that names it.

    [plant]
    entry = "dc_motor:plant"

    [plant.arguments]      # only where the entry is a function
    load = 0.02

A plant is code, which no file holds: saved tuners and data sets name its entry and keep a
fingerprint (`yawrate_env.plant.fingerprint`).
"""

import sys
import tomllib
from collections.abc import Mapping
from copy import copy
from dataclasses import asdict
from importlib import invalidate_caches
from importlib.machinery import PathFinder
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any

from yawrate_env.loop.target import Target
from yawrate_env.plant.calls import call, one_line
from yawrate_env.plant.plant import Plant

TARGET = "target"
"""Argument of an entry that takes the loop's target, as a dict of `Target`'s attributes."""

_NONE: Mapping[str, Any] = MappingProxyType({})


def find(
    entry: str | Plant, folder: Path | None = None, arguments: Mapping[str, Any] = _NONE
) -> Plant:
    """Import the plant at an entry point; modules in `folder` are found too.

    Importing a module runs it: name only what you would run.

    Parameters
    ----------
    entry : str or Plant
        ``module:attribute``; the attribute is a plant, or a function annotated ``-> Plant``.
    folder : Path, optional
        Goes to the front of ``sys.path``, as the working folder does.
    arguments : dict, optional
        Keyword arguments of the function.
    """
    if isinstance(entry, Plant):
        return entry
    found = attribute(entry, folder)
    if callable(found) and not isinstance(found, Plant):
        _check_gives_plant(entry, found)
        found = call(entry, lambda: found(**arguments))
    elif arguments:
        raise ValueError(f"entry = {entry!r} takes no arguments. Leave them out.")
    if not isinstance(found, Plant):
        raise ValueError(f"entry = {entry!r} is a {type(found).__name__}. Name a Plant.")
    return found if found.entry == entry else with_entry(found, entry, arguments)


def attribute(entry: str, folder: Path | None = None) -> Any:
    """Import what is at an entry point; modules in `folder` are found too."""
    name, colon, last = str(entry).partition(":")
    if not colon or not all(part.isidentifier() for part in (*name.split("."), last)):
        raise ValueError(
            f"entry = {entry!r} is no entry point. "
            'Write it as "module:attribute", for example "my_plant:plant".'
        )
    _put_on_path(name.partition(".")[0], folder)
    return _resolved(entry, name)


def of(thing: Any, what: str) -> str:
    """Entry point of a class or a function; ``ValueError`` where it could not be found again."""
    name = f"{getattr(thing, '__module__', '')}:{getattr(thing, '__qualname__', '')}"
    found = None
    if not name.startswith("__main__:") and name.partition(":")[2].isidentifier():
        found = getattr(sys.modules.get(name.partition(":")[0]), name.partition(":")[2], None)
    if found is not thing:
        raise ValueError(
            f"{what} = {thing!r} could not be found again when a tuner is loaded. Define it at the "
            "top of a module that can be imported."
        )
    return name


def with_entry(plant: Plant, entry: str, arguments: Mapping[str, Any] = _NONE) -> Plant:
    """The plant under an entry; ``replace`` would call all its functions again."""
    renamed = copy(plant)
    object.__setattr__(renamed, "entry", entry)
    object.__setattr__(renamed, "arguments", dict(arguments))
    return renamed


def with_target(plant: Plant, target: Target) -> Plant:
    """The same plant for another target of its loop.

    Raises
    ------
    ValueError
        The plant's entry is no function of its target.
    """
    if TARGET not in plant.arguments:
        raise ValueError(
            "target: this plant has only one. Give it an entry that is a function of its target, "
            "as in docs/plants.md, or train a tuner for the other target."
        )
    return find(plant.entry, arguments={**plant.arguments, TARGET: asdict(target)})


def named(plant: Plant, what: str) -> str:
    """The plant's entry, or ``ValueError`` where `what` could not find the plant again."""
    if not plant.entry:
        raise ValueError(
            f'{what} must find its plant again: give the plant entry="module:attribute", for '
            'example entry="my_plant:plant".'
        )
    return plant.entry


def home(plant: Plant) -> Path | None:
    """The folder from which a plant's module was imported; None if no file holds it."""
    name = plant.entry.partition(":")[0]
    module = sys.modules.get(name)
    file = getattr(module, "__file__", None)
    depth = name.count(".") + hasattr(module, "__path__")
    return Path(file).resolve().parents[depth] if file else None


def from_file(path: Path) -> Plant | None:
    """The plant called ``plant`` in a Python file, or that a TOML file names (`from_toml`)."""
    return find(f"{path.stem}:plant", path.parent) if path.suffix == ".py" else from_toml(path)


def from_toml(path: Path) -> Plant | None:
    """The plant that a TOML file names, found beside the file; None where it names none."""
    import msgspec

    class Table(msgspec.Struct, forbid_unknown_fields=True):
        entry: str
        arguments: dict[str, Any] = {}

    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        if "plant" not in content:
            return None
        table = msgspec.convert(content["plant"], Table)
        return find(table.entry, path.parent, table.arguments)
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise ValueError(f"{path} is not TOML: {error}.") from None
    except msgspec.ValidationError as error:
        raise ValueError(f"{path}: [plant]: {error}.") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _put_on_path(top: str, folder: Path | None) -> None:
    """Find modules in `folder` and here; ``ValueError`` where one of that name is from elsewhere.

    Otherwise the plant of another folder would silently be used.  This package itself is what
    runs, also in a clone's folder with the package installed elsewhere.
    """
    if top == __name__.partition(".")[0]:
        return
    places = [str(place.resolve()) for place in (folder, Path()) if place is not None]
    sys.path[:] = [*places, *(place for place in sys.path if place not in places)]
    invalidate_caches()
    spec, module = PathFinder.find_spec(top, places), sys.modules.get(top)
    here, there = getattr(spec, "origin", None), getattr(module, "__file__", None)
    if here and there and Path(here).resolve() != Path(there).resolve():
        raise ValueError(
            f"module {top!r} is imported from {there} already, not from {here}. Rename one of the "
            "two, or use them in different processes."
        )


def _check_gives_plant(entry: str, function: Any) -> None:
    """Refuse functions not annotated ``-> Plant``: a data file could name ``os:system``."""
    returns = getattr(function, "__annotations__", {}).get("return")
    if returns is not Plant and str(returns).rpartition(".")[2] != Plant.__name__:
        raise ValueError(
            f"entry = {entry!r} is a {type(function).__name__} not annotated to give a Plant. "
            f"Write def {entry.partition(':')[2]}(...) -> Plant, or name a Plant."
        )


def _resolved(entry: str, name: str) -> Any:
    try:
        return resolve_name(entry)
    except ModuleNotFoundError as error:
        if f"{name}.".startswith(f"{error.name}."):
            raise ValueError(
                f"entry = {entry!r}: there is no module {name!r}. "
                "Run from the folder where it is, or add that to PYTHONPATH."
            ) from None
        raise ValueError(f"importing {name} failed: {one_line(error)}.") from error
    except AttributeError as error:
        if name in sys.modules:
            raise ValueError(f"entry = {entry!r}: {name} has no such attribute.") from None
        raise ValueError(f"importing {name} failed: {one_line(error)}.") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a module may raise anything, or exit
        why = one_line(error).removesuffix(".")
        raise ValueError(f"importing {name} failed: {why}.") from error
