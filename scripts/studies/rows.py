"""Errors of tuners beside the bound on the same episodes: a row each of a table."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.markdown import short
from studies.metrics import bootstrap_interval, ratio_of_rms, rms
from tuners.tuner.evaluation import Policy, evaluate
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Row = dict[str, Any]

QUANTITIES = ("phase_margin", "crossover")
BATCH = 256

HEADS = (
    "phase margin rms [°]",
    "crossover rms [Hz]",
    "ratio to the bound: phase margin (95 %)",
    "crossover (95 %)",
    "unstable",
)


def errors(policy: Policy, plant: Plant, episodes: int, seed: int) -> Array:
    """Phase margin [deg] and crossover [Hz] off the target, (E, 2); ``nan`` where unstable."""
    (found,) = evaluate(
        {"": policy}, plant, "test", episodes=episodes, seed=seed, batch=BATCH
    )  # fmt: skip
    return np.where(found.stable[:, None], found.errors, np.nan)


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


def cells(r: Row) -> list[str]:
    """Those of `HEADS`."""
    texts = [short(r[quantity]["rms"]) for quantity in QUANTITIES]
    for quantity in QUANTITIES:
        low, high = (short(v) for v in r[quantity]["ratio_interval"])
        texts.append(f"{short(r[quantity]['ratio'])} ({low} to {high})")
    return [*texts, str(r["unstable"])]
