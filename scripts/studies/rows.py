"""Errors of tuners beside the bound on the same episodes: a row each of a table."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.metrics import bootstrap_interval, ratio_of_rms, rms
from studies.table import short
from tuners.tuner.evaluation import Policy, evaluate
from yawrate_env.vehicle.contexts import CONTEXT_SETS, ContextSet
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Row = dict[str, Any]

QUANTITIES = ("phase_margin", "crossover")
BATCH = 256


def errors(
    policy: Policy, task: Task, episodes: int, seed: int, contexts: ContextSet | None = None
) -> Array:
    """Phase margin [deg] and crossover [Hz] off the target, (E, 2); ``nan`` where unstable."""
    (found,) = evaluate(
        {"": policy},
        task,
        contexts or CONTEXT_SETS["test"],
        episodes=episodes,
        seed=seed,
        batch=BATCH,
    )
    off = [getattr(found, name) - getattr(task.target, name) for name in QUANTITIES]
    return np.where(found.stable[:, None], np.stack(off, axis=1), np.nan)


def row(name: str, off: Array, bound: Array, **about: Any) -> Row:
    """Root mean squares of errors or spreads (E, 2), and their ratios to the bound's (E, 2).

    With 95 % bootstrap intervals over the episodes.  Episodes without a margin are counted
    and left out.
    """
    kept = np.isfinite(off).all(axis=1)
    result: Row = {"name": name, **about, "episodes": len(off), "unstable": int((~kept).sum())}
    for k, quantity in enumerate(QUANTITIES):
        pairs = np.stack([off[kept, k], bound[kept, k]], axis=1)
        result[quantity] = {
            "rms": float(rms(pairs[:, 0])),
            "rms_interval": list(bootstrap_interval(pairs[:, 0], rms)),
            "ratio": float(ratio_of_rms(pairs)),
            "ratio_interval": list(bootstrap_interval(pairs, ratio_of_rms)),
        }
    return result


HEAD = (
    "phase margin rms [°] | crossover rms [Hz] "
    "| ratio to the bound: phase margin (95 %) | crossover (95 %) | unstable |"
)


def cells(r: Row) -> str:
    """Those of `HEAD`."""
    texts = [short(r[quantity]["rms"]) for quantity in QUANTITIES]
    for quantity in QUANTITIES:
        low, high = (short(v) for v in r[quantity]["ratio_interval"])
        texts.append(f"{short(r[quantity]['ratio'])} ({low} to {high})")
    return " | ".join([*texts, str(r["unstable"])]) + " |"
