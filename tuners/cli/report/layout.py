"""What the pages share: their template, how white a residual is, numbers as people read them."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import yawrate_env
from tuners.cli.report import figures
from tuners.cli.report.figures import Traces
from tuners.cli.report.numbers import minus
from tuners.cli.report.residuals import Correlation, autocorrelation, cross_correlation
from tuners.cli.text import between
from tuners.tuner.result import Check, Interval

Array = NDArray[np.float64]
Number = tuple[str, str, str, str]


@dataclass(frozen=True, slots=True)
class Residuals:
    """How white a residual is, at the recording's own sampling time."""

    auto: Correlation
    cross: Correlation

    @classmethod
    def of(cls, e: Array, u: Array, Ts: float, recorded: float, longest: float) -> "Residuals":
        """Correlations of the samples that were recorded, not of those between them.

        Parameters
        ----------
        e, u : (N,) float64
            Residual and input.
        Ts, recorded : float
            Sampling times of these, and of the recording [s].
        longest : float
            Largest lag [s].
        """
        every = max(1, round(recorded / Ts))
        e, u, Ts = e[::every], u[::every], every * Ts
        return cls(autocorrelation(e, Ts, longest), cross_correlation(e, u, Ts, longest))


def page(template: str, **values: Any) -> str:
    """A page as text, from a template that extends ``base.html``."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("tuners.cli.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["minus"] = minus
    text = environment.get_template(template).render(version=yawrate_env.__version__, **values)
    return text + "\n"


def pictures(traces: Traces, residuals: Residuals, input: str, **more: Any) -> dict[str, str]:
    """The figures that every page has, and `more`, as markup."""
    drawn = {
        "wide": figures.recording(traces, figures.FULL),
        "narrow": figures.recording(traces, figures.HALF),
        **more,
        "auto": figures.correlation(residuals.auto, "Residual with itself"),
        "cross": figures.correlation(residuals.cross, f"Residual with the {input}"),
    }
    return {name: figures.svg(picture, name) for name, picture in drawn.items()}


def shown_interval(name: str, interval: Interval, unit: str) -> Number:
    """A figure as the verdict shows it: name, value with its unit, and the interval below."""
    value, _, below = minus(between(interval, unit)).partition(", ")
    below = below.replace(" %", "\N{NO-BREAK SPACE}%")
    return name, value, "", below or "the recording does not say"


def rows(checks: Iterable[Check], words: dict[str, tuple[str, str]]) -> list[Any]:
    """Checks with their names and units for people."""
    return [(c, *words.get(c.name, (c.name.replace("_", " "), ""))) for c in checks]
