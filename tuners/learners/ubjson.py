"""Read universal binary JSON (ubjson.org, draft 12), in which xgboost keeps its models.

xgboost's own reader trusts what it reads: numbers out of range end the process.
"""

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_NUMBERS = {"i": ">i1", "U": ">u1", "I": ">i2", "l": ">i4", "L": ">i8", "d": ">f4", "D": ">f8"}
_FORMATS = {"i": ">b", "U": ">B", "I": ">h", "l": ">i", "L": ">q", "d": ">f", "D": ">d"}
_CONSTANTS = {"Z": None, "T": True, "F": False}
_DEEPEST = 16


def decoded(content: bytes) -> Any:
    """Objects as dicts, arrays of numbers of one type as arrays, others as lists.

    ``ValueError`` for anything else than one whole value.
    """
    reader = _Reader(content)
    try:
        found = reader.value(reader.marker())
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise ValueError(f"byte {reader.at} is no universal binary JSON: {error}.") from None
    if reader.at != len(content):
        raise ValueError(f"{len(content) - reader.at} bytes follow the universal binary JSON.")
    return found


class _Reader:
    """A place in the content."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at, self.depth = content, 0, 0

    def marker(self) -> str:
        self.at += 1
        return chr(self.content[self.at - 1])

    def value(self, marker: str) -> Any:
        """The value that a marker begins."""
        if marker in _FORMATS:
            return self._number(marker)
        if marker == "S":
            return self._text()
        if marker in _CONSTANTS:
            return _CONSTANTS[marker]
        if marker not in "[{":
            raise ValueError(f"byte {self.at} has {marker!r}, which begins no value.")
        self.depth += 1
        if self.depth > _DEEPEST:
            raise ValueError(f"byte {self.at}: values are nested more than {_DEEPEST} deep.")
        found = self._array() if marker == "[" else self._object()
        self.depth -= 1
        return found

    def _number(self, marker: str) -> float | int:
        (found,) = struct.unpack_from(_FORMATS[marker], self.content, self.at)
        self.at += struct.calcsize(_FORMATS[marker])
        return found  # type: ignore[no-any-return]

    def _length(self) -> int:
        marker = self.marker()
        length = self._number(marker) if marker in "iUIlL" else -1
        if not 0 <= length <= len(self.content) - self.at:
            raise ValueError(f"byte {self.at} has a length that the content does not have.")
        return int(length)

    def _text(self) -> str:
        length = self._length()
        self.at += length
        return self.content[self.at - length : self.at].decode()

    def _array(self) -> list[Any] | NDArray[Any]:
        marker = self.marker()
        if marker == "$":
            kind = self.marker()
            if kind not in _NUMBERS or self.marker() != "#":
                raise ValueError(f"byte {self.at}: an array of {kind!r} without a length.")
            numbers = np.frombuffer(self.content, _NUMBERS[kind], self._length(), self.at)
            self.at += numbers.nbytes
            return numbers
        if marker == "#":
            return [self.value(self.marker()) for _ in range(self._length())]
        found = []
        while marker != "]":
            found.append(self.value(marker))
            marker = self.marker()
        return found

    def _object(self) -> dict[str, Any]:
        found = {}
        while self.content[self.at] != ord("}"):
            key = self._text()
            found[key] = self.value(self.marker())
        self.at += 1
        return found
