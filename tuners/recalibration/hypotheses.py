"""What may be wrong with a car's data, and what is known of cars under each hypothesis."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from yawrate_env.vehicle.drive_slopes import Past

Array = NDArray[np.float64]

SPREAD = {
    "C_f": 0.1,
    "J_z": 0.1,
    "omega_n": 0.2,
    "xi": 0.15,
    "l_rel_r": 0.15,
    "l_f": 0.1,
    "l_r": 0.1,
    "speed": 0.1,
    "load": 0.1,
    "gain": 0.1,
    "late": 0.02,
    "offset": 0.005,
}
"""What may be wrong, and its standard deviation where it is."""

TOGETHER = ("C_f", "J_z", "omega_n", "gain")
"""What costs margins most: of these, two may be wrong at once."""

_SINGLE, _DOUBLE = 0.05, 0.005  # of cars with one wrong number, and with two


def suspected() -> dict[tuple[str, ...], float]:
    """What may be wrong: each of `SPREAD`, and two of `TOGETHER`, with probabilities."""
    pairs = list(combinations(TOGETHER, 2))
    return {(name,): _SINGLE / len(SPREAD) for name in SPREAD} | dict.fromkeys(
        pairs, _DOUBLE / len(pairs)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Knowledge:
    """What is known of B cars.

    Attributes
    ----------
    mean, covariance : NDArray
        (B, H, q) and (B, H, q, q) of the coordinates that all share, and a hypothesis' own.
    weight : NDArray
        (B, H) logarithms of probabilities.
    jumped : NDArray
        (B,) probability that friction jumped before the last window.
    energy, slow, windows : NDArray
        (B,) squared prediction errors in units of the claimed noise, those of slow sums, and of how
        many windows.
    past : Past
        What reading the next window needs.
    response : NDArray
        (B, P + 1) slopes of the plant's response (`yawrate_env.vehicle.drive_slopes.Slopes`); zero
        before the first window.
    """

    mean: Array
    covariance: Array
    weight: Array
    jumped: Array
    energy: Array
    slow: Array
    windows: Array
    past: Past
    response: NDArray[np.complex128]

    def __len__(self) -> int:
        return len(self.mean)
