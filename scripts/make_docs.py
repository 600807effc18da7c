"""Write the pages in docs/ that come from the code.

    python scripts/make_docs.py [--check] [--folder docs]

environment.md and recalibration_environment.md are the environments' docstrings, in the form of
Gymnasium's pages; cli.md is what `yawrate --help` says of every command.  With --check nothing is
written; the exit status is 1 if a page is out of date.
"""

import argparse
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path

import click
import gymnasium

from tuners.cli import COMMANDS
from tuners.cli import main as yawrate
from yawrate_env import ENV_ID, RECALIBRATION_ID
from yawrate_env.env.recalibration_env import PIRecalibrationEnv
from yawrate_env.env.yaw_rate_env import PITuningEnv

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

| exit status | meaning |
|---|---|
| 0 | done; of `tune`: the gains are usable, with care or without |
| 1 | a log, a tuner or a plant's file cannot be used; the reason is on stderr |
| 2 | wrong usage |
| 3 | of `tune`: gains are refused, take care under `--strict`, or `--validate` contradicts them |
| 3 | of `check`: margins are not as promised, or the drive cannot tell |

{commands}

## How `excite` and `train` use simulations

`excite --wanted W` simulates recordings of 32 plants of the prior, with the noise of today's
experiment or of `--noise`, and finds length and amplitude for which nine out of ten claim an
interval of ± W or less; the width falls about as 1/(amplitude √length). A table shows the median
too, and what length or amplitude alone would have to be. For a plant whose loop has no target of
phase margin and crossover the width is the Cramér–Rao bound's; describe the new experiment in the
plant before a tuner learns from it.

`train` first names parameters that the experiment cannot tell apart, by the Fisher information of
64 plants in widths of the ranges: a direction counts as not found where it holds less than the
prior's own precision, 12. Errors below 0.7 of what noise and prior allow, on 100 episodes or more,
are warned of: such a simulator leaks the answer, or its noise is not applied.

## What a log may hold

Every tuner reads logs in the same way, for a vehicle as for [any other plant](plants.md).

- **Files** are text of any layout (delimiter, decimal comma, thousands, preamble, comments,
  encoding, units in brackets or a row of their own), spreadsheets (`yawrate[xlsx]`), MATLAB with
  structures, Simulink's signals and timetables (`yawrate[matlab]`), HDF5, Parquet, Feather, MDF 3
  and 4 (`yawrate[mdf]`), MCAP of ROS 2 (`yawrate[mcap]`), CAN traces BLF and ASC with `--dbc`
  (`yawrate[can]`); packed by gzip, bzip2, xz, zstd or zip. `yawrate[logs]` brings all of these.
  A file is read once, so that `/dev/stdin` and `<(command)` serve; devices, pipes that are silent
  for 10 s and files above 1 GiB (text: 256 MiB) are refused, other formats with the way out.
- **Columns** are named as the plant names its signals, measured parameters and their labels, or
  `t`, `u` and `y`; for vehicles also as loggers, simulators and standards spell `steer`,
  `yaw_rate` and `speed` (`VehSpd`, `ESP_Gierrate`, `carState.steeringAngleDeg`, `AVz`, `psi_dot`).
  Two columns that may be meant are refused by name, unless they hold the same; what was passed
  over is noted, and so are speeds that contradict each other. Others are given by
  `--input-column`, `--output-column`, `--measured NAME=COLUMN`.
- **Time** is seconds or says its unit; clock times, dates, epochs in ms, µs and ns, and counters
  that begin again at 0 are understood. Rows that repeat or come out of order are put right with a
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
  that acts alike, to 1 % where the input has no frequencies above a fifth of the sampling rate; for
  faster ones describe the plant with a shorter sampling time.
- **Stretch**: of a log longer than two experiments the best-excited part is used, where measured
  parameters are steady and within the tuner's range, for plants with `linear=True` or `initial`
  states; the report draws the whole log around it, and a note says where gains over speed are
  possible. Others start from rest and are used from the first sample on.
- **`--Ts`** takes the place of a time column and of channels' stamps: beside `--time-column` or
  `--time-unit` it is refused. So are other options that contradict each other.
- **`--start auto`** means `rest` for plants whose responses do not add up.

`python scripts/log_files.py files` tunes from 65 files of these kinds whose answer is known;
`hunt` damages files of every format at random and counts what becomes of them. Of 5,000 (seed 0)
3,822 were refused in one line, the gains of 70 were refused, and 1,108 answers were right. None was
wrong and trusted, had an interval beside the undamaged file's, ended in a traceback, took 10 s or
2 GB ([results/log_files.md](../results/log_files.md)).

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


PICTURE = "![Vehicles tuned one after the other](../figures/environment.gif)\n\n"


def environment_page(kind: type, id: str, title: str, picture: str = "") -> str:
    summary, sections = inspect.cleandoc(kind.__doc__ or "").split("\n\n", 1)
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
    return CLI_PAGE.format(introduction=yawrate.help, commands="\n\n".join(sections))


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
