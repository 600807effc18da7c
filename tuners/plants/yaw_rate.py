"""The yaw-rate case as one plant among others, through no private door."""

import numpy as np
from numpy.typing import NDArray

from tuners.plants.coordinates import loop
from tuners.plants.pi_loop import FIGURES, GAINS, PILoop
from tuners.plants.plant import Plant, snr
from yawrate_env.discretisation import DiscretePlant
from yawrate_env.episode import excitation, plants
from yawrate_env.task import Task
from yawrate_env.vehicle import Context

Array = NDArray[np.float64]


def yaw_rate(task: Task) -> Plant:
    """Describe a task's vehicles, experiment and loop target.

    A plant has one experiment and nothing that is measured beside it: the speed must be
    known and the register the same.
    """
    low, high = task.prior.v_x
    if low != high or task.experiment.register != "same":
        raise ValueError(
            f'v_x = [{low:g}, {high:g}], register = "{task.experiment.register}": a plant has one '
            'speed and one input. Give a single v_x and register="same".'
        )

    def discrete(theta: Array, Ts: float) -> DiscretePlant:
        return plants(task.vehicle, Context.of(theta[:, 0], theta[:, 1], low), Ts)

    vehicle = PILoop(discrete, task.experiment.Ts, task.target)
    return Plant(
        prior={"mu_s": task.prior.mu_s, "M_delta": task.prior.M_delta},
        simulate=vehicle.simulate,
        design=vehicle.design,
        judge=vehicle.judge,
        gains=GAINS,
        figures=FIGURES,
        coordinates=loop(task.target),
        u=excitation(task.experiment, np.zeros(1, np.uint64))[0],
        Ts=task.experiment.Ts,
        noise=snr(task.experiment.snr_db),
        signals=("steering command [rad]", "yaw rate [rad/s]"),
    )
