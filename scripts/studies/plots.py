"""The paper's figures 4 to 8, and the spread of the margins, as pure functions of arrays.

Arrays come in SI units and angles in radians; figures show degrees.  A tuner has the same
colour in all of them.  Neither pyplot nor the global settings are touched.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from studies.palette import DPI, INK, MODEL, NOISE, STYLE, WIDTH, ZOOM, chance, colour
from yawrate_env.env import rendering
from yawrate_env.files import replacing

Array = NDArray[np.float64]
Pair = tuple[float, float]
_THIN: dict[str, Any] = {"color": INK, "lw": 0.8, "zorder": 1.5}


def identification(
    time: Array, clean: Array, noisy: Array, model_time: Array, model: Array, u: Array
) -> Figure:
    """Draw an identification episode and its model (fig. 4), and where the model errs most.

    Parameters
    ----------
    time, clean, noisy, u : (N,) float64
        Time [s], yaw rate without and with noise [rad/s], steering command [rad].
    model_time, model : (M,) float64
        Times [s] and simulated yaw rate [rad/s] of the reduced-order model.
    """
    window = _worst(model_time, model - np.interp(model_time, time, clean))
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 6.0))
        above, whole, zoom = picture.subplots(3, 1, height_ratios=[0.6, 1.3, 1.9])
        above.plot(time, np.degrees(u), color=rendering.COMMAND, drawstyle="steps-post", lw=1.2)
        above.set(ylabel="steering\n[deg]", ymargin=0.2)
        above.tick_params(labelbottom=False)
        for axes, marker in ((whole, ""), (zoom, "o")):
            axes.plot(time, np.degrees(noisy), color=NOISE, lw=0.9, label="measured")
            axes.plot(time, np.degrees(clean), color=INK, lw=1.1, label="noise-free")
            line = {"color": MODEL, "lw": 1.3, "ms": 4, "label": "ARMAX model"}
            axes.plot(model_time, np.degrees(model), marker=marker, **line)
            axes.set_ylabel("yaw rate [deg/s]")
        _zoom(time, window, (above, whole), zoom)
        zoom.set(title="Where the model errs most", xlabel="time [s]")
        _legend(picture, whole)
    return picture


def regression(
    truth: Array, estimates: Mapping[str, Array], symbol: str, unit: str, rms: Mapping[str, float]
) -> Figure:
    """Draw estimates against the truth (figs. 5 and 6), and their relative errors.

    Parameters
    ----------
    truth, estimates : (E,) float64
        True parameter, and estimates by tuner; `nan` where there is none.
    symbol, unit, rms
        Of the parameter; eq. (14) [%], by tuner.
    """
    shown = {name: _finite(truth, values) for name, values in estimates.items()}
    everything = np.concatenate([np.ravel(pair) for pair in shown.values()])
    ends = (everything.min(), everything.max()) if everything.size else (0.0, 1.0)
    size = min(WIDTH / len(shown), 4.0)
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(size * len(shown), size + 1.9))
        grid = picture.subplots(
            2, len(shown), squeeze=False, sharex=True, sharey="row", height_ratios=[size, 1.1]
        )
        for (above, below), (name, (true, estimate)) in zip(grid.T, shown.items(), strict=True):
            dots: dict[str, Any] = {"s": 7, "color": colour(name), "alpha": 0.45, "lw": 0}
            _identity(above, *ends)
            above.scatter(true, estimate, **dots)
            above.set_title(f"{name}: rms {_number(rms[name])} %", color=colour(name))
            above.set_box_aspect(1)
            below.axhline(0, **_THIN)
            below.scatter(true, 100 * (estimate / true - 1), **dots)
            below.set_xlabel(f"true {symbol} [{unit}], n = {len(true)}")
        grid[0, 0].set_ylabel(f"estimated {symbol} [{unit}]")
        grid[1, 0].set_ylabel("error [%]")
        picture.align_ylabels()
    return picture


def times(seconds: Mapping[str, Array]) -> Figure:
    """Draw how long an answer takes (fig. 7): every episode, quartiles, 5 and 95 %, median.

    Parameters
    ----------
    seconds : (E,) float64
        From recording to gains [s], by tuner.
    """
    everything = 1e3 * np.concatenate(list(seconds.values()))
    ends = float(everything.min()) / 2, 2 * float(everything.max())  # a labelled tick at least
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 1.0 + 0.65 * len(seconds)))
        axes = picture.subplots()
        axes.set(xscale="log", xlim=ends, ylim=(len(seconds) - 0.5, -0.5))
        axes.set_xlabel("time for one answer [ms]")
        axes.set_yticks(range(len(seconds)), list(seconds))
        axes.grid(False, axis="y")
        _plain(axes.xaxis)
        for row, (name, values) in enumerate(seconds.items()):
            _distribution(axes, row, 1e3 * values, colour(name))
    return picture


def tracking(
    time: Array, reference: Array, yaw_rates: Mapping[str, Array], commands: Mapping[str, Array]
) -> Figure:
    """Draw closed loops that follow a reference (fig. 8), and the steepest transient.

    Parameters
    ----------
    time, reference : (N,) float64
        Time [s] and wanted yaw rate [rad/s].
    yaw_rates, commands : (N,) float64
        Yaw rate [rad/s] and steering command [rad], by tuner.
    """
    middle = float(time[np.argmax(np.abs(np.diff(reference)))])
    window = (max(middle - 0.25, time[0]), min(middle + 1.0, time[-1]))
    rows = ((yaw_rates, "yaw rate", "deg/s"), (commands, "steering command", "deg"))
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 4.8))
        grid = picture.subplots(2, 2, sharex="col", sharey="row", width_ratios=[1.5, 1])
        for above, below in grid.T:
            below.set_xlabel("time [s]")
            above.plot(time, np.degrees(reference), color=INK, lw=1.1, ls="--", label="reference")
        for (whole, zoom), (curves, what, unit) in zip(grid, rows, strict=True):
            _striped(whole, time, curves)
            _striped(zoom, time, curves)
            _zoom(time, window, (whole,), zoom)
            whole.set_ylabel(f"{what} [{unit}]")
            apart = np.degrees(np.ptp(list(curves.values()), axis=0)).max()
            zoom.set_title(f"tuners differ by up to {_number(apart)} {unit}" if apart else "")
        _legend(picture, grid[0, 0])
    return picture


def margin_scatter(
    points: Mapping[str, tuple[Array, Array]],
    target: Pair,
    bound: Pair | None,
    others: Sequence[str] = (),
) -> Figure:
    """Draw how far loops end from their target: dots, half of them in an ellipse, and the rms.

    Dots closer to the target than a hundredth of the bound (or the least rms) are left out, and
    counted below the picture.

    Parameters
    ----------
    points : ((E,), (E,)) float64
        Phase margin [deg] and crossover [Hz] by tuner; `nan` where there is none.
    target, bound : (float, float)
        The same: wanted, and least standard deviations of an unbiased tuner, or None.
    others : sequence of str
        Tuners that are not drawn, which the picture says.
    """
    wanted = np.array(target)[:, None]
    errors = {name: np.abs(np.stack(_finite(*pair)) - wanted) for name, pair in points.items()}
    rms = {name: np.sqrt((e**2).sum(axis=1) / (e.shape[1] or np.nan)) for name, e in errors.items()}
    floor = np.fmax(np.fmin.reduce(list(rms.values())) if bound is None else bound, 1e-9) / 100
    top = 2 * np.concatenate([*errors.values(), 100 * floor[:, None]], axis=1).max(axis=1)
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 5.6))
        axes = picture.subplots()
        axes.set(xscale="log", yscale="log", xlim=(floor[1], top[1]), ylim=(floor[0], top[0]))
        axes.set_xlabel(f"distance from a crossover of {target[1]:g} Hz [Hz]")
        axes.set_ylabel(f"distance from a phase margin of {target[0]:g}° [deg]")
        if bound is not None:
            axes.axvline(bound[1], ls=(0, (4, 3)), **_THIN)
            axes.axhline(bound[0], ls=(0, (4, 3)), **_THIN)
            _mark(axes, bound, "Cramér-Rao bound", INK, "*", 22)
        for name, error in errors.items():
            axes.scatter(error[1], error[0], s=6, color=colour(name), alpha=0.25, lw=0)
            if error.shape[1] > 2:
                _half(axes, np.maximum(error, floor[:, None]), colour(name))
            _mark(axes, rms[name], f"{name}, n = {error.shape[1]}", colour(name), "o", 8.5)
        words = "rms distance\ndots: episodes, ellipses: half of them"
        axes.legend(title=words, loc="lower right", frameon=True, alignment="left")
        fewest = min(error.shape[1] for error in errors.values())
        said = _left_out(errors, floor, others) + ([chance(fewest)] if bound and fewest else [])
        picture.supxlabel("\n".join(said), fontsize=8, color=INK, x=0.01, ha="left")
    return picture


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a PNG, completely or not at all; equal figures give equal bytes."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with style.context(["default", STYLE]), replacing(path) as file:
        figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})


def _left_out(errors: Mapping[str, Array], floor: Array, others: Sequence[str]) -> list[str]:
    """Say which dots and tuners a scatter of (2, E) distances does not show."""
    nearer = sum(int((error < floor[:, None]).any(axis=0).sum()) for error in errors.values())
    of = sum(error.shape[1] for error in errors.values())
    dots = f"{nearer} of {of} dots, nearer than the axes' ends"
    if not others:
        return [f"Left out: {dots}."]
    return [f"Left out: {dots}; and of the table's rows", f"{', '.join(others)}."]


def _finite(a: Array, b: Array) -> tuple[Array, Array]:
    both = np.isfinite(a) & np.isfinite(b)
    return a[both], b[both]


def _worst(time: Array, error: Array) -> Pair:
    """Begin and end of the second with the largest mean square error."""
    step = float(time[1] - time[0])
    samples = min(round(1.0 / step), len(time))
    start = int(np.argmax(np.convolve(error**2, np.ones(samples), "valid")))
    return float(time[start]), float(time[start] + samples * step)


def _zoom(time: Array, window: Pair, whole: tuple[Axes, ...], zoom: Axes) -> None:
    """Show all samples, to the end of the last, in `whole` and a shaded part in `zoom`."""
    for axes in whole:
        axes.set_xlim(time[0], 2 * time[-1] - time[-2])
        axes.axvspan(*window, color=ZOOM, zorder=0)
    zoom.set(xlim=window, facecolor=ZOOM)


def _legend(picture: Figure, axes: Axes) -> None:
    entries = axes.get_legend_handles_labels()
    picture.legend(*entries, loc="outside upper right", ncols=len(entries[0]), handlelength=2.6)
    picture.align_ylabels()


def _identity(axes: Axes, low: float, high: float) -> None:
    """The line y = x over the data, which make the axes logarithmic beyond a decade."""
    axes.plot([low, high], [low, high], **_THIN)
    if 0 < 10 * low < high:
        axes.set(xscale="log", yscale="log")
        _plain(axes.xaxis, axes.yaxis)
    else:
        axes.locator_params(nbins=5)


def _plain(*logarithmic: Axis) -> None:
    """Label with plain numbers."""
    for axis in logarithmic:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=99))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def _distribution(axes: Axes, row: int, values: Array, hue: str) -> None:
    """Dots, a box from quartile to quartile, a line from 5 to 95 %, and the median."""
    p5, p25, median, p75, p95 = (float(p) for p in np.percentile(values, (5, 25, 50, 75, 95)))
    jitter = np.random.default_rng(0).uniform(-0.32, 0.32, len(values))
    axes.scatter(values, row + jitter, s=5, color=hue, alpha=0.25, lw=0)
    axes.hlines(row, p5, p95, color=hue, lw=1.4)
    box: dict[str, Any] = {"facecolor": (1, 1, 1, 0.8), "edgecolor": hue, "lw": 1.4}
    axes.broken_barh([(p25, p75 - p25)], (row - 0.2, 0.4), zorder=2.5, **box)
    axes.vlines(median, row - 0.2, row + 0.2, color=hue, lw=3, zorder=3)
    words = f"median {_number(median)} ms"
    axes.annotate(words, (1.02, row), xycoords=("axes fraction", "data"), color=hue, va="center")


def _striped(axes: Axes, time: Array, curves: Mapping[str, Array]) -> None:
    """Curves [rad] drawn so that where they coincide their colours alternate."""
    count = len(curves)
    for i, (name, values) in enumerate(curves.items()):
        dashes = (0, (2.5 * (count - i), 2.5 * i)) if i else "-"
        axes.plot(time, np.degrees(values), color=colour(name), lw=2.4, ls=dashes, label=name)


def _half(axes: Axes, distances: Array, hue: str) -> None:
    """Ellipse in the logarithms of (2, E) distances, with half of the episodes in it."""
    logs = np.log(distances)
    centre = np.median(logs, axis=1, keepdims=True)
    L = np.linalg.cholesky(np.cov(logs) + 1e-9 * np.eye(2))
    radius = np.median(np.linalg.norm(np.linalg.solve(L, logs - centre), axis=0))
    angle = np.linspace(0, 2 * np.pi, 200)
    y, x = np.exp(centre + radius * L @ [np.cos(angle), np.sin(angle)])
    axes.plot(x, y, color=hue, lw=1.3)


def _mark(axes: Axes, at: Any, label: str, hue: str, marker: str, size: float) -> None:
    """Mark (phase margin, crossover); the numbers go into the legend."""
    label += f": {_number(at[0])}°, {_number(at[1])} Hz" if np.isfinite(at[0]) else ""
    edge: dict[str, Any] = {"mec": "white", "mew": 1.2, "ls": "", "zorder": 4}
    axes.plot([at[1]], [at[0]], color=hue, marker=marker, ms=size, label=label, **edge)


def _number(value: float) -> str:
    """Two significant digits, or whole."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.2g}".rstrip(".")
