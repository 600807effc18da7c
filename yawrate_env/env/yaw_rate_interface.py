"""Keyword arguments of ``yawrate/PITuning-v0`` to its task, spaces and visible parameters."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from yawrate_env import validation
from yawrate_env.env.interface import Interface
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.single_track import LARGEST, OTHERS, Vehicle, bounds, check_parameter
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

KP_RANGE = (1e-3, 10.0)
TI_RANGE = (1e-3, 100.0)
YAW_RATE_RANGE = 20.0
"""The sensor saturates here [rad/s], far beyond any vehicle."""

BASIS = (10, 12.0)
"""Order and pole [rad/s] of the Laguerre features."""

VISIBLE = {"episode": (), "speed": ("v_x",), "context": ("v_x", "mu_s", "M_delta")}
"""Parameters that the observation holds beside command and yaw rate, constant in time; the last
has every other one of the prior, too."""


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
    others: Mapping[str, Any],
) -> Task:
    """Build the task from the environment's keyword arguments, checking every one."""
    try:
        known = Vehicle(**(vehicle or {}))
    except TypeError:
        names = ", ".join(Vehicle.__slots__)
        raise ValueError(f"vehicle = {vehicle!r}: give any of {names}, as numbers.") from None
    unknown = [name for name in others if name not in OTHERS]
    if unknown:
        raise TypeError(
            f"__init__() got an unexpected keyword argument {unknown[0]!r}. Give a documented "
            f"one, or a range of one of {', '.join(OTHERS)}."
        )
    return Task(
        known,
        Prior(mu_s, M_delta, v_x, **others),
        Experiment(Ts, N, amplitude, bit_time, register, snr_db),
        Target(phase_margin, crossover, Ts_control, delay_samples, controller),
    )


def interface_of(task: Task, visible: str, decimate: int) -> Interface:
    """The published spaces; visible parameters are features as they are."""
    names = VISIBLE[validation.one_of("visible", visible, tuple(VISIBLE))]
    names += task.prior.others if visible == "context" else ()
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
        check_pin=check_parameter,
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
    rows = [experiment.amplitude * (1 + 1e-6), YAW_RATE_RANGE, *(_largest(n) for n in visible)]
    high = np.repeat(np.array(rows, dtype=np.float32)[:, None], samples, axis=1)
    return Box(-high, high, dtype=np.float32)


def _largest(name: str) -> float:
    return LARGEST[name] if name in LARGEST else bounds(name)[1]
