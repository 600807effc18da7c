"""What a plant was when something was made of it, for what must notice that it changed since.

A plant is code, which no file holds: its settings are compared by value, its functions by
what they answer to a trial.  Answers may differ by what another machine's rounding does,
which is why they are kept as numbers: a hash of them would change with their last digit.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.episodes import Draw, integers_of, sample
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]

_TRIALS = 3
_SEED = 21
_ROUNDING = 1e-6
_OF_ROWS = ("prior", "gains", "Ts", "measured")


def settings(plant: Plant) -> dict[str, Any]:
    """What can be compared by value, as plain JSON values."""
    return {
        "prior": [[name, *ends] for name, ends in plant.prior.items()],
        "gains": list(plant.gains),
        "Ts": plant.Ts,
        "measured": [[name, slack] for name, slack in plant.measured.items()],
        "metrics": [
            [name, *(float(plant.metric_setting(of)[i]) for of in Metric.__slots__)]
            for i, name in enumerate(plant.metrics)
        ],
        "target": plant.target and list(plant.target),
        "linear": plant.linear,
        "plausible": [x if np.isfinite(x) else None for x in plant.plausible],
        "crossover": plant.crossover,
        "search_limits": [[name, *ends] for name, ends in plant.search_limits.items()],
    }


def trial(plant: Plant) -> dict[str, Array]:
    """What can only be compared by what it answers: to plants that are always the same."""
    theta = sample(plant, _TRIALS)
    return {
        "u": plant.u,
        "simulate": plant.respond(theta),
        "noise": plant.sigma(plant.respond(theta)),
        "design": plant.oracle(theta),
        "coordinates": plant.parametrisation.encode(plant.oracle(theta)),
        "evaluate": plant.metric_values(theta, plant.oracle(plant.middle).repeat(_TRIALS, axis=0)),
        "recordings": _recordings(plant),
    }


def changed(plant: Plant, then: dict[str, Any], answers: dict[str, Array]) -> str:
    """The first of `settings` and `trial` that is other than then; empty if none is.

    What comes after the first may be its consequence.
    """
    other = [name for name, value in settings(plant).items() if then.get(name) != value]
    if not other:
        now = trial(plant)
        other = [name for name in now if not _same(answers[name], now[name])]
    return other[0] if other else ""


@lru_cache(maxsize=8)
def of_episodes(plant: Plant) -> dict[str, Any]:
    """All that rows of a data set follow from, as few plain JSON values; compare by `alike`.

    What only judges gains is left out: no row holds a figure.
    """
    asked = trial(plant)
    return {
        **{name: value for name, value in settings(plant).items() if name in _OF_ROWS},
        "answers": {name: _sums(asked[name]) for name in asked if name != "evaluate"},
    }


def alike(then: Any, now: Any) -> bool:
    """Whether two of the answers of `of_episodes` differ by rounding at most."""
    a, b = (np.array(rows, dtype=np.float64) for rows in (then, now))
    return a.shape == b.shape and bool((np.abs(a - b) <= _ROUNDING * a[:, -1:]).all())


def _recordings(plant: Plant) -> Array:
    """What episodes show of noise, inputs and the simulator's own randomness."""
    draw = Draw.of(plant, stream(_SEED, 0, _TRIALS, integers_of(plant)))
    return plant.measure(draw.theta, draw.u, draw.keys, np.random.default_rng(_SEED))


def _sums(values: Array) -> list[list[float]]:
    """Two weighted sums of every row, and its norm: hardly a change of it leaves all three alone.

    Where some are not finite, rows that say where come after those with zeros instead.
    """
    rows = np.atleast_2d(values)
    finite = np.isfinite(rows)
    if not finite.all():
        rows = np.concatenate([np.where(finite, rows, 0.0), ~finite])
    weights = np.cos(np.outer(np.arange(rows.shape[1]), [1, 2]))
    norm = np.sqrt((rows**2).sum(axis=1, keepdims=True))
    sums: list[list[float]] = np.concatenate([rows @ weights, norm], axis=1).tolist()
    return sums


def _same(then: Array, now: Array) -> bool:
    """Equal but for what another machine's rounding may do."""
    if then.shape != now.shape:
        return False
    largest = np.abs(then[np.isfinite(then)]).max(initial=0.0)
    return np.allclose(then, now, rtol=1e-6, atol=1e-9 * largest, equal_nan=True)
