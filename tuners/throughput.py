"""How fast the batch environment serves episodes, beside what people would use instead.

Contenders take turns in one process, several rounds, so that a busy moment of the
machine hits all of them; what counts is the median of the ratios within a round.
"""

import os
import platform
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from yawrate_env import ENV_ID
from yawrate_env.compiled import cores

Progress = Callable[[str, int, int], None]

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


def stepping(env: VectorEnv[Any, Any, Any]) -> Callable[[], int]:
    """One step of a vector environment that resets in the same step."""
    env.reset(seed=0)
    actions = np.tile(np.array(GAINS), (env.num_envs, 1))

    def step() -> int:
        env.step(actions)
        return int(env.num_envs)

    return step


def measure(num_envs: int, rounds: int, progress: Progress | None = None) -> dict[str, Any]:
    """Episodes a second of every contender, and the batch environment's ratios to them.

    Returns
    -------
    dict
        Machine, versions, and for each contender ``episodes_per_second`` (median of the
        rounds) and ``ratio`` (batch environment over contender: median, least, most).
    """
    same = {"autoreset_mode": AutoresetMode.SAME_STEP}
    scalar = max(num_envs // 16, cores())
    envs = {
        "batch": gymnasium.make_vec(ENV_ID, num_envs=num_envs),
        "SyncVectorEnv": gymnasium.make_vec(
            ENV_ID, num_envs=scalar, vectorization_mode="sync", vector_kwargs=same
        ),
        "AsyncVectorEnv, a process a core": gymnasium.make_vec(
            ENV_ID, num_envs=cores(), vectorization_mode="async", vector_kwargs=same
        ),
    }
    samples = envs["batch"].unwrapped.task.experiment.N  # type: ignore[attr-defined]
    contenders = {name: stepping(env) for name, env in envs.items()}
    contenders["NumPy noise in the same arrays"] = noise_limit(num_envs, samples)
    rates: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(rounds + 1):
        for name, work in contenders.items():
            start = time.perf_counter()
            episodes = work()
            rate = episodes / (time.perf_counter() - start)
            if turn:  # the first round warms up
                rates[name].append(rate)
        if progress is not None:
            progress("benchmark", turn, rounds)
    for env in envs.values():
        env.close()
    return {
        "machine": f"{processor()}, {cores()} cores",
        "versions": {"python": platform.python_version(), "numpy": np.__version__},
        "num_envs": num_envs,
        "rounds": rounds,
        "contenders": {
            name: {
                "episodes_per_second": float(np.median(found)),
                "ratio": _ratio(np.array(rates["batch"]) / np.array(found)),
            }
            for name, found in rates.items()
        },
    }


def to_markdown(result: dict[str, Any]) -> str:
    """The measurements as a table."""
    lines = [
        f"{result['machine']}, {result['num_envs']} environments, median of "
        f"{result['rounds']} rounds.",
        "",
        "| contender | episodes a second | batch environment over it (least to most) |",
        "|---|---|---|",
    ]
    for name, found in result["contenders"].items():
        ratio = found["ratio"]
        lines.append(
            f"| {name} | {found['episodes_per_second']:.0f} "
            f"| {ratio['median']:.2f} ({ratio['least']:.2f} to {ratio['most']:.2f}) |"
        )
    return "\n".join(lines) + "\n"


def _ratio(values: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float]:
    low, middle, high = np.quantile(values, [0, 0.5, 1])
    return {"median": float(middle), "least": float(low), "most": float(high)}


def processor() -> str:
    """What kind of processor this machine has."""
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
