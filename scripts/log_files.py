"""Log files as people have them: sixty with a known answer, and thousands with random damage.

python scripts/log_files.py files               # what becomes of each of the sixty
python scripts/log_files.py hunt                # 5,000, to results/log_files.*
python scripts/log_files.py hunt --count 1000   # and --first 1000 goes on where that has stopped
"""

import json
import os
import tempfile
from functools import partial
from pathlib import Path

import click
from click.testing import CliRunner

from studies import mutations, mutations_page
from studies.log_files import LogFile, log_files
from studies.program import FOLDER
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
@click.option("--first", type=int, default=0, show_default=True, help="Go on from this one.")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder, made if absent.")
def hunt(count: int, first: int, seed: int, results: Path) -> None:
    """Damage valid files of every format."""
    stored = results / "log_files.json"
    before = json.loads(stored.read_text()) if first else None
    if before and before["conditions"] != {"count": first, "seed": seed}:
        raise click.ClickException(f"--first {first}: {stored} has {before['conditions']}.")
    cases = []
    with Bars() as bars:
        progress = partial(bars, "hunting", of=count)
        for case in mutations.hunt(count, seed, progress, first):
            cases.append(case)
            if case.outcome in mutations.FORBIDDEN:
                click.echo(f"{case.outcome}: {case.source}, seed {case.seed}: {case.damage}; "
                           f"{case.words[:200]}")  # fmt: skip
    found = mutations_page.counted(cases, seed)
    results.mkdir(parents=True, exist_ok=True)
    mutations_page.write(mutations_page.merged(before, found) if before else found, results)
    click.echo((results / "log_files.md").read_text())


if __name__ == "__main__":
    main()
