"""The learning curves as a picture: error against training vehicles, the bound below."""

from collections.abc import Sequence

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

from studies.curve_plots import name_ends
from studies.learning import BOUND
from studies.palette import INK, STYLE, WIDTH, chance, colour
from studies.rows import Row


def curves(rows: Sequence[Row]) -> Figure:
    """Draw root mean square errors of phase margin and crossover, (tuner, vehicles) a row."""
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 7.2))
        above, below = picture.subplots(2, 1, sharex=True)
        _panel(above, rows, "phase_margin")
        _panel(below, rows, "crossover")
        above.set_ylabel("phase margin, rms error [deg]")
        below.set_ylabel("crossover, rms error [Hz]")
        below.set_xlabel("training vehicles")
        picture.supxlabel(
            f"{rows[0]['episodes']} test episodes.  Bands: 95 % bootstrap intervals over them.  "
            f"Dashed: no training.\n{chance(rows[0]['episodes'])}",
            fontsize=8, color=INK, x=0.01, ha="left",
        )  # fmt: skip
        picture.align_ylabels()
    return picture


def _panel(axes: Axes, rows: Sequence[Row], quantity: str) -> None:
    ends: dict[str, float] = {}
    for name in dict.fromkeys(r["name"] for r in rows):
        own = sorted((r for r in rows if r["name"] == name), key=lambda r: r["vehicles"])
        values = np.array([r[quantity]["rms"] for r in own])
        if own[-1]["vehicles"]:
            sizes = [r["vehicles"] for r in own]
            low, high = np.transpose([r[quantity]["rms_interval"] for r in own])
            axes.plot(sizes, values, color=colour(name), lw=1.8, marker="o", ms=4)
            axes.fill_between(sizes, low, high, color=colour(name), alpha=0.2, lw=0)
        elif name == BOUND:
            axes.axhline(values[0], color=INK, lw=1.2)
        elif name == "gb":
            axes.axhline(values[0], color=colour(name), lw=1.2, ls=(0, (5, 3)))
        else:
            continue  # the posterior spread lies on the bound's line
        ends[name] = float(values[-1])
    sizes = sorted({r["vehicles"] for r in rows if r["vehicles"]})
    axes.set(xscale="log", yscale="log", xlim=(sizes[0] / 1.08, sizes[-1] * 1.08))
    axes.set_xticks(sizes, [f"{m:,}".replace(",", " ") for m in sizes])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    name_ends(axes, ends)
