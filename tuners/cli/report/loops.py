"""The closed loop around the fitted plant: pictures and margins."""

from typing import Any

import numpy as np

from tuners.cli.report import figures
from tuners.cli.report.numbers import hertz, minus, seconds
from yawrate_env.loop.margins import Margins
from yawrate_env.plant.responses import ClosedLoop

Row = tuple[str, str, str]


def pictured(loop: ClosedLoop | None, output: str) -> dict[str, Any]:
    """Pictures by name; responses alone are drawn for wide and for narrow pages.

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
    """Names, values and meanings; empty without a frequency response."""
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
        ("Delay margin", delay, seconds(delay), "further delay at which the loop stays stable"),
    ]
    return [
        (name, minus(shown) if np.isfinite(value) else "none", words)
        for name, value, shown, words in rows
    ]
