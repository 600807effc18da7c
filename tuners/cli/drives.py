"""Shared parts of the commands about drives: the car, and whole logs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tuners.logs import Options
from yawrate_env.vehicle import vehicle_file
from yawrate_env.vehicle.drive_conditions import Conditions
from yawrate_env.vehicle.drives import Drives
from yawrate_env.vehicle.single_track import CONTEXT
from yawrate_env.vehicle.task import Experiment, Prior, Task

SPEEDS = (10.0, 33.0)
"""Range of the speed [m/s], where no vehicle's file says one."""


def task_of(vehicle: Path | None) -> Task:
    """The task of a vehicle's file, or the paper's; sampled as its controller is."""
    task = Task(prior=Prior(v_x=SPEEDS)) if vehicle is None else vehicle_file.read(vehicle)
    given = task.experiment
    N = max(2, round(given.N * given.Ts / task.target.Ts))
    sampled = Experiment(task.target.Ts, N, given.amplitude, max(given.bit_time, task.target.Ts))
    return replace(task, experiment=sampled)


def drives_of(task: Task) -> Drives:
    """Drives of its cars."""
    ends: Any = {name: tuple(getattr(task.prior, name)) for name in CONTEXT}
    return Drives.of(task.vehicle, Conditions(**ends, Ts=task.target.Ts), task.target)


def whole(options: Options) -> Options:
    """A log is used from its beginning to its end, unless a stretch is chosen."""
    chosen = options.start is not None or options.stop is not None
    return options if chosen else replace(options, start=-np.inf)
