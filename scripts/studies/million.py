"""A million episodes: the worst that happens, in bounded memory, and not lost when killed.

Of every tuner the tally holds counts, extremes and a histogram of absolute errors whose
bins grow by half a percent, which is what its quantiles are exact to.  It is written after
every chunk, completely or not at all, and a later call goes on from there.
"""

import json
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.rows import QUANTITIES
from studies.table import short
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env import validation
from yawrate_env.files import write_text
from yawrate_env.loop.loops import Evaluation
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops, record
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Tally = dict[str, Any]
Progress = Callable[[str, int, int], None]

SEED = 1_000_000
"""Of the ``test`` set: episodes that no training, calibration or other result has seen."""

CHUNK = 2048
_BATCH = 256
_LEAST, _GROWTH = 1e-9, 1.005
QUANTILES = (0.5, 0.9, 0.99, 0.999, 0.9999, 0.99999)


def run(
    tuners: Mapping[str, Tuner],
    episodes: int,
    path: Path,
    seed: int = SEED,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Give the tuners `episodes` of the ``test`` set, those that `path` has not yet had.

    Returns
    -------
    dict
        What the file holds: ``conditions``, ``done`` and a tally for each tuner.
    """
    validation.count("episodes", episodes)
    task = Task()
    state = _earlier(path, {name: _fingerprint(tuner) for name, tuner in tuners.items()}, seed)
    while state["done"] < episodes:
        first = state["done"]
        stop = min(first + CHUNK, episodes)
        for start in range(first, stop, _BATCH):
            _batch(tuners, task, seed, start, min(_BATCH, stop - start), state["tuners"])
        state["done"] = stop
        write_text(path, json.dumps(state) + "\n")
        if progress is not None:
            progress("episodes", stop, episodes)
    return state


def _batch(
    tuners: Mapping[str, Tuner],
    task: Task,
    seed: int,
    first: int,
    count: int,
    tallies: dict[str, Tally],
) -> None:
    draw = CONTEXT_SETS["test"].draw(task.prior, seed, first, count)
    u, y = record(task, draw)
    recording = Recording(u, np.asarray(y), task.experiment.Ts, draw.context.v_x)
    judge = loops(task, draw.context)
    for name, tuner in tuners.items():
        verdict = judge.evaluate(*tuner.act(recording).T)
        _count(tallies[name], verdict, task, draw.context, first)


def _count(tally: Tally, verdict: Evaluation, task: Task, context: Context, first: int) -> None:
    """Add a batch whose first episode is number `first`."""
    tally["unstable"] += int((~verdict.stable).sum())
    for name in QUANTITIES:
        values, entry = getattr(verdict.margins, name), tally[name]
        kept = np.flatnonzero(verdict.stable & np.isfinite(values))
        entry["undefined"] += int(verdict.stable.sum()) - len(kept)
        if not len(kept):
            continue
        off = np.abs(values[kept] - getattr(task.target, name))
        entry["squares"] += float((off**2).sum())
        bins = np.log(np.maximum(off, _LEAST) / _LEAST) / np.log(_GROWTH)
        for k, n in zip(*np.unique(bins.astype(int), return_counts=True), strict=True):
            entry["histogram"][str(k)] = entry["histogram"].get(str(k), 0) + int(n)
        for end, at in (("lowest", values[kept].argmin()), ("highest", values[kept].argmax())):
            i, sign = kept[at], 1 if end == "highest" else -1
            if not entry[end] or sign * values[i] > sign * entry[end]["value"]:
                entry[end] = {
                    "value": float(values[i]),
                    "episode": int(first + i),
                    "mu_s": float(context.mu_s[i]),
                    "M_delta": float(context.M_delta[i]),
                }


def _fresh() -> Tally:
    def entry() -> Tally:
        return {"undefined": 0, "squares": 0.0, "histogram": {}, "lowest": {}, "highest": {}}

    return {"unstable": 0, **{name: entry() for name in QUANTITIES}}


def _fingerprint(tuner: Tuner) -> int:
    """Changes with the tuner's numbers."""
    return zlib.crc32(b"".join(np.ascontiguousarray(a).tobytes() for a in tuner.arrays().values()))


def _earlier(path: Path, fingerprints: dict[str, int], seed: int) -> dict[str, Any]:
    conditions = {"context": "test", "seed": seed, "tuners": fingerprints}
    if not path.exists():
        return {"conditions": conditions, "done": 0, "tuners": {n: _fresh() for n in fingerprints}}
    state: dict[str, Any] = json.loads(path.read_text())
    if state["conditions"] != conditions:
        raise ValueError(
            f"{path} counts other tuners or another seed: {state['conditions']} instead of "
            f"{conditions}. Delete it, or write to another folder."
        )
    return state


def quantile(entry: Tally, level: float) -> float:
    """Of the absolute error: the upper edge of the bin that it falls into."""
    bins = sorted((int(k), n) for k, n in entry["histogram"].items())
    counts = np.cumsum([n for _, n in bins])
    k = bins[int(np.searchsorted(counts, level * counts[-1]))][0]
    return float(_LEAST * _GROWTH ** (k + 1))


def to_markdown(state: dict[str, Any]) -> str:
    """Worst cases and quantiles, a line a tuner and quantity."""
    levels = " | ".join(f"{100 * level:g} %" for level in QUANTILES)
    lines = [
        f"{state['done']} episodes of the `test` set, seed {state['conditions']['seed']}, "
        "none left out. Unstable loops: "
        + ", ".join(f"`{name}` {t['unstable']}" for name, t in state["tuners"].items())
        + ". Columns in % are quantiles of the absolute error.",
        "",
        f"| tuner | quantity | lowest | highest | rms error | {levels} | undefined |",
        "|---|---|---|---|---|" + "---|" * (len(QUANTILES) + 1),
    ]
    for name, tally in state["tuners"].items():
        for quantity, unit in zip(QUANTITIES, ("°", "Hz"), strict=True):
            entry = tally[quantity]
            number = sum(entry["histogram"].values())
            if not number:
                continue
            ends = [_extreme(entry[end]) for end in ("lowest", "highest")]
            spread = short((entry["squares"] / number) ** 0.5)
            found = [short(quantile(entry, level)) for level in QUANTILES]
            texts = [f"`{name}`", f"{quantity.replace('_', ' ')} [{unit}]", *ends, spread, *found]
            lines.append("| " + " | ".join([*texts, str(entry["undefined"])]) + " |")
    return "\n".join(lines) + "\n"


def _extreme(found: Tally) -> str:
    vehicle = f"μs {found['mu_s']:.3f}, Mδ {found['M_delta']:.0f} kg"
    return f"{found['value']:.4f} ({vehicle}, episode {found['episode']})"
