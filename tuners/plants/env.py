"""``yawrate/Plant-v0``: any described plant as a one-step Gymnasium environment."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from numpy.typing import NDArray

from tuners.plants.data import Draw, sample, words_of
from tuners.plants.entry import find
from tuners.plants.plant import Plant
from yawrate_env import validation

Observation = NDArray[np.float32]

_LARGEST = 1e30  # finite, as agents want it, and beyond any unit
_PLANTS = 256
_SPARE = 0.25  # of the range that the prior's plants need, on either side


class PlantEnv(gymnasium.Env[Observation, NDArray[np.float64]]):
    """See one recorded experiment on an unknown plant; answer with its controller's gains.

    | space | shape | content |
    |---|---|---|
    | observation | (2 + m, N) float32 | input, measured output; m parameters measured, constant |
    | action | (k,) float64 | gains; the range that the prior's plants need, and a quarter more |

    The reward is -e/(1 + e/4) with e the distance of the plant's figures from what the
    design rule reaches, in the errors that count as one; -4 where a figure is undefined,
    -5 where the loop is unstable.  An episode is one step.  The info after it has the
    gains, ``clipped``, ``stable``, the figures, ``oracle_NAME`` of every gain and the
    parameters; that of ``reset`` is empty.

    Parameters
    ----------
    plant : str or Plant
        ``"module:attribute"``; a Plant itself works too, but not with ``EnvSpec.to_json``.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, plant: str | Plant) -> None:
        self.plant = find(plant)
        shape = (2 + len(self.plant.shown_names), len(self.plant.u))
        self.observation_space: Any = Box(-_LARGEST, _LARGEST, shape, dtype=np.float32)
        self.action_space: Any = action_space(self.plant)
        self._theta: NDArray[np.float64] | None = None
        self._obs: Observation | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw a plant and record the experiment; `options` pin parameters by name."""
        super().reset(seed=seed)
        words = self.np_random.bit_generator.random_raw(words_of(self.plant))[None]
        draw = Draw.of(self.plant, words)
        names = tuple(self.plant.prior)
        for name, value in (options or {}).items():
            validation.one_of("options' parameter", name, names)
            draw.theta[0, names.index(name)] = validation.number(name, value)
        y = self.plant.measure(draw.theta, draw.u, draw.keys, self.np_random)
        self._theta, self._obs = draw.theta, observation(self.plant, draw.u, y, draw.theta)[0]
        return self._obs.copy(), {}

    def step(
        self, action: NDArray[np.float64]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Judge the gains."""
        if self._theta is None or self._obs is None:
            raise ResetNeeded("An episode has one step. Call reset() before the next step().")
        plant, theta = self.plant, self._theta
        given = validation.finite_array("action", action, shape=(len(plant.gains),))
        gains = np.clip(given, self.action_space.low, self.action_space.high)[None]
        figures, oracle = plant.judged(theta, gains)[0], plant.oracle(theta)[0]
        info = {
            **dict(zip(plant.gains, gains[0].tolist(), strict=True)),
            "clipped": bool((gains[0] != given).any()),
            "stable": not bool(np.isnan(figures).any()),
            **dict(zip(plant.figures, figures.tolist(), strict=True)),
            **{f"oracle_{n}": g for n, g in zip(plant.gains, oracle.tolist(), strict=True)},
            **dict(zip(plant.prior, theta[0].tolist(), strict=True)),
        }
        self._theta = None
        return self._obs.copy(), float(plant.reward(theta, gains)[0]), True, False, info


def observation(
    plant: Plant, u: NDArray[np.float64], y: NDArray[np.float64], theta: NDArray[np.float64]
) -> Observation:
    """(B, 2 + m, N) of recordings (1 or B, N), (B, N) and parameters (B, p)."""
    names = tuple(plant.prior)
    beside = [theta[:, names.index(name)] for name in plant.shown_names]
    rows = [np.broadcast_to(u, y.shape), y]
    rows += [np.broadcast_to(value[:, None], y.shape) for value in beside]
    return np.stack(rows, axis=1).astype(np.float32)


def action_space(plant: Plant) -> Box:
    """Gains between a quarter below and a quarter above what plants of the prior need.

    The quarter is one of the range, in logarithms where all gains are positive.
    """
    gains = plant.oracle(sample(plant, _PLANTS))
    gains = gains[np.isfinite(gains).all(axis=1)]
    positive = (gains > 0).all(axis=0)
    scaled = np.where(positive, np.log(np.where(positive, gains, 1.0)), gains)
    low, high = scaled.min(axis=0), scaled.max(axis=0)
    # Plants that all need the same gain leave no range to take a part of.
    spare = np.maximum(_SPARE * (high - low), 1e-3 + 1e-3 * np.abs(low))
    ends = [np.where(positive, np.exp(end), end) for end in (low - spare, high + spare)]
    return Box(ends[0], ends[1], dtype=np.float64)
