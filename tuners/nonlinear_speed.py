"""How fast the nonlinear vehicle is driven, beside a loop of ``solve_ivp`` calls.

Both must keep the yaw rate within `ERROR` of a solution with tolerances of 1e-12.  SciPy
gets its fastest method and the loosest tolerance that manage; where the steering rate
stays below its limit, it need not watch for it.  Contenders take turns, and each counts
with its best round and in processor time, which a busy machine disturbs least; that this
runs on all cores and a loop on one comes on top.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.nonlinear_reference import solve
from tuners.nonlinear_study import task_at
from yawrate_env.batch import take
from yawrate_env.compiled import LANES, cores, over_blocks
from yawrate_env.contexts import CONTEXT_SETS
from yawrate_env.episode import excitation
from yawrate_env.nonlinear import NonlinearTwin
from yawrate_env.task import Task
from yawrate_env.vehicle import Context

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

ERROR = 1e-8
METHODS = ("RK45", "DOP853", "LSODA")
TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
_VEHICLES = 1  # that SciPy solves in a round


def measure(num_envs: int, rounds: int, progress: Progress) -> list[dict[str, Any]]:
    """Processor seconds an episode of this and of SciPy, their errors and ratio, at 1 and 4 degrees."""
    found = []
    for amplitude, limited in ((1.0, False), (4.0, True)):
        task = task_at(amplitude)
        draw = CONTEXT_SETS["test"].draw(task.prior, 0, 0, num_envs)
        u = excitation(task.experiment, draw.start)
        few = take(draw.context, slice(0, _VEHICLES))
        truth = _loop(task, few, u, limited, "DOP853", 1e-12)
        method, tolerance, error = _fastest(task, few, u, limited, truth)
        ours: list[float] = []
        theirs: list[float] = []
        y = driven(task, draw.context, u)  # compiles
        for done in range(rounds):
            start = time.process_time()
            y = driven(task, draw.context, u)
            ours.append((time.process_time() - start) / num_envs)
            start = time.process_time()
            _loop(task, few, u, limited, method, tolerance)
            theirs.append((time.process_time() - start) / len(few))
            progress(f"speed at {amplitude:g} deg", done + 1, rounds)
        found.append(
            {
                "amplitude": amplitude,
                "cores": cores(),
                "num_envs": num_envs,
                "seconds": min(ours),
                "error": float(np.abs(y[:_VEHICLES] - truth).max()),
                "scipy": {
                    "method": method,
                    "tolerance": tolerance,
                    "seconds": min(theirs),
                    "error": error,
                },
                "ratio": min(theirs) / min(ours),
            }
        )
    return found


def driven(task: Task, context: Context, u: Array) -> Array:
    """Noise-free yaw rates of the task's twin, (B, N) [rad/s]."""
    y = np.empty((len(context), u.shape[1]))
    simulate = task.twin.simulator(task.vehicle, context, u, task.experiment.Ts)
    over_blocks(lambda i, j: simulate(y[i:j], i, j), len(context), LANES)
    return y


def to_markdown(found: list[dict[str, Any]]) -> str:
    """The measurements as a table."""
    lines = [
        f"Processor time; batches of {found[0]['num_envs']} vehicles share "
        f"{found[0]['cores']} cores, which the ratio leaves out.",
        "",
        "| command | this, ms an episode | error [rad/s] | SciPy's best | ms an episode "
        "| error [rad/s] | ratio |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in found:
        scipy = row["scipy"]
        lines.append(
            f"| ±{row['amplitude']:g}° | {1e3 * row['seconds']:.2f} | {row['error']:.0e} "
            f"| {scipy['method']} at {scipy['tolerance']:.0e} | {1e3 * scipy['seconds']:.0f} "
            f"| {scipy['error']:.0e} | {row['ratio']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def _fastest(
    task: Task, context: Context, u: Array, limited: bool, truth: Array
) -> tuple[str, float, float]:
    """Method, tolerance and error of SciPy's fastest way to an error below `ERROR`."""
    candidates = []
    for method in METHODS:
        for tolerance in TOLERANCES:
            start = time.process_time()
            y = _loop(task, context, u, limited, method, tolerance)
            seconds, error = time.process_time() - start, float(np.abs(y - truth).max())
            if error < ERROR:
                candidates.append((seconds, method, tolerance, error))
                break
    _, method, tolerance, error = min(candidates)
    return method, tolerance, error


def _loop(
    task: Task, context: Context, u: Array, limited: bool, method: str, tolerance: float
) -> Array:
    assert isinstance(task.twin, NonlinearTwin)
    rows = np.stack([context.mu_s, context.M_delta, context.v_x], axis=1).tolist()
    return np.stack(
        [
            solve(task.vehicle, task.twin, tuple(c), u[0], task.experiment.Ts, method=method,
                  rtol=tolerance, atol=tolerance / 100, limited=limited)
            for c in rows
        ]
    )  # fmt: skip
