"""Where a plant's description is found again: ``module:attribute``, or a TOML file that says so.

    [plant]
    entry = "dc_motor:plant"

A plant is code, which a saved tuner does not hold: it names the entry, and keeps what the
plant answered to a trial so that a description that changed since is noticed.
"""

import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from importlib import import_module, invalidate_caches
from pathlib import Path
from types import ModuleType

from yawrate_env.plant.calls import said
from yawrate_env.plant.plant import Plant

_FORM = 'Write it as "module:attribute", for example "my_plant:plant".'

_ASIDE: dict[tuple[str, Path], ModuleType] = {}
"""Modules that others of their name keep out of ``sys.modules``, by name and folder."""


def find(entry: str | Plant, folder: Path | None = None) -> Plant:
    """The plant at an entry point; modules in `folder` are found too.

    Importing a module runs it: name only what you would run.  Whatever it raises, its own
    exit too, becomes ``ValueError``.
    """
    if isinstance(entry, Plant):
        return entry
    name, colon, attribute = str(entry).partition(":")
    if not colon or not all(part.isidentifier() for part in (*name.split("."), attribute)):
        raise ValueError(f"entry = {entry!r} is no entry point. {_FORM}")
    try:
        module = _module(name, None if folder is None else folder.resolve())
    except (Exception, SystemExit) as error:
        missing = isinstance(error, ModuleNotFoundError) and _within(name, error.name)
        if not missing:
            why = said(error).removesuffix(".")
            raise ValueError(f"importing {name} failed: {why}.") from error
        raise ValueError(
            f"entry = {entry!r}: there is no module {name!r}. "
            "Run from the folder where it is, or add that to PYTHONPATH."
        ) from None
    found = getattr(module, attribute, None)
    if not isinstance(found, Plant):
        what = "has no such attribute" if found is None else f"holds a {type(found).__name__}"
        raise ValueError(f"entry = {entry!r}: {name} {what}, wanted a tuners.plants.Plant.")
    return entered(found, entry)


def entered(plant: Plant, entry: str) -> Plant:
    """The plant as one of that entry; `replace` would try all its functions again."""
    if plant.entry == entry:
        return plant
    renamed = copy(plant)
    object.__setattr__(renamed, "entry", entry)
    return renamed


def named(plant: Plant, what: str) -> str:
    """The plant's entry, or ``ValueError`` where `what` could not find the plant again."""
    if not plant.entry:
        raise ValueError(
            f'{what} must find its plant again: give the plant entry="module:attribute", for '
            'example entry="my_plant:plant".'
        )
    return plant.entry


def home(plant: Plant) -> Path | None:
    """The folder from which a plant's module was imported; None if no file holds it.

    Of several modules of one name it is the one that holds the plant, or else the first.
    """
    name, _, attribute = plant.entry.partition(":")
    modules = [sys.modules.get(name), *(m for (n, _), m in _ASIDE.items() if n == name)]
    held = (m for m in modules if _is(getattr(m, attribute, None), plant))
    module = next(held, modules[0])
    if module is None or not getattr(module, "__file__", None):
        return None
    depth = name.count(".") + hasattr(module, "__path__")
    return Path(str(module.__file__)).resolve().parents[depth]


def from_toml(path: Path) -> Plant | None:
    """The plant that a TOML file names, found beside the file; None where it names none."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"{path} is not TOML: {error}.") from None
    if "plant" not in content:
        return None
    table = content["plant"]
    if not isinstance(table, dict) or set(table) != {"entry"}:
        raise ValueError(f'{path}: [plant] must hold entry = "module:attribute" and nothing else.')
    try:
        return find(table["entry"], path.parent)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _is(found: object, plant: Plant) -> bool:
    """Whether a plant is the one found, or what `entered` made of it."""
    return isinstance(found, Plant) and found.prior is plant.prior


def _within(name: str, missing: str | None) -> bool:
    """Whether a module that is missing is the named one, or a package on the way to it."""
    return missing is not None and f"{name}.".startswith(f"{missing}.")


def _module(name: str, folder: Path | None) -> ModuleType:
    """Import a module: the one that is in `folder` or here, whatever else has its name."""
    top = name.partition(".")[0]
    places = [place.resolve() for place in (folder, Path()) if place is not None]
    home = next((place for place in places if _is_in(top, place)), None)
    if home is not None and not _comes_from(home, top) and _taken(top, home):
        if (name, home) not in _ASIDE:
            _ASIDE[name, home] = _aside(name, home)
        return _ASIDE[name, home]
    with _importable(folder):
        return import_module(name)


def _aside(name: str, home: Path) -> ModuleType:
    """Import a module while others, whose names it and its neighbours have, are out of the way.

    These stay what everybody else imports by the name.
    """
    taken = _taken(name.partition(".")[0], home)
    others = {n: m for n, m in sys.modules.items() if n.partition(".")[0] in taken}
    for other in others:
        del sys.modules[other]
    try:
        with _importable(home):
            return import_module(name)
    finally:
        sys.modules.update(others)


def _taken(top: str, home: Path) -> set[str]:
    """Names of a module and its neighbours that modules from elsewhere have."""
    neighbours = {path.stem for path in home.glob("*.py")} - sys.stdlib_module_names
    return {n for n in neighbours | {top} if n in sys.modules and not _comes_from(home, n)}


def _is_in(top: str, place: Path) -> bool:
    return any(file.is_file() for file in _files(top, place))


def _comes_from(place: Path, top: str) -> bool:
    file = getattr(sys.modules.get(top), "__file__", None)
    return file is not None and Path(file).resolve() in _files(top, place)


def _files(top: str, place: Path) -> tuple[Path, Path]:
    return place / f"{top}.py", place / top / "__init__.py"


@contextmanager
def _importable(folder: Path | None) -> Iterator[None]:
    """Find modules in `folder` and in the working folder, as ``python -m`` does."""
    before = list(sys.path)
    sys.path[:0] = [str(f.resolve()) for f in (folder, Path()) if f is not None]
    invalidate_caches()
    try:
        yield
    finally:
        sys.path[:] = before
