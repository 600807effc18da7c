"""Policies from elsewhere, evaluated as tuners are.

A policy gets the observations of a plant's environment in one batch, and its actions are applied
as the environment applies them, clipped to the action space.  It is not given the truth, unless
the environment shows it (``visible="context"``).

* `of_factory`: an object with Stable-Baselines3's ``predict``, made by ``module:factory``;
* `of_sb3`: a model that Stable-Baselines3 saved, trained in the environment itself or on its
  features and with its unit actions; the model's spaces tell which.
"""

import importlib
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from tuners.agents.wrappers import FeatureObservation, UnitAction, features_of
from tuners.features import BY_NAME
from tuners.tuner.recording import Recording
from yawrate_env import validation
from yawrate_env.env.tuning_env import TuningEnv

Array = NDArray[Any]

TRUSTED_ONLY = "Stable-Baselines3 files hold pickles, which can run code: load trusted files only."

# What only training needs: buffers, which for raw recordings would fill the memory, and
# schedules, which are pickled functions.
_NOT_LOADED = {
    "buffer_size": 1,
    "n_steps": 1,
    "learning_rate": 0.0,
    "lr_schedule": None,
    "clip_range": 0.2,
    "clip_range_vf": None,
    "tensorboard_log": None,
}


class Predictor(Protocol):
    """A policy, as Stable-Baselines3's own tools call one."""

    def predict(
        self, obs: Array, /, *, state: Any, episode_start: Array, deterministic: bool
    ) -> tuple[Any, Any]:
        """(B, k) of actions for a batch of B observations, and the state."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Player:
    """A policy that acts on recordings, as a tuner does.

    Attributes
    ----------
    name : str
        For messages.
    policy : Predictor
        Chooses actions.
    env : TuningEnv
        Its spaces and visible parameters count; it is never stepped.
    observe : callable
        Observations (B, rows, N) to those that the policy was trained on.
    gains : callable
        The policy's actions (B, k) to gains.
    """

    name: str
    policy: Predictor
    env: TuningEnv
    observe: Callable[[Array], Array] = np.asarray
    gains: Callable[[Array], Array] = np.asarray

    def act(self, recording: Recording) -> NDArray[np.float64]:
        """(B, k) gains within the environment's bounds."""
        count, space = len(recording), self.env.action_space
        answer = self.policy.predict(
            self.observe(observations(recording, self.env)),
            state=None,
            episode_start=np.ones(count, dtype=np.bool_),
            deterministic=True,
        )
        if not isinstance(answer, tuple) or len(answer) != 2:
            raise ValueError(
                f"{self.name}: predict gave {type(answer).__name__}. Return (actions, state)."
            )
        actions = answer[0]
        if count == 1 and np.shape(actions) == space.shape:
            actions = np.asarray(actions)[None]
        shape = (count, *space.shape)
        checked = validation.finite_array(f"{self.name}: actions", actions, shape=shape)
        return np.clip(self.gains(checked), space.low, space.high)


def observations(recording: Recording, env: TuningEnv) -> NDArray[np.float32]:
    """The environment's observations of recorded episodes, (B, rows, samples) float32."""
    known = recording.known
    theta = recording.parameters(env.plant) if known is None else known
    return env.interface.observe(recording.u, recording.y, theta)


def of_factory(spec: str, env: TuningEnv) -> Player:
    """Call ``package.module:factory`` and play the policy that it returns.

    Raises
    ------
    ValueError
        No such module or factory, or the policy cannot predict.
    """
    factory = _imported(spec)
    if not callable(factory):
        raise ValueError(f"{spec} is not callable. Name a function or class without arguments.")
    policy = factory()
    if not callable(getattr(policy, "predict", None)):
        raise ValueError(
            f"{spec} made a {type(policy).__name__}, which has no predict. Give it "
            "predict(obs, state=None, episode_start=None, deterministic=True)."
        )
    return Player(spec, policy, env)


def of_sb3(path: str, env: TuningEnv, algorithm: str) -> Player:
    """Load a model of Stable-Baselines3 and play it.

    Parameters
    ----------
    path : str
        Zip file; see `TRUSTED_ONLY`.
    env : TuningEnv
        With the keyword arguments that the model was trained with.
    algorithm : str
        Its class, ``module:Class``, such as ``stable_baselines3:SAC``.

    Raises
    ------
    ValueError
        Not such a file, or trained with other observations or actions than `env` has.
    """
    if not Path(path).is_file():
        raise ValueError(f"sb3 = {path}: there is no such file. Check the name; it ends in .zip.")
    kind = _imported(algorithm)
    try:
        model = kind.load(path, device="cpu", custom_objects=_NOT_LOADED)
    except Exception as error:  # pickles and foreign classes raise anything
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ValueError(
            f"sb3 = {path} cannot be loaded with {algorithm}: {reason}. Give the class that wrote "
            "it (--algo); a .tuner file goes with --tuner."
        ) from error
    observe = _observer(path, model.observation_space, env)
    return Player(path, model, env, observe, _actions(path, model.action_space, env))


def chosen(
    factories: Sequence[str], models: Sequence[str], algorithm: str | None, env: TuningEnv
) -> dict[str, Player]:
    """Players by name.

    Parameters
    ----------
    factories : list of str
        As for `of_factory`.
    models : list of str
        Stable-Baselines3's zip files.
    algorithm : str, optional
        Class of the models; needed for any.
    env : TuningEnv
        Whose observations they get.
    """
    players = {spec: of_factory(spec, env) for spec in factories}
    if models and algorithm is None:
        raise ValueError(
            "algo is missing: name the class of the --sb3 models, such as "
            "--algo stable_baselines3:SAC."
        )
    if models and algorithm is not None:
        print(TRUSTED_ONLY, file=sys.stderr)
        players |= {path: of_sb3(path, env, algorithm) for path in models}
    return players


def _imported(spec: str) -> Any:
    """The object ``package.module:name``; modules in the working folder are found too."""
    module, _, name = spec.partition(":")
    if not module or not name:
        raise ValueError(f"{spec!r} is not of the form package.module:name, such as my.agent:make.")
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ValueError(
            f"{spec}: {error}. Run from the folder that holds it, or install it."
        ) from None
    if not hasattr(found, name):
        raise ValueError(f"{spec}: the module {module} has no {name}. Check the name.")
    return getattr(found, name)


def _observer(path: str, space: Any, env: TuningEnv) -> Callable[[Array], Array]:
    """Observations to those of a model with this observation space."""
    if space.shape == env.observation_space.shape:
        return np.asarray
    if isinstance(space, Box) and len(space.shape) == 1:
        for name in BY_NAME:
            with suppress(ValueError):  # the episodes are too short for this one
                wrapper = FeatureObservation(env, name)
                if wrapper.observation_space.shape == space.shape:
                    return partial(features_of, env.interface, wrapper.map)
    raise ValueError(
        f"sb3 = {path} takes observations of shape {space.shape}, here they are "
        f"{env.observation_space.shape}, or their features. Give the --env-kwargs that it was "
        "trained with (N, decimate, visible)."
    )


def _actions(path: str, space: Any, env: TuningEnv) -> Callable[[Array], Array]:
    """Actions within a space to gains."""
    unit = UnitAction(env)
    if space == unit.action_space:
        return unit.map.gains
    if space == env.action_space:
        return np.asarray
    raise ValueError(
        f"sb3 = {path} acts in {space}. Train it in this environment, {env.action_space}, or with "
        f"unit actions, {unit.action_space}."
    )
