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

from studies.draws import draw, recorded
from studies.markdown import short, table
from studies.rows import QUANTITIES
from tuners import Tuner
from yawrate_env import validation
from yawrate_env.files import write_text
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Tally = dict[str, Any]
Progress = Callable[[str, int, int], None]

SEED = 1_000_000
"""Of the ``test`` set: episodes that no training, calibration or other result has seen."""

CHUNK = 2048
_BATCH = 256
_LEAST, _GROWTH = 1e-9, 1.005
_SHOWN = {"mu_s": 0, "M_delta": 1}  # parameters of an extreme episode
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
    plant = yaw_rate(Task())
    state = _earlier(path, {name: _fingerprint(tuner) for name, tuner in tuners.items()}, seed)
    while state["done"] < episodes:
        first = state["done"]
        stop = min(first + CHUNK, episodes)
        for start in range(first, stop, _BATCH):
            _batch(tuners, plant, seed, start, min(_BATCH, stop - start), state["tuners"])
        state["done"] = stop
        write_text(path, json.dumps(state) + "\n")
        if progress is not None:
            progress("episodes", stop, episodes)
    return state


def _batch(
    tuners: Mapping[str, Tuner],
    plant: Plant,
    seed: int,
    first: int,
    count: int,
    tallies: dict[str, Tally],
) -> None:
    drawn = draw(plant, "test", seed, first, count)
    recording = recorded(plant, drawn)
    for name, tuner in tuners.items():
        _count(tallies[name], plant, drawn.theta, tuner.act(recording), first)


def _count(tally: Tally, plant: Plant, theta: Array, gains: Array, first: int) -> None:
    """Add a batch whose first episode is number `first`."""
    assert plant.target is not None
    metrics = plant.metric_values(theta, gains)
    stable = ~np.isnan(metrics).any(axis=1)
    tally["unstable"] += int((~stable).sum())
    for name, target, values in zip(QUANTITIES, plant.target, metrics.T, strict=True):
        kept, entry = np.flatnonzero(np.isfinite(values)), tally[name]
        entry["undefined"] += int(stable.sum()) - len(kept)
        if not len(kept):
            continue
        off = np.abs(values[kept] - target)
        entry["squares"] += float((off**2).sum())
        bins = np.log(np.maximum(off, _LEAST) / _LEAST) / np.log(_GROWTH)
        for k, n in zip(*np.unique(bins.astype(int), return_counts=True), strict=True):
            entry["histogram"][str(k)] = entry["histogram"].get(str(k), 0) + int(n)
        for end, at in (("lowest", values[kept].argmin()), ("highest", values[kept].argmax())):
            i, sign = kept[at], 1 if end == "highest" else -1
            if not entry[end] or sign * values[i] > sign * entry[end]["value"]:
                about = {n: float(theta[i, k]) for n, k in _SHOWN.items()}
                entry[end] = {"value": float(values[i]), "episode": int(first + i), **about}


def _fresh() -> Tally:
    def entry() -> Tally:
        return {"undefined": 0, "squares": 0.0, "histogram": {}, "lowest": {}, "highest": {}}

    return {"unstable": 0, **{name: entry() for name in QUANTITIES}}


def _fingerprint(tuner: Tuner) -> int:
    """Changes with the tuner's numbers."""
    return zlib.crc32(
        b"".join(np.ascontiguousarray(a).tobytes() for a in tuner.method.arrays().values())
    )


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
    unstable = ", ".join(f"`{name}` {t['unstable']}" for name, t in state["tuners"].items())
    levels = [f"{100 * level:g} %" for level in QUANTILES]
    rows = [
        (f"`{name}`", f"{quantity.replace('_', ' ')} [{unit}]", *_cells(tally[quantity]))
        for name, tally in state["tuners"].items()
        for quantity, unit in zip(QUANTITIES, ("°", "Hz"), strict=True)
        if tally[quantity]["histogram"]
    ]
    return (
        f"{state['done']} episodes of the `test` set, seed {state['conditions']['seed']}, "
        f"none left out. Unstable loops: {unstable}. "
        "Columns in % are quantiles of the absolute error.\n\n"
    ) + table(
        ("tuner", "quantity", "lowest", "highest", "rms error", *levels, "undefined"), rows
    )  # fmt: skip


def _cells(entry: Tally) -> list[object]:
    rms = (entry["squares"] / sum(entry["histogram"].values())) ** 0.5
    ends = [_extreme(entry[end]) for end in ("lowest", "highest")]
    found = [short(quantile(entry, level)) for level in QUANTILES]
    return [*ends, short(rms), *found, entry["undefined"]]


def _extreme(found: Tally) -> str:
    vehicle = f"μs {found['mu_s']:.3f}, Mδ {found['M_delta']:.0f} kg"
    return f"{found['value']:.4f} ({vehicle}, episode {found['episode']})"
