"""Figure of `studies.degree`: how wrong the vehicle's data may be."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from studies.degree import Level
from studies.palette import INK, STYLE, WIDTH, colour
from studies.robustness import PLAYERS
from studies.trusting import MISS

_HUES = {"learner": "ts-ff-lag", "fitted plant": "gb", "black box": "bb", "ladder": "ladder"}
_LOOKS = {"learner": ("o", 7.0, 3.4), "fitted plant": ("o", 4.0, 1.4), "black box": ("s", 7.0, 3.4)}
_USUAL = "o", 4.0, 1.4
_TITLES = (
    "phase margin: rms error [°]",
    "intervals that hold [%]",
    "usable [%] (dashed: or with care)",
)
_MARK: dict[str, Any] = {"color": INK, "lw": 1.0, "ls": (0, (1, 2)), "zorder": 1.5}


def degrees(levels: Sequence[Level]) -> Figure:
    """Draw rms error, coverage and verdicts over the degree, a line a player."""
    ticks = sorted({level.degree for level in levels})
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 3.4))
        error, held, usable = picture.subplots(1, 3)
        for name in PLAYERS:
            row = [level for level in levels if level.player == name]
            x = [ticks.index(level.degree) for level in row]
            marker, ms, lw = _LOOKS.get(name, _USUAL)  # wide below narrow: lines may coincide
            hue = colour(_HUES[name])
            look: dict[str, Any] = {
                "color": hue,
                "label": name,
                "marker": marker,
                "ms": ms,
                "lw": lw,
            }
            rms = np.array([np.nan if level.rms is None else level.rms for level in row])
            error.plot(x, rms, **look)
            low, high = np.transpose([level.interval or (np.nan, np.nan) for level in row])
            error.fill_between(x, low, high, color=hue, alpha=0.15, lw=0)
            held.plot(x, [100 * level.covered for level in row], **look)
            usable.plot(x, [100 * level.usable for level in row], **look)
            either = [100 * (level.usable + level.careful) for level in row]
            usable.plot(x, either, color=hue, ls="--", lw=lw / 1.4)
        error.axhline(MISS[0], **_MARK)
        held.axhline(90, **_MARK)
        error.set_yscale("log")
        error.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
        error.yaxis.set_minor_formatter(NullFormatter())
        held.set_ylim(-4, 104)
        usable.set_ylim(-4, 104)
        for axes, title in zip((error, held, usable), _TITLES, strict=True):
            axes.set_xticks(range(len(ticks)), [f"{tick:g}" for tick in ticks])
            axes.set_title(title, fontsize=9)
        handles, labels = error.get_legend_handles_labels()
        picture.legend(handles, labels, loc="outside upper center", ncols=len(PLAYERS))
        picture.supxlabel(
            "all of the vehicle's data wrong, each by up to [%]", fontsize=STYLE["font.size"]
        )
    return picture
