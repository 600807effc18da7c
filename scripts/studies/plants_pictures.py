"""One picture a plant: a recording with the plant found in it, and the errors of every tuner."""

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from studies.palette import COLOURS, INK, NOISE, STYLE, WIDTH
from tuners.tuner.comparison import GRAY_BOX, NOMINAL, TUNER, Comparison
from yawrate_env.env import rendering
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_COLOURS = {TUNER: COLOURS["ts-ff"], GRAY_BOX: COLOURS["gb"], NOMINAL: COLOURS["nominal"]}


def overview(plant: Plant, y: Array, simulated: Array, comparison: Comparison) -> Figure:
    """Draw a recording (N,) with its fit, and the shares of episodes within each error.

    Parameters
    ----------
    y, simulated : (N,) float64
        A measured output, and that of the plant which explains it best.
    """
    t, f = np.arange(len(y)) * plant.Ts, len(plant.counted)
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 6.4))
        grid = picture.add_gridspec(3, f, height_ratios=[0.55, 1.2, 2.0])
        above = picture.add_subplot(grid[0, :])
        above.plot(t, plant.u, color=rendering.COMMAND, drawstyle="steps-post", lw=1.2)
        above.set(ylabel=_label(plant.signals[0]), ymargin=0.2, xlim=(0, t[-1]))
        above.tick_params(labelbottom=False)
        below = picture.add_subplot(grid[1, :], sharex=above)
        below.plot(t, y, color=NOISE, lw=2.4, label="recorded")
        below.plot(t, simulated, color=INK, lw=0.9, label="plant found in it")
        below.set(ylabel=_label(plant.signals[1]), xlabel="time [s]", ymargin=0.1)
        above.legend(*below.get_legend_handles_labels(), loc="lower right", ncols=2,
                     bbox_to_anchor=(1, 1), frameon=False)  # fmt: skip
        for k, name in enumerate(plant.counted):
            axes = picture.add_subplot(grid[2, k])
            _shares(axes, comparison, k)
            axes.set_xlabel(f"error of {name}")
            if k == 0:
                axes.set_ylabel("share of test plants within")
        names = axes.get_legend_handles_labels()
        picture.legend(*names, loc="outside lower center", ncols=4, frameon=False)
        picture.align_ylabels()
    return picture


def _shares(axes: Axes, comparison: Comparison, k: int) -> None:
    """Cumulative distributions of the absolute errors, and of errors on the bound."""
    bound = comparison.bound[:, k]
    # Errors on the bound are normal with each episode's own spread: their quantiles, mixed.
    normal = np.abs(np.random.default_rng(0).standard_normal((20, len(bound))) * bound).ravel()
    series = {"Cramér–Rao bound": (normal, INK, "--")}
    for name, hue in _COLOURS.items():
        series[name] = (np.abs(comparison.errors[name][:, k]), hue, "-")
    for name, (values, colour, dashes) in series.items():
        x = np.sort(np.where(np.isnan(values), np.inf, values))
        axes.plot(x, np.arange(1, len(x) + 1) / len(x), color=colour, ls=dashes, lw=1.6, label=name)
    left = np.nanquantile(np.abs(comparison.errors[TUNER][:, k]), 0.05)
    right = np.nanquantile(np.abs(comparison.errors[NOMINAL][:, k]), 0.99)
    axes.set(xscale="log", xlim=(left, right), ylim=(0, 1))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:.0f} %"))


def _label(signal: str) -> str:
    return signal.replace(" [", "\n[")
