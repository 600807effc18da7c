"""The report's figures, as SVG whose text is text that a page can style.

Figures are drawn for half of a desktop page, which is the width of a phone's; the recording
is drawn twice, for wide and for narrow pages.
"""

import io
import re
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator
from numpy.typing import NDArray

from tuners.cli.report.numbers import hertz
from tuners.cli.report.residuals import Correlation
from tuners.logs.stretch import Whole
from yawrate_env.env import rendering
from yawrate_env.plant.names import split
from yawrate_env.plant.responses import OpenLoop, Response

Array = NDArray[np.float64]

HALF, FULL = 4.7, 9.8  # inch
POINTS = 72  # an inch, as in SVG
MOST_POINTS = 3000  # of a drawn line
_PAD = 3.0  # points around the labels of axes
MEASURED, MODEL, RESIDUAL = "#9db4c8", "#b0307a", "#69717a"
THEMED = {
    rendering.INK: "ink",
    rendering.MUTED: "muted",
    rendering.GRID: "grid",
    rendering.STYLE["axes.edgecolor"]: "edge",
    rendering.YAW_RATE: "other",
    MODEL: "loop",
}
"""The page's variables for the colours that its dark theme changes."""

STYLE = {
    **rendering.STYLE,
    "font.size": 9.5,
    "axes.titlesize": 10.0,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "svg.fonttype": "none",
    "legend.fontsize": 9.0,
}


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """A recording and the fitted model, arrays in the units of their labels.

    Attributes
    ----------
    t0, Ts : float
        Time of the first sample, and of each further one [s].
    command : NDArray
        (m, N) inputs.
    measured, simulated : NDArray
        (q, N) outputs.
    labels : tuple of tuple of str
        Of inputs and of outputs, as in ``yaw rate [deg/s]``.
    """

    t0: float
    Ts: float
    command: Array
    measured: Array
    simulated: Array
    labels: tuple[tuple[str, ...], tuple[str, ...]]


def recording(traces: Traces, width: float) -> Figure:
    """The inputs, each output with the fitted model over it, and its residual."""
    every = max(1, traces.measured.shape[1] // MOST_POINTS)
    signals = (traces.command, traces.measured, traces.simulated)
    inputs, outputs, models = (signal[:, ::every] for signal in signals)
    time = traces.t0 + traces.Ts * every * np.arange(outputs.shape[1])
    commands, labels = traces.labels
    heights = [1.0] * len(commands) + [2.6, 1.0] * len(labels)
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(width, sum(heights)))
        rows = picture.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        above, pairs = rows[: len(commands)], rows[len(commands) :].reshape(-1, 2)
        for axes, u, command in zip(above, inputs, commands, strict=True):
            axes.plot(time, u, color=rendering.COMMAND, lw=1.0, drawstyle="steps-post")
            axes.set_ylabel(_two_lines(command))
        for (middle, below), y, model, output in zip(pairs, outputs, models, labels, strict=True):
            middle.plot(time, y, color=MEASURED, lw=1.4, label="measured")
            middle.plot(time, model, color=MODEL, lw=0.9, label="fitted model")
            middle.set_ylabel(_two_lines(output))
            below.plot(time, y - model, color=RESIDUAL, lw=0.7)
            below.set_ylabel(_two_lines("residual", output))
        first = pairs[0, 0]
        first.legend(loc="lower right", bbox_to_anchor=(1, 0.98), ncols=2, borderaxespad=0)
        rows[-1].set(xlabel="time [s]", xlim=(time[0], time[-1]))
        for axes in rows:
            axes.yaxis.set_major_locator(MaxNLocator(4 if axes in pairs[:, 0] else 2))
        picture.align_ylabels()
    return picture


def whole(
    found: Whole,
    inputs: tuple[tuple[str, float], ...],
    measured: tuple[str, ...],
    width: float,
) -> Figure:
    """A long recording and the part of it that is used.

    Parameters
    ----------
    inputs : tuple of (str, float)
        Label of each input, and the factor to its unit.
    measured : tuple of str
        Labels of the measured parameters.
    """
    rows = len(inputs) + len(measured)
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(width, 0.9 + 1.1 * rows))
        every = picture.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
        above, others = every[: len(inputs)], every[len(inputs) :]
        for axes, (label, factor), ends in zip(above, inputs, found.inputs, strict=True):
            low, high = factor * ends.T
            axes.fill_between(found.time, low, high, color=rendering.COMMAND, lw=0.8)
            axes.set_ylabel(_two_lines(label))
        for axes, label, values in zip(others, measured, found.measured.values(), strict=True):
            axes.plot(found.time, values, color=rendering.INK, lw=1.0)
            axes.set_ylabel(_two_lines(label))
        for axes in every:
            axes.axvspan(*found.used, color=rendering.TARGET, alpha=0.16, lw=0)
            axes.yaxis.set_major_locator(MaxNLocator(2))
            axes.set_xlim(found.time[0], found.time[-1])
        picture.axes[-1].set_xlabel("time [s]")
    return picture


def bode(loop: OpenLoop) -> Figure:
    """The open loop with its margins marked."""
    margins = loop.marked
    crossover, turn = float(margins.crossover[0]), float(margins.phase_crossover[0])
    magnitude, phase = loop.magnitude, loop.phase
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(HALF, 4.4))
        above, below = picture.subplots(2, 1, sharex=True)
        line: dict[str, Any] = {"color": rendering.LOOP, "lw": 1.8}
        above.semilogx(loop.frequency, magnitude, **line)
        below.semilogx(loop.frequency, phase, **line)
        above.axhline(0, color=rendering.INK, lw=0.8)
        below.axhline(-180, color=rendering.INK, lw=0.8)
        above.set(ylabel="magnitude [dB]", ylim=(-50, max(30, float(magnitude.max()) + 5)))
        below.set(
            ylabel="phase [deg]",
            xlabel="frequency [Hz]",
            ylim=(-285, max(-30.0, float(phase.max()) + 15)),
        )
        below.yaxis.set_major_locator(MultipleLocator(45))
        _hertz(below)
        if np.isfinite(crossover):
            bottom = -180 + float(margins.phase_margin[0])
            _mark(above, crossover, 0.0, f"{hertz(crossover)} Hz", (7, 7))
            _span(below, crossover, bottom, f"{bottom + 180:.1f}°", align="right")
        if np.isfinite(turn):
            gain = float(margins.gain_margin[0])
            _span(above, turn, -gain, f"{gain:.1f} dB", 0.0)
            _mark(below, turn, -180.0, f"{hertz(turn)} Hz", (-7, -14), "right")
    return picture


def responses(drawn: tuple[Response, ...], output: str, width: float = HALF) -> Figure:
    """A loop's responses over time.

    Parameters
    ----------
    output : str
        Label of the responses that have none of their own.
    """
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(width, max(2.6, 2.2 * len(drawn))))
        every = picture.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
        for axes, response in zip(every, drawn, strict=True):
            axes.axhline(response.setpoint, color=rendering.TARGET, lw=1.0, dashes=(4, 3))
            axes.plot(response.time, response.value, color=rendering.LOOP, lw=1.8)
            axes.set(title=response.title, ylabel=response.label or output)
        every[-1].set(xlabel="time [s]", xlim=(0, max(r.time[-1] for r in drawn)))
    return picture


def correlation(found: Correlation, title: str) -> Figure:
    """A correlation of the residual and its 99 % band; without lag 0 of an autocorrelation."""
    inner = found.value < 1 - 1e-9
    limit = 1.2 * max(2.5 * found.band, float(np.abs(found.value[inner]).max(initial=0)))
    with style.context(["default", STYLE]):
        picture = Figure(figsize=(HALF, 2.6))
        axes = picture.subplots()
        axes.axhspan(-found.band, found.band, color=rendering.TARGET, alpha=0.16, lw=0)
        axes.axhline(0, color=rendering.INK, lw=0.8)
        axes.plot(found.lag[inner], found.value[inner], color=rendering.YAW_RATE, lw=1.0)
        axes.set(title=title, ylim=(-limit, limit), xlim=(found.lag[0], found.lag[-1]))
        axes.set(xlabel="lag [s]", ylabel="correlation")
        axes.xaxis.set_major_locator(MaxNLocator(5))
    return picture


def svg(picture: Figure, name: str, alternative: str = "") -> str:
    """Markup to put into a page: scales with it, and uses the page's font and colours.

    Parameters
    ----------
    name : str
        Of the picture, which its identifiers are made from.
    alternative : str
        What is told to whom cannot see it; its name if not given.
    """
    text = io.StringIO()
    with style.context(["default", STYLE, {"svg.hashsalt": name}]):
        FigureCanvasSVG(picture)
        picture.set_dpi(POINTS)
        _fit(picture)
        picture.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    markup = text.getvalue()[text.getvalue().index("<svg") :]
    markup = re.sub(r"<metadata>.*?</metadata>", "", markup, flags=re.DOTALL)
    markup = re.sub(r' id="[a-z]+[\w.]*_\d+"', "", markup)  # of groups; two figures share them
    for colour, variable in THEMED.items():
        markup = markup.replace(colour, f"var(--{variable})")
    head, rest = markup.split(">", 1)
    head = re.sub(r' (width|height)="[^"]*"', "", head)
    return f'{head} role="img" aria-label="{escape(alternative or name)}">{rest}'


def _fit(picture: Figure) -> None:
    """Make room for the labels of axes above each other, and align those at the left.

    Matplotlib's constrained layout measures everything twice and has it drawn twice.
    """
    width, height = picture.bbox.size
    renderer: Any = RendererSVG(width, height, io.StringIO())  # type: ignore[no-untyped-call]
    column, inner = picture.axes, [axes.bbox.frozen() for axes in picture.axes]
    outer = [
        axes.get_tightbbox(renderer, for_layout_only=True) or inside
        for axes, inside in zip(column, inner, strict=True)
    ]
    pairs = list(zip(inner, outer, strict=True))
    left = _PAD + max(inside.x0 - around.x0 for inside, around in pairs)
    across = width - left - _PAD - max(around.x1 - inside.x1 for inside, around in pairs)
    above = [_PAD + around.y1 - inside.y1 for inside, around in pairs]
    below = [_PAD + inside.y0 - around.y0 for inside, around in pairs]
    stretch = (height - sum(above) - sum(below)) / sum(inside.height for inside in inner)
    labels = [axes.yaxis.label.get_position()[0] for axes in column]
    label = min(x - inside.x0 for x, inside in zip(labels, inner, strict=True))
    y = height
    for axes, inside, over, under in zip(column, inner, above, below, strict=True):
        y -= over + stretch * inside.height
        axes.set_position(
            (left / width, y / height, across / width, stretch * inside.height / height)
        )
        axes.yaxis.set_label_coords(label / across, 0.5)
        y -= under


def _two_lines(label: str, unit_of: str = "") -> str:
    """A name above its unit, or above another's."""
    name, unit = split(unit_of or label)
    return f"{label if unit_of else name}\n[{unit}]" if unit else label


def _mark(
    axes: Axes, x: float, y: float, words: str, offset: tuple[int, int], align: Any = "left"
) -> None:
    axes.plot([x], [y], "o", color=rendering.TARGET, ms=5, zorder=4)
    axes.annotate(words, (x, y), offset, textcoords="offset points", ha=align, color=rendering.INK)


def _span(
    axes: Axes, x: float, y: float, words: str, foot: float = -180.0, align: Any = "left"
) -> None:
    axes.plot([x, x], [foot, y], color=rendering.TARGET, lw=2.2, zorder=3, solid_capstyle="butt")
    middle = (foot + y) / 2
    beside = (6 if align == "left" else -6, 0)
    axes.annotate(words, (x, middle), beside, textcoords="offset points", va="center", ha=align,
                  color=rendering.INK, weight="bold")  # fmt: skip


def _hertz(axes: Axes) -> None:
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
