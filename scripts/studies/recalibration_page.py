"""The page of `studies.recalibration`."""

from typing import Any

import numpy as np

from studies.markdown import short, table
from tuners.trust.verdict import Verdict

Row = dict[str, Any]

_PAGE = """\
# Re-calibration while driving

Drives of `yawrate/PIRecalibration-v0` at its defaults: 50 windows of 5 s in closed loop, steps and
lane changes, 10 to 33 m/s, friction as a random walk (0.02 rms a minute) with jumps (one in five
minutes, uniform over the prior), another load in every drive; seed {seed}. Errors are mean absolute
distances of phase margin and crossover from what the design rule reaches on the vehicle of the
window; brackets hold 95 % bootstrap intervals over drives. Every rung starts with the gains that
are right at the start, and sees windows that are over and the speed to come.

{ladder}
The mean margin error of the filter is {never} times below never re-tuning, {scheduled} times below
the gains at the start scheduled over speed.  What it cannot have is `one window late`: a jump is
seen after the window it happened in.

**Why a tuner on every window alone is worse than never.** A window has one manoeuvre of less than 5
s where identification has 10 s of pseudo-random steering, and nothing that earlier windows told is
kept; without the reference the loop's feedback looks like the vehicle, too. The tuners know it, and
refuse nearly every window: with refusals heeded gains hardly ever change from those of the start.
`every window alone, with the prior` reads the same windows by prediction errors, which feedback
does not bias, and helps itself with the prior: above never, below the filter, since it forgets.

**The agent** learns from the rewards of {learned:,} windows (`tuners.agents.recalibrator`;
{training:.0f} s, median): a cone over the gains, as `rl`'s, on the means of a memory whose settings
the rewards teach, too. What it knows beyond rewards: their documented form; that gains have no
effect on later windows; that the first two numbers of an observation are estimates with a
covariance, in standard deviations of a prior; and that memory is a normal distribution, which
widens from window to window and may jump in the first number. It is not told the vehicle, the
design rule, how fast friction walks or how often it jumps, nor, as the filter is, load and friction
at the start. `agent without memory` is the same learner on the last window alone.

**The information bound** (Tichavský, Muravchik and Nehorai, 1998) is the recursion
`J+ = (J^-1 + Q)^-1 + F` at the truth, told of every jump after its window; its row draws estimates
with covariance J^-1.

## What the filter does not know

`filter` is a bank: the car as its data say, and one hypothesis for each number that may be wrong
and for some pairs, all with unknown noise (`tuners.recalibration.bank`). `filter, data as
exact` is its first hypothesis alone, with the claimed noise. Both assume the vehicle and the noise
of the first row.

{faults}
A verdict comes with every window's gains (`tuners.recalibration.doubt`): usable where the 90 %
intervals reach no further than 3° and 0.15 Hz, with care within twice that. Counted are windows
before which friction did not jump, without each drive's first; wrong is an error of more than 3° or
0.15 Hz.

{trust}
## Speed

The native batch environment, {batch} drives, {cores}: **{speed} windows a second**, features,
design and margins included (the fastest of the rounds). Shares of the time, each measured alone:

{shares}"""

_WAYS = {
    "never": "never",
    "scheduled": "scheduled over speed",
    "filter, data as exact": "filter, data as exact",
    "filter": "filter",
}
_HEADS = ("", "phase margin error [°]", "crossover error [Hz]", "reward a drive",
          "windows below 45° or unstable", "unstable", "windows")  # fmt: skip


def page(found: Row) -> str:
    """Ladder, faults and speed."""
    rows = {row["rung"]: row for row in found["rows"]}
    error = {name: row["phase_margin"]["mean"] for name, row in rows.items()}
    speed = found["speed"]
    return _PAGE.format(
        seed=found["seed"],
        learned=found["learned"],
        training=np.median([row["seconds"] for row in found["rows"] if "seconds" in row]),
        ladder=table(_HEADS, [_cells(row) for row in found["rows"]]),
        never=short(error["never re-tune"] / error["filter"]),
        scheduled=short(error["never, scheduled over speed"] / error["filter"]),
        faults=table(
            ("", *(f"{way} [{unit}]" for unit in ("°", "Hz") for way in _WAYS.values()),
             "unstable, filter", "drives"),
            [_fault(each) for each in found["faults"]],
        ),
        trust=table(
            ("", "usable", "with care", "refused", "wrong, of all", "usable and wrong",
             "90 % intervals hold [°], [Hz]", "half width [°], [Hz]"),
            [_trust(each) for each in found["faults"]],
        ),
        batch=speed["batch"],
        cores="1 core" if speed["cores"] == 1 else f"{speed['cores']} cores",
        speed=f"{speed['windows_per_second']:,.0f}",
        shares=table(("", "share"), [(k, f"{v:.0%}") for k, v in speed["shares"].items()]),
    )  # fmt: skip


def _cells(row: Row) -> list[str]:
    means = [_interval(row[name]) for name in ("phase_margin", "crossover", "return")]
    cost = f"{100 * row['cost']['mean']:.2g} %"
    return [row["rung"], *means, cost, str(row["unstable"]), f"{row['windows']:,}"]


def _interval(value: Row) -> str:
    if abs(value["mean"]) < 1e-6:
        return "0"
    return f"{value['mean']:.3g} ({value['low']:.3g} to {value['high']:.3g})"


def _fault(each: Row) -> list[str]:
    errors = [short(each[way][name]["mean"]) for name in ("phase_margin", "crossover")
              for way in _WAYS]  # fmt: skip
    return [each["fault"], *errors, str(each["filter"]["unstable"]), str(each["filter"]["drives"])]


def _trust(each: Row) -> list[str]:
    found = each["trust"]
    shares = [f"{found[name]:.0%}" for name in Verdict]
    holds = ", ".join(f"{value:.0%}" for value in found["coverage"])
    half = ", ".join(short(value) for value in found["half"])
    usable = f"{found['wrong']} of {found['of']:,}"
    return [each["fault"], *shares, f"{found['missed']:.1%}", usable, holds, half]
