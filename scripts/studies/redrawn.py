"""Pictures drawn again from stored results, for a change of their looks."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from matplotlib.figure import Figure

from benchmarks import page as speed
from studies import (
    comparison,
    curve_plots,
    dataset_scale,
    degree,
    learning_plot,
    nonlinear,
    nonlinear_plots,
    off_design_page,
    pictures,
    robustness,
    robustness_plot,
)
from studies.schedule import Bin, Price, Schedule


def _stored(folder: Path, name: str) -> Any:
    return json.loads((folder / f"{name}.json").read_text("utf-8"))


def _rl(folder: Path) -> Figure:
    scores = msgspec.convert(_stored(folder, "rl"), list[comparison.Score])
    return curve_plots.learning_curves(scores)


def _schedule(folder: Path) -> Figure:
    found = _stored(folder, "schedule")
    return pictures.schedule(
        msgspec.convert(found["schedule"], list[Schedule]),
        msgspec.convert(found["accuracy"], list[Bin]),
        msgspec.convert(found["wrong_speed"], list[Price]),
    )


def _degrees(folder: Path) -> Figure:
    found = _stored(folder, "robustness")["degrees"]
    return robustness_plot.degrees(msgspec.convert(found, list[degree.Level]))


def _kinds(folder: Path) -> Figure:
    found = _stored(folder, "robustness")["rows"]
    return robustness_plot.kinds(msgspec.convert(found, list[robustness.Row]))


def _nonlinear(folder: Path) -> Figure:
    scores = msgspec.convert(_stored(folder, "nonlinear")["rows"], list[nonlinear.Score])
    return nonlinear_plots.overview(scores)


PICTURES: dict[str, Callable[[Path], Figure]] = {
    "datasets": lambda folder: dataset_scale.picture(_stored(folder, "datasets")),
    "learning": lambda folder: learning_plot.curves(_stored(folder, "learning")["rows"]),
    "nonlinear": _nonlinear,
    "off_design": lambda folder: pictures.off_design(off_design_page.read(folder)[0]),
    "rl": _rl,
    "robustness": _kinds,
    "robustness_degree": _degrees,
    "schedule": _schedule,
    "speed": lambda folder: speed.picture(*next(iter(_stored(folder, "benchmark").items()))),
}
"""From the folder of results, by file name."""
