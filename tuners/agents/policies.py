"""Anyone's policy among the tuners.

A policy is given what the environment shows, as one batch, and what it answers is applied
as the environment applies it, clipped to the action space.  It is not given the truth,
unless the environment is asked to show it (``visible="context"``).

* `of_factory`: an object with Stable-Baselines3's ``predict``, made by ``module:factory``;
* `of_sb3`: a model that Stable-Baselines3 saved, trained in ``yawrate/PITuning-v0`` or in
  ``yawrate/PITuningFeatures-v0``; its spaces say which.
"""

import importlib
import json
import os
import sys
import zipfile
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from tuners.agents.wrappers import Compressed, LoopAction
from tuners.features import COMPRESSORS
from tuners.tuner.recording import Recording
from yawrate_env import validation
from yawrate_env.env.interaction import show
from yawrate_env.env.yaw_rate_env import PITuningEnv

Array = NDArray[Any]

TRUSTED_ONLY = "Stable-Baselines3 files hold pickles, which can run code: load trusted files only."

# What only this algorithm saves, and no earlier one in the table; DDPG is saved as a TD3.
_MARKS = {
    "stable_baselines3:PPO": {"clip_range"},
    "sb3_contrib:TRPO": {"cg_max_steps"},
    "sb3_contrib:TQC": {"top_quantiles_to_drop_per_net"},
    "sb3_contrib:CrossQ": {"target_entropy", "policy_delay"},
    "stable_baselines3:TD3": {"policy_delay"},
    "stable_baselines3:SAC": {"target_entropy"},
    "stable_baselines3:A2C": {"gae_lambda"},
}

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
    """What Stable-Baselines3's own tools call a policy."""

    def predict(
        self, obs: Array, /, *, state: Any, episode_start: Array, deterministic: bool
    ) -> tuple[Any, Any]:
        """(B, 2) of actions for a batch of B observations, and the state."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Player:
    """A policy in the shape of a tuner.

    Attributes
    ----------
    name : str
        For messages.
    policy : Predictor
        Who decides.
    env : PITuningEnv
        Says what is shown and what is applied; never stepped.
    see : callable
        Observations (B, rows, N) to what the policy takes.
    gains : callable
        Actions (B, 2) of the policy to (kp, Ti).
    """

    name: str
    policy: Predictor
    env: PITuningEnv
    see: Callable[[Array], Array] = np.asarray
    gains: Callable[[Array], Array] = np.asarray

    def act(self, recording: Recording) -> NDArray[np.float64]:
        """(B, 2) of (kp, Ti) within the environment's bounds."""
        count = len(recording)
        answer = self.policy.predict(
            self.see(observations(recording, self.env)),
            state=None,
            episode_start=np.ones(count, dtype=np.bool_),
            deterministic=True,
        )
        if not isinstance(answer, tuple) or len(answer) != 2:
            raise ValueError(
                f"{self.name}: predict gave {type(answer).__name__}. Return (actions, state)."
            )
        actions = answer[0]
        if count == 1 and np.shape(actions) == (2,):
            actions = np.asarray(actions)[None]
        checked = validation.finite_array(f"{self.name}: actions", actions, shape=(count, 2))
        space = self.env.action_space
        return np.clip(self.gains(checked), space.low, space.high)


def observations(recording: Recording, env: PITuningEnv) -> NDArray[np.float32]:
    """What `env` shows of recorded episodes, (B, rows, N // decimate) float32."""
    return show(recording.u, recording.y, recording.context, env.visible, env.decimate)


def of_factory(spec: str, env: PITuningEnv) -> Player:
    """Call ``package.module:factory`` and play what it gives.

    Raises
    ------
    ValueError
        No such module or factory, or what it makes cannot predict.
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


def of_sb3(path: str, env: PITuningEnv, algorithm: str | None = None) -> Player:
    """Load a model of Stable-Baselines3 and play it.

    Parameters
    ----------
    path : str
        Zip file; see `TRUSTED_ONLY`.
    env : PITuningEnv
        With the keyword arguments that the model was trained with.
    algorithm : str, optional
        ``module:Class``, where the file does not tell.

    Raises
    ------
    ValueError
        Not such a file, or trained with other observations or actions than `env` has.
    """
    spec = algorithm or _algorithm(path)
    kind = _imported(spec)
    try:
        model = kind.load(path, device="cpu", custom_objects=_NOT_LOADED)
    except Exception as error:  # pickles and foreign classes raise anything
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ValueError(
            f"{path} cannot be loaded with {spec}: {reason}. Save it again with this machine's "
            "versions, or name its class with --algo."
        ) from error
    see = _sight(path, model.observation_space, env)
    return Player(path, model, env, see, _reach(path, model.action_space, env))


def add_arguments(parser: ArgumentParser) -> None:
    """Let a script take policies."""
    parser.add_argument(
        "--policy", action="append", default=[], metavar="MODULE:FACTORY",
        help="your own: factory() returns an object whose predict(obs, state, episode_start,\n"
        "deterministic) gives (actions, state), actions being (kp, Ti); may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--sb3", action="append", default=[], metavar="ZIP",
        help="a Stable-Baselines3 model trained here, with the same --env-kwargs; trusted files\n"
        "only, since they hold pickles; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--algo", metavar="MODULE:CLASS",
        help="class of the --sb3 models where the file does not tell, such as\n"
        "stable_baselines3:SAC",
    )  # fmt: skip


def chosen(
    factories: Sequence[str], models: Sequence[str], algorithm: str | None, env: PITuningEnv
) -> dict[str, Player]:
    """Name to player of what the arguments name.

    Parameters
    ----------
    env : PITuningEnv
        What they answer.
    """
    if models:
        print(TRUSTED_ONLY, file=sys.stderr)
    return {spec: of_factory(spec, env) for spec in factories} | {
        path: of_sb3(path, env, algorithm) for path in models
    }


def _imported(spec: str) -> Any:
    """What ``package.module:name`` names; modules are looked for where the user is, too."""
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


def _algorithm(path: str) -> str:
    """Class of a saved model, from the names of what it saved; nothing is unpickled."""
    try:
        with zipfile.ZipFile(path) as file:
            saved = json.loads(file.read("data")).keys()
    except FileNotFoundError:
        raise ValueError(f"There is no file {path}. Check the name; it ends in .zip.") from None
    except (zipfile.BadZipFile, KeyError, ValueError, AttributeError):
        raise ValueError(
            f"{path} is not a Stable-Baselines3 model. Give what model.save() wrote; a .tuner "
            "file goes with --tuner."
        ) from None
    for spec, marks in _MARKS.items():
        if marks <= saved:
            return spec
    raise ValueError(
        f"{path} does not tell its algorithm. Name its class, such as --algo stable_baselines3:SAC."
    )


def _sight(path: str, space: Any, env: PITuningEnv) -> Callable[[Array], Array]:
    """Observations to what a model with this observation space takes."""
    if space.shape == env.observation_space.shape:
        return np.asarray
    if isinstance(space, Box) and len(space.shape) == 1:
        for name in COMPRESSORS:
            with suppress(ValueError):  # the episodes are too short for this one
                wrapper = Compressed(env, name)
                if wrapper.observation_space.shape == space.shape:
                    return wrapper.observation
    raise ValueError(
        f"{path} takes observations of shape {space.shape}, here they are "
        f"{env.observation_space.shape}, or features of yawrate/PITuningFeatures-v0. Give the "
        "--env-kwargs that it was trained with (N, decimate, visible)."
    )


def _reach(path: str, space: Any, env: PITuningEnv) -> Callable[[Array], Array]:
    """Actions within a space to (kp, Ti)."""
    loop = LoopAction(env)
    if space == loop.action_space:
        return loop.map.gains
    if space == env.action_space:
        return np.asarray
    raise ValueError(
        f"{path} acts in {space}. Train it in yawrate/PITuning-v0, {env.action_space}, or in "
        f"yawrate/PITuningFeatures-v0, {loop.action_space}."
    )
