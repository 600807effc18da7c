"""How fast the batch environment serves episodes, beside what people would use instead."""

import resource
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from benchmarks.stopwatch import Contender, Times, race
from yawrate_env import ENV_ID
from yawrate_env.compiled import cores

GAINS = (0.2, 0.2)


def noise_limit(num_envs: int, samples: int) -> Callable[[], int]:
    """NumPy filling the observation arrays with Gaussian noise, one thread a core."""
    out = np.empty((num_envs, 2, samples), dtype=np.float32)
    generators = [np.random.default_rng(i) for i in range(cores())]
    parts = np.array_split(np.arange(num_envs), len(generators))

    def fill() -> int:
        with ThreadPoolExecutor(len(generators)) as pool:
            for _ in pool.map(
                lambda job: job[0].standard_normal(
                    out=out[job[1][0] : job[1][-1] + 1], dtype=np.float32
                ),
                zip(generators, parts, strict=True),
            ):
                pass
        return num_envs

    return fill


def copy_limit(num_envs: int, samples: int) -> Callable[[], int]:
    """NumPy copying the observation arrays."""
    source = np.ones((num_envs, 2, samples), dtype=np.float32)
    target = np.empty_like(source)

    def copy() -> int:
        np.copyto(target, source)
        return num_envs

    return copy


def stepping(env: VectorEnv[Any, Any, Any]) -> Callable[[], int]:
    """One step of a vector environment that resets in the same step."""
    env.reset(seed=0)
    actions = np.tile(np.array(GAINS), (env.num_envs, 1))

    def step() -> int:
        env.step(actions)
        return int(env.num_envs)

    return step


def page_faults(num_envs: int, steps: int = 20) -> float:
    """Pages of fresh memory that a step takes, the median after as many steps."""
    env: Any = gymnasium.make_vec(ENV_ID, num_envs=num_envs)
    step, found = stepping(env), []
    for _ in range(2 * steps):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        step()
        found.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    env.close()
    return float(np.median(found[steps:]))


def plain_loop(env: gymnasium.Env[Any, Any], episodes: int) -> Callable[[], int]:
    """Reset and step of a scalar environment, again and again."""
    env.reset(seed=0)

    def play() -> int:
        for _ in range(episodes):
            env.step(np.array(GAINS))
            env.reset()
        return episodes

    return play


def measure(
    num_envs: int, rounds: int, progress: Callable[[int, int], None] = lambda done, of: None
) -> Times:
    """Time an episode takes in the batch environment, in its rivals, and at two limits."""
    same = {"autoreset_mode": AutoresetMode.SAME_STEP}
    scalar = max(min(num_envs, 1000) // 16, cores())
    batch: Any = gymnasium.make_vec(ENV_ID, num_envs=num_envs)
    envs = {
        "SyncVectorEnv": gymnasium.make_vec(
            ENV_ID, num_envs=scalar, vectorization_mode="sync", vector_kwargs=same
        ),
        "AsyncVectorEnv, a process a core": gymnasium.make_vec(
            ENV_ID, num_envs=cores(), vectorization_mode="async", vector_kwargs=same
        ),
    }
    samples = batch.unwrapped.task.experiment.N
    contenders = {f"batch environment, {num_envs}": stepping(batch)}
    contenders |= {name: stepping(env) for name, env in envs.items()}
    contenders["plain loop over reset and step"] = plain_loop(gymnasium.make(ENV_ID), scalar)
    contenders["limit: NumPy noise in the same arrays"] = noise_limit(num_envs, samples)
    contenders["limit: copying the same arrays"] = copy_limit(num_envs, samples)
    found = race({name: Contender(work) for name, work in contenders.items()}, rounds, progress)
    for env in (batch, *envs.values()):
        env.close()
    return found
