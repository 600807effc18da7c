"""Log files as people have them: sixty with a known answer, and thousands with random damage.

python scripts/log_files.py files               # what becomes of each of the sixty
python scripts/log_files.py hunt --count 5000   # counts by outcome; forbidden ones by seed
"""

import json
import os
import tempfile
from pathlib import Path

import click
from click.testing import CliRunner

from studies import mutations
from studies.log_files import LogFile, log_files
from tuners.cli import main as yawrate
from tuners.cli.progress import Bars

CLOSE = 0.02  # of the gains


@click.group()
def main() -> None:
    """Try log files."""


@main.command()
@click.option("--folder", type=click.Path(path_type=Path), help="Keep the files here.")
def files(folder: Path | None) -> None:
    """Tune from sixty files whose right answer is known."""
    with tempfile.TemporaryDirectory() as place:
        os.chdir(folder or place)
        found = [(file, *judged(file)) for file in log_files()]
    for file, right, words in found:
        click.echo(f"{'right' if right else 'WRONG':6}{file.name:26}{words}")
    click.echo(f"{sum(right for _, right, _ in found)} of {len(found)} are right.")


def judged(file: LogFile) -> tuple[bool, str]:
    """Whether the command answers as it should, and what it says."""
    file.write(Path(file.name))
    done = CliRunner().invoke(yawrate, ["tune", file.name, "--json", *file.flags])
    if file.refusal:
        one = done.stderr.count("\n") == 1 and done.exit_code in (1, 2)
        return one and file.refusal in done.stderr, done.stderr.strip()
    if done.exit_code != 0:
        return False, done.stderr.strip() or done.output[:200]
    gains = json.loads(done.stdout)["gains"]
    errors = [gains[name] / right - 1 for name, right in RIGHT.items()]
    return max(map(abs, errors)) < CLOSE, ", ".join(f"{error:+.2%}" for error in errors)


RIGHT = {"kp": 0.15051, "Ti": 0.10417}
"""Gains for ``examples/log.csv``."""


@main.command()
@click.option("--count", type=int, default=5000, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
def hunt(count: int, seed: int) -> None:
    """Damage valid files of every format."""
    cases = []
    with Bars() as bars:
        for case in mutations.hunt(count, seed, lambda done: bars("hunting", done, count)):
            cases.append(case)
            if case.outcome in mutations.FORBIDDEN:
                click.echo(f"{case.outcome}: {case.source}, seed {case.seed}: {case.damage}; "
                           f"{case.words[:200]}")  # fmt: skip
    click.echo(mutations.to_markdown(cases))


if __name__ == "__main__":
    main()
