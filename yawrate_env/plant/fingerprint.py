"""Detect whether a plant has changed since a tuner or a data set was made from it.

A plant is code, which no file holds.  Its settings are compared by value, its functions by
their answers in a trial that is always the same.  Each row of an answer is kept as three
numbers, which are compared to a tolerance: processors differ in their rounding, so that a
hash would change with the last digit.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.episodes import Draw, integers_of, sample
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]

_TRIALS = 3
_SEED = 21
_ROUNDING = 1e-6

OF_EPISODES = (
    "prior", "gains", "Ts", "measured", "u", "simulate", "noise", "design", "parametrisation",
    "recordings",
)  # fmt: skip
"""Parts that episodes, features and targets follow from; the others concern metrics and trust."""


@lru_cache(maxsize=8)
def fingerprint(plant: Plant) -> dict[str, Any]:
    """A plant's settings and answers by name, as plain JSON values."""
    return _settings(plant) | {name: _summary(values) for name, values in _answers(plant).items()}


def changed(plant: Plant, then: dict[str, Any], parts: tuple[str, ...] = ()) -> str:
    """Name of the first part that differs from `then`, empty if none does.

    Parameters
    ----------
    then : dict
        An earlier `fingerprint`.
    parts : tuple of str, optional
        Parts to compare, such as `OF_EPISODES`; all by default.
    """
    settings = _settings(plant)  # compared first: another prior may not even be simulated
    for name in settings:
        if name in (parts or settings) and then.get(name) != settings[name]:
            return name
    for name, now in fingerprint(plant).items():
        if name not in settings and name in (parts or then) and not _alike(then.get(name), now):
            return name
    return ""


def _settings(plant: Plant) -> dict[str, Any]:
    found = {"initial": list(plant.initial)} if plant.initial else {}
    return found | {
        "prior": [
            [name, *each, *([each.kind] if each.kind else [])]
            for name, each in zip(plant.prior, plant.shapes, strict=True)
        ],
        "gains": list(plant.gains),
        "Ts": plant.Ts,
        "measured": [[name, slack] for name, slack in plant.measured.items()],
        "metrics": [
            [name, *(_finite(getattr(metric, of)) for of in ("scale", "error", "spread", "widest"))]
            for name, metric in plant.settings.items()
        ],
        "target": None if plant.target is None else list(plant.target),
        "linear": plant.linear,
        "plausible": [_finite(value) for value in plant.plausible],
        "crossover": plant.crossover,
        "search_limits": [[name, *ends] for name, ends in plant.search_limits.items()],
    }


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return value if np.isfinite(value) else None


def _answers(plant: Plant) -> dict[str, Array]:
    """The functions' answers to plants that are always the same."""
    theta = sample(plant, _TRIALS)
    y, gains = plant.respond(theta), plant.oracle(theta)
    middle = plant.oracle(plant.middle).repeat(_TRIALS, axis=0)
    draw = Draw.of(plant, stream(_SEED, 0, _TRIALS, integers_of(plant)))
    return {
        "u": plant.u,
        "simulate": y,
        "noise": plant.sigma(y),
        "design": gains,
        "parametrisation": plant.parametrisation.encode(gains),
        "evaluate": plant.metric_values(theta, middle),
        "recordings": plant.measure(draw.theta, draw.u, draw.keys, np.random.default_rng(_SEED)),
    }


def _summary(values: Array) -> list[list[float]]:
    """Two weighted sums of every row, and its norm: hardly a change leaves all three alone.

    Where some values are not finite, rows that mark them follow those with zeros instead.
    """
    rows = values.reshape(len(values), -1) if values.ndim > 2 else np.atleast_2d(values)
    finite = np.isfinite(rows)
    if not finite.all():
        rows = np.concatenate([np.where(finite, rows, 0.0), ~finite])
    weights = np.cos(np.outer(np.arange(rows.shape[1]), [1, 2]))
    norm = np.sqrt((rows**2).sum(axis=1, keepdims=True))
    sums: list[list[float]] = np.concatenate([rows @ weights, norm], axis=1).tolist()
    return sums


def _alike(then: Any, now: Any) -> bool:
    """Whether two summaries differ by rounding at most."""
    try:
        a, b = (np.array(rows, dtype=np.float64) for rows in (then, now))
    except (TypeError, ValueError):
        return False
    return a.shape == b.shape and bool((np.abs(a - b) <= _ROUNDING * a[..., -1:]).all())
