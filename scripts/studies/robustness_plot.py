"""Figures: who breaks where, and how wrong the vehicle's data may be."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from studies.degree import Level
from studies.palette import INK, STYLE, WIDTH, colour
from studies.robustness import PLAYERS, Row, pooled
from studies.trusting import MISS

_HUES = {"learner": "ts-ff-lag", "fitted plant": "gb", "black box": "bb", "ladder": "ladder"}
_LOOKS = {"learner": ("o", 7.0, 3.4), "fitted plant": ("o", 4.0, 1.4), "black box": ("s", 7.0, 3.4)}
_USUAL = "o", 4.0, 1.4
_VERDICTS = {
    "usable": "#009E73", "usable, but a miss": "#CC3311", "with care": "#A8DDC6",
    "with care, but a miss": "#F0B27A", "refused": "#d5d5d0",
}  # fmt: skip
_TITLES = (
    "phase margin: rms error [°]",
    "intervals that hold [%]",
    "usable [%], -- or with care",
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


def kinds(rows: Sequence[Row]) -> Figure:
    """Draw who misses how often, a row a kind, and what the ladder's verdicts say."""
    names = list(dict.fromkeys((row.group, row.kind) for row in rows))
    found = [pooled([r for r in rows if (r.group, r.kind) == name]) for name in names]
    firsts = [i for i, (group, _) in enumerate(names) if i == 0 or names[i - 1][0] != group]
    y = np.cumsum([2.0 if i in firsts else 1.0 for i in range(len(names))])
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 0.165 * y[-1] + 1.6))
        who, what = picture.subplots(1, 2, sharey=True)
        for name in PLAYERS:
            marker, ms, _ = _LOOKS.get(name, _USUAL)
            missed = [100 * row.misses[name] / row.recordings for row in found]
            who.plot(missed, y, marker, color=colour(_HUES[name]), ms=ms, label=name, ls="")
        left = np.zeros(len(found))
        for name, hue in _VERDICTS.items():
            share = np.array([100 * _counted(row)[name] / row.recordings for row in found])
            what.barh(y, share, 0.8, left, color=hue, label=name)
            left += share
        who.set(yticks=y, ylim=(y[-1] + 1, 0.4), xlim=(-4, 104), xlabel="gains that miss [%]")
        who.set_yticklabels([kind for _, kind in names], fontsize=7)
        for i in firsts:
            head: dict[str, Any] = {
                "fontsize": 7.5,
                "fontweight": "bold",
                "va": "center",
                "color": INK,
            }
            who.text(0.01, y[i] - 0.7, names[i][0], transform=who.get_yaxis_transform(), **head)
        what.set(xlim=(0, 100), xlabel="answers of the ladder [%]")
        for axes in (who, what):
            axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize=7.5)
    return picture


def _counted(row: Row) -> dict[str, int]:
    """Answers of the ladder by the names of `_VERDICTS`."""
    verdicts, missed = row.verdicts, row.missed
    return {
        "usable": verdicts["usable"] - missed["usable"],
        "usable, but a miss": missed["usable"],
        "with care": verdicts["usable_with_care"] - missed["usable_with_care"],
        "with care, but a miss": missed["usable_with_care"],
        "refused": verdicts["refuse"],
    }
