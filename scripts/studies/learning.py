"""Learning curves: what a two-stage tuner's error is after so many training vehicles.

The vehicles of every first stage are simulated once; the tuners of a curve train on the first m of
them.  Fresh noise on the same vehicles (``noise_draws``) is part of a recipe, and is given up
where there are vehicles enough: rows say how many were used.  A study that was cut off goes
on where it was.
"""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies import nested
from studies.bounds import bound_on, posterior_on
from studies.markdown import table
from studies.rows import HEADS, Row, cells, errors, row
from tuners import RECIPES, Tuner, load
from yawrate_env.files import write_text
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

TUNERS = ("ts-ff-lag", "ts-gbm-lag", "ts-ff", "ts-gbm")
VEHICLES = (100, 300, 1000, 3000, 10_000, 30_000, 100_000)
BOUND = "Cramér–Rao bound"


def learn(
    path: Path,
    vehicles: Sequence[int] = VEHICLES,
    episodes: int = 1500,
    seed: int = 0,
    progress: Progress | None = None,
) -> list[Row]:
    """Train every tuner on every number of vehicles, and test it.

    Parameters
    ----------
    path : Path
        JSON file that gets every row as soon as it is found, and whose rows are not
        computed again.
    episodes, seed : int
        Test episodes.
    """
    conditions = {"episodes": episodes, "seed": seed, "training_seed": nested.TRAINING_SEED}
    rows = _earlier(path, conditions)
    done = {(r["name"], r["vehicles"]) for r in rows}
    for found in _missing(done, vehicles, episodes, seed, progress):
        rows.append(found)
        write_text(path, json.dumps({"conditions": conditions, "rows": rows}, indent=1) + "\n")
    return rows


def _missing(
    done: set[tuple[str, int]],
    vehicles: Sequence[int],
    episodes: int,
    seed: int,
    progress: Progress | None,
) -> Iterator[Row]:
    """Rows whose (name, vehicles) are not yet `done`."""
    plant = yaw_rate(Task())
    bound = bound_on(plant, "test", seed, episodes)
    levels: dict[str, Callable[[], Array]] = {
        BOUND: lambda: bound,
        "posterior spread under the prior": lambda: posterior_on(plant, "test", seed, episodes),
        "gb": lambda: errors(load("gb"), plant, episodes, seed),
    }
    for name, spread in levels.items():
        if (name, 0) not in done:
            yield row(name, spread(), bound, vehicles=0, noise_draws=0, seconds=0.0)
    for features in dict.fromkeys(RECIPES[name].features for name in TUNERS):
        names = [name for name in TUNERS if RECIPES[name].features == features]
        runs = [(name, m) for m in sorted(vehicles) for name in names if (name, m) not in done]
        for name, m, tuner, seconds in _trained(plant, runs, progress):
            about = {"vehicles": m, "noise_draws": tuner.training["noise_draws"]}
            off = errors(tuner, plant, episodes, seed)
            yield row(name, off, bound, **about, seconds=seconds)


def _trained(
    plant: Plant, runs: Sequence[tuple[str, int]], progress: Progress | None
) -> Iterator[tuple[str, int, Tuner, float]]:
    """Tuners of the same features with their training time [s]; its vehicles are simulated once."""
    if not runs:
        return
    draws = {(name, m): nested.noise_draws(RECIPES[name], m) for name, m in runs}
    most = {m: max(d for (_, n), d in draws.items() if n == m) for _, m in runs}
    report = None if progress is None else lambda k, of: progress("simulating", k, of)
    parts = nested.simulate(plant, RECIPES[runs[0][0]].features, most, report)
    for (name, m), d in draws.items():
        start = time.perf_counter()
        tuner = nested.trained(RECIPES[name], plant, parts, m, d, _named(progress, name, m))
        yield name, m, tuner, time.perf_counter() - start


def _named(progress: Progress | None, name: str, vehicles: int) -> Progress | None:
    if progress is None:
        return None
    return lambda _, done, of: progress(f"{name}, {vehicles} vehicles", done, of)


def _earlier(path: Path, conditions: dict[str, Any]) -> list[Row]:
    if not path.exists():
        return []
    found = json.loads(path.read_text())
    if found["conditions"] != conditions:
        raise ValueError(
            f"{path} was made with {found['conditions']}, not {conditions}. "
            "Delete it, or write to another folder."
        )
    return list(found["rows"])


def to_markdown(rows: Sequence[Row]) -> str:
    """One table, a tuner after the other."""
    names = list(dict.fromkeys(r["name"] for r in rows))
    ordered = sorted(rows, key=lambda r: (names.index(r["name"]), r["vehicles"]))
    return table(("tuner", "vehicles × noise draws", *HEADS), map(_cells, ordered))


def _cells(r: Row) -> tuple[str, ...]:
    size = f"{r['vehicles']} × {r['noise_draws']}" if r["vehicles"] else ""
    return f"`{r['name']}`" if size or r["name"] == "gb" else r["name"], size, *cells(r)
