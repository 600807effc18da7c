"""A page of example plants, each with a recording, the plant found in it, and the loop it gives.

docs/gallery.md        what stands between its markers
figures/gallery_*.png  one picture a plant
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import tuners
from studies.markdown import table
from studies.palette import INK, NOISE, STYLE, WIDTH
from studies.plots import save
from studies.readme import updated
from tuners.tuner.result import Result
from yawrate_env.env import rendering
from yawrate_env.files import write_text
from yawrate_env.plant.entry import find
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import ClosedLoop, Response

Array = NDArray[np.float64]

NAME = "gallery"

_STEP = "Step of the reference by 1"
_HUES = INK, "#b3541e"


@dataclass(frozen=True, slots=True)
class Exhibit:
    """A plant of the gallery.

    Attributes
    ----------
    title, text : str
        Heading, and what there is to see, in Markdown.
    entry : str
        Where the plant is found.
    arguments : dict
        Of the entry.
    """

    title: str
    text: str
    entry: str
    arguments: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Short, for files: ``fopdt`` of ``yawrate_env.plants:fopdt``."""
        module, _, attribute = self.entry.partition(":")
        return attribute if attribute != "plant" else module


EXHIBITS = (
    Exhibit(
        "A heater: first order plus dead time",
        "`yawrate init --plant fopdt`, with four levels in its experiment (`levels = 4`), which "
        "show whether the heater saturates. Gain, lag and dead time are unknown; the rule is SIMC.",
        "yawrate_env.plants:fopdt",
        {"experiment": {"levels": 4, "signals": ["heater [%]", "temperature [K]"]}},
    ),
    Exhibit(
        "Two lags plus dead time",
        "`yawrate init --plant sopdt`, with a sum of sines (`kind = \"multisine\"`) for an input. "
        "SIMC's half rule makes one lag of the two.",
        "yawrate_env.plants:sopdt",
        {"experiment": {"kind": "multisine"}},
    ),
    Exhibit(
        "A distillation column: two inputs, two outputs",
        "[`examples/plants/wood_berry.py`](../examples/plants/wood_berry.py): reflux and steam "
        "act on both compositions, and eight gains and lags are found at once. Two PI loops get "
        "Luyben's biggest log-modulus tuning; the step is that of the top's set point.",
        "wood_berry:plant",
    ),
    Exhibit(
        "An inverted pendulum in closed loop",
        "[`examples/plants/pendulum.py`](../examples/plants/pendulum.py): unstable alone, so a "
        "cautious PD holds it while it is recorded; the input is that loop's reference.",
        "pendulum:plant",
    ),
    Exhibit(
        "A reactor that gains heat from its reaction",
        "[`examples/plants/cstr.py`](../examples/plants/cstr.py): nonlinear; a warmer jacket moves "
        "the tank by more than a colder one. The rule is loop shaping for the linearised reactor, "
        "the step that of the nonlinear one.",
        "cstr:plant",
    ),
)  # fmt: skip


def run(exhibits: tuple[Exhibit, ...], examples: Path, page: Path, figures: Path) -> str:
    """Tune a recording of each plant, draw it, and write the page; returns what it says of them."""
    parts = []
    for exhibit in exhibits:
        plant = find(exhibit.entry, examples, exhibit.arguments)
        block = recorded(plant, "test", 0, 1)
        result = tuners.load("gb", plant).tune(block.u[0], block.y[0])
        save(picture(plant, result, block.theta[0]), figures / f"{NAME}_{exhibit.name}.png")
        parts.append(section(exhibit, result, plant.oracle(block.theta)[0], block.theta[0]))
    text = "\n\n".join(parts)
    write_text(page, updated(page.read_text(encoding="utf-8"), NAME, text))
    return text


def section(exhibit: Exhibit, result: Result, right: Array, theta: Array) -> str:
    """What the page says of one plant."""
    gains = [
        (f"`{name}`", f"{gain:.4g}", _interval(result, name), f"{true:.4g}")
        for (name, gain), true in zip(result.gains.items(), right, strict=True)
    ]
    fitted = zip(result.fit.parameters.items(), theta, strict=True)
    parameters = [
        (f"`{split(name)[0]}`", f"{value:.4g}", _deviation(result, name), f"{true:.4g}")
        for (name, value), true in fitted
    ]
    rows = table(("", "found", "90 %", "right"), gains + parameters).strip()
    verdict = str(result.verdict.value).replace("_", " ")
    return (
        f"## {exhibit.title}\n\n{exhibit.text}\n\n"
        f"![{exhibit.name}](../figures/{NAME}_{exhibit.name}.png)\n\n{rows}\n\nVerdict: {verdict}."
    )


def _interval(result: Result, name: str) -> str:
    ends = result.gain_intervals[name]
    return f"{ends.low:.4g} to {ends.high:.4g}"


def _deviation(result: Result, name: str) -> str:
    value, wide = result.fit.parameters[name], 1.645 * result.fit.deviations.get(name, 0.0)
    return f"{value - wide:.4g} to {value + wide:.4g}"


def picture(plant: Plant, result: Result, theta: Array) -> Figure:
    """Recording with the plant found in it, and a step of the loop of the gains found."""
    fit = result.fit
    inputs, outputs = np.atleast_2d(fit.u), np.atleast_2d(fit.measured)
    simulated, t = np.atleast_2d(fit.simulated), np.arange(outputs.shape[1]) * fit.Ts
    heights = [0.5] * len(inputs) + [1.0] * len(outputs)
    with style.context(["default", STYLE]):
        drawn = Figure(figsize=(WIDTH, 1.1 + 1.25 * sum(heights)))
        grid = drawn.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=[1.7, 1])
        for i, (row, name) in enumerate(zip(inputs, plant.inputs_named, strict=True)):
            axes = drawn.add_subplot(grid[i, 0])
            axes.plot(t, row, color=rendering.COMMAND, drawstyle="steps-post", lw=1.0)
            axes.set(ylabel=_label(name), ymargin=0.2, xlim=(0, t[-1]))
            axes.tick_params(labelbottom=False)
        for j, name in enumerate(plant.outputs_named):
            axes = drawn.add_subplot(grid[len(inputs) + j, 0])
            axes.plot(t, outputs[j], color=NOISE, lw=2.0, label="recorded")
            axes.plot(t, simulated[j], color=INK, lw=0.9, label="plant found in it")
            axes.set(ylabel=_label(name), ymargin=0.1, xlim=(0, t[-1]))
            axes.tick_params(labelbottom=j == len(outputs) - 1)
        axes.set_xlabel("time [s]")
        axes = drawn.axes[len(inputs)]
        axes.legend(loc="lower right", ncols=2, fontsize="small", bbox_to_anchor=(1, 0.97))
        loop = plant.closed_loop(theta, np.array(list(result.gains.values())))
        if loop is not None:
            _step(drawn.add_subplot(grid[:, 1]), loop)
        drawn.align_ylabels()
    return drawn


def _step(axes: Axes, loop: ClosedLoop) -> None:
    """The first step's curves, with the true plant."""
    title = loop.responses[0].title or _STEP
    curves = [r for r in loop.responses if (r.title or _STEP) == title and r.setpoint is not None]
    for response, hue in zip(curves, _HUES, strict=False):
        _curve(axes, response, hue)
    axes.set(xlabel="time [s]", xlim=(0, curves[0].time[-1]))
    axes.set_title(title, fontsize=8.5, loc="left")
    if len(curves) > 1:
        axes.legend(fontsize="small")


def _curve(axes: Axes, response: Response, hue: str) -> None:
    axes.plot(response.time, response.value, color=hue, lw=1.4, label=split(response.label)[0])
    axes.axhline(response.setpoint, color=hue, lw=0.7, ls=":")


def _label(signal: str) -> str:
    return signal.replace(" [", "\n[")
