"""Write the pages in docs/ that come from the code.

    python scripts/make_docs.py [--check] [--folder docs]

environment.md is the environment's docstring, in the form of Gymnasium's pages; cli.md is
what `yawrate --help` says of every command.  With --check nothing is written; the exit
status is 1 if a page is out of date.
"""

import argparse
import inspect
from collections.abc import Sequence
from pathlib import Path

import click
import gymnasium

from tuners.cli import COMMANDS
from tuners.cli import main as yawrate
from yawrate_env import ENV_ID
from yawrate_env.env.yaw_rate_env import PITuningEnv

PAGE = """\
<!-- Written by scripts/make_docs.py from the docstring of PITuningEnv: edit that. -->

# PI tuning

![Vehicles tuned one after the other](../figures/environment.gif)

{summary}

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
| 0 | done; of `tune`: the gains are trusted |
| 1 | a log, a model or a vehicle's file cannot be used; the reason is on stderr |
| 2 | wrong usage |
| 3 | of `tune`: the gains are not trusted; the reasons are in the output |

{commands}

## Logs of a plant of your own

`yawrate tune log.csv --tuner my.tuner` takes the tuner of [a plant](plants.md) as it takes a
vehicle's, with the same formats, exit statuses, `--report` and `--json`. What differs:

- **Columns** are called as the plant calls its signals and measured parameters, or `u` and
  `y`; others are named by `--input-column` and `--output-column`.
- **Units**: a column that says `[mV]`, or is called `voltage_mV`, or has it in a row of units
  or as an MDF channel's, is converted where the plant has `voltage [V]`, and a note says so;
  `--input-unit` and `--output-unit` say what a log doesn't. A unit that is not known, or that
  measures something else, is refused.
- **Signs and ratios**: `--output-scale -1` for a sensor that counts the other way, and
  `--input-scale 50` for what is measured behind a gear. Scales come after units; one that would
  convert a second time is refused.
- **Measured parameters** are a column's mean over the stretch that is used, converted
  likewise: of the column of the parameter's name, or of `--measured speed=wheel_speed`. Or they
  are `--measured speed=20` in the plant's unit. What reads as a number is one: a column that is
  called so, or is meant by its place, is put in quotes, `--measured 'speed="3"'`.
- **Sampling**: other times than the plant's are resampled, the input held, the output along a
  cubic spline. Slower than a tenth of the crossover's period is refused, or than ten of the
  plant's samples where it has no crossover. An output that bends sharply where the input
  jumps, as that of a single lag does, needs samples nearer to the plant's own.
- **Stretch**: of a log longer than two experiments the best-excited part, for plants with
  `linear=True`. Others start from rest, and are used from the first sample on.
- **`--start auto`** means `rest` where responses do not add up.

Nothing is known of what the quantities may be: only what stands still is refused, and the
checks of trust have to find wrong units. A vehicle's flags are refused by name.
"""


def environment_page() -> str:
    summary, sections = inspect.cleandoc(PITuningEnv.__doc__ or "").split("\n\n", 1)
    env = gymnasium.make(ENV_ID)
    return PAGE.format(
        summary=summary,
        action_space=box(env.action_space),
        observation_space=box(env.observation_space),
        id=ENV_ID,
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


PAGES = {"environment.md": environment_page, "cli.md": cli_page}


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
