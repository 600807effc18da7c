"""Cost of an emulator's errors: how far the simulator's own slopes would move answers.

Where a fit with the emulator's slopes has ended, one more Gauss-Newton step is taken with those of
the simulator.  If the emulator were exact it would be none.
"""

import numpy as np

from tuners.trust.bound import metric_slopes
from tuners.trust.fit import signals
from tuners.trust.identification import drawn_to_prior
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.episodes import recorded

PLANTS = 32
"""Of the ``calibration`` set."""

MUCH = 0.3
"""Of a metric's standard deviation: a larger shift is told as a warning."""


def emulator_shift(tuner: Tuner, seed: int = 0) -> float:
    """Root mean square shift of the counted metrics, in their standard deviations."""
    plant = tuner.plant
    block = recorded(plant, "calibration", seed, PLANTS)
    seen = tuner.inspection.look(Recording(block.u, block.y, plant.Ts, block.theta))
    theta, exact = seen.fit.theta, plant.with_simulator(plant.simulate)
    error, slopes = signals(exact, theta, seen.model)
    inverse, covariance = drawn_to_prior(slopes, (error**2).mean(axis=1))
    step = np.einsum("bij,bjn,bn->bi", inverse, slopes, error)
    J = metric_slopes(plant, theta)
    variance = np.einsum("bfi,bij,bfj->bf", J, covariance, J)
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.einsum("bfi,bi->bf", J, step) ** 2 / variance
    return float(np.sqrt(shift[np.isfinite(shift)].mean()))


def sentences(training: dict[str, object]) -> list[str]:
    """What to say of it."""
    found = training.get("emulator")
    if not isinstance(found, dict):
        return []
    shift, nodes = found["shift"], found["nodes"]
    said = (
        f"An emulator of {nodes} simulations helped to fit plants; its error moves metrics by "
        f"{shift:.2g} of their standard deviations"
    )
    if shift <= MUCH:
        return [f"{said}."]
    return [f"{said}: simulate more plants (--episodes), or narrow the prior."]
