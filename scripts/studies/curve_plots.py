"""Learning curves: what an agent reaches after so many simulated episodes, and others do.

An agent is the interquartile mean of its seeds in a band, its 95 % interval; a two-stage
tuner that was trained on as many episodes a line with markers; what needs no training a
dashed level.  Every line has its name at its end.
"""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

from studies.comparison import TEST_EPISODES, Score, curve
from studies.palette import INK, STYLE, WIDTH, chance, colour

_LINE = 0.065  # height of a name, as a share of the panel's


def learning_curves(scores: Sequence[Score]) -> Figure:
    """Draw margin error and spread of the phase margin against simulated episodes.

    Parameters
    ----------
    scores : sequence of Score
        Those without episodes are levels; those with a time of training are agents.
    """
    agents = {s.name for s in scores if s.seconds}
    counts = {max(s.seed for s in scores if s.name == name) + 1 for name in agents} or {1}
    seeds, most = min(counts), max(counts)
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(WIDTH, 7.2))
        above, below = picture.subplots(2, 1, sharex=True)
        _panel(above, scores, lambda s: s.error)
        _panel(below, scores, lambda s: s.phase_margin[1])
        above.set_ylabel("mean margin error [1 = 10° or 0.25 Hz]")
        below.set_ylabel("standard deviation of the phase margin [deg]")
        below.set_xlabel("simulated episodes")
        many = f"{seeds} seeds" if seeds == most else f"{seeds} to {most} seeds"
        many = f"interquartile mean of {many} and its 95 % interval"
        dots = "Dots: two stages.  " if any(s.episodes and not s.seconds for s in scores) else ""
        picture.supxlabel(
            f"Agents: {many if most > 1 else 'one seed'}.  {dots}"
            f"Dashed: no training.  oracle: 0.\n{chance(TEST_EPISODES)}",
            fontsize=8, color=INK, x=0.01, ha="left",
        )  # fmt: skip
        picture.align_ylabels()
    return picture


def _panel(axes: Axes, scores: Sequence[Score], value: Callable[[Score], float]) -> None:
    sizes = sorted({s.episodes for s in scores if s.episodes})
    names = {s.name: s for s in scores if s.name != "oracle"}
    ends: dict[str, float] = {}
    levels = []
    for name, last in names.items():
        found = {n: v for n, v in curve(scores, name, value).items() if np.isfinite(v).all()}
        if not found:
            continue
        middle, low, high = np.array(list(found.values())).T
        hue = colour(name)
        ends[name] = float(middle[-1])
        levels += [float(np.min(low)), float(np.max(high))]
        if not last.episodes:
            axes.axhline(middle[0], color=hue, lw=1.2, ls=(0, (5, 3)))
            continue
        axes.plot(list(found), middle, color=hue, lw=1.8, marker="" if last.seconds else "o", ms=4)
        if last.seconds:
            axes.fill_between(list(found), low, high, color=hue, alpha=0.2, lw=0)
    axes.set(xscale="log", yscale="log", ylim=(min(levels) / 1.4, max(levels) * 1.4))
    axes.set_xlim(sizes[0] / 1.08, sizes[-1] * 1.08)
    axes.set_xticks(sizes, [f"{n:,}".replace(",", " ") for n in sizes])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    name_ends(axes, ends)


def name_ends(axes: Axes, ends: dict[str, float]) -> None:
    """Write names beside the last values, moved apart where they would overlap."""
    low, high = np.log(axes.get_ylim())
    order = sorted(ends, key=lambda name: ends[name])
    wanted = np.array([(np.log(ends[name]) - low) / (high - low) for name in order])
    for name, wish, y in zip(order, wanted, apart(wanted, _LINE), strict=True):
        axes.annotate(
            name, (1.0, wish), (1.035, y), xycoords="axes fraction", color=colour(name),
            va="center",
            arrowprops={"arrowstyle": "-", "color": colour(name), "lw": 0.7, "relpos": (0, 0.5)},
        )  # fmt: skip


def apart(wanted: np.ndarray[tuple[int], np.dtype[np.float64]], gap: float) -> list[float]:
    """Ascending positions from 0 up and at least `gap` apart, neighbours about their mean."""
    groups: list[list[float]] = []
    for position in wanted:
        groups.append([float(position)])
        while len(groups) > 1 and _start(groups[-1], gap) < _start(groups[-2], gap) + gap * len(
            groups[-2]
        ):
            last = groups.pop()
            groups[-1] += last
    return [_start(group, gap) + gap * i for group in groups for i in range(len(group))]


def _start(group: list[float], gap: float) -> float:
    return max(0.0, float(np.mean(group)) - gap * (len(group) - 1) / 2)
