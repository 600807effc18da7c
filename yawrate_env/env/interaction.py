"""What the scalar and the vector environment share: spaces, observation, outcome.

Everything here is batched; the scalar environment is a batch of one.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop.loops import Evaluation
from yawrate_env.loop.target import Target
from yawrate_env.signals.decimation import averaged
from yawrate_env.vehicle.episode import Draw, loops, record
from yawrate_env.vehicle.single_track import LARGEST, Context, Vehicle
from yawrate_env.vehicle.task import Experiment, Prior, Task

KP_RANGE = (1e-3, 10.0)
TI_RANGE = (1e-3, 100.0)
YAW_RATE_RANGE = 20.0
"""The sensor saturates here [rad/s], far beyond any vehicle."""

VISIBLE = {"episode": (), "speed": ("v_x",), "context": ("v_x", "mu_s", "M_delta")}
"""What the observation shows beside command and yaw rate: further rows, constant in time."""

Info = dict[str, Any]


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


def action_space() -> Box:
    """(kp, Ti) in physical units."""
    low, high = np.array([KP_RANGE, TI_RANGE]).T
    return Box(low, high, dtype=np.float64)


def observation_space(experiment: Experiment, visible: str, decimate: int) -> Box:
    """Rows: command [rad], yaw rate [rad/s], and what is visible of the context (SI)."""
    validation.one_of("visible", visible, tuple(VISIBLE))
    remedy = "Use 1 to keep every sample."
    decimate = validation.count("decimate", decimate, at_least=1, remedy=remedy)
    samples = experiment.N // decimate
    if samples < 2:
        raise ValueError(f"decimate = {decimate} leaves {samples} of {experiment.N} samples.")
    rows = [experiment.amplitude * (1 + 1e-6), YAW_RATE_RANGE]
    rows += [LARGEST[name] for name in VISIBLE[visible]]
    high = np.repeat(np.array(rows, dtype=np.float32)[:, None], samples, axis=1)
    return Box(-high, high, dtype=np.float32)


def mapping(options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Options of ``reset``, a copy, or ``ValueError``."""
    if not isinstance(options, Mapping | None):
        raise ValueError(
            f"reset options = {options!r} are not a dictionary. Give {{name: value}}, or None."
        )
    return dict(options or {})


def pinned(options: Mapping[str, Any] | None, count: int) -> dict[str, NDArray[np.float64]]:
    """Context values that ``reset(options=...)`` pins, each (count,)."""
    values: dict[str, NDArray[np.float64]] = {}
    for name, value in mapping(options).items():
        if name not in Context.__slots__:
            raise ValueError(
                f"reset option {name!r} is unknown. Use any of {', '.join(Context.__slots__)}."
            )
        try:
            array = np.asarray(validation.real_array(name, value), dtype=np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"reset option {name} = {value!r}: give one number.") from None
        if array.shape not in ((), (count,)):
            raise ValueError(f"reset option {name} has shape {array.shape}: give one number.")
        values[name] = np.broadcast_to(array, (count,))
    return values


def draw(words: NDArray[np.uint64], task: Task, fixed: Mapping[str, NDArray[np.float64]]) -> Draw:
    """Episodes of the prior, with the pinned values in place of the drawn ones."""
    drawn = Draw.of(words, task.prior)
    if not fixed:
        return drawn
    context = Context.of(
        *(fixed.get(name, getattr(drawn.context, name)) for name in Context.__slots__)
    )
    return Draw(context, drawn.start, drawn.key)


def observe(task: Task, drawn: Draw, visible: str, decimate: int) -> NDArray[np.float32]:
    """Record the episodes, (B, rows, N // decimate) float32; decimation averages blocks."""
    rows = 2 + len(VISIBLE[visible])
    obs = np.empty((len(drawn), rows, task.experiment.N), dtype=np.float32)
    u, _ = record(task, drawn, out=obs[:, 1])
    if not np.isfinite(obs[:, 1]).all():
        worst = int(np.argmin(np.isfinite(obs[:, 1]).all(axis=1)))
        mu_s, M_delta, v_x = (getattr(drawn.context, name)[worst] for name in Context.__slots__)
        raise ValueError(
            f"The yaw rate with mu_s = {mu_s:.3g}, M_delta = {M_delta:.4g} kg and v_x = {v_x:.3g} "
            "m/s is not finite: the vehicle is unstable. Lower v_x, or check the vehicle."
        )
    return _completed(obs, u, drawn.context, visible, decimate)


def show(
    u: NDArray[np.float64],
    y: NDArray[np.floating],
    context: Context | None,
    visible: str,
    decimate: int,
) -> NDArray[np.float32]:
    """What `observe` would give for episodes already recorded, (1 or B, N) and (B, N)."""
    obs = np.empty((len(y), 2 + len(VISIBLE[visible]), y.shape[1]), dtype=np.float32)
    obs[:, 1] = y
    return _completed(obs, u, context, visible, decimate)


def _completed(
    obs: NDArray[np.float32],
    u: NDArray[np.float64],
    context: Context | None,
    visible: str,
    decimate: int,
) -> NDArray[np.float32]:
    """Fill in what surrounds the yaw rate of row 1, and decimate."""
    obs[:, 0] = u
    np.clip(obs[:, 1], -YAW_RATE_RANGE, YAW_RATE_RANGE, out=obs[:, 1])
    for row, name in enumerate(VISIBLE[visible], start=2):
        obs[:, row] = getattr(context, name)[:, None]
    return obs if decimate == 1 else averaged(obs, decimate).astype(np.float32)


def checked_actions(actions: Any, count: int) -> NDArray[np.float64]:
    """Actions as (count, 2) finite float64, or ``ValueError``."""
    return validation.finite_array("action", actions, shape=(count, 2))


def outcome(task: Task, context: Context, actions: NDArray[np.float64]) -> tuple[Evaluation, Info]:
    """Loops actions (B, 2); the info holds arrays (B,), the truth included."""
    space_low, space_high = np.array([KP_RANGE, TI_RANGE]).T
    gains = np.clip(actions, space_low, space_high)
    kp, Ti = gains.T
    judge = loops(task, context)
    verdict, oracle = judge.evaluate(kp, Ti), judge.design()
    return verdict, {
        "kp": kp,
        "Ti": Ti,
        "clipped": (gains != actions).any(axis=1),
        "phase_margin": verdict.margins.phase_margin,
        "crossover": verdict.margins.crossover,
        "gain_margin": verdict.margins.gain_margin,
        "stable": verdict.stable,
        "oracle_kp": oracle.kp,
        "oracle_Ti": oracle.Ti,
        "mu_s": context.mu_s,
        "M_delta": context.M_delta,
        "v_x": context.v_x,
    }
