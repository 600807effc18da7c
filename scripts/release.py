"""Build a release and try it: everything but the upload.

python scripts/release.py --repository https://example.org/owner/yawrate
python scripts/release.py --python 3.13 --page docs/release.md

Builds wheel and sdist of the last commit into dist/ with the changelog's notes, and checks them
with twine and check-wheel-contents. Resolves every extra for every supported Python. Installs the
wheel into an empty environment of each Python that this machine has, and runs the README's
commands for engineers there.
"""

import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import click

import yawrate_env
from releases import source, trial
from studies import readme
from studies.markdown import table
from studies.program import FOLDER, program
from tuners.cli.progress import Bars
from yawrate_env.files import write_text

ROOT = Path(__file__).parents[1]
SUPPORTED = ("3.11", "3.12", "3.13", "3.14")
PAGES = ("README.md", "docs/start/engineer.md")
TABLE = "installed.md"


@program(__doc__)
@click.option("--repository", metavar="URL", help="Where the project's files are to be seen.")
@click.option(
    "--python", "pythons", multiple=True, default=SUPPORTED, metavar="VERSION",
    help="To install into, where this machine has it; may be repeated.",
)  # fmt: skip
@click.option("--out", type=FOLDER, default=Path("dist"), help="Folder for what is built.")
@click.option("--page", type=click.Path(path_type=Path), help="Page to update with what was found.")
def main(repository: str | None, pythons: tuple[str, ...], out: Path, page: Path | None) -> None:
    version = yawrate_env.__version__
    if unsaved := source.changed(ROOT):
        raise ValueError(f"{unsaved[0]} differs from the last commit. Commit or remove it.")
    text = source.notes((ROOT / "CHANGELOG.md").read_text("utf-8"), version)
    wheel = build(repository, version, out)
    write_text(out / "notes.md", text)
    click.echo(extras())
    commands = [c for name in PAGES for c in source.commands((ROOT / name).read_text("utf-8"))]
    found = {name: trial.tried(wheel, name, commands, ROOT / "examples") for name in pythons}
    done = trial.page([t for t in found.values() if t])
    write_text(out / TABLE, done)
    if page:
        readme.update(page, out / TABLE)
    click.echo(done)
    for name in (name for name, t in found.items() if t is None):
        click.echo(f"Python {name}: not on this machine, so not tried.")
    click.echo(
        f"{len(commands)} commands ran in each environment. In {out}: {wheel.name}, notes.md."
    )
    if repository is None:
        click.echo("Not for upload: without --repository there are no addresses to link to.")


def build(repository: str | None, version: str, out: Path) -> Path:
    """Build and check wheel and sdist from a copy of the last commit; the wheel's path."""
    shutil.rmtree(out, ignore_errors=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        source.export(ROOT, folder)
        if repository:
            source.place(folder, repository, f"v{version}")
        trial.uv("build", "--quiet", "--out-dir", out.resolve(), folder)
        wheel, sdist = next(out.glob("*.whl")), next(out.glob("*.tar.gz"))
        tools = [sys.executable, "-m"]
        trial.run([*tools, "twine", "check", "--strict", wheel, sdist])
        trial.run([*tools, "check_wheel_contents", wheel.resolve()], folder)
    if wheel.name != f"yawrate-{version}-py3-none-any.whl":
        raise ValueError(f"{wheel.name} is not of version {version}. Install the tree again.")
    return wheel


def extras() -> str:
    """A table of how many distributions each extra brings on each Python."""
    names = sorted(source.project(ROOT)["optional-dependencies"])
    rows = []
    with Bars() as bars, ThreadPoolExecutor(len(SUPPORTED)) as pool:
        for i, name in enumerate(names):
            rows.append((name, *pool.map(partial(trial.resolve, ROOT, name), SUPPORTED)))
            bars("extras resolved", i + 1, len(names))
    return table(("distributions of", *(f"Python {v}" for v in SUPPORTED)), rows)


if __name__ == "__main__":
    main()
