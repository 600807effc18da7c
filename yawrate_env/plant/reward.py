"""The reward: closed-loop margin error.

    e = hypot((phase margin - target)/10 deg, (crossover - target)/0.25 Hz)
    reward = -e / (1 + e/4)          stable loops: in (-4, 0], slope -1 at the target
    reward = -4                      stable without a crossover
    reward = -5                      unstable

Unlike a clipped error it still slopes when far off, and no unstable loop can be worth
more than a stable one.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.target import Target

PHASE_SCALE = 10.0
CROSSOVER_SCALE = 0.25
WORST_STABLE = -4.0
UNSTABLE = -5.0


def margin_error(
    phase_margin: NDArray[np.float64], crossover: NDArray[np.float64], target: Target
) -> NDArray[np.float64]:
    """Scaled distance from the target, (B,) of [deg] and (B,) of [Hz] to (B,)."""
    return np.hypot(
        (phase_margin - target.phase_margin) / PHASE_SCALE,
        (crossover - target.crossover) / CROSSOVER_SCALE,
    )


def reward(
    phase_margin: NDArray[np.float64],
    crossover: NDArray[np.float64],
    stable: NDArray[np.bool_],
    target: Target,
) -> NDArray[np.float64]:
    """Reward of B loops, between -5 and 0."""
    return np.where(stable, graded(margin_error(phase_margin, crossover, target)), UNSTABLE)


def graded(e: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reward of stable loops with scaled errors `e`, not finite where there is none."""
    finite = np.isfinite(e)
    e = np.where(finite, e, 0.0)
    return np.where(finite, WORST_STABLE * e / (e - WORST_STABLE), WORST_STABLE)
