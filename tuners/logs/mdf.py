"""Measurement data format (ASAM MDF 3 and 4), with every channel on its own time base."""

from contextlib import suppress
from io import BytesIO
from typing import Any

import numpy as np

from tuners.logs.table import Column, LogError, Table

Place = tuple[int, int]


def read(content: bytes) -> Table:
    """Read the names; a channel's samples are read when it is asked for."""
    try:
        from asammdf import MDF
        from asammdf.blocks.mdf_v3 import MDF3
        from asammdf.blocks.mdf_v4 import MDF4
    except ImportError:
        raise LogError('MDF files need asammdf: pip install "yawrate[mdf]".') from None
    MDF3.__del__ = MDF4.__del__ = _close  # type: ignore[method-assign]
    try:
        file = MDF(BytesIO(content))
        places = _places(file)
    except Exception as error:  # asammdf raises all kinds on damaged files
        raise LogError(f"The MDF file cannot be read: {error or type(error).__name__}") from None

    def column(name: str) -> Column:
        group, index = places[name]
        try:
            signal = file.get(group=group, index=index)
            values = np.asarray(signal.samples, dtype=np.float64)
        except Exception as error:
            raise LogError(f"Channel {name} cannot be read: {error}") from None
        if values.ndim != 1 or not len(values):
            raise LogError(f"Channel {name} holds no numbers.")
        return Column(values, str(signal.unit or ""), np.asarray(signal.timestamps, float))

    return Table(tuple(places), column)


def _places(file: Any) -> dict[str, Place]:
    """Where every channel is; those of one name in several groups are told apart by these.

    Groups without samples count where no others have the channel.
    """
    places: dict[str, Place] = {}
    for name, found in file.channels_db.items():
        if name in ("t", "time", "Time"):
            continue
        filled = [place for place in found if _samples(file, place[0])]
        several = len(filled) > 1
        for group, index in filled or found[:1]:
            called = f"{name} #{group + 1}" if several else name
            places.setdefault(called, (group, index))
    return places


def _samples(file: Any, group: int) -> int:
    channels = file.groups[group].channel_group
    return int(getattr(channels, "cycles_nr", 0))


def _close(file: Any) -> None:
    """Instead of asammdf's finaliser, which prints a traceback where a file did not open."""
    for close in (file.close, lambda: file._tempfile.close()):
        with suppress(AttributeError):
            close()
