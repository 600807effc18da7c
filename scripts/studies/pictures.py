"""Figures of tuners off their design point, and of the gain schedule over speed."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from studies.conditions import SPEED, SWEEPS, Sweep
from studies.off_design import Cell
from studies.off_design_page import shown_level
from studies.palette import INK, STYLE, WIDTH, chance, colour
from studies.players import LADDER
from studies.schedule import Bin, Price, Schedule
from studies.trusting import MISS

_BOUND: dict[str, Any] = {"color": INK, "lw": 1.0, "ls": (0, (4, 3)), "zorder": 1.5}
_MISS: dict[str, Any] = {"color": INK, "lw": 1.0, "ls": (0, (1, 2)), "zorder": 1.5}
_DESIGN: dict[str, Any] = {"color": "#f0efe9", "lw": 0}
_DOTS = 7.5, 2.5  # sizes of the first tuner's dots and the last one's
_COLUMNS = 3
_ASIDE = 0.015  # of a panel's width, between tuners
_WIDEST = 0.7  # of a level's width, for all tuners
_VEHICLES = ("#1f2328", "#0072B2", "#56B4E9", "#D55E00", "#E69F00")


def off_design(cells: Sequence[Cell]) -> Figure:
    """Draw rms errors of the phase margin, a panel a condition, on one logarithmic scale.

    A dot is full where at least half of the gains were trusted and hollow where fewer
    were, a triangle where loops were unstable; a cross on the upper edge says that a tuner
    refused.  The design point is shaded.  Tuners stand side by side at levels that are words, and
    within each other, later ones smaller, at numbers.
    """
    drawn = {c.condition for c in cells}
    sweeps = [sweep for sweep in SWEEPS if sweep.name in drawn]
    names = list(dict.fromkeys(c.tuner for c in cells))
    values = [v for c in cells for v in (c.phase_margin.rms, c.phase_margin.bound) if v]
    rows = len(sweeps) // _COLUMNS + 1  # the key fills what is left of the last
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 2.3 * rows + 0.3))
        grid = picture.subplots(rows, _COLUMNS, sharey=True, squeeze=False)
        for axes, sweep in zip(grid.flat, sweeps, strict=False):
            axes.set(yscale="log", ylim=(min(values) / 1.6, max(values) * 2.5))
            _condition(axes, sweep, [c for c in cells if c.condition == sweep.name], names)
            _numbers(axes, (1,))
        for axes in grid.flat[len(sweeps) :]:
            axes.set_axis_off()
        picture.supylabel("rms error of the phase margin [deg]", fontsize=STYLE["font.size"])
        _key(grid.flat[len(sweeps)], names)
        picture.supxlabel(
            f"* {chance(cells[0].episodes)}", fontsize=8, color=INK, x=0.01, ha="left"
        )
    return picture


def _condition(axes: Axes, sweep: Sweep, cells: Sequence[Cell], names: Sequence[str]) -> None:
    at = {level: i for i, level in enumerate(sweep.levels)}
    axes.set_xticks(range(len(at)), [shown_level(level) for level in at])
    axes.set(xlim=(-0.5, len(at) - 0.5), xlabel=sweep.name)
    axes.axhline(MISS[0], **_MISS)
    axes.axvspan(at[sweep.design] - 0.5, at[sweep.design] + 0.5, **_DESIGN, zorder=0)
    bounds = {at[c.level]: c.phase_margin.bound for c in cells if c.phase_margin.bound}
    for middle, bound in bounds.items():
        axes.hlines(bound, middle - 0.5, middle + 0.5, **_BOUND)
    words = all(isinstance(level, str) for level in at)
    aside = min(_ASIDE * len(at), _WIDEST / len(names)) if words else 0.0
    for k, name in enumerate(names):
        row = [c for c in cells if c.tuner == name]
        x = np.array([at[c.level] for c in row]) + (k - (len(names) - 1) / 2) * aside
        y = np.array([np.nan if c.phase_margin.rms is None else c.phase_margin.rms for c in row])
        axes.plot(x, y, color=colour(name), lw=1.8 if name == LADDER else 0.9, alpha=0.7)
        for c, place in zip(row, x, strict=True):
            _mark(axes, place, c, 4.0 if words else _sizes(len(names))[k])


def _sizes(count: int) -> list[float]:
    """Of dots that stand within each other."""
    return np.linspace(*_DOTS, count).tolist() if count > 1 else [4.0]


def _mark(axes: Axes, x: float, c: Cell, size: float) -> None:
    """One dot, or whatever else became of a cell; on the upper edge where it has no error."""
    mostly_trusted = c.trusted >= c.episodes / 2
    look: dict[str, Any] = {"color": colour(c.tuner), "ms": size, "mew": 1.2, "ls": ""}
    look["marker"] = "x" if c.refused else "^" if c.unstable else "o"
    look["mfc"] = look["color"] if mostly_trusted else "white"
    if c.phase_margin.rms is None:
        axes.plot([x], [0.96], transform=axes.get_xaxis_transform(), **look)
    else:
        axes.plot([x], [c.phase_margin.rms], **look)


def _key(axes: Axes, names: Sequence[str]) -> None:
    dot: dict[str, Any] = {"marker": "o", "ms": 4}
    entries: list[Any] = [Line2D([], [], color=colour(n), lw=0.9, **dot, label=n) for n in names]
    entries += [
        Line2D([], [], color=INK, ls="", **dot, label="trusted"),
        Line2D([], [], color=INK, ls="", mfc="white", **dot, label="mostly refused"),
        Line2D([], [], color=INK, ls="", marker="^", ms=4, label="some loops unstable"),
        Line2D([], [], color=INK, ls="", marker="x", ms=4, label="refused"),
        Line2D([], [], **_BOUND, label="Cramér–Rao bound*"),
        Line2D([], [], **_MISS, label=f"a miss: {MISS[0]:g}°"),
        Patch(**_DESIGN, label="design point"),
    ]
    key = axes.legend(handles=entries, loc="center left", bbox_to_anchor=(0.1, 0.5), ncols=2)
    key.set_in_layout(False)  # it reaches into the empty panel beside


def schedule(rows: Sequence[Schedule], bins: Sequence[Bin], prices: Sequence[Price]) -> Figure:
    """Draw kp and Ti over speed, accuracy over speed, and what a wrong speed costs.

    Parameters
    ----------
    rows : sequence of Schedule
        Vehicles; the oracle's gains are lines, the tuner's dots.
    bins : sequence of Bin
        Errors and bound between speeds.
    prices : sequence of Price
        Lines, at most four.
    """
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 6.8))
        (kp, Ti), (errors, wrong) = picture.subplots(2, 2)
        for row, hue in zip(rows, _VEHICLES, strict=True):
            label = f"μs {row.mu_s:g}, {row.M_delta:g} kg"
            kp.plot(row.v_x, row.oracle_kp, color=hue, lw=1.2, label=label)
            kp.plot(row.v_x, row.kp, "o", color=hue, ms=3.5)
            Ti.plot(row.v_x, row.oracle_Ti, color=hue, lw=1.2)
            Ti.plot(row.v_x, row.Ti, "o", color=hue, ms=3.5)
        kp.set(xlabel="speed [m/s]", ylabel="kp [s]", yscale="log")
        Ti.set(xlabel="speed [m/s]", ylabel="Ti [s]", yscale="log")
        words = "vehicles; lines: the oracle's gains, dots: the tuner's"
        picture.legend(
            handles=kp.get_lines()[::2], loc="outside upper center", ncols=len(rows), title=words
        )
        _accuracy(errors, bins)
        for found, dashes in zip(prices, ("-", "-", "--", ":"), strict=False):
            _price(wrong, found, dashes)
        wrong.set(xlabel=SPEED.name, ylabel="rms error of the phase margin [deg]", ylim=(0, None))
        wrong.legend(fontsize=8)
        for axes in (kp, Ti, errors):
            _numbers(axes, (1, 2, 5))
    return picture


def _accuracy(axes: Axes, bins: Sequence[Bin]) -> None:
    edges = [b.low for b in bins] + [bins[-1].high]
    found, hue = [b.phase_margin for b in bins], colour("ts-ff-lag-vx")
    _stairs(axes, edges, [a.rms for a in found], color=hue, lw=1.8, label="ts-ff-lag-vx")
    _stairs(axes, edges, [a.bound for a in found], **_BOUND, label="Cramér–Rao bound")
    for b in bins:
        if b.phase_margin.interval:
            label = None if b.low > bins[0].low else "95 % interval"
            band: dict[str, Any] = {"color": hue, "alpha": 0.2, "lw": 0, "label": label}
            axes.fill_between([b.low, b.high], *b.phase_margin.interval, **band)
    axes.set(xlabel="speed [m/s]", ylabel="rms error of the phase margin [deg]", yscale="log")
    axes.legend(fontsize=8)


def _stairs(axes: Axes, edges: Sequence[float], values: Sequence[Any], **line: Any) -> None:
    heights = [np.nan if v is None else v for v in values]
    axes.plot(edges, [*heights, heights[-1]], drawstyle="steps-post", **line)


def _price(axes: Axes, found: Price, dashes: str) -> None:
    errors = [np.nan if c.phase_margin.rms is None else c.phase_margin.rms for c in found.cells]
    label = f"{found.tuner} at {found.v_x:g} m/s"
    line: dict[str, Any] = {"color": colour(found.tuner), "ls": dashes, "marker": "o", "ms": 4}
    axes.plot(SPEED.levels, errors, label=label, **line)


def _numbers(axes: Axes, steps: Sequence[int]) -> None:
    """Label a logarithmic axis with plain numbers at `steps` of every decade."""
    axes.yaxis.set_major_locator(LogLocator(subs=steps, numticks=99))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
