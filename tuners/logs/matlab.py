"""MATLAB files and HDF5: variables, fields of structures, columns of a matrix, timetables.

Versions 4 to 7 are read by SciPy, version 7.3 and other HDF5 by h5py, tables and timetables by
mat-io.  What stays after flattening are vectors, called ``x``, ``log.x`` or, the columns of a
matrix, ``x:1``.  Elements of a structure array, as Simulink's signals, are called by their label.
"""

import faulthandler
import os
import signal
import struct
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tuners.logs.table import Array, Column, LogError, Table

HDF5 = b"\x89HDF\r\n\x1a\n"
_END = {0: 40, 1: 44, 2: 28, 3: 28}  # where a superblock of this version has the file's length
_DEEPEST = 8
_PATIENCE = 10  # s
_MOST = 20_000  # datasets that are looked at
_LABELS = "label", "name", "signalName", "title", "blockName"
_VALUES = "values", "data", "Data", "Values", "value"


def read(content: bytes) -> Table:
    """Read a MATLAB file of any version, or another HDF5 file."""
    what = "MATLAB" if content.startswith(b"MATLAB") or HDF5 not in content[:1024] else "HDF5"
    found: dict[str, tuple[Array, str]] = {}
    try:
        tree = _hdf5(content) if HDF5 in content[:1024] else _classic(content)
        for name, values, unit in _vectors("", tree):
            found.setdefault(name, (values, unit))
    except LogError:
        raise
    except Exception as error:  # the libraries raise all kinds on damaged files
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise LogError(f"The MATLAB file cannot be read: {reason}") from None
    if not found:
        raise LogError(f"The {what} file has no vectors of numbers in it.")
    return Table(tuple(found), lambda name: Column(*found[name]))


def _classic(content: bytes) -> Any:
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabOpaque

    _check_survives(content)
    file: Any = BytesIO(content)  # the stubs know paths only
    variables = loadmat(file, simplify_cells=True)
    if any(isinstance(value, MatlabOpaque) for value in variables.values()):
        return _objects(content)
    return {name: value for name, value in variables.items() if not name.startswith("__")}


def _check_survives(content: bytes) -> None:
    """Refuse files that would end the process: SciPy's reader of damaged structures does so."""
    if sys.platform == "win32":  # which has no fork
        return
    from scipy.io import loadmat

    with warnings.catch_warnings():  # of threads, which the other process does without
        warnings.simplefilter("ignore")
        process = os.fork()
    if process == 0:
        with suppress(BaseException):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            faulthandler.disable()
            signal.alarm(_PATIENCE)
            file: Any = BytesIO(content)
            loadmat(file, simplify_cells=True)
        os._exit(0)
    if os.WIFSIGNALED(os.waitpid(process, 0)[1]):
        raise LogError("The MATLAB file cannot be read: it is damaged.")


def _objects(content: bytes) -> Any:
    """A file with tables or timetables, whose library wants a path."""
    with warnings.catch_warnings():  # it sets an option of pandas that is on its way out
        warnings.simplefilter("ignore")
        try:
            from matio import load_from_mat
        except ImportError:
            raise LogError(
                'Tables and timetables of MATLAB need mat-io: pip install "yawrate[matlab]"; or '
                "write CSV with writetimetable."
            ) from None
        with TemporaryDirectory() as folder:  # Windows opens no temporary file twice
            file = Path(folder, "log.mat")
            file.write_bytes(content)
            variables = load_from_mat(str(file))
    return {name: _plain(value) for name, value in variables.items() if name[:2] != "__"}


def _plain(value: Any) -> Any:
    """Columns of a table, with the time that is a timetable's index; others as they are."""
    if not hasattr(value, "columns"):
        return value
    columns = {str(name): value[name].to_numpy() for name in value.columns}
    index = value.index.to_numpy()
    times = {"time": index} if index.dtype.kind in "mM" else {}
    return {name: _seconds(column) for name, column in (times | columns).items()}


def _seconds(values: Any) -> Any:
    if values.dtype.kind not in "mM":
        return values
    start = values[0] if values.dtype.kind == "M" else np.zeros(1, values.dtype)[0]
    return (values - start) / np.timedelta64(1, "s")


def _check_length(content: bytes) -> None:
    """``LogError`` where an HDF5 file is longer than its superblock says: bytes came in between.

    Nothing else shows that: h5py reads a channel's values where they were, one or more of another
    time.  The library itself refuses what is shorter.
    """
    begin = content.index(HDF5)
    version = content[begin + 8]
    if version in _END:
        (end,) = struct.unpack_from("<Q", content, begin + _END[version])
        if end != len(content):
            raise LogError(
                f"The HDF5 file has {len(content)} bytes and says that it has {end}: it was "
                "damaged on its way. Copy it again, or let h5repack write it anew."
            )


def _hdf5(content: bytes) -> Any:
    import h5py

    _check_length(content)
    seen: set[Any] = set()  # links may form loops

    def children(group: Any) -> Iterator[tuple[str, Any]]:
        for name in group:
            try:
                yield name, group[name]
            except (KeyError, OSError):  # a link to nowhere
                continue

    def unpacked(item: Any, file: Any) -> Any:
        if isinstance(item, h5py.Group):
            place = h5py.h5o.get_info(item.id).addr
            if place in seen or len(seen) > _MOST:
                return None
            seen.add(place)
            return {name: unpacked(child, file) for name, child in children(item) if name[0] != "#"}
        if not isinstance(item, h5py.Dataset):
            return None
        if item.attrs.get("MATLAB_object_decode") == 3:
            raise _HasObjects
        kind, unit = item.dtype.kind, _text(item.attrs.get("units", item.attrs.get("unit", "")))
        if item.dtype.names:
            return {name: item[name] for name in item.dtype.names}
        if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
            return [unpacked(file[ref], file) for ref in np.ravel(item[()]) if ref]
        text = item.attrs.get("MATLAB_class")
        if text is not None and _text(text) == "char":
            return "".join(map(chr, np.ravel(item[()])))
        # HDF5 has MATLAB's arrays transposed.
        return _Stated(np.transpose(item[()]), unit) if kind in "fiub" else None

    with h5py.File(BytesIO(content), "r") as file:
        try:
            return unpacked(file, file)
        except _HasObjects:
            return _objects(content)


class _HasObjects(Exception):
    """The file has tables in it."""


class _Stated:
    """Values and their unit."""

    def __init__(self, values: Any, unit: str) -> None:
        self.values, self.unit = values, unit


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _vectors(name: str, item: Any, depth: int = 0) -> Iterator[tuple[str, Array, str]]:
    unit = ""
    if isinstance(item, _Stated):
        item, unit = item.values, item.unit
    if isinstance(item, Mapping):
        if depth < _DEEPEST:
            yield from _fields(name, item, depth)
    elif isinstance(item, list) or (isinstance(item, np.ndarray) and item.dtype.kind == "O"):
        if depth < _DEEPEST and len(elements := list(np.ravel(np.array(item, object)))) < _MOST:
            for k, element in enumerate(elements):
                yield from _vectors(f"{name}.{_label(element) or k + 1}", element, depth + 1)
    elif isinstance(item, np.ndarray) and item.dtype.kind in "fiub" and item.size > 1:
        values = np.atleast_2d(np.squeeze(item).astype(np.float64))
        if 1 in values.shape:
            yield name, values.ravel(), unit
        elif values.ndim == 2:
            columns = values if values.shape[0] < values.shape[1] else values.T
            for k, column in enumerate(columns):
                yield f"{name}:{k + 1}", column.copy(), unit


def _fields(name: str, item: Mapping[str, Any], depth: int) -> Iterator[tuple[str, Array, str]]:
    """Fields of a structure; values beside a label are called by that."""
    label = _label(item)
    for key, child in item.items():
        within = _vectors(f"{name}.{key}" if name else str(key), child, depth + 1)
        if label and key in _VALUES:
            called = name if name.endswith(f".{label}") else f"{name}.{label}"
            within = _vectors(called.lstrip("."), child, depth + 1)
        yield from within


def _label(item: Any) -> str:
    """What a structure calls itself."""
    if not isinstance(item, Mapping):
        return ""
    texts = (item.get(key) for key in _LABELS)
    found = next((text for text in texts if isinstance(text, str) and text.strip()), "")
    return found.strip().rpartition("/")[2].replace(".", "_")
