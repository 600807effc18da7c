"""Lower sampling rates by block averages."""

import numpy as np
from numpy.typing import NDArray


def averaged(x: NDArray[np.floating], block: int) -> NDArray[np.float64]:
    """Block averages along the last axis; an incomplete block at the end is left out."""
    kept = x.shape[-1] // block
    blocks = x[..., : kept * block].reshape(*x.shape[:-1], kept, block)
    return np.asarray(blocks.mean(axis=-1, dtype=np.float64))
