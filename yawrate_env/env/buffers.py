"""Memory for arrays of one shape, used again once nobody looks at it any more.

Observations of a thousand episodes take 80 MB.  Fresh memory costs a page fault every 4 kB, which
on many machines is more than filling it; memory that a caller still looks at must not change.  So
every array is handed out on memory of its own, and the memory comes back when the array and all
views of it are gone.
"""

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SPARE = 4  # more than a loop drops at a time


class Buffers:
    """Arrays of one shape on recycled memory.

    Parameters
    ----------
    shape : tuple of int
        The arrays'.
    dtype : dtype
        The arrays'.
    """

    def __init__(self, shape: tuple[int, ...], dtype: Any) -> None:
        self._shape, self._dtype = shape, np.dtype(dtype)
        self._spare: list[memoryview] = []

    def empty(self) -> NDArray[Any]:
        """An array with arbitrary content that nobody else sees."""
        memory = self._spare.pop() if self._spare else np.empty(self._shape, self._dtype).data
        # Every view refers to this array, since what is behind it is no array.
        flat = np.frombuffer(memory, dtype=self._dtype)
        weakref.finalize(flat, _give_back, self._spare, memory).atexit = False
        return flat.reshape(self._shape)


def _give_back(spare: list[memoryview], memory: memoryview) -> None:
    if len(spare) < _SPARE:
        spare.append(memory)
