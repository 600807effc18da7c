"""The one-step environment of any plant: ``yawrate/Plant-v0``."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

from yawrate_env import validation
from yawrate_env.env.interface import Array, Interface, Observation, copied
from yawrate_env.plant.entry import find
from yawrate_env.plant.plant import Plant


class TuningEnv(gymnasium.Env[Observation, Array]):
    """Choose a controller's gains from one recorded experiment on an unknown plant.

    | space | shape | content |
    |---|---|---|
    | observation | (2 + m, N) float32 | input, measured output; m measured parameters, constant |
    | action | (k,) float64 | gains: those that the prior's plants need, and a quarter more |

    Of several channels all inputs come first, then all outputs.

    The reward is -e/(1 + e/4) with e the distance of the loop's metrics from what the design
    rule reaches, in the errors that count as one; -4 where a metric is undefined, -5 where
    the loop is unstable.  An episode is one step.  The info after it has the gains,
    ``clipped``, the metrics by their names without units, ``stable``, ``cost``, ``oracle_NAME`` of
    every gain and the parameters; that of ``reset`` is empty.  ``cost`` is 1.0 where the loop is
    unstable or its ``phase_margin``, if that is a metric, below 45 deg, else 0.0.
    ``reset(options={name: value})`` pins parameters, and ``{"width": 0.5}`` draws from the middle
    half of every distribution.

    Parameters
    ----------
    interface : Interface
        Between the plant and the agent.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, interface: Interface) -> None:
        self.interface = interface
        self.observation_space: Any = interface.observation_space
        self.action_space: Any = interface.action_space
        self._theta: Array | None = None
        self._obs: Observation | None = None
        self._gains: Array | None = None

    @property
    def plant(self) -> Plant:
        """The family of plants that episodes are drawn from."""
        return self.interface.plant

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw a plant and record its episode."""
        pins = self.interface.pins(copied(options), 1)
        super().reset(seed=seed)
        integers = self.np_random.bit_generator.random_raw(self.interface.integers)[None]
        obs = np.empty((1, *self.observation_space.shape), dtype=np.float32)
        self._theta = self.interface.begin(integers, pins, self.np_random, obs)
        self._obs, self._gains = obs[0], None
        return self._obs.copy(), {}

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Close the loop with these gains and evaluate it."""
        if self._theta is None or self._obs is None or self._gains is not None:
            raise ResetNeeded("An episode has one step. Call reset() before the next step().")
        names = self.plant.gains
        given = validation.finite_array("action", action, shape=(len(names),))
        reward, info = self.interface.outcome(self._theta, given[None])
        self._gains = np.concatenate([info[name] for name in names])
        # Flags as Python's: Gymnasium's batches make object arrays of NumPy's.
        scalars = {n: v[0].item() if v.dtype == np.bool_ else v[0] for n, v in info.items()}
        return self._obs.copy(), float(reward[0]), True, False, scalars


def plant_env(plant: str | Plant) -> TuningEnv:
    """Entry point of ``yawrate/Plant-v0``.

    Parameters
    ----------
    plant : str or Plant
        ``"module:attribute"``; a Plant itself works too, but not with ``EnvSpec.to_json``.
    """
    return TuningEnv(Interface.of(find(plant)))
