"""Contenders that take turns: how long each works for an episode, and their ratios.

All run in one process, round after round, so that a busy moment of the machine hits all
of them; what counts is the median of the ratios within a round.
"""

import os
import platform
import subprocess
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from yawrate_env.compiled import cores

PACKAGES: tuple[str, ...] = ("numpy", "numba", "scipy", "control", "gymnasium", "xgboost")
PACKAGES += ("torch", "pysib", "sippy_unipi")

Times = dict[str, dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Contender:
    """Something to measure.

    Attributes
    ----------
    work : callable
        Does it, and returns for how many episodes.
    rounds : int, optional
        How many rounds it takes part in, where all would take too long.
    """

    work: Callable[[], int]
    rounds: int | None = None


def race(
    contenders: Mapping[str, Contender], rounds: int, progress: Callable[[int, int], None]
) -> Times:
    """Let the contenders take turns; the first is compared with all.

    Returns
    -------
    dict
        For each contender ``milliseconds`` an episode and ``ratio``, its time over that of
        the first, both as median, least and most of the ``rounds``.
    """
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(rounds + 1):
        for name, contender in contenders.items():
            if turn > (contender.rounds or rounds):
                continue
            start = time.perf_counter()
            episodes = contender.work()
            if turn:  # the first round warms up
                seconds[name].append((time.perf_counter() - start) / episodes)
        progress(turn, rounds)
    first = seconds[next(iter(contenders))]
    return {
        name: {
            "milliseconds": spread(1e3 * np.array(found)),
            "ratio": spread(np.array(found) / first[: len(found)]),
            "rounds": len(found),
        }
        for name, found in seconds.items()
    }


def spread(values: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float]:
    """Median, least and most."""
    return dict(
        zip(("median", "least", "most"), map(float, np.quantile(values, [0.5, 0, 1])), strict=True)
    )


def machine() -> str:
    """Processor and cores."""
    return f"{processor()}, {cores()} cores"


def processor() -> str:
    """What kind of processor this machine has."""
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def commit() -> str:
    """The commit that is measured, and whether files differ from it; empty outside a clone."""
    words = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    with suppress(OSError, subprocess.CalledProcessError):
        return subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()
    return ""


def versions() -> dict[str, str]:
    """Python's and those of the packages that are measured, where they are installed."""
    found = {"Python": platform.python_version()}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
