"""MCAP, the container of ROS 2 bags: every number of every topic, with its own time stamps."""

import json
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np

from tuners.logs.table import Array, Column, LogError, Table

_DEEPEST = 6


def read(content: bytes) -> Table:
    """Read messages of ROS 2, and of JSON."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise LogError('MCAP files need mcap-ros2-support: pip install "yawrate[mcap]".') from None
    found: dict[str, tuple[list[float], list[float]]] = {}
    try:
        factory = DecoderFactory()
        reader = make_reader(BytesIO(content), validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                decoded = json.loads(message.data)
            else:
                decode = factory.decoder_for(channel.message_encoding, schema)
                if decode is None:
                    continue
                decoded = decode(message.data)
            stamp = _stamp(decoded) or 1e-9 * message.log_time
            for name, value in _numbers(channel.topic.strip("/").replace("/", "."), decoded):
                stamps, values = found.setdefault(name, ([], []))
                stamps.append(stamp)
                values.append(value)
    except Exception as error:  # the libraries raise all kinds on damaged files
        why = str(error) or type(error).__name__
        raise LogError(f"The MCAP file cannot be read: {why}") from None
    if not found:
        raise LogError("The MCAP file has no messages of ROS 2 or JSON in it. Export CSV.")

    def column(name: str) -> Column:
        stamps, values = (np.array(x, dtype=np.float64) for x in found[name])
        ranks: Any = np.argsort(stamps, kind="stable")
        times: Array = stamps[ranks]
        return Column(values[ranks], time=times)

    return Table(tuple(found), column)


def _numbers(name: str, item: Any, depth: int = 0) -> Iterator[tuple[str, float]]:
    """Numbers in a message by their path: ``imu.angular_velocity.z``."""
    if isinstance(item, int | float) and not isinstance(item, bool):
        yield name, float(item)
        return
    fields = item if isinstance(item, dict) else _slots(item)
    if depth < _DEEPEST:
        for key, child in fields.items():
            if key not in ("header", "stamp"):
                yield from _numbers(f"{name}.{key}", child, depth + 1)


def _slots(message: Any) -> dict[str, Any]:
    """Fields of a ROS message."""
    return {key: getattr(message, key) for key in getattr(message, "__slots__", ())}


def _stamp(message: Any) -> float:
    """When a message was made, as its header says [s]; 0 where it does not."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    seconds, nanoseconds = (getattr(stamp, key, 0) for key in ("sec", "nanosec"))
    return float(seconds) + 1e-9 * float(nanoseconds)
