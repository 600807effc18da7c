"""A wheel in an empty environment: how large that is, and how long the first answer takes."""

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from studies.markdown import table

_MEGA = 1e6
_REPEATS = 5


@dataclass(frozen=True, slots=True)
class Trial:
    """What was found in one environment.

    Attributes
    ----------
    python : str
        Version of the interpreter.
    distributions : int
        How many are installed, the wheel's own among them.
    size, own : float
        Of all files installed, and of the wheel's own [MB].
    first, next, numpy : float
        The example's answer, compiled and again, and ``import numpy`` [s], from the shell;
        the last two are the least of five.
    """

    python: str
    distributions: int
    size: float
    own: float
    first: float
    next: float
    numpy: float


def run(words: Sequence[str | os.PathLike[str]], folder: Path | None = None) -> str:
    """Run a command without this process's Python paths; its output.

    Raises
    ------
    ValueError
        If it fails, with the end of what it said.
    """
    hidden = {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [str(word) for word in words],
        cwd=folder,
        env={name: value for name, value in os.environ.items() if name not in hidden},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        said = " ".join((done.stderr or done.stdout).split())
        raise ValueError(f"{shlex.join(map(str, words))} failed: {said[-600:]}")
    return done.stdout


def uv(*words: str | os.PathLike[str]) -> str:
    """Run uv, which builds, resolves and installs."""
    return run([sys.executable, "-m", "uv", *words])


def resolve(project: Path, extra: str, python: str) -> int:
    """How many distributions an extra brings on a version of Python, from wheels alone.

    No interpreter of that version is needed.  ``ValueError`` if the extra does not resolve.
    """
    pins = uv(
        *("pip", "compile", "--quiet", "--no-header", "--no-annotate", "--only-binary", ":all:"),
        *("--python-version", python, "--extra", extra, project / "pyproject.toml"),
    )
    return len(pins.split("\n")) - 1


def tried(wheel: Path, python: str, commands: Sequence[str], examples: Path) -> Trial | None:
    """Install ``wheel[tune]`` into an empty environment and run the commands there.

    None where there is no such interpreter on this machine.
    """
    with tempfile.TemporaryDirectory() as scratch:
        environment, work = Path(scratch, "env"), Path(scratch, "work")
        shutil.copytree(examples, work / examples.name)
        try:
            uv("venv", "--quiet", "--no-python-downloads", "--python", python, environment)
        except ValueError:
            return None
        programs = environment / ("Scripts" if os.name == "nt" else "bin")
        uv("pip", "install", "--quiet", "--python", environment, f"{wheel}[tune]")
        size, own, count = _sizes(environment)
        answer = [str(programs / "yawrate"), "tune", str(Path(examples.name, "log.csv"))]
        first = _seconds(answer, work)
        again = min(_seconds(answer, work) for _ in range(_REPEATS))
        numpy = [str(programs / "python"), "-c", "import numpy"]
        least = min(_seconds(numpy, work) for _ in range(_REPEATS))
        for command in commands:
            words = shlex.split(command)
            run([programs / words[0], *words[1:]], work)
        version = run(
            [programs / "python", "-c", "import platform as p; print(p.python_version())"]
        )
        return Trial(version.strip(), count, size, own, first, again, least)


def page(trials: Sequence[Trial]) -> str:
    """A table of environments."""
    heads = ("Python", "distributions", "installed [MB]", "of these `yawrate` [MB]",
             "first answer [s]", "later ones [s]", "`import numpy` [s]")  # fmt: skip
    return table(heads, [_cells(t) for t in trials])


def _cells(t: Trial) -> tuple[object, ...]:
    first = f"{t.first:.1f} ({t.first / t.numpy:.0f} ×)"
    later = f"{t.next:.2f} ({t.next / t.numpy:.1f} ×)"
    sizes = f"{t.size:.0f}", f"{t.own:.1f}"
    return t.python, t.distributions, *sizes, first, later, f"{t.numpy:.2f}"


def _seconds(words: Sequence[str | os.PathLike[str]], folder: Path) -> float:
    start = time.perf_counter()
    run(words, folder)
    return time.perf_counter() - start


def _sizes(environment: Path) -> tuple[float, float, int]:
    """Sizes [MB] of all files and of the wheel's, and how many distributions there are."""
    files = [path for path in environment.rglob("*") if path.is_file() and not path.is_symlink()]
    mine = ("tuners", "yawrate_env")
    own = sum(p.stat().st_size for p in files if set(p.parts) & set(mine))
    count = len(list(environment.rglob("*.dist-info")))
    return sum(p.stat().st_size for p in files) / _MEGA, own / _MEGA, count
