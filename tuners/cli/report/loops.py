"""The loop of an answer around the plant that its fit found: pictures and margins."""

from typing import Any

import numpy as np

from tuners.cli.report import figures
from tuners.cli.report.numbers import hertz, minus, seconds
from yawrate_env.loop.margins import Margins
from yawrate_env.plant.responses import ClosedLoop

Row = tuple[str, str, str]


def pictured(loop: ClosedLoop | None, output: str) -> dict[str, Any]:
    """What the figures of a page show of it, by name.

    Without a frequency response beside them, responses are drawn for wide and narrow pages.

    Parameters
    ----------
    output : str
        Label of the responses that have none of their own.
    """
    if loop is None:
        return {}
    drawn, responses = {}, loop.responses
    if loop.open is not None:
        drawn["bode"] = figures.bode(loop.open)
    if responses and loop.open is not None:
        drawn["responses"] = figures.responses(responses, output)
    elif responses:
        drawn["responses_wide"] = figures.responses(responses, output, figures.FULL)
        drawn["responses_narrow"] = figures.responses(responses, output)
    return drawn


def margins(loop: ClosedLoop | None) -> list[Row]:
    """Names, values and what they mean; nothing where there is no frequency response."""
    return [] if loop is None or loop.open is None else _rows(loop.open.marked)


def _rows(margins: Margins) -> list[Row]:
    phase, crossover, gain, _, modulus, delay = (
        float(getattr(margins, name)[0]) for name in Margins.__slots__
    )
    rows = [
        ("Phase margin", phase, f"{phase:.1f}°", "at the crossover"),
        ("Crossover", crossover, f"{hertz(crossover)} Hz", "where the loop gain falls through 1"),
        ("Gain margin", gain, f"{gain:.1f} dB", "at the phase crossover"),
        ("Modulus margin", modulus, f"{modulus:.2f}", "least distance of the loop from −1"),
        ("Delay margin", delay, seconds(delay), "further delay that it bears"),
    ]
    return [
        (name, minus(shown) if np.isfinite(value) else "none", words)
        for name, value, shown, words in rows
    ]
