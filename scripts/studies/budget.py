"""Where the error comes from: the bound, and what each stage of a tuner adds to it.

Down a tuner's column something is lost at every step, and nothing else changes:

1. the information in the whole recording, which is the Cramer-Rao bound;
2. what block averaging keeps of it (ARMAX alone averages);
3. what the features keep of it (`studies.information`);
4. the best network that we can train on these features, with as many vehicles as it takes;
5. the tuner's own learner, with as many;
6. the same with the usual number of vehicles;
7. the same with (kp, Ti) for targets.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies import information, nested
from studies.bounds import bound_on, posterior_on
from studies.draws import draw
from studies.markdown import table
from studies.rows import HEADS, Row, cells, errors, row
from tuners import RECIPES, Recipe, load
from tuners.features import Features, known_name
from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.trust.bound import metric_slopes, spread
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
Kept = Callable[[Array, Array], Array]

TUNERS = ("ts-ff-lag", "ts-gbm-lag", "ts-ff", "ts-gbm")
BEST = FeedForwardSettings(neurons=24, max_fail=10)
_BLOCK = 100


@dataclass(frozen=True, slots=True)
class Sizes:
    """How much of everything.

    Attributes
    ----------
    episodes : int
        Test episodes.
    vehicles : int
        That the tuners usually train on.
    many : int
        As many as it takes.
    """

    episodes: int = 1500
    vehicles: int = 1500
    many: int = 20_000


def budget(sizes: Sizes, seed: int = 0, progress: Progress | None = None) -> list[Row]:
    """Rows with ``tuner`` ("" for what holds for all), ``step`` and the errors."""
    plant = yaw_rate(Task())
    bound = bound_on(plant, "test", seed, sizes.episodes)
    rows = [
        row("Cramér–Rao bound", bound, bound, tuner=""),
        row(
            "posterior spread under the prior",
            posterior_on(plant, "test", seed, sizes.episodes), bound, tuner="",
        ),
        row("`gb`", errors(load("gb"), plant, sizes.episodes, seed), bound, tuner=""),
    ]  # fmt: skip
    for features in dict.fromkeys(RECIPES[name].features for name in TUNERS):
        names = [name for name in TUNERS if RECIPES[name].features == features]
        shared = list(_information(plant, features, sizes.episodes, seed, progress))
        learned = list(_learned(plant, names, sizes, seed, progress))
        for name in names:
            own = [(step, off) for of, step, off in learned if of in ("", name)]
            rows += [row(step, off, bound, tuner=name) for step, off in [*shared, *own]]
    return rows


def _information(
    plant: Plant, features: Features, episodes: int, seed: int, progress: Progress | None
) -> Iterator[tuple[str, Array]]:
    """Steps 2 and 3 with their spreads (E, 2)."""
    for step, kept in _kept(plant, features).items():
        found = []
        for first in range(0, episodes, _BLOCK):
            stop = min(first + _BLOCK, episodes)
            drawn = draw(plant, "test", seed, first, stop - first)
            covariance = np.asarray(np.linalg.inv(kept(drawn.theta, drawn.u)), dtype=np.float64)
            found.append(spread(metric_slopes(plant, drawn.theta), covariance))
            if progress is not None:
                progress(step, stop, episodes)
        yield step, np.concatenate(found)


def _kept(plant: Plant, features: Features) -> dict[str, Kept]:
    """Information (B, 2, 2) left of recordings step by step, for parameters and inputs."""
    account = _ACCOUNTS.get(known_name(features))
    if account is None:
        raise ValueError(f"{features} has no account of its information; use ARMAX or Laguerre.")
    return account(plant, features)


def _of_laguerre(plant: Plant, features: Laguerre) -> dict[str, Kept]:
    return {_LAST: lambda theta, u: information.in_laguerre(plant, theta, u, features)}


def _of_armax(plant: Plant, features: Armax) -> dict[str, Kept]:
    block = round(features.Ts / plant.Ts)
    return {
        f"information in averages over {block} samples": lambda theta, u: (
            information.after_averaging(plant, theta, u, block)
        ),
        _LAST: lambda theta, u: information.in_armax(plant, theta, u, features),
    }


_LAST = "information in the features"
_ACCOUNTS: dict[str, Callable[[Plant, Any], dict[str, Kept]]] = {
    "laguerre": _of_laguerre,
    "armax": _of_armax,
}


def _learned(
    plant: Plant, names: Sequence[str], sizes: Sizes, seed: int, progress: Progress | None
) -> Iterator[tuple[str, str, Array]]:
    """Steps 4 to 7 of tuners with the same features: tuner ("" for all), step, errors."""
    most = max((RECIPES[name] for name in names), key=lambda recipe: recipe.noise_draws)
    draws = {m: nested.noise_draws(most, m) for m in (sizes.vehicles, sizes.many)}
    report = None if progress is None else lambda done, of: progress("simulating", done, of)
    parts = nested.simulate(plant, most.features, draws, report)

    def tested(recipe: Recipe, vehicles: int) -> Array:
        tuner = nested.trained(recipe, plant, parts, vehicles, draws[vehicles], progress)
        return errors(tuner, plant, sizes.episodes, seed)

    best = f"the best network, {sizes.many} vehicles"
    yield "", best, tested(replace(most, learner=BEST), sizes.many)
    for name in names:
        recipe = RECIPES[name]
        yield name, f"its own learner, {sizes.many} vehicles", tested(recipe, sizes.many)
        yield name, f"… {sizes.vehicles} vehicles", tested(recipe, sizes.vehicles)
        gains = replace(recipe, parametrisation="gains")
        yield name, "… and (kp, Ti) as targets", tested(gains, sizes.vehicles)


def to_markdown(rows: Sequence[Row]) -> str:
    """One table, a tuner after the other; each is named once."""
    before = [None, *(r["tuner"] for r in rows)]
    names = (
        f"**`{r['tuner']}`**" if r["tuner"] and r["tuner"] != last else ""
        for r, last in zip(rows, before, strict=False)
    )
    return table(
        ("tuner", "step", *HEADS),
        [(name, r["name"], *cells(r)) for name, r in zip(names, rows, strict=True)],
    )


def to_json(rows: Sequence[Row], sizes: Sizes, seed: int = 0) -> str:
    """Rows and the conditions they hold for."""
    conditions = {**asdict(sizes), "seed": seed, "context": "test"}
    return json.dumps({"conditions": conditions, "rows": list(rows)}, indent=1) + "\n"
