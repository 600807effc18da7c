"""The page ``results/accuracy.md``: every study of accuracy and trust, explained."""

import json
from pathlib import Path

from studies.budget import POSTERIOR
from studies.rows import QUANTITIES
from studies.trusting import MISS

_PAGE = """\
# Accuracy, and when to trust it

Made by `python scripts/accuracy.py page` from the tables of the same script (`ratios`, `trust`,
`budget`, `learning`, `million`, `minimax`) and of `scripts/off_design.py`; edits are overwritten.

## What the bound is

A recording of ten seconds with noise cannot say exactly which vehicle it comes from. How much it
can say is its **Fisher information**: how strongly the yaw rate would change if friction or mass
were a little different, compared with the noise. Its inverse is the **Cramér–Rao bound**: nobody
who estimates friction and mass without bias spreads less. We carry it through "design with the
estimate, close the loop around the true vehicle" to what an engineer reads off: degrees of phase
margin and hertz of crossover. An estimator that knows the range of vehicles may lean on it and
end a little below, as one that shrinks its answers does; how much that can bring on average is the
**posterior spread**, {below} below the bound at 30 dB.

Errors here are root mean squares from the target, bias included, and a ratio of 1.00 says that
nothing better exists; brackets are 95 % bootstrap intervals over test episodes. No test episode
was seen in training or calibration: `test`, `train` and `calibration` are sets of their own,
whatever the seeds.

{ratios}
`ts-ff-lag-vx` works at every speed and is given the speed; both it and `ts-ff-lag` know one
excitation, and another costs them four to eight times the bound. `ts-poly-any` takes any: it seeks
the recording's response along twelve principal components of the simulated vehicles' by plain least
squares, which noise leaves without bias whatever the input is, and its second stage is a cubic
polynomial. Most of what it lacks to the bound is the price of one map for all inputs, which cannot
weigh a recording's features by their own covariance. `ts-gbm-lag` fits a quadratic trend to the
features first and lets boosted trees learn the rest. Trees alone, the lines below it, answer in
steps: they need many more vehicles for a part of that accuracy.

## Where the error comes from
{budget}
## More vehicles
{learning}
## The worst of a million
{million}
## Trained for the worst case
{minimax}
## Away from the design point
{off_design}
## When not to trust

`tune` climbs a ladder: the learner's gains, those of the simulator fitted to the recording, those
of the recording's own response; each where the next does not contradict it. What is checked, which
two intervals there are and what the verdicts mean is in [docs/trust.md](../docs/trust.md). Nothing
depends on the stored excitation: other registers, bit times, lengths and starts in mid-drive pass.

The tables count what is *usable* without care. Where the log alone is wrong (its clock, a late yaw
rate) gains miss and take care, with a question; [robustness.md](robustness.md) counts them.

Severities of the faults below (`scripts/studies/faults.py`) were fixed before any measurement.
"Gains miss" means more than {miss} off with the true vehicle, or an unstable loop.
Recordings with values that are not numbers are refused with an error and do not appear.

{trust}"""

_ABSENT = "\nNot measured here yet: `python scripts/{script}`.\n"

_MINIMAX = """
The same features and polynomial, fitted for the least mean and for the least largest risk over 64
parts of the prior, eight of friction by eight of mass (Lakshminarayanan and Rojas). The risk is the
squared distance of the reward, 1 for 10° or 0.25 Hz. It changes something where the polynomial is
what errs. Where the noise in the features is, the fit for the mean is nearly the minimax one
already, and weights for the worst part only cost accuracy.

"""

_PIECES = {
    "ratios": ("accuracy.py ratios", ""),
    "budget": (
        "accuracy.py budget",
        "\nDown each column something is lost at every step, and nothing else changes.\n\n",
    ),
    "learning": ("accuracy.py learning", "\n![Learning curves](../figures/learning.png)\n\n"),
    "million": ("accuracy.py million", "\n"),
    "minimax": ("accuracy.py minimax", _MINIMAX),
    "off_design": ("off_design.py", "\n![Off the design point](../figures/off_design.png)\n\n"),
    "trust": ("accuracy.py trust", ""),
}


def page(results: Path) -> str:
    """Build the page from the tables that are in a folder; what is missing is said."""
    pieces = {}
    for name, (script, before) in _PIECES.items():
        table = results / f"{name}.md"
        text = before + table.read_text() if table.exists() else _ABSENT.format(script=script)
        pieces[name] = _deeper(text)
    return _PAGE.format(**pieces, below=_below(results), miss=f"{MISS[0]:g}° or {MISS[1]:g} Hz")


def _below(results: Path) -> str:
    """By how much the posterior spread lies below the bound."""
    stored = results / "budget.json"
    if not stored.exists():
        return "a little"
    rows = json.loads(stored.read_text())["rows"]
    (posterior,) = (r for r in rows if r["name"] == POSTERIOR)
    shares = (
        f"{1 - posterior[name]['ratio']:.1%} ({name.replace('_', ' ')})" for name in QUANTITIES
    )
    return " and ".join(shares)


def _deeper(text: str) -> str:
    """Headings one level down."""
    return "\n".join("#" + line if line.startswith("#") else line for line in text.split("\n"))
