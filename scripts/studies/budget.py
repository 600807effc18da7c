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

import numpy as np
from numpy.typing import NDArray

from studies import information, nested
from studies.rows import HEAD, Row, cells, errors, row
from tuners.catalogue import RECIPES
from tuners.features import FirstStage
from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.trust.vehicle_bound import (
    cramer_rao,
    inverse,
    margin_sensitivity,
    posterior_spread,
    spread,
)
from tuners.tuner.gray_box import GrayBox
from tuners.tuner.stages import Recipe
from yawrate_env.batch import take
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import Draw
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

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
    task = Task()
    draw = CONTEXT_SETS["test"].draw(task.prior, seed, 0, sizes.episodes)
    bound = cramer_rao(task, draw)
    gray_box = errors(GrayBox(task), task, sizes.episodes, seed)
    rows = [
        _row("", "Cramér–Rao bound", bound, bound),
        _row("", "posterior spread under the prior", posterior_spread(task, draw), bound),
        _row("", "`gb`", gray_box, bound),
    ]
    for compressor in dict.fromkeys(RECIPES[name].compressor for name in TUNERS):
        names = [name for name in TUNERS if RECIPES[name].compressor == compressor]
        shared = list(_information(task, draw, compressor, progress))
        learned = list(_learned(task, names, sizes, seed, progress))
        for name in names:
            for step, off in [*shared, *((s, off) for own, s, off in learned if own in ("", name))]:
                rows.append(_row(name, step, off, bound))
    return rows


def _row(tuner: str, step: str, off: Array, bound: Array) -> Row:
    return row(step, off, bound, tuner=tuner)


def _information(
    task: Task, draw: Draw, compressor: FirstStage, progress: Progress | None
) -> Iterator[tuple[str, Array]]:
    """Steps 2 and 3 with their spreads (E, 2)."""
    J = margin_sensitivity(task, draw.context)
    for step, kept in _kept(task, compressor).items():
        found = []
        for first in range(0, len(draw), _BLOCK):
            found.append(kept(take(draw, slice(first, first + _BLOCK))))
            if progress is not None:
                progress(step, min(first + _BLOCK, len(draw)), len(draw))
        yield step, spread(J, inverse(np.concatenate(found)))


def _kept(task: Task, compressor: FirstStage) -> dict[str, Callable[[Draw], Array]]:
    """What a compressor does to a recording step by step: information left, (B, 2, 2)."""
    in_features = "information in the features"
    if isinstance(compressor, Laguerre):
        return {in_features: lambda draw: information.in_laguerre(task, draw, compressor)}
    if isinstance(compressor, Armax):
        block = round(compressor.Ts / task.experiment.Ts)
        return {
            f"information in averages over {block} samples": lambda draw: (
                information.after_averaging(task, draw, block)
            ),
            in_features: lambda draw: information.in_armax(task, draw, compressor),
        }
    raise ValueError(f"{compressor} has no account of its information yet; use ARMAX or Laguerre.")


def _learned(
    task: Task, names: Sequence[str], sizes: Sizes, seed: int, progress: Progress | None
) -> Iterator[tuple[str, str, Array]]:
    """Steps 4 to 7 of tuners with the same compressor: tuner ("" for all), step, errors."""
    most = max((RECIPES[name] for name in names), key=lambda recipe: recipe.noise_draws)
    draws = {m: nested.noise_draws(most, m) for m in (sizes.vehicles, sizes.many)}
    report = None if progress is None else lambda done, of: progress("simulating", done, of)
    parts = nested.simulate(task, most.compressor, draws, report)

    def tested(recipe: Recipe, vehicles: int) -> Array:
        tuner = nested.trained(recipe, task, parts, vehicles, draws[vehicles], progress)
        return errors(tuner, task, sizes.episodes, seed)

    best = f"the best network, {sizes.many} vehicles"
    yield "", best, tested(replace(most, learner=BEST), sizes.many)
    for name in names:
        recipe = RECIPES[name]
        yield name, f"its own learner, {sizes.many} vehicles", tested(recipe, sizes.many)
        yield name, f"… {sizes.vehicles} vehicles", tested(recipe, sizes.vehicles)
        gains = replace(recipe, coordinates="gains")
        yield name, "… and (kp, Ti) as targets", tested(gains, sizes.vehicles)


def to_markdown(rows: Sequence[Row]) -> str:
    """One table, a tuner after the other."""
    lines = [f"| tuner | step | {HEAD}", "|---|---|---|---|---|---|---|"]
    before = None
    for r in rows:
        tuner = f"**`{r['tuner']}`**" if r["tuner"] and r["tuner"] != before else ""
        lines.append(f"| {tuner} | {r['name']} | {cells(r)}")
        before = r["tuner"]
    return "\n".join(lines) + "\n"


def to_json(rows: Sequence[Row], sizes: Sizes, seed: int = 0) -> str:
    """Rows and the conditions they hold for."""
    conditions = {**asdict(sizes), "seed": seed, "context": "test"}
    return json.dumps({"conditions": conditions, "rows": list(rows)}, indent=1) + "\n"
