"""Lengths of Fourier transforms: products of 2, 3 and 5, for which they are fast.

As ``scipy.fft.next_fast_len(n, real=True)``, whose package takes as long to import as an answer.
"""

from functools import lru_cache
from itertools import product


@lru_cache(maxsize=64)
def fast_length(n: int) -> int:
    """Least product of powers of 2, 3 and 5 that is `n` or more."""
    odd = [int(3**i * 5**j) for i, j in product(range(n.bit_length()), repeat=2)]
    return min(k << max((-(-n // k) - 1).bit_length(), 0) for k in odd)
