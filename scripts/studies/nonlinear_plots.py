"""The nonlinear vehicle in pictures: its tyres, its response, and what a linear twin costs."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray

from studies.nonlinear import GRAY, LINEAR, MISTAKEN, NONLINEAR, Score, task_at
from studies.nonlinear_speed import driven
from studies.palette import INK, MODEL, STYLE, WIDTH, colour
from yawrate_env.env import rendering
from yawrate_env.vehicle.episode import excitation
from yawrate_env.vehicle.nonlinear import Tyre
from yawrate_env.vehicle.nonlinear.body import GRAVITY
from yawrate_env.vehicle.nonlinear.tyre import lateral_force
from yawrate_env.vehicle.single_track import Context, Vehicle

Array = NDArray[np.float64]

FRICTIONS = {0.3: "#b9bec4", 0.7: "#7b838c", 1.1: INK}
# One tuner has one colour, whatever it was trained on; the gray box covers the widest line.
LOOKS: dict[str, dict[str, Any]] = {
    LINEAR: {"color": colour("ts-ff-lag"), "marker": "o", "lw": 4, "ms": 7, "alpha": 0.6},
    NONLINEAR: {"color": colour("ts-ff-lag"), "marker": "s", "lw": 1.5, "ms": 4},
    GRAY: {"color": colour("gb"), "marker": "o", "lw": 1.5, "ms": 4},
    MISTAKEN: {"color": colour("ts-ff-lag"), "marker": "^", "lw": 1.5, "ms": 5},
}
_SHOWN = 3.0  # seconds of the response


def overview(scores: Sequence[Score]) -> Figure:
    """Draw the front axle's force, a response on low friction, and errors over amplitude."""
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 6.8))
        halves: Any = picture.subfigures(2, 1, height_ratios=[1, 1.15])
        tyre, response = halves[0].subplots(1, 2, width_ratios=[1, 1.5])
        _tyre(tyre)
        _response(response)
        margin, crossover = halves[1].subplots(1, 2)
        _errors(margin, scores, "phase_margin", "phase margin, rms error [deg]")
        _errors(crossover, scores, "crossover", "crossover, rms error [Hz]")
        entries = crossover.get_legend_handles_labels()
        halves[1].legend(*entries, loc="outside lower center", ncols=2, handlelength=1.6)
        margin.set_title("Solid: all vehicles.  Dotted: $\\mu_s$ < 0.5", fontsize=8)
    return picture


def _tyre(axes: Axes) -> None:
    vehicle = Vehicle()
    weight = vehicle.M_0 * GRAVITY * vehicle.l_r / (vehicle.l_f + vehicle.l_r)
    slip = np.linspace(0, np.radians(15), 200)
    for mu_s, hue in FRICTIONS.items():
        stiffness, peak = mu_s * vehicle.C_f, mu_s * Tyre().friction * weight
        force = lateral_force(np.tan(slip), stiffness, peak) / 1e3
        axes.plot(np.degrees(slip), force, color=hue, label=f"$\\mu_s$ = {mu_s:g}")
        linear = stiffness * slip / 1e3
        near = linear < 1.25 * peak / 1e3
        axes.plot(np.degrees(slip[near]), linear[near], color=hue, lw=0.9, ls="--")
    axes.set(title="Front axle", xlabel="slip angle [deg]", ylabel="lateral force [kN]")
    axes.set(xlim=(0, 15), ylim=(0, None))
    axes.legend(loc="upper right", fontsize=8, handlelength=1.4)


def _response(axes: Axes) -> None:
    context = Context.of(0.35, 150.0, 20.0)
    for nonlinear in (False, True):
        task = task_at(4.0, nonlinear)
        u = excitation(task.experiment, np.zeros(1, dtype=np.uint64))
        count = round(_SHOWN / task.experiment.Ts)
        y = driven(task, context, u[:, :count])[0]
        time = task.experiment.Ts * np.arange(count)
        line = {"color": INK, "lw": 1.5} if nonlinear else {"color": MODEL, "lw": 1.1}
        axes.plot(time, np.degrees(y), **line, label="nonlinear" if nonlinear else "linear")  # type: ignore[arg-type]
    axes.plot(time, np.degrees(u[0, :count]), color=rendering.COMMAND, lw=0.8, label="command",
              drawstyle="steps-post")  # fmt: skip
    axes.set(title="±4° on $\\mu_s$ = 0.35", xlabel="time [s]", ylabel="yaw rate [deg/s], [deg]")
    axes.set(xlim=(0, _SHOWN))
    axes.legend(loc="lower left", ncols=3, fontsize=8, handlelength=1.4)


def _errors(axes: Axes, scores: Sequence[Score], what: str, label: str) -> None:
    for name, look in LOOKS.items():
        for low, line in ((False, "-"), (True, ":")):
            part = [s for s in scores if s.tuner == name and s.low_friction == low]
            axes.plot(
                [s.amplitude for s in part],
                [getattr(s, what) for s in part],
                ls=line,
                label=None if low else name,
                **look,
            )
    axes.set(xscale="log", yscale="log", xlabel="command [deg]", ylabel=label)
    axes.set_xticks(sorted({s.amplitude for s in scores}))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"±{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
