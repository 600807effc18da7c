"""The experiment for a wanted interval, beside today's and the other ways to it."""

import click
import numpy as np
from numpy.typing import NDArray

from tuners.cli.text import displayed, levels, metric_name, quantity, unit_of
from tuners.logs.excitation import SHORTEST
from tuners.logs.stretch import LONGEST as STRETCH
from tuners.trust.forecast import Forecast, forecast
from tuners.trust.proposal import (
    WAYS,
    OutOfReachError,
    Proposal,
    check_reached,
    check_wanted,
    evaluated,
    propose,
    room,
)
from tuners.tuner.sampling import LONGEST
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]


def proposed(
    plant: Plant, wanted: float, way: str, noise: float | None, snr: float | None, seed: int
) -> tuple[Array, str]:
    """Input (N,) or (m, N) that gives intervals of a half width, and what to say of it."""
    found = forecast(plant, noise=noise, snr=snr, seed=seed)
    within = room(found, SHORTEST, LONGEST)
    try:
        check_wanted(found, wanted)
        chosen = propose(found, wanted, within, way)
        check_reached(found, wanted, chosen, within)
    except OutOfReachError as error:  # it begins with the argument's name, which is the option's
        raise click.UsageError(f"--{error}") from None
    rows = {"today": evaluated(found, 1.0, plant.samples)}
    for each in WAYS:
        rows[each] = chosen if each == way else propose(found, wanted, within, each)
    u = found.input(chosen.amplitude, chosen.samples)
    parts = ["", "", heading(found), "", *table(found, rows, way), *notes(found, u, chosen, wanted)]
    return u, "\n".join(parts)


def heading(found: Forecast) -> str:
    """What the table shows, of which plants and with which noise."""
    plant = found.plant
    by = (
        "that a recording alone supports"
        if found.alone
        else "by the Cramér-Rao bound of the fitted plant, since a recording alone does not tell it"
    )
    low, high = (end / plant.weights[:, 0] for end in (found.sigma.min(), found.sigma.max()))
    noise = " and ".join(
        ("" if np.isclose(a, b) else f"{a:.3g} to ") + quantity(float(b), unit_of(name), digits=3)
        for a, b, name in zip(low, high, plant.outputs_named, strict=True)
    )
    return (
        f"Half width of the 90 % interval of the {metric_name(plant.counted[0])} {by},\n"
        f"for {len(found.theta)} plants of the prior and noise of {noise}:"
    )


def table(found: Forecast, rows: dict[str, Proposal], way: str) -> list[str]:
    """One line an experiment."""
    plant = found.plant
    unit = unit_of(plant.counted[0])
    inputs, _ = displayed(plant)
    names = [split(name)[0] for name, _ in inputs]
    cells = [("change", *names, "length", "median", "9 of 10", "")]
    for name, row in rows.items():
        u = np.atleast_2d(found.input(row.amplitude, row.samples))
        cells.append((
            name,
            *(levels(factor * of, label) for (label, factor), of in zip(inputs, u, strict=True)),
            f"{row.samples * plant.Ts:.4g} s",
            quantity(row.median, unit, digits=3),
            quantity(row.most, unit, digits=3),
            "written" if name == way else "",
        ))  # fmt: skip
    widths = [max(map(len, column)) + 2 for column in zip(*cells, strict=True)]
    lines = ("".join(f"{c:<{w}}" for c, w in zip(row, widths, strict=True)) for row in cells)
    return [f"  {line}".rstrip() for line in lines]


def notes(found: Forecast, u: Array, chosen: Proposal, wanted: float) -> list[str]:
    """What to know before the experiment is driven."""
    plant, said = found.plant, []
    used, N = STRETCH * plant.samples, u.shape[-1]
    if chosen.most < 0.95 * wanted:
        said.append("Weaker or shorter recordings would take care or be refused.")
    if (plant.linear or plant.initial) and N > used:
        said.append(
            f"Of so long a log `yawrate tune` uses the best {used * plant.Ts:g} s; with --from and "
            "--to it uses what you name."
        )
    if plant.remarks is not None:
        y = plant.respond(plant.middle, u)[0]
        measured = {
            name: np.full(N, plant.middle[0, i])
            for name, i in zip(plant.measured, plant.indices(plant.measured), strict=True)
        }
        said += plant.remarks(u, y, measured)
    return ["", *said] if said else []
