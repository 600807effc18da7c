"""The measured speed as a page and as a picture."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.stages import ANSWERS, TUNERS
from benchmarks.stopwatch import PACKAGES
from studies.markdown import table
from studies.palette import INK, STYLE, WIDTH, colour

MARKERS = ("o", "s", "^")


def stored(path: Path) -> dict[str, Any]:
    """What was measured so far, by machine; nothing where there is no file."""
    return dict(json.loads(path.read_text())) if path.exists() else {}


def to_markdown(machines: Mapping[str, dict[str, Any]]) -> str:
    """Tables of all that was measured, machine by machine."""
    return "\n".join(["# Speed\n", *(_machine(*each) for each in machines.items())])


def _machine(name: str, result: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in result["versions"].items())
    parts = [
        f"## {name}\n\nCommit {result['commit']}; {versions}. Episodes of 10 000 samples. All "
        f"contenders of a table take turns in one process, {result['rounds']} rounds (those that "
        "take seconds: 3); times are medians (least to most), ratios are medians within a round.\n"
    ]
    missing = [name for name in PACKAGES if name not in result["versions"]]
    if missing:
        parts.append(f"Not installed, so without their rows: {', '.join(missing)}.\n")

    def add(title: str, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        parts.append(f"### {title}\n\n{table(heads, rows)}")

    for title, contenders in result["stages"].items():
        add(
            title,
            ("", "time an episode [ms]", "times the first row's"),
            [
                (name, _spread(found["milliseconds"]), _spread(found["ratio"]))
                for name, found in contenders.items()
            ],
        )
    if "page_faults" in result:
        faults = [(f"{n} environments", f"{found:g}") for n, found in result["page_faults"].items()]
        add("Fresh pages of memory", ("", "a step of the batch environment"), faults)
    if "commands" in result:
        add(
            "From the shell to the answer",
            ("", "seconds", "times the import of NumPy"),
            [
                (f"`{name}`", _spread(_seconds(found["milliseconds"])), _spread(found["ratio"]))
                for name, found in result["commands"].items()
            ],
        )
        first = result["first_answer"]
        parts.append(f"`yawrate tune` where nothing is compiled yet: {first:.1f} s.\n")
    add(
        "What a process does first",
        ("", "compiling [s]", "from the cache [s]"),
        [(what, f"{s['cold']:.2f}", f"{s['cached']:.2f}") for what, s in result["first"].items()],
    )
    if result["training"]:
        trained = [(name, f"{seconds:.1f}") for name, seconds in result["training"].items()]
        add("Training", ("", "seconds, simulation included"), trained)
    for what, rows in result["growth"].items():
        add(
            f"Laguerre features and targets by {what}",
            ("", "episodes", "seconds", "ms an episode", "memory so far [MB]"),
            [
                (
                    f"{row['size']} {what}", row["count"], f"{row['seconds']:.2f}",
                    f"{1e3 * row['seconds'] / row['count']:.3g}", f"{row['megabytes']:.0f}",
                )
                for row in rows
            ],
        )  # fmt: skip
        if "first" in rows[0]:
            seconds = ", ".join(f"{row['first']:.2f}" for row in rows)
            parts.append(f"The first time, with memory that the process never had: {seconds} s.\n")
    return "\n".join(parts)


def picture(machine: str, result: dict[str, Any]) -> Figure:
    """Draw for one machine what an answer of each tuner costs, and how data sets' costs grow."""
    with style.context(["default", STYLE]):
        figure = Figure(figsize=(WIDTH, 5.8))
        figure.suptitle(machine)
        parts = figure.subplot_mosaic("AA;BC", height_ratios=[1.25, 1])
        _answers(parts["A"], {how: result["stages"][how] for how in ANSWERS})
        for axes, what in ((parts["B"], "episodes"), (parts["C"], "samples")):
            _growth(axes, what, result["growth"][what])
    return figure


def _answers(axes: Axes, found: dict[str, Any]) -> None:
    """One row a tuner, one mark a way of asking."""
    for (how, times), marker in zip(found.items(), MARKERS, strict=True):
        for row, tuner in enumerate(TUNERS):
            time, hue = times[tuner]["milliseconds"], colour(tuner)
            axes.hlines(row, time["least"], time["most"], color=hue, lw=1.4)
            axes.plot([time["median"]], [row], color=hue, marker=marker, mec="white", ms=8)
        axes.plot([], [], color=INK, marker=marker, ls="", label=how.removeprefix("Gains, "))
    axes.set(xscale="log", ylim=(len(TUNERS) - 0.5, -0.5))
    axes.set_xlabel("time an episode, from raw arrays to gains [ms]")
    axes.set_yticks(range(len(TUNERS)), TUNERS)
    axes.grid(False, axis="y")
    axes.legend(loc="lower left")


def _growth(axes: Axes, what: str, rows: Sequence[dict[str, float]]) -> None:
    """Seconds, or milliseconds an episode, and a line of slope one through the last."""
    size = np.array([row["size"] for row in rows], dtype=float)
    seconds = np.array([row["seconds"] for row in rows])
    each = what == "samples"
    cost = 1e3 * seconds / [row["count"] for row in rows] if each else seconds
    axes.plot(size, cost[-1] * size / size[-1], color=INK, lw=0.8, ls=(0, (4, 3)), label="linear")
    axes.plot(size, cost, color=colour("ts-ff-lag"), marker="o", label="measured")
    axes.set(
        xscale="log", yscale="log", xlabel=f"{what} in a{'n episode' if each else ' data set'}"
    )
    axes.set_ylabel("time an episode [ms]" if each else "time [s]")
    axes.legend()


def _spread(values: dict[str, float]) -> str:
    median, least, most = (_number(values[name]) for name in ("median", "least", "most"))
    return f"{median} ({least} to {most})"


def _seconds(milliseconds: dict[str, float]) -> dict[str, float]:
    return {name: value / 1e3 for name, value in milliseconds.items()}


def _number(value: float) -> str:
    """Three significant digits, or whole."""
    return f"{value:.0f}" if value >= 1000 else f"{value:.3g}"
