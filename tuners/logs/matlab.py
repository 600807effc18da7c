"""MATLAB files: variables, fields of structures, columns of a matrix.

Versions 4 to 7 are read by SciPy, version 7.3 is HDF5 and read by h5py.  What stays after
flattening are vectors, called ``x``, ``log.x`` or, the columns of a matrix, ``x:1``.
"""

from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np

from tuners.logs.table import Array, Column, LogError, Table

HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 4


def read(content: bytes) -> Table:
    """Read a MATLAB file of any version."""
    try:
        tree = _hdf5(content) if HDF5 in content[:1024] else _classic(content)
    except Exception as error:  # both libraries raise all kinds on damaged files
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise LogError(f"The MATLAB file cannot be read: {reason}") from None
    vectors = dict(_vectors("", tree))
    if not vectors:
        raise LogError("The MATLAB file has no vectors of numbers in it.")
    return Table(tuple(vectors), lambda name: Column(vectors[name]))


def _classic(content: bytes) -> dict[str, Any]:
    from scipy.io import loadmat

    file: Any = BytesIO(content)  # the stubs know paths only
    return {
        name: value
        for name, value in loadmat(file, simplify_cells=True).items()
        if not name.startswith("__")
    }


def _hdf5(content: bytes) -> dict[str, Any]:
    import h5py

    def unpacked(item: Any) -> Any:
        if isinstance(item, h5py.Group):
            return {name: unpacked(child) for name, child in item.items() if name[0] != "#"}
        # HDF5 has MATLAB's arrays transposed.
        return np.transpose(item[()]) if item.dtype.kind in "fiub" else None

    with h5py.File(BytesIO(content), "r") as file:
        tree: dict[str, Any] = unpacked(file)
    return tree


def _vectors(name: str, item: Any, depth: int = 0) -> Iterator[tuple[str, Array]]:
    if isinstance(item, dict) and depth < _DEEPEST:
        for key, child in item.items():
            yield from _vectors(f"{name}.{key}" if name else str(key), child, depth + 1)
    elif isinstance(item, np.ndarray) and item.dtype.kind in "fiub" and item.size > 1:
        values = np.atleast_2d(np.squeeze(item).astype(np.float64))
        if 1 in values.shape:
            yield name, values.ravel()
        elif values.ndim == 2:
            columns = values if values.shape[0] < values.shape[1] else values.T
            for k, column in enumerate(columns):
                yield f"{name}:{k + 1}", column.copy()
