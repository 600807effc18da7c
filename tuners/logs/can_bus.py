"""CAN traces of Vector's tools, BLF and ASC, decoded by a DBC file."""

from collections.abc import Callable
from functools import partial
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np

from tuners.logs.table import Column, LogError, Table

_NEEDED = (
    'CAN traces need python-can and cantools: pip install "yawrate[can]"; or export the decoded '
    "signals to MDF or CSV."
)


def read(content: bytes, dbc: Path | None = None) -> Table:
    """Read a binary trace (BLF)."""
    return _read("BLF", lambda can: can.BLFReader(BytesIO(content)), dbc)


def read_asc(content: bytes, dbc: Path | None = None) -> Table:
    """Read a trace in text (ASC)."""
    text = content.decode("latin-1")
    return _read("ASC", lambda can: can.ASCReader(StringIO(text)), dbc)


def _read(kind: str, opened: Callable[[Any], Any], dbc: Path | None) -> Table:
    if dbc is None:
        raise LogError(f"This is a CAN trace ({kind}): give the file of its signals with --dbc.")
    try:
        import can
        import cantools
    except ImportError:
        raise LogError(_NEEDED) from None
    try:
        database: Any = cantools.database.load_file(dbc)
    except Exception as error:  # cantools raises all kinds
        raise LogError(f"{dbc} cannot be read: {str(error).splitlines()[0]}") from None
    messages = {m.frame_id: m for m in database.messages}
    found: dict[str, tuple[list[float], list[float], str]] = {}
    try:
        for frame in opened(can):
            message = messages.get(frame.arbitration_id)
            if message is not None and not (frame.is_error_frame or frame.is_remote_frame):
                _decode(message, frame, found)
    except Exception as error:  # python-can raises all kinds on damaged files
        why = str(error) or type(error).__name__
        raise LogError(f"The {kind} file cannot be read: {why}") from None
    if not found:
        raise LogError(f"No message of the trace is in {dbc}. Give the DBC file of its bus.")
    return Table(tuple(found), partial(_column, found))


def _decode(
    message: Any, frame: Any, found: dict[str, tuple[list[float], list[float], str]]
) -> None:
    values = message.decode(frame.data, decode_choices=False, allow_truncated=True)
    units = {signal.name: signal.unit or "" for signal in message.signals}
    for name, value in values.items():
        full = f"{message.name}.{name}"
        stamps, known, _ = found.setdefault(full, ([], [], units[name]))
        stamps.append(float(frame.timestamp))
        known.append(float(value))


def _column(found: dict[str, tuple[list[float], list[float], str]], name: str) -> Column:
    stamps, values, unit = found[name]
    return Column(np.array(values), unit, np.array(stamps))
