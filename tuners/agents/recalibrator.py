"""An agent for ``yawrate/PIRecalibration-v0`` that learns from rewards what to remember.

    envs = gymnasium.make_vec("yawrate/PIRecalibration-v0", num_envs=200)
    agent = Recalibrator(seed=0).learn(envs, 20_000)
    actions, state = agent.predict(observations, state, episode_start)

Its critic is that of `tuners.agents.naf`, on the means of a memory (`tuners.agents.memory`) and the
speed to come: the error that gains earn is a cone around the best ones.  The cone is fitted to all
rewards so far; then the memory's settings take some Gauss-Newton steps on the same sum of squares,
since a memory that follows the car well forecasts rewards well.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from tuners.agents.cone import Cone, fit
from tuners.agents.critic import FAR, Critic, explored, refitted, weighted
from tuners.agents.memory import FORGETFUL, NUMBERS, blank, inputs, remembered, replayed, within
from tuners.recalibration.belief import Belief
from yawrate_env import validation
from yawrate_env.files import replacing
from yawrate_env.plant.reward import error_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_STEP = 0.05  # of a setting, for slopes
_LONGEST = 1.0  # step of a setting
_TRIES, _STEPS, _POLISH = 6, 4, 4
_DAMPING = 1.0, 1e-3  # first and least


class Recalibrator:
    """Normalised advantage on a memory.

    Parameters
    ----------
    seed : int
        Of exploration and of the fits' starts.
    error : callable
        Rewards (B,) to errors (B,), 0 at best.
    remembers : bool
        Whether it has a memory; otherwise every window counts alone.
    learning_starts : int
        Random actions before the first fit; settings stay until there are four times as many.
    growth : float
        The critic is fitted again when there are so many times the windows of the last fit.
    restarts, restart_until : int
        The fit has so many further starts, random ones, until there are so many windows.
    neurons : tuple of int
        Hidden units of the best action and of the steepness.
    """

    def __init__(
        self,
        *,
        seed: int = 0,
        error: Callable[[Array], Array] = error_of,
        remembers: bool = True,
        learning_starts: int = 500,
        growth: float = 1.5,
        restarts: int = 3,
        restart_until: int = 3000,
        neurons: tuple[int, int] = (12, 4),
    ) -> None:
        self.seed = validation.count("seed", seed, at_least=0)
        self.error = error
        self.remembers = validation.flag("remembers", remembers)
        self.learning_starts = validation.count("learning_starts", learning_starts, at_least=1)
        self.growth = validation.number("growth", growth, above=1.0, remedy="1.5 is the default.")
        self.restarts = validation.count("restarts", restarts, at_least=0)
        self.restart_until = validation.count("restart_until", restart_until, at_least=0)
        self.cone = Cone(NUMBERS, 2, neurons)
        self.settings: Array = FORGETFUL.copy()
        self.critic: Critic | None = None

    def learn(self, envs: VectorEnv[Any, Any, Any], total: int) -> Self:
        """Learn from so many windows, or a few more, of a native batch environment."""
        total = validation.count("total", total, at_least=1)
        rng, count = np.random.default_rng(self.seed), envs.num_envs
        obs, _ = envs.reset(seed=self.seed)
        starts, memory = np.ones(count, np.bool_), blank(count)
        seen: tuple[list[Any], ...] = ([], [], [], [])
        fitted = 0
        while fitted < total:
            due = min(total, max(self.learning_starts, int(self.growth * fitted)))
            while len(seen[0]) * count < due:
                memory = remembered(self.settings, memory, obs, self._starts(starts))
                actions = self._tried(inputs(memory, obs), rng)
                taken = np.column_stack([actions, np.ones(count)])
                after, rewards, terminated, truncated, _ = envs.step(taken)
                new = obs, starts, actions, self.error(np.asarray(rewards, dtype=np.float64))
                for part, values in zip(seen, new, strict=True):
                    part.append(values)
                obs, starts = after, terminated | truncated
            observed, begun, a, e = (np.stack(part) for part in seen)
            self.fit(observed, begun, a.reshape(-1, 2), e.ravel(), fitted, rng)
            fitted = e.size
        return self

    def fit(
        self,
        obs: NDArray[np.floating],
        starts: Flags,
        a: Array,
        e: Array,
        known: int = 0,
        rng: np.random.Generator | None = None,
    ) -> Self:
        """Fit critic and memory to windows of B drives at a time.

        Parameters
        ----------
        obs, starts : (T, B, 9), (T, B)
            Observations, and which of them begin a drive.
        a, e : (T B, 2), (T B,) float64
            Coordinates of the gains that were taken, and the errors they earned.
        known : int
            How many of these windows the fit before knew.
        """
        begun, count = self._starts(starts), len(e)
        (x,) = replayed(self.settings[None], obs, begun)
        last = None if self.critic is None else self.critic.weights
        rng, early = rng or np.random.default_rng(self.seed), count <= self.restart_until
        new = refitted(self.cone, last, x, a, e, known, rng, self.restarts, early)
        if self.remembers and count >= 4 * self.learning_starts:
            new = self._settled(new, obs, begun, a, e)
        self.critic = new
        return self

    def predict(
        self,
        observation: NDArray[np.floating],
        state: Belief | None = None,
        episode_start: Flags | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Belief]:
        """Actions (3,) or (B, 3), and the memory after these observations (9,) or (B, 9)."""
        obs = np.atleast_2d(observation)
        starts = np.full(len(obs), state is None)
        if state is not None and episode_start is not None:
            starts = np.asarray(episode_start, dtype=np.bool_)
        before = blank(len(obs)) if state is None else state
        memory = remembered(self.settings, before, obs, self._starts(starts))
        actions = np.ones((len(obs), 3), dtype=np.float32)
        actions[:, :2] = self.best(inputs(memory, obs))
        return actions.reshape(*np.shape(observation)[:-1], 3), memory

    def best(self, x: Array) -> Array:
        """Coordinates (B, 2) of the best gains, from `tuners.agents.memory.inputs`."""
        if self.critic is None:
            raise ValueError("The agent has learned nothing. Call learn() or fit() first.")
        return np.clip(self.cone.best(self.critic.weights, x), -1, 1)

    def save(self, path: str | Path) -> None:
        """Write what it learned: arrays alone, in NumPy's format."""
        critic = self.critic
        if critic is None:
            raise ValueError("The agent has learned nothing. Call learn() or fit() first.")
        with replacing(path) as file:
            np.savez(file, settings=self.settings, remembers=self.remembers, weights=critic.weights,
                     neurons=self.cone.neurons, noise=critic.noise, spread=critic.spread,
                     cost=critic.cost)  # fmt: skip

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a saved agent."""
        with np.load(path, allow_pickle=False) as found:
            first, second = found["neurons"].tolist()
            agent = cls(remembers=bool(found["remembers"]), neurons=(first, second))
            agent.settings = found["settings"]
            numbers = (float(found[name]) for name in ("noise", "spread", "cost"))
            agent.critic = Critic(found["weights"], *numbers)
        return agent

    def _starts(self, starts: Flags) -> Flags:
        return starts if self.remembers else np.ones_like(starts)

    def _tried(self, x: Array, rng: np.random.Generator) -> Array:
        """Actions to learn from."""
        if self.critic is None:
            return rng.uniform(-1, 1, (len(x), 2))
        far, normal = rng.random((len(x), 1)) < FAR, rng.standard_normal((len(x), 2))
        return explored(self.cone, self.critic.weights, x, self.critic.spread, far, normal)

    def _settled(
        self, critic: Critic, obs: NDArray[np.floating], starts: Flags, a: Array, e: Array
    ) -> Critic:
        """The critic after some steps of the settings, its weights adapted to each."""
        cone, weight = self.cone, weighted(critic.noise, e)
        weights, cost, damping = critic.weights, critic.cost, _DAMPING[0]
        varied = np.vstack([np.zeros(len(self.settings)), _STEP * np.eye(len(self.settings))])
        for _ in range(_STEPS):
            xs = replayed(within(self.settings + varied), obs, starts)
            off = np.stack([(cone.errors(weights, x, a) - e) * weight for x in xs])
            J, cost = (off[1:] - off[0]).T / _STEP, float(off[0] @ off[0])
            normal, slope = J.T @ J, J.T @ off[0]
            scale = np.diag(np.diag(normal) + 1e-3 * np.trace(normal) / len(normal))
            for _ in range(_TRIES):
                step = np.linalg.solve(normal + damping * scale, slope)
                trial = within(self.settings - np.clip(step, -_LONGEST, _LONGEST))
                (x,) = replayed(trial[None], obs, starts)
                if float((((cone.errors(weights, x, a) - e) * weight) ** 2).sum()) < cost:
                    break
                damping *= 5
            else:
                break
            self.settings, damping = trial, max(damping / 5, _DAMPING[1])
            weights, cost = fit(cone, weights, x, a, e, weight, _POLISH)
        return Critic(weights, critic.noise, critic.spread, cost)
