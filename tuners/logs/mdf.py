"""Measurement data format 4 (ASAM MDF), with every channel on its own time base."""

from contextlib import suppress
from io import BytesIO
from typing import Any

import numpy as np

from tuners.logs.table import Column, LogError, Table


def read(content: bytes) -> Table:
    """Read the names; a channel's samples are read when it is asked for."""
    try:
        from asammdf import MDF
        from asammdf.blocks.mdf_v4 import MDF4
    except ImportError:
        raise LogError('MDF files need asammdf: pip install "yawrate[mdf]".') from None
    MDF4.__del__ = _close  # type: ignore[method-assign]
    try:
        file = MDF(BytesIO(content))
    except Exception as error:  # asammdf raises all kinds on damaged files
        raise LogError(f"The MDF file cannot be read: {error or type(error).__name__}") from None

    def column(name: str) -> Column:
        try:
            found = (file.get(group=group, index=i) for group, i in file.channels_db[name])
            signal = max(found, key=len)  # a channel may be in empty groups too
            values = np.asarray(signal.samples, dtype=np.float64)
        except Exception as error:
            raise LogError(f"Channel {name} cannot be read: {error}") from None
        if values.ndim != 1 or not len(values):
            raise LogError(f"Channel {name} holds no numbers.")
        return Column(values, str(signal.unit or ""), np.asarray(signal.timestamps, float))

    names = tuple(name for name in file.channels_db if name not in ("t", "time", "Time"))
    return Table(names, column)


def _close(file: Any) -> None:
    """Instead of asammdf's finaliser, which prints a traceback where a file did not open."""
    for close in (file.close, lambda: file._tempfile.close()):
        with suppress(AttributeError):
            close()
