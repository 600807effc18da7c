"""An agent for problems of one step, as an algorithm of Stable-Baselines3.

    from tuners.agents.naf import NAF

    model = NAF("MlpPolicy", env, seed=0).learn(20_000)
    action, _ = model.predict(observation, deterministic=True)

It is for environments whose episodes have one step and whose reward falls with the distance from a
best action that depends on the observation: calibration, tuning, contextual optimisation.  A
critic of normalised advantage (`tuners.agents.cone`) is fitted to all episodes so far, whenever
there are half as many again; its best action is the policy.  Exploration is Gaussian around it,
round in units of the error, and as wide as the noise allows: far away a cone is a poor model, near
by the noise is larger than the slope, and the square root of the noise lies between.
"""

from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.utils import configure_logger, safe_mean

from tuners.agents.cone import Cone
from tuners.agents.critic import FAR, explored, refitted
from yawrate_env import validation

Array = NDArray[np.float64]


def negative(rewards: Array) -> Array:
    """Errors of rewards that are negative errors."""
    return -rewards


class ConePolicy(BasePolicy):
    """The best action of a cone, or a random one around it.

    Parameters
    ----------
    observation_space, action_space : Box
        Of any shape; actions are scaled to [-1, 1], observations standardised.
    neurons : tuple of int
        Hidden units of the best action and of the steepness.
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Box,
        neurons: tuple[int, int] = (12, 4),
    ) -> None:
        super().__init__(observation_space, action_space, squash_output=True)
        self.neurons = neurons
        n, m = spaces.flatdim(observation_space), spaces.flatdim(action_space)
        self.cone = Cone(n, m, neurons)
        for name, value in (
            ("weights", torch.zeros(int(self.cone.ends[-1]), dtype=torch.float64)),
            ("mean", torch.zeros(n, dtype=torch.float64)),
            ("scale", torch.ones(n, dtype=torch.float64)),
            ("spread", torch.tensor(torch.inf, dtype=torch.float64)),
        ):
            self.register_buffer(name, value)

    def array(self, name: str) -> Array:
        """A buffer as an array."""
        value: Array = self.get_buffer(name).numpy()
        return value

    def keep(self, **values: Any) -> None:
        """Replace buffers."""
        for name, value in values.items():
            self.get_buffer(name).copy_(torch.as_tensor(value))

    def standardised(self, observations: NDArray[Any]) -> Array:
        """Observations (B, ...) as the cone takes them, (B, n)."""
        flat = observations.reshape(len(observations), -1)
        return np.asarray((flat - self.array("mean")) / self.array("scale"))

    def layers(self) -> list[tuple[Array, Array]]:
        """Weights and biases from observations to actions in [-1, 1], with tanh between."""
        W, b, V, c, *_ = self.cone.parts(self.array("weights"))
        W = W / self.array("scale")
        return [(W, b - W @ self.array("mean")), (V.copy(), c.copy())]

    def _predict(self, observation: Any, deterministic: bool = False) -> torch.Tensor:
        x, m = self.standardised(observation.numpy()), self.cone.actions
        weights, spread = self.array("weights"), float(self.array("spread"))
        if deterministic:
            return torch.from_numpy(np.clip(self.cone.best(weights, x), -1, 1))
        if np.isinf(spread):
            return 2 * torch.rand(len(x), m, dtype=torch.float64) - 1
        far = torch.rand(len(x), 1).numpy() < FAR
        normal = torch.randn(len(x), m, dtype=torch.float64).numpy()
        return torch.from_numpy(explored(self.cone, weights, x, spread, far, normal))

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {
            "observation_space": self.observation_space,
            "action_space": self.action_space,
            "neurons": self.neurons,
        }


class NAF(BaseAlgorithm):
    """Normalised advantage functions for problems of one step, fitted by least squares.

    All episodes are kept, and saved with the model, so that a loaded one learns on.

    Parameters
    ----------
    policy : str or type
        ``"MlpPolicy"``, a `ConePolicy`.
    env : Env, VecEnv or str
        Its episodes must end after one step; observations and actions are boxes.  Several
        environments make it faster, and change little else.
    error : callable
        Rewards (B,) to errors (B,), which are 0 at best and grow with the distance from the best
        action; the negative reward by default.
    unit : float
        An error that is large: actions are explored up to 0.7 of it.
    learning_starts : int
        Random actions before the first fit.
    growth : float
        The critic is fitted again when there are so many times the episodes of the last fit, and
        at the end.
    restarts, restart_until : int
        The fit has so many further starts, random ones, until there are so many episodes.
    policy_kwargs, stats_window_size, tensorboard_log, verbose, seed, device
        As everywhere in Stable-Baselines3; it computes on the processor.
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": ConePolicy}
    policy: ConePolicy

    def __init__(
        self,
        policy: str | type[ConePolicy],
        env: Any,
        *,
        error: Callable[[Array], Array] = negative,
        unit: float = 1.0,
        learning_starts: int = 500,
        growth: float = 1.5,
        restarts: int = 3,
        restart_until: int = 3000,
        policy_kwargs: dict[str, Any] | None = None,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: Any = "cpu",
        _init_setup_model: bool = True,
    ) -> None:
        del device
        super().__init__(
            policy, env, learning_rate=0.0, policy_kwargs=policy_kwargs,
            stats_window_size=stats_window_size, tensorboard_log=tensorboard_log, verbose=verbose,
            device="cpu", support_multi_env=True, seed=seed,
            supported_action_spaces=(spaces.Box,),
        )  # fmt: skip
        if self._vec_normalize_env is not None:
            raise ValueError("env is a VecNormalize. Leave it out: the policy standardises.")
        self.error = error
        self.unit = validation.number("unit", unit, above=0.0, remedy="1.0 is the default.")
        self.learning_starts = validation.count("learning_starts", learning_starts, at_least=1)
        self.growth = validation.number("growth", growth, above=1.0, remedy="1.5 is the default.")
        self.restarts = validation.count("restarts", restarts, at_least=0)
        self.restart_until = validation.count("restart_until", restart_until, at_least=0)
        self.memory: tuple[list[Array], ...] = ([], [], [])
        self.fitted = 0
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        self._setup_lr_schedule()
        self.set_random_seed(self.seed)
        self.rng = np.random.default_rng(self.seed)
        self.policy = self.policy_class(  # type: ignore[assignment]
            self.observation_space, self.action_space, **self.policy_kwargs
        )

    @property
    def episodes(self) -> int:
        """In the memory."""
        return sum(map(len, self.memory[2]))

    def learn(
        self,
        total_timesteps: int,
        callback: Any = None,
        log_interval: int = 1,
        tb_log_name: str = "NAF",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Learn from so many episodes; `log_interval` is in fits."""
        total, callback = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        callback.on_training_start(locals(), globals())
        while self.num_timesteps < total:
            due = max(self.learning_starts, int(self.growth * self.fitted))
            if not self._collect(callback, min(total - self.num_timesteps, due - self.episodes)):
                break
            self.train()
            if log_interval and self._n_updates % log_interval == 0:
                self._log()
        callback.on_training_end()
        return self

    def learn_offline(
        self, observations: NDArray[Any], actions: NDArray[Any], rewards: NDArray[Any]
    ) -> Self:
        """Learn from recorded episodes (N, ...), (N, ...), (N,), as if they came in this order."""
        if not self._custom_logger:
            self._logger = configure_logger(self.verbose, self.tensorboard_log, "NAF")
        count, done = len(rewards), 0
        while done < count:
            due = max(self.learning_starts, int(self.growth * self.fitted))
            rows = slice(done, done + max(due - self.episodes, 1))
            new = np.asarray(observations[rows], dtype=np.float64)
            self._remember(new, np.asarray(actions[rows]), rewards[rows])
            done += len(new)
            self.train()
        return self

    def train(self) -> None:
        """Fit the critic to all episodes, and set the exploration by its errors on new ones."""
        observations, a, e = (np.concatenate(part) for part in self.memory)
        policy, last = self.policy, None
        if self.fitted:
            last = policy.array("weights").copy()
        else:
            scale = observations.std(axis=0)
            policy.keep(mean=observations.mean(axis=0), scale=np.where(scale > 0, scale, 1.0))
        x, restarts = policy.standardised(observations), self.restarts
        early = len(e) <= self.restart_until
        found = refitted(policy.cone, last, x, a, e, self.fitted, self.rng, restarts, early)
        policy.keep(weights=found.weights, spread=found.spread)
        self.fitted = len(e)
        self._n_updates += 1
        told = ("loss", found.cost / len(e)), ("noise", found.noise), ("spread", found.spread)
        for name, value in told:
            self.logger.record(f"train/{name}", value)
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")

    def _collect(self, callback: BaseCallback, count: int) -> bool:
        """Act in `count` episodes or a few more; whether the callback lets it go on."""
        assert self.env is not None
        seen: Any = self._last_obs
        callback.on_rollout_start()
        end = self.num_timesteps + count
        while self.num_timesteps < end:
            observations = np.array(seen, dtype=np.float64)
            actions, _ = self.policy.predict(seen, deterministic=False)
            seen, rewards, dones, infos = self.env.step(actions)
            self._last_obs = seen
            if not dones.all():
                raise ValueError(
                    "env has an episode that goes on after one step. NAF learns problems of one "
                    "step; use SAC, TD3 or PPO."
                )
            self._remember(observations, actions, rewards)
            self.num_timesteps += self.env.num_envs
            self._update_info_buffer(infos, dones)
            self._update_current_progress_remaining(self.num_timesteps, self._total_timesteps)
            callback.update_locals(locals())
            if not callback.on_step():
                return False
        callback.on_rollout_end()
        return True

    def _remember(self, observations: Array, actions: Array, rewards: NDArray[Any]) -> None:
        B = len(rewards)
        values = self.error(np.asarray(rewards, dtype=np.float64)) / self.unit
        errors = validation.finite_array("error(rewards)", values, shape=(B,))
        scaled = np.asarray(self.policy.scale_action(actions), dtype=np.float64)
        parts = observations.reshape(B, -1), scaled.reshape(B, -1), errors
        for part, new in zip(self.memory, parts, strict=True):
            part.append(new)

    def _log(self) -> None:
        if self.ep_info_buffer:
            rewards = [info["r"] for info in self.ep_info_buffer]
            self.logger.record("rollout/ep_rew_mean", safe_mean(rewards))
        self.logger.record("time/total_timesteps", self.num_timesteps, exclude="tensorboard")
        self.logger.dump(step=self.num_timesteps)
