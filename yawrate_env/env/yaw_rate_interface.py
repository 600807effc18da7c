"""Keyword arguments of ``yawrate/PITuning-v0`` to its task, spaces and visible parameters."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from yawrate_env import validation
from yawrate_env.env.interface import Interface
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.single_track import LARGEST, SMALLEST, Vehicle
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

KP_RANGE = (1e-3, 10.0)
TI_RANGE = (1e-3, 100.0)
YAW_RATE_RANGE = 20.0
"""The sensor saturates here [rad/s], far beyond any vehicle."""

BASIS = (10, 12.0)
"""Order and pole [rad/s] of the Laguerre features."""

VISIBLE = {"episode": (), "speed": ("v_x",), "context": ("v_x", "mu_s", "M_delta")}
"""Parameters that the observation holds beside command and yaw rate, constant in time."""


def task_of(
    *,
    Ts: float,
    N: int,
    snr_db: float,
    amplitude: float,
    bit_time: float,
    register: str,
    Ts_control: float,
    delay_samples: int,
    phase_margin: float,
    crossover: float,
    controller: str,
    mu_s: Any,
    M_delta: Any,
    v_x: Any,
    vehicle: Mapping[str, float] | None,
) -> Task:
    """Build the task from the environment's keyword arguments, checking every one."""
    try:
        known = Vehicle(**(vehicle or {}))
    except TypeError:
        names = ", ".join(Vehicle.__slots__)
        raise ValueError(f"vehicle = {vehicle!r}: give any of {names}, as numbers.") from None
    return Task(
        known,
        Prior(mu_s, M_delta, v_x),
        Experiment(Ts, N, amplitude, bit_time, register, snr_db),
        Target(phase_margin, crossover, Ts_control, delay_samples, controller),
    )


def interface_of(task: Task, visible: str, decimate: int) -> Interface:
    """The published spaces; visible parameters are features as they are."""
    names = VISIBLE[validation.one_of("visible", visible, tuple(VISIBLE))]
    remedy = "Use 1 to keep every sample."
    decimate = validation.count("decimate", decimate, at_least=1, remedy=remedy)
    plant = yaw_rate(task, check=False)
    columns = np.array(plant.indices(names), dtype=np.intp)
    low, high = np.array([KP_RANGE, TI_RANGE]).T
    return Interface(
        plant,
        _observation_space(task.experiment, names, decimate),
        Box(low, high, dtype=np.float64),
        names,
        features_of=partial(np.take, indices=columns, axis=1),
        check_pin=_check_pin,
        decimate=decimate,
        unmasked=True,
        basis=BASIS,
    )


def _observation_space(experiment: Experiment, visible: tuple[str, ...], decimate: int) -> Box:
    """Rows: command [rad], yaw rate [rad/s], and the visible parameters (SI)."""
    samples = experiment.N // decimate
    if samples < 2:
        raise ValueError(
            f"decimate = {decimate} leaves {samples} of {experiment.N} samples. Leave 2 or more."
        )
    rows = [experiment.amplitude * (1 + 1e-6), YAW_RATE_RANGE, *(LARGEST[n] for n in visible)]
    high = np.repeat(np.array(rows, dtype=np.float32)[:, None], samples, axis=1)
    return Box(-high, high, dtype=np.float32)


def _check_pin(name: str, value: float) -> float:
    """Any vehicle that is physical, also outside the prior."""
    above = 0.0 if name in SMALLEST else -np.inf
    return validation.number(
        name,
        value,
        above=above,
        at_least=SMALLEST.get(name, -np.inf),
        at_most=LARGEST[name],
        remedy="Use SI units.",
    )
