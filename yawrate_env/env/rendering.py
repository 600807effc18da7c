"""Picture of an episode and of the loop that gains close.

Before the step only the observation and the target are drawn, after it also the loops of
the gains and of the oracle's.
"""

from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from yawrate_env.env.loop_curves import LoopCurves, band, duration
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

try:
    from matplotlib import style
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator, MultipleLocator, NullLocator, StrMethodFormatter
    from matplotlib.transforms import blended_transform_factory
except ImportError as error:
    raise DependencyNotInstalled(
        'Rendering needs matplotlib: pip install "yawrate[tuners]".'
    ) from error

SIZE = (10.0, 6.4)
"""Of the picture [inch], at 100 pixels an inch."""

LEFT, RIGHT = 0.082, 0.975
"""Where everything begins and ends, as a fraction of the width."""


INK, MUTED, GRID = "#2b3036", "#69717a", "#e9ebee"
COMMAND, YAW_RATE = "#8a95a3", "#3f6c94"
LOOP, UNSTABLE, ORACLE, TARGET = "#2f8f86", "#bd5346", "#4c5259", "#c9852b"

STYLE: dict[str, Any] = {
    "figure.dpi": 100,
    "figure.facecolor": "white",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": "#c3c8ce",
    "axes.linewidth": 0.8,
    "axes.labelcolor": MUTED,
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": "#c3c8ce",
    "ytick.color": "#c3c8ce",
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "legend.frameon": False,
    "lines.solid_capstyle": "round",
}

GAINS_LINE: dict[str, Any] = {"linewidth": 2.2, "zorder": 2.5}
ORACLE_LINE: dict[str, Any] = {"linewidth": 0.9, "dashes": (5, 2.5), "zorder": 3}

Gains = NDArray[np.float64] | None


def figure(task: Task, context: Context, obs: NDArray[np.float32], gains: Gains) -> Figure:
    """Draw one episode, without pyplot.

    Parameters
    ----------
    task : Task
    context : Context
        The vehicle, a batch of one; not looked at without gains.
    obs : (rows, samples) float32
        Steering command [rad] and yaw rate [rad/s]; further rows are not drawn.
    gains : (2,) float64, or None
        kp and Ti [s]; None before the step.

    Returns
    -------
    matplotlib.figure.Figure
        1000 by 640 pixels.
    """
    with style.context(["default", STYLE]):
        picture = Figure(figsize=SIZE)
        paint(picture, task, context, obs, gains)
    return picture


def pixels(picture: Figure) -> NDArray[np.uint8]:
    """Draw a figure into an (H, W, 3) uint8 array."""
    canvas = FigureCanvasAgg(picture)
    with style.context(["default", STYLE]):
        canvas.draw()  # type: ignore[no-untyped-call]
    rgba = np.asarray(canvas.buffer_rgba(), dtype=np.uint8)  # type: ignore[no-untyped-call]
    return rgba[..., :3].copy()


def paint(
    picture: Figure, task: Task, context: Context, obs: NDArray[np.float32], gains: Gains
) -> None:
    """Draw one episode into an empty figure; arguments as for `figure`."""
    loops = None if gains is None else LoopCurves.of(task, context, gains)
    edges = {"left": LEFT, "right": RIGHT}
    upper = picture.add_gridspec(
        2, 1, top=0.83, bottom=0.565, height_ratios=[1, 2.2], hspace=0.16, **edges
    )
    lower = picture.add_gridspec(
        2, 2, top=0.435, bottom=0.08, width_ratios=[1.08, 1], hspace=0.16, wspace=0.18, **edges
    )
    _headline(picture, task.target, loops)
    _episode(picture, upper, task, obs)
    _vehicle(picture, None if gains is None else context)
    _bode(picture, lower, task.target, loops)
    _step(picture.add_subplot(lower[:, 1]), task.target, loops)


def _colour(loops: LoopCurves) -> str:
    return LOOP if loops.stable else UNSTABLE


def _headline(picture: Figure, target: Target, loops: LoopCurves | None) -> None:
    y, size = 0.925, 15.0
    if loops is None:
        picture.text(LEFT, y, "waiting for gains", size=size, weight="bold", color=MUTED)
        aim = f"target: phase margin {target.phase_margin:g}°, crossover {target.crossover:g} Hz"
        picture.text(RIGHT, y, aim, size=10.5, color=TARGET, ha="right")
        return
    margins = loops.found.margins
    fields = [
        (0.0, "kp", "{:#.3g} s", loops.kp),
        (0.14, "Ti", "{:#.3g} s", loops.Ti),
        (0.28, f"phase margin (target {target.phase_margin:g}°)", "{:z.1f}°", margins.phase_margin),
        (0.47, f"crossover (target {target.crossover:g} Hz)", "{:#.3g} Hz", margins.crossover),
        (0.66, "reward", "{:z.2f}", loops.reward),
    ]
    for x, name, form, values in fields:
        value = _number(values[0], form)
        x += LEFT
        picture.text(x, y + 0.043, name, size=9, color=MUTED, va="baseline")
        picture.text(x, y, value, size=size, weight="bold", va="baseline")
    state = "stable" if loops.stable else "UNSTABLE"
    picture.text(RIGHT, y, state, size=size, weight="bold", color=_colour(loops), ha="right")


def _number(value: float, form: str) -> str:
    """Format with a real minus sign; ``#`` leaves a bare point behind whole numbers."""
    if not np.isfinite(value):
        return "\N{EN DASH}"
    return form.format(value).replace(". ", " ").replace("-", "\N{MINUS SIGN}")


def _episode(picture: Figure, grid: Any, task: Task, obs: NDArray[np.float32]) -> None:
    time = _times(task, obs.shape[1])
    command, yaw_rate = np.degrees(obs[:2].astype(np.float64))
    above = picture.add_subplot(grid[0])
    above.set_title("Identification episode", pad=7)
    above.plot(time, command, color=COMMAND, linewidth=1.1, drawstyle="steps-post")
    above.set_ylim(np.degrees(task.experiment.amplitude) * np.array([-1.35, 1.35]))
    _label(above, "steering\n[deg]")
    above.tick_params(labelbottom=False)
    below = picture.add_subplot(grid[1], sharex=above)
    below.plot(time, yaw_rate, color=YAW_RATE, linewidth=1.0)
    below.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    below.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    _label(below, "yaw rate\n[deg/s]")
    below.set_xlabel("time [s]", labelpad=1)
    below.set_xlim(0, task.experiment.N * task.experiment.Ts)


def _label(axes: Axes, words: str) -> None:
    """Label the y axis at a fixed distance, which wider tick labels do not move."""
    left = axes.get_position().x0 - 0.046
    assert axes.figure is not None
    across = blended_transform_factory(axes.figure.transFigure, axes.transAxes)
    axes.set_ylabel(words)
    axes.yaxis.set_label_coords(left, 0.5, transform=across)


def _times(task: Task, samples: int) -> NDArray[np.float64]:
    """Times of the samples [s]; decimated ones stand at the middle of their blocks."""
    block = task.experiment.N // samples
    return task.experiment.Ts * (block * np.arange(samples, dtype=np.float64) + (block - 1) / 2)


def _vehicle(picture: Figure, context: Context | None) -> None:
    words = "hidden vehicle: ?"
    if context is not None:
        words = (
            f"hidden vehicle: friction {context.mu_s[0]:.2f}, "
            f"extra mass {context.M_delta[0]:.0f} kg, speed {context.v_x[0]:.3g} m/s"
        )
    picture.text(RIGHT, 0.844, words, size=9, color=MUTED, ha="right")


def _bode(picture: Figure, grid: Any, target: Target, loops: LoopCurves | None) -> None:
    upper = picture.add_subplot(grid[0, 0])
    lower = picture.add_subplot(grid[1, 0], sharex=upper)
    upper.set_title("Open loop", pad=7)
    upper.set(xscale="log", xlim=band(target), ylim=(-65, 45), yticks=[-60, -30, 0, 30])
    lower.set(ylim=(-285, 0), yticks=[-270, -180, -90, 0])
    _label(upper, "gain [dB]")
    _label(lower, "phase [deg]")
    lower.set_xlabel("frequency [Hz]", labelpad=1)
    upper.tick_params(labelbottom=False)
    lower.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    lower.xaxis.set_minor_locator(NullLocator())
    for axes, level in ((upper, 0.0), (lower, -180.0)):
        axes.axhline(level, color="#b9bfc6", linewidth=0.9, zorder=1)
        axes.axvline(target.crossover, color=TARGET, linewidth=1.1, linestyle=":", zorder=1.5)
    _bode_target(upper, lower, target)
    if loops is None:
        at = target.phase_margin - 180
        _note(lower, target.crossover, at, f"target {target.phase_margin:g}°", (-9, -12), TARGET)
    else:
        _bode_loops(upper, lower, target, loops)


def _bode_target(upper: Axes, lower: Axes, target: Target) -> None:
    ring: dict[str, Any] = {
        "marker": "o",
        "markersize": 8,
        "markerfacecolor": "none",
        "markeredgecolor": TARGET,
        "markeredgewidth": 1.4,
        "zorder": 4,
    }
    upper.plot([target.crossover], [0], **ring)
    lower.plot([target.crossover], [target.phase_margin - 180], **ring)
    _note(upper, target.crossover, -65, f"target {target.crossover:g} Hz", (-5, 4), TARGET)


def _bode_loops(upper: Axes, lower: Axes, target: Target, loops: LoopCurves) -> None:
    for axes, values in ((upper, loops.magnitude), (lower, loops.phase)):
        axes.plot(loops.frequency, values[0], color=_colour(loops), **GAINS_LINE)
        axes.plot(loops.frequency, values[1], color=ORACLE, **ORACLE_LINE)
    crossover = float(loops.found.margins.crossover[0])
    low, high = band(target)
    if not low <= crossover <= high:  # there may be none
        return
    dot: dict[str, Any] = {"marker": "o", "markersize": 5.5, "color": _colour(loops), "zorder": 5}
    upper.plot([crossover], [0], **dot)
    offset = _offset(crossover, target)
    _note(upper, crossover, 0, _number(crossover, "{:#.3g} Hz"), offset, _colour(loops))
    phase = float(np.interp(crossover, loops.frequency, loops.phase[0]))
    bottom, top = lower.get_ylim()
    if not bottom < phase < top:
        return
    lower.plot([crossover], [phase], **dot)
    lower.vlines(crossover, -180, phase, color=_colour(loops), linewidth=4, alpha=0.35, zorder=2)
    margin = _number(loops.found.margins.phase_margin[0], "{:z.0f}°")
    _note(lower, crossover, phase, margin, offset, _colour(loops))


def _offset(crossover: float, target: Target) -> tuple[float, float]:
    """Where the notes stand [points]: below slow loops and above fast ones, off the oracle's."""
    low, high = band(target)
    below = 4 * low < crossover < 0.99 * target.crossover or crossover > 0.4 * high
    return (-8, -13) if below else (8, 5)


def _note(
    axes: Axes, x: float, y: float, words: str, offset: tuple[float, float], colour: str
) -> None:
    """Write beside a point, left of it where the offset [points] is negative."""
    axes.annotate(
        words,
        (x, y),
        xytext=offset,
        textcoords="offset points",
        ha="right" if offset[0] < 0 else "left",
        color=colour,
        zorder=3.5,
        bbox={
            "boxstyle": "square,pad=0.1",
            "facecolor": "white",
            "edgecolor": "none",
            "alpha": 0.8,
        },
    )


def _step(axes: Axes, target: Target, loops: LoopCurves | None) -> None:
    axes.set_title("Step response", pad=7)
    axes.set(xlim=(0, duration(target)), ylim=(-0.1, 1.9), yticks=[0, 0.5, 1, 1.5])
    _label(axes, "yaw rate [deg/s]")
    axes.set_xlabel("time [s]", labelpad=1)
    axes.xaxis.set_major_locator(MultipleLocator(duration(target) / 4))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:.3g}"))
    axes.axhline(1.0, color=TARGET, linewidth=1.1, linestyle=":", label="reference")
    if loops is not None:
        y = loops.yaw_rate
        axes.plot(loops.time, y[1], color=ORACLE, label=loops.oracle_label, **ORACLE_LINE)
        axes.plot(loops.time, y[0], color=_colour(loops), label="gains", **GAINS_LINE)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.02),
        borderaxespad=0.0,
        borderpad=0.0,
        ncols=3,
        labelcolor=MUTED,
        handlelength=1.5,
        handletextpad=0.5,
        columnspacing=1.1,
    )
