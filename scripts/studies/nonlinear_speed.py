"""How fast the nonlinear vehicle is simulated, compared with a loop of ``solve_ivp`` calls.

Both must keep the yaw rate within `ERROR` of a solution with tolerances of 1e-12.  SciPy
gets its fastest method and the loosest tolerance that manage; where the steering rate
stays below its limit, it need not watch for it.  Contenders take turns, and each counts
with its best round, the one that a busy machine disturbed least: by the clock, where this
has all cores and a loop has one, and in processor time, which compares core with core.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.draws import draw
from studies.markdown import table
from studies.nonlinear import task_at
from studies.nonlinear_reference import solve
from yawrate_env.batch import take
from yawrate_env.compiled import LANES, cores, over_blocks
from yawrate_env.vehicle.nonlinear import NonlinearTwin
from yawrate_env.vehicle.single_track import Context, context_of
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

ERROR = 1e-8
METHODS = ("RK45", "DOP853", "LSODA")
TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
_VEHICLES = 1  # that SciPy solves in a round


def measure(num_envs: int, rounds: int, progress: Progress) -> list[dict[str, Any]]:
    """Milliseconds an episode, errors and ratios at 1 and 4 degrees."""
    found = []
    for amplitude, limited in ((1.0, False), (4.0, True)):
        task = task_at(amplitude)
        drawn = draw(yaw_rate(task), "test", 0, 0, num_envs)
        context, u = context_of(drawn.theta), drawn.u
        few = take(context, slice(0, _VEHICLES))
        truth = _loop(task, few, u, limited, "DOP853", 1e-12)
        method, tolerance, error = _fastest(task, few, u, limited, truth)
        y = driven(task, context, u)  # compiles
        times = np.empty((rounds, 2, 2))
        for done in range(rounds):
            times[done, 0] = _timed(lambda: driven(task, context, u)) / num_envs  # noqa: B023
            times[done, 1] = _timed(
                lambda: _loop(task, few, u, limited, method, tolerance)  # noqa: B023
            ) / len(few)  # fmt: skip
            progress(f"speed at {amplitude:g} deg", done + 1, rounds)
        ours, theirs = 1e3 * times.min(axis=0)
        found.append(
            {
                "amplitude": amplitude,
                "cores": cores(),
                "num_envs": num_envs,
                "milliseconds": ours.tolist(),
                "error": float(np.abs(y[:_VEHICLES] - truth).max()),
                "scipy": {"method": method, "tolerance": tolerance,
                          "milliseconds": theirs.tolist(), "error": error},
                "ratio": (theirs / ours).tolist(),
            }
        )  # fmt: skip
    return found


def _timed(work: Callable[[], object]) -> Array:
    """Seconds that some work takes, by the clock and of the processor."""
    wall, processor = time.perf_counter(), time.process_time()
    work()
    return np.array([time.perf_counter() - wall, time.process_time() - processor])


def driven(task: Task, context: Context, u: Array) -> Array:
    """Noise-free yaw rates of the task's twin, (B, N) [rad/s]."""
    y = np.empty((len(context), u.shape[1]))
    simulate = task.twin.simulator(task.vehicle, context, u, task.experiment.Ts)

    def one_block(i: int, j: int) -> None:
        simulate(y[i:j], i, j)

    over_blocks(one_block, len(context), LANES)
    return y


def to_markdown(found: list[dict[str, Any]]) -> str:
    """The measurements as a table."""
    first, rows = found[0], []
    for row in found:
        scipy, ratio = row["scipy"], row["ratio"]
        rows.append(
            (f"±{row['amplitude']:g}°", f"{row['milliseconds'][0]:.2f}", f"{row['error']:.0e}",
             f"{scipy['method']} at {scipy['tolerance']:.0e}", f"{scipy['milliseconds'][0]:.0f}",
             f"{scipy['error']:.0e}", f"{ratio[0]:.0f}", f"{ratio[1]:.0f}")
        )  # fmt: skip
    return (
        f"Batches of {first['num_envs']} vehicles on {first['cores']} cores; SciPy's loop "
        "uses one.\n\n"
    ) + table(
        ("command", "this, ms an episode", "error [rad/s]", "SciPy's best", "ms an episode",
         "error [rad/s]", "ratio", "core to core"),
        rows,
    )  # fmt: skip


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
