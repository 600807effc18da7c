"""The tables of `studies.schedule`, as JSON and as a page."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from studies.markdown import general, table
from studies.schedule import Bin, Price, Schedule
from tuners.cli.answer import plain
from yawrate_env.files import write_text

_PAGE = """\
# One tuner for every speed

`ts-ff-lag-vx` is given the speed of the recording. Tests are {episodes} episodes of the `test`
set (seed {seed}) over the whole range, and {wrong} for each wrong speed; 95 % bootstrap intervals
are in `schedule.json`. Errors are root mean squares of the distance from the target.

## Accuracy against speed (× the bound)

{accuracy}
## Gain schedule

From one recording at each speed, and the design rule's that knows the vehicle in brackets; the
vehicle is the one in the middle of the prior. Others are in `schedule.json` and in
`figures/schedule.png`.

{schedule}
## A wrong speed: rms error of the phase margin [°]

Columns are how much faster [m/s] than claimed the vehicle really is, and what 1 m/s costs on
average of both directions. The last says how many of the {wrong} gains were trusted at −1 and
at +1 m/s.

{prices}"""


def write(
    rows: Sequence[Schedule],
    bins: Sequence[Bin],
    prices: Sequence[Price],
    episodes: int,
    seed: int,
    folder: Path,
) -> None:
    """Write ``schedule.json`` and ``schedule.md`` into a folder that exists."""
    found = {
        "conditions": {
            "set": "test",
            "episodes": episodes,
            "seed": seed,
            "interval": "95 % bootstrap",
        },
        "schedule": [asdict(row) for row in rows],
        "accuracy": [asdict(b) for b in bins],
        "wrong_speed": [{**asdict(p), "degrees": p.degrees} for p in prices],
    }
    text = json.dumps(plain(found), indent=1, allow_nan=False)
    write_text(folder / "schedule.json", text + "\n")
    write_text(folder / "schedule.md", page(rows, bins, prices, episodes, seed))


def page(
    rows: Sequence[Schedule],
    bins: Sequence[Bin],
    prices: Sequence[Price],
    episodes: int,
    seed: int,
) -> str:
    """Accuracy, the schedule of the first vehicle, and the price of a wrong speed."""
    return _PAGE.format(
        episodes=episodes,
        seed=seed,
        wrong=prices[0].cells[0].episodes,
        accuracy=_accuracy(bins),
        schedule=_schedule(rows[0]),
        prices=_prices(prices),
    )


def _accuracy(bins: Sequence[Bin]) -> str:
    heads = ("speed [m/s]", "episodes", "phase margin [°]", "crossover [Hz]", "unstable", "trusted")
    return table(
        heads,
        [
            (
                f"{b.low:g} to {b.high:g}",
                b.episodes,
                general(b.phase_margin.rms, b.phase_margin.ratio),
                general(b.crossover.rms, b.crossover.ratio),
                b.unstable,
                f"{b.trusted / max(b.episodes, 1):.1%}",
            )
            for b in bins
        ],
    )


def _schedule(row: Schedule) -> str:
    heads = ("speed [m/s]", "kp [s]", "Ti [s]", "phase margin [°]", "crossover [Hz]")
    columns = (row.v_x, row.kp, row.oracle_kp, row.Ti, row.oracle_Ti, row.phase_margin)
    return table(
        heads,
        [
            (f"{v:g}", f"{kp:.4f} ({kp0:.4f})", f"{Ti:.4f} ({Ti0:.4f})", f"{pm:.3f}", f"{fc:.4f}")
            for v, kp, kp0, Ti, Ti0, pm, fc in zip(*columns, row.crossover, strict=True)
        ],
    )


def _prices(prices: Sequence[Price]) -> str:
    levels = [c.level for c in prices[0].cells]
    heads = ("tuner", "claimed", *(f"{level:+g}" for level in levels), "for 1 m/s", "trusted")
    return table(
        heads,
        [
            (
                f"`{p.tuner}`",
                f"{p.v_x:g} m/s",
                *(general(c.phase_margin.rms) for c in p.cells),
                general(p.degrees),
                " and ".join(str(c.trusted) for c in p.cells if c.level in (-1.0, 1.0)),
            )
            for p in prices
        ],
    )
