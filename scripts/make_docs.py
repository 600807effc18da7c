"""Write the pages in docs/ that come from the code.

    python scripts/make_docs.py [--check] [--folder docs]

environment.md and recalibration_environment.md are the environments' docstrings, in the form of
Gymnasium's pages, with the sources of their numbers (`studies.numbers`); cli.md is what
`yawrate --help` says of every command.  With --check nothing is written; the exit status is 1 if a
page is out of date.
"""

import argparse
import inspect
import json
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import click
import gymnasium

from studies import mutations_page
from studies.markdown import table
from studies.numbers import NUMBER
from tuners.cli import COMMANDS
from tuners.cli import main as yawrate
from tuners.cli.arguments import REFUSED, UNUSABLE
from tuners.cli.check import NOT_KEPT
from yawrate_env import ENV_ID, RECALIBRATION_ID
from yawrate_env.env.recalibration_env import PIRecalibrationEnv
from yawrate_env.env.yaw_rate_env import PITuningEnv

RESULTS = Path(__file__).parents[1] / "results"

PAGE = """\
<!-- Written by scripts/make_docs.py from the docstring of {name}: edit that. -->

# {title}

{picture}{summary}

| | |
|---|---|
| Action space | `{action_space}` |
| Observation space | `{observation_space}` |
| Import | `import yawrate_env` |
| Make | `gymnasium.make("{id}")` |

{sections}
"""


CLI_PAGE = """\
<!-- Written by scripts/make_docs.py from the help of the commands: edit that. -->

# The `yawrate` command

{introduction}

<!-- statuses:start -->
{statuses}<!-- statuses:end -->

{commands}

## How `excite` and `train` use simulations

`excite --wanted W` simulates recordings of 32<!-- code: tuners.trust.forecast:PLANTS --> plants
of the prior, with the noise of today's experiment or of `--noise`, and finds length and amplitude
for which nine out of ten claim an interval of ± W or less; the width falls about as `1/(amplitude
sqrt(length))`. A table shows the median too, and what length or amplitude alone would have to be.
For a plant whose loop has no target of phase margin and crossover the width is the Cramér–Rao
bound's; describe the new experiment in the plant before a tuner learns from it.

`train` first names parameters that the experiment cannot tell apart, by the Fisher information of
64<!-- code: tuners.trust.distinction:PLANTS --> plants in widths of the ranges: a direction counts
as not found where it holds less than the prior's own precision,
12<!-- 1 / code: tuners.trust.identification:UNIFORM -->. Errors below
0.7<!-- code: tuners.cli.train:LEAKS --> of what noise and prior allow, on
100<!-- code: tuners.cli.train:ENOUGH --> episodes or more,
are warned of: such a simulator leaks the answer, or its noise is not applied.

## What a log may hold

Every tuner reads logs in the same way, for a vehicle as for [any other plant](plants.md).

- **Files** are text of any layout (delimiter, decimal comma, thousands, preamble, comments,
  encoding, units in brackets or a row of their own), spreadsheets (`yawrate[xlsx]`), MATLAB with
  structures, Simulink's signals and timetables (`yawrate[matlab]`), HDF5, Parquet, Feather, MDF 3
  and 4 (`yawrate[mdf]`), MCAP of ROS 2 (`yawrate[mcap]`), CAN traces BLF and ASC with `--dbc`
  (`yawrate[can]`); packed by gzip, bzip2, xz, zstd or zip. `yawrate[logs]` brings all of these.
  A file is read once, so that `/dev/stdin` and `<(command)` serve; devices, pipes that are silent
  for 10 s<!-- code: tuners.logs.source:PATIENCE --> and files above
  1 GiB<!-- code: tuners.logs.source:LARGEST / 1073741824 --> (text:
  256 MiB<!-- code: tuners.logs.csv_file:LARGEST / 1048576 -->) are refused, other formats
  with the way out.
- **Columns** are named as the plant names its signals, measured parameters and their labels, or
  `t`, `u` and `y`; for vehicles also as loggers, simulators and standards spell `steer`,
  `yaw_rate` and `speed` (`VehSpd`, `ESP_Gierrate`, `carState.steeringAngleDeg`, `AVz`, `psi_dot`).
  Two columns that may be meant are refused by name, unless they hold the same; what was passed
  over is noted, and so are speeds that contradict each other. Others are given by
  `--input-column`, `--output-column`, `--measured NAME=COLUMN`.
- **Time** is seconds or says its unit; clock times, dates, epochs in ms, µs and ns, and counters
  that start over are understood. Rows that repeat or come out of order are put right with a
  note. Stamps that jitter about an even line belong to evenly spaced samples, unless the output
  shows that the samples were taken when stamped: these are resampled. Channels with clocks of
  their own (MDF, MCAP, CAN, blank cells in text) keep them; a command that changes between the
  output's samples counts by its mean.
- **What was lost**: samples of the output at which it stands still and then jumps, as a sensor that
  drops out does, and single ones far from those around them are left out with a note. HDF5 files
  that are longer than they say are refused.
- **Units**: a column called `voltage [mV]` or `voltage_mV`, or whose unit stands in a row of
  units or with an MDF channel, is converted where the plant has `voltage [V]`, and a note says
  so; `--input-unit` and `--output-unit` say what a log doesn't. A unit that is unknown, or that
  measures something else, is refused.
- **Signs and ratios**: `--flip-output` for a sensor that counts the other way, and
  `--input-scale 50` for a signal measured behind a gear. Scales come after units; one that would
  convert a second time is refused.
- **Measured parameters** are a column's mean over the stretch that is used, or
  `--measured speed=20` in the plant's unit. A value that reads as a number is one: put a
  column's name or number in quotes, `--measured 'speed="3"'`.
- **Sampling**: another sampling time than the plant's is resampled, the input held, the output
  along a cubic spline. Sampling times above a tenth of the crossover's period are refused, or
  above ten of the plant's where it has no crossover.
- **Between samples** the input is held, as by a digital output. That of an analogue generator, or
  one that was measured, is nearer to `--input-between lines`: it is then turned into a held input
  that acts alike where the input has no frequencies above a fifth of the sampling rate; for
  faster ones describe the plant with a shorter sampling time.
- **Stretch**: of a log longer than two experiments the best-excited part is used, where measured
  parameters are steady and within the tuner's range, for plants with `linear=True` or `initial`
  states; the report draws the whole log around it, and a note says where gains over speed are
  possible. Others start from rest and are used from the first sample on.
- **`--Ts`** takes the place of a time column and of channels' stamps: beside `--time-column` or
  `--time-unit` it is refused. So are other options that contradict each other.
- **`--start auto`** means `rest` for plants whose responses do not add up.

`python scripts/log_files.py files` tunes from files of these kinds whose answer is known; `hunt`
damages files of every format at random and counts what becomes of them
([results/log_files.md](../results/log_files.md)).

<!-- hunt:start -->
{hunt}
<!-- hunt:end -->

`--steer-column`, `--steer-unit`, `--flip-steer` and `--steer-is` are other names of the
`--input-` options, `--yaw-rate-column`, `--yaw-rate-unit` and `--flip-yaw-rate` of the
`--output-` options; `--steer-ratio R` divides the input by R.

## What `tune --json` prints

Gains and metrics stand by name at the top level and, all of them, in `gains` and `metrics`
(each with `value`, `low`, `high`); names have no units, `units` lists these. `parameters` are
those of the fitted plant, `deviations` the standard deviations of the estimated ones. `log` has
the stretch, the measured parameters and the excitation, `fit` the estimated parameters and what
the recording started from, `checks` every check with value and limit, `forms` a PI controller's
usual forms, `controller` its kind and [vendors' forms](controllers.md#vendors-forms) of its gains,
and with `--speeds` `speeds` gains and margins of slower and faster loops. What does not exist is
`null`: where a tuner finds no gains, `status` says why, and `fallback` has gains that are stable
for every plant of the prior.

For several logs `log` is `null` and `logs` has an entry for each, with its `share` of the
information, and whether it `agrees` with the others: `chi_square`, which is about `freedom` for
one plant, the `chance` of as much, the `difference` that it makes to the metrics of these gains,
and the `parameters` of the plant fitted to it alone; for one log `logs` is empty. `validation` is
`null` without `--validate`, and else says the same of that log, with `fit_percent`,
`attainable_percent` (a model of this log alone), its `metrics`, whether it `agrees`, and whether it
`contradicts` the gains by more than they may miss.
"""


STATUSES = (
    (os.EX_OK, "done; of `tune`: the gains are usable, with care or without"),
    (UNUSABLE, "a log, a tuner or a plant's file cannot be used; the reason is on stderr"),
    (click.UsageError.exit_code, "wrong usage"),
    (
        REFUSED,
        "of `tune`: gains are refused, take care under `--strict`, or `--validate` contradicts "
        "them",
    ),
    (NOT_KEPT, "of `check`: margins are not as promised, or the drive cannot tell"),
)

PICTURE = "![Vehicles tuned one after the other](../figures/environment.gif)\n\n"


_ARGUMENT = r"^\| ((?:`\w+`(?:, )?)+) \| ([^|`]*\d[^|`]*) \| (.*) \|$"
_SIGNED = rf"(?:(?<!\w)-)?{NUMBER}"
_SPACES = "code: yawrate_env.env.yaw_rate_interface:"
_REWARD = "code: yawrate_env.plant.reward:"
_DRIVE = "code: yawrate_env.env.recalibration_env:PIRecalibrationEnv"
_RANDOM = "leaderboard/PITuning-v0.random.json: runs/0/"

SOURCES: dict[type, dict[str, tuple[str, ...]]] = {
    PITuningEnv: {
        "`kp` | 0.001 | 10 |": (f"{_SPACES}KP_RANGE/0", f"{_SPACES}KP_RANGE/1"),
        "`Ti` | 0.001 | 100 |": (f"{_SPACES}TI_RANGE/0", f"{_SPACES}TI_RANGE/1"),
        "±20 |": (f"{_SPACES}YAW_RATE_RANGE",),
        "-4 for a stable": (f"{_REWARD}WORST_STABLE",),
        "-5 for an unstable": (f"{_REWARD}UNSTABLE",),
        "below 45 deg": ("code: yawrate_env.env.interface:LEAST_MARGIN",),
        "92 % of the loops are\nunstable and the mean reward is -4.8": (
            f"{_RANDOM}unstable * 100", f"{_RANDOM}mean",
        ),
        "earn -0.73": ("scoreboard.json: rows/tuner=nominal&context_set=test/reward/value",),
    },
    PIRecalibrationEnv: {
        "drive of 50 windows of 5 s": (f"{_DRIVE}(windows)", f"{_DRIVE}(window)"),
        "at 100 Hz": (f"1 / {_DRIVE}(Ts_control)",),
        "(0.02 root mean square": (f"{_DRIVE}(friction_walk)",),
        "in units of 10 deg and 0.25 Hz": (
            "code: yawrate_env.plant.pi_loop:PHASE_SCALE",
            "code: yawrate_env.plant.pi_loop:CROSSOVER_SCALE",
        ),
        "-4 for a stable": (f"{_REWARD}WORST_STABLE",),
        "-5 for an\nunstable": (f"{_REWARD}UNSTABLE",),
        "below 45 deg": ("code: yawrate_env.env.recalibration_interface:SAFE_MARGIN",),
    },
}  # fmt: skip
"""Phrases of the docstrings with numbers, and where these come from; defaults of arguments are
found by their names."""


def environment_page(kind: type, id: str, title: str, picture: str = "") -> str:
    text = inspect.cleandoc(kind.__doc__ or "")
    for phrase, sources in SOURCES[kind].items():
        if text.count(phrase) != 1:
            raise ValueError(
                f"{kind.__name__}: {phrase!r} stands {text.count(phrase)} times, not once"
            )
        text = text.replace(phrase, anchored(phrase, sources))
    text = re.sub(_ARGUMENT, lambda row: with_defaults(kind, row), text, flags=re.MULTILINE)
    summary, sections = text.split("\n\n", 1)
    env = gymnasium.make(id)
    return PAGE.format(
        name=kind.__name__,
        title=title,
        picture=picture,
        summary=summary,
        action_space=box(env.action_space),
        observation_space=box(env.observation_space),
        id=id,
        sections=sections,
    )


def anchored(phrase: str, sources: Sequence[str]) -> str:
    """A phrase with a source behind each of its numbers."""
    left = iter(sources)
    with_sources = re.sub(_SIGNED, lambda number: f"{number[0]}<!-- {next(left)} -->", phrase)
    if next(left, None) is not None:
        raise ValueError(f"{phrase!r} has fewer than {len(sources)} numbers")
    return with_sources


def with_defaults(kind: type, row: re.Match[str]) -> str:
    """A row of the table of arguments, whose defaults are those of the code."""
    names, default = re.findall(r"`(\w+)`", row[1]), row[2]
    numbers = re.findall(_SIGNED, default)
    unit = " * degrees" if "deg" in default else ""
    entry = f"code: {kind.__module__}:{kind.__name__}"
    one = len(names) == 1
    sources = [
        f"{entry}({names[0 if one else i]}){f'/{i}' if one and len(numbers) > 1 else ''}{unit}"
        for i in range(len(numbers))
    ]
    return f"| {row[1]} | {anchored(default, sources)} | {row[3]} |"


def box(space: gymnasium.Space) -> str:
    """One bound a row: the rows of the observation are constant in time."""
    assert isinstance(space, gymnasium.spaces.Box)
    rows = [bound.reshape(space.shape[0], -1)[:, 0] for bound in (space.low, space.high)]
    low, high = ("[" + ", ".join(f"{x:.4g}" for x in row) + "]" for row in rows)
    return f"Box({low}, {high}, {space.shape}, {space.dtype})"


def cli_page() -> str:
    top = click.Context(yawrate, info_name="yawrate", terminal_width=88)
    sections = []
    for name in COMMANDS:
        command = yawrate.get_command(top, name)
        assert command is not None
        context = click.Context(command, parent=top, info_name=name, terminal_width=88)
        sections.append(f"## yawrate {name}\n\n```text\n{command.get_help(context)}\n```")
    hunt = json.loads((RESULTS / "log_files.json").read_text())
    return CLI_PAGE.format(
        introduction=yawrate.help,
        statuses=table(("exit status", "meaning"), STATUSES),
        hunt=mutations_page.summary(hunt),
        commands="\n\n".join(sections),
    )


PAGES: dict[str, Callable[[], str]] = {
    "environment.md": lambda: environment_page(PITuningEnv, ENV_ID, "PI tuning", PICTURE),
    "recalibration_environment.md": lambda: environment_page(
        PIRecalibrationEnv, RECALIBRATION_ID, "PI re-calibration"
    ),
    "cli.md": cli_page,
}


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if out of date")
    parser.add_argument("--folder", type=Path, default=Path(__file__).parents[1] / "docs")
    args = parser.parse_args(arguments)
    stale = []
    for name, page in PAGES.items():
        path, text = args.folder / name, page()
        if not (path.exists() and path.read_text(encoding="utf-8") == text):
            stale.append(path)
            if not args.check:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8")
    if args.check and stale:
        print(f"{', '.join(map(str, stale))} out of date: run scripts/make_docs.py")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
