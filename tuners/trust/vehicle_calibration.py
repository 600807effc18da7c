"""Split conformal calibration of a vehicle tuner's intervals."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.trust.vehicle_trust import Calibration
from tuners.tuner import training
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env import validation
from yawrate_env.plant.episodes import Episodes
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import context_of, yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

EPISODES = 5000


def calibrate(
    tuner: Tuner, *, episodes: int = EPISODES, seed: int = 0, progress: Progress | None = None
) -> None:
    """Set the tuner's `calibration` from `episodes` of the ``calibration`` set."""
    validation.count("episodes", episodes, at_least=100, remedy="Simulate more.")
    factors = training.calibrated(
        yaw_rate(tuner.task),
        assessed(tuner, "calibration", episodes, seed),
        None if progress is None else lambda done: progress(done, episodes),
    )
    tuner.calibration = Calibration(float(factors[0]), float(factors[1]), episodes, seed)


def assessed(
    tuner: Tuner, name: str, episodes: int, seed: int, task: Task | None = None
) -> Iterator[tuple[Episodes, Assessment, Array]]:
    """Tune and assess episodes of a set as `Tuner.tune` does, in bounded memory.

    Parameters
    ----------
    task : Task, optional
        Where the episodes come from, if not from the tuner's own task.

    Yields
    ------
    Episodes
    Assessment
    (B, 2) float64
        Phase margin [deg] and crossover [Hz] with the true vehicles; ``nan`` if unstable.
    """

    def answer(block: Episodes) -> tuple[Array, Assessment]:
        truth = context_of(block.theta)
        design, found = tuner.assess(Recording(block.u, block.y, plant.Ts, truth.v_x, truth))
        return np.stack([design.kp, design.Ti], axis=1), found

    plant = yaw_rate(task or tuner.task)
    yield from training.assessed(plant, name, episodes, seed, answer)
