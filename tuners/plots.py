"""The paper's figures 4 to 8, and the spread of the margins: pure functions of arrays.

Arrays come in SI units, angles in radians; figures show degrees.  Every tuner keeps its
colour through all of them.  Nothing here touches pyplot or the global settings.
"""

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from yawrate_env import rendering

Array = NDArray[np.float64]

WIDTH = 8.0
"""Of every figure [inch]."""

DPI = 150

COLOURS = {
    "gb": "#0072B2",
    "ts-ff": "#D55E00",
    "ts-gbm": "#009E73",
    "ts-ff-gains": "#E69F00",
    "ts-gbm-gains": "#CC79A7",
    "nominal": "#7b838c",
    "oracle": "#1f2328",
}
"""Of the tuners: Okabe and Ito's palette, which the colour-blind can tell apart."""

OTHER_COLOURS = ("#56B4E9", "#882255", "#999933", "#332288")
"""Of tuners that are not in `COLOURS`, by name."""

MODEL, NOISE, ZOOM = "#b0307a", "#a9bfd4", "#faf6ea"

STYLE: dict[str, Any] = {
    **rendering.STYLE,
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "figure.constrained_layout.use": True,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
}

_ZOOM_SECONDS = 1.0  # of an episode
_TRANSIENT = (-0.25, 1.0)  # around the steepest reference [s]


def colour(tuner: str) -> str:
    """Colour of a tuner, the same in every figure."""
    return COLOURS.get(tuner) or OTHER_COLOURS[crc32(tuner.encode()) % len(OTHER_COLOURS)]


def identification(
    time: Array, clean: Array, noisy: Array, model_time: Array, model: Array, u: Array
) -> Figure:
    """Draw an identification episode and its model (fig. 4), and the model's worst second.

    Parameters
    ----------
    time : (N,) float64
        [s].
    clean, noisy : (N,) float64
        Yaw rate without and with noise [rad/s].
    model_time, model : (M,) float64
        Simulated yaw rate of the reduced-order model [rad/s] and its times [s].
    u : (N,) float64
        Steering command [rad].
    """
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 6.0))
        above, whole, zoom = picture.subplots(3, 1, height_ratios=[0.6, 1.3, 1.9])
        above.plot(time, np.degrees(u), color=rendering.COMMAND, drawstyle="steps-post", lw=1.2)
        above.set(ylabel="steering\n[deg]")
        above.margins(y=0.2)
        above.tick_params(labelbottom=False)
        window = _worst_second(model_time, model - np.interp(model_time, time, clean))
        _episode(whole, time, clean, noisy, model_time, model)
        _episode(zoom, *_within(window, time, clean, noisy), *_within(window, model_time, model))
        for line in zoom.get_lines():
            line.set_linewidth(1.5 * line.get_linewidth())
        zoom.get_lines()[-1].set_marker("o")
        for axes, ends in ((above, (time[0], time[-1])), (whole, (time[0], time[-1]))):
            axes.set_xlim(*ends)
            axes.axvspan(*window, color=ZOOM, zorder=0)
        zoom.set(xlabel="time [s]", xlim=window, facecolor=ZOOM)
        _legend(picture, whole)
        picture.align_ylabels()
    return picture


def regression(
    truth: Array, estimates: Mapping[str, Array], symbol: str, unit: str, rms: Mapping[str, float]
) -> Figure:
    """Draw estimates against the truth (figs. 5 and 6), and their relative errors.

    Parameters
    ----------
    truth : (E,) float64
        True parameter; `nan` where there is none.
    estimates : mapping of str to (E,) float64
        By tuner.
    symbol, unit : str
        Of the parameter.
    rms : mapping of str to float
        Eq. (14) [%], by tuner.
    """
    shown = {name: _finite(truth, values) for name, values in estimates.items()}
    everything = np.concatenate([np.ravel(pair) for pair in shown.values()])
    low, high = (everything.min(), everything.max()) if everything.size else (0.0, 1.0)
    log = bool(low > 0 and high > 10 * low)
    with style.context(["default", STYLE]):
        size = min(WIDTH / len(shown), 4.0)
        picture = Figure(figsize=(max(size * len(shown), 4.0), size + 1.9))
        grid = picture.subplots(
            2, len(shown), squeeze=False, sharex=True, sharey="row", height_ratios=[size, 1.1]
        )
        for (above, below), (name, (true, estimate)) in zip(grid.T, shown.items(), strict=True):
            dots: dict[str, Any] = {"s": 7, "color": colour(name), "alpha": 0.45, "lw": 0}
            above.axline((low, low), (high, high), color=rendering.INK, lw=0.8, zorder=1.5)
            above.scatter(true, estimate, **dots)
            below.axhline(0, color=rendering.INK, lw=0.8, zorder=1.5)
            below.scatter(true, 100 * (estimate / true - 1), **dots)
            above.set_title(f"{name}: rms {_number(rms[name])} %", color=colour(name))
            _count(above, len(true), len(truth))
            below.set_xlabel(f"true {symbol} [{unit}]")
            above.set_box_aspect(1)
        _limits(grid[0, 0], low, high, log)
        grid[0, 0].set_ylabel(f"estimated {symbol} [{unit}]")
        grid[1, 0].set_ylabel("error [%]")
        picture.align_ylabels()
    return picture


def times(seconds: Mapping[str, Array]) -> Figure:
    """Draw how long an answer takes (fig. 7): every episode, quartiles, 5 and 95 %, median.

    Parameters
    ----------
    seconds : mapping of str to (E,) float64
        From recording to gains [s], by tuner.
    """
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 1.0 + 0.65 * len(seconds)))
        axes = picture.subplots()
        for row, (name, values) in enumerate(seconds.items()):
            ms, hue = 1e3 * values[np.isfinite(values)], colour(name)
            jitter = np.random.default_rng(0).uniform(-0.3, 0.3, len(ms))
            axes.scatter(ms, row + jitter, s=5, color=hue, alpha=0.25, lw=0)
            box = axes.boxplot(
                ms, positions=[row], vert=False, widths=0.42, whis=(5, 95), showfliers=False,
                patch_artist=True, medianprops={"color": hue, "lw": 2.2},
            )  # fmt: skip
            for part in (*box["boxes"], *box["whiskers"], *box["caps"]):
                part.set(color=hue, lw=1.2)
            box["boxes"][0].set_facecolor((1, 1, 1, 0.75))
            axes.text(1.02, row, f"{_number(float(np.median(ms)))} ms", color=hue, weight="bold",
                      va="center", transform=axes.get_yaxis_transform())  # fmt: skip
        axes.text(1.02, 1.02, "median", color=rendering.MUTED, transform=axes.transAxes)
        axes.set_yticks(range(len(seconds)), list(seconds))
        axes.set(xscale="log", xlabel="time for one answer [ms]", ylim=(len(seconds) - 0.5, -0.5))
        axes.grid(False, axis="y")
        _plain(axes.xaxis)
    return picture


def tracking(
    time: Array, reference: Array, yaw_rates: Mapping[str, Array], commands: Mapping[str, Array]
) -> Figure:
    """Draw closed loops that follow a reference (fig. 8), and the steepest transient.

    Parameters
    ----------
    time, reference : (N,) float64
        [s], and yaw-rate reference [rad/s].
    yaw_rates, commands : mapping of str to (N,) float64
        Yaw rate [rad/s] and steering command [rad], by tuner.
    """
    middle = time[np.argmax(np.abs(np.diff(reference)))]
    window = (max(middle + _TRANSIENT[0], time[0]), min(middle + _TRANSIENT[1], time[-1]))
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 4.8))
        grid = picture.subplots(2, 2, sharex="col", width_ratios=[1.55, 1], height_ratios=[1.4, 1])
        for row, (curves, what) in enumerate(
            ((yaw_rates, "yaw rate [deg/s]"), (commands, "steering command [deg]"))
        ):
            for axes, ends in zip(grid[row], ((time[0], time[-1]), window), strict=True):
                inside = (time >= ends[0]) & (time <= ends[1])
                _onion(axes, time[inside], {name: y[inside] for name, y in curves.items()})
                axes.set_xlim(*ends)
            grid[row, 0].axvspan(*window, color=ZOOM, zorder=0)
            grid[row, 1].set_facecolor(ZOOM)
            grid[row, 0].set_ylabel(what)
            grid[1, row].set_xlabel("time [s]")
        for axes in grid[0]:
            axes.plot(time, np.degrees(reference), color=rendering.INK, lw=1.1, ls=(0, (4, 2)),
                      label="reference", zorder=4)  # fmt: skip
        _legend(picture, grid[0, 0])
        picture.align_ylabels()
    return picture


def margin_scatter(
    points: Mapping[str, tuple[Array, Array]],
    target: tuple[float, float],
    bound: tuple[float, float] | None,
) -> Figure:
    """Draw how far loops end from the target, an episode a dot and its rms a marker.

    Parameters
    ----------
    points : mapping of str to ((E,), (E,)) float64
        Phase margin [deg] and crossover [Hz] by tuner; `nan` where there is none.
    target : (float, float)
        Wanted phase margin [deg] and crossover [Hz].
    bound : (float, float) or None
        Least standard deviations that an unbiased tuner can have.
    """
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 5.2))
        axes = picture.subplots()
        for name, pair in points.items():
            errors = [np.abs(x - t) for x, t in zip(_finite(*pair), target, strict=True)]
            axes.scatter(errors[1], errors[0], s=7, color=colour(name), alpha=0.3, lw=0)
        axes.set(xscale="log", yscale="log", xlabel=f"|crossover - {target[1]:g} Hz|  [Hz]",
                 ylabel=f"|phase margin - {target[0]:g}°|  [deg]")  # fmt: skip
    return picture


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a PNG, completely or not at all; the same figure gives the same bytes."""
    target = Path(path)
    handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file, style.context(["default", STYLE]):
            figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
        os.chmod(temporary, 0o644)
        os.replace(temporary, target)
    except BaseException:
        os.unlink(temporary)
        raise


def _finite(a: Array, b: Array) -> tuple[Array, Array]:
    both = np.isfinite(a) & np.isfinite(b)
    return a[both], b[both]


def _within(window: tuple[float, float], time: Array, *series: Array) -> tuple[Array, ...]:
    inside = (time >= window[0]) & (time <= window[1])
    return time[inside], *(values[inside] for values in series)


def _worst_second(time: Array, error: Array) -> tuple[float, float]:
    """Where the error is largest in mean square."""
    step = float(time[1] - time[0])
    samples = min(round(_ZOOM_SECONDS / step), len(time))
    start = int(np.argmax(np.convolve(error**2, np.ones(samples), "valid")))
    return float(time[start]), float(time[start] + samples * step)


def _episode(
    axes: Axes, time: Array, clean: Array, noisy: Array, model_time: Array, model: Array
) -> None:
    axes.plot(time, np.degrees(noisy), color=NOISE, lw=0.7, label="measured")
    axes.plot(time, np.degrees(clean), color=rendering.INK, lw=1.0, label="noise-free")
    axes.plot(model_time, np.degrees(model), color=MODEL, lw=1.0, label="ARMAX model", ms=3.5)
    axes.set_ylabel("yaw rate [deg/s]")


def _onion(axes: Axes, time: Array, curves: Mapping[str, Array]) -> None:
    """Curves that coincide [rad], each narrower than the one below it."""
    widths = np.geomspace(5.0, 1.2, max(len(curves), 2))
    for (name, values), width in zip(curves.items(), widths, strict=False):
        axes.plot(time, np.degrees(values), color=colour(name), lw=width, label=name)


def _legend(picture: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    picture.legend(handles, labels, loc="outside upper right", ncols=len(labels), borderpad=0.2)


def _limits(axes: Axes, low: float, high: float, log: bool) -> None:
    """Same range for both axes, a little wider than the data."""
    if log:
        gap = (high / low) ** 0.04
        axes.set(xscale="log", yscale="log", xlim=(low / gap, high * gap), ylim=(low / gap, high * gap))
    else:
        gap = 0.04 * (high - low) or 1.0
        axes.set(xlim=(low - gap, high + gap), ylim=(low - gap, high + gap))


def _count(axes: Axes, shown: int, of: int) -> None:
    words = f"{shown} episodes" if shown == of else f"{shown} of {of} episodes"
    axes.text(0.97, 0.03, words, transform=axes.transAxes, ha="right", color=rendering.MUTED)


def _plain(axis: Any) -> None:
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _number(value: float) -> str:
    """Two significant digits, or whole."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.2g}".rstrip(".")
