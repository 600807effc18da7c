"""Freeze what users of the outside names get, so that a change of it is noticed.

    python tests/references/make_frozen_answers.py     # writes frozen_answers.json beside itself

Run it only where answers are meant to change, and say so in CHANGELOG.md.
"""

import json
from pathlib import Path

import gymnasium
import numpy as np

import tuners
import yawrate_env

PATH = Path(__file__).with_name("frozen_answers.json")
ENVIRONMENTS = {
    "default": {},
    "random": {"register": "random"},
    "speeds": {"v_x": [10.0, 33.0], "visible": "speed"},
    "truth": {"visible": "context"},
    "hard": {"phase_margin": 80.0, "v_x": 30.0},
}
SEES = {"ts-ff-lag-vx": "speeds", "ts-poly-any": "speeds", "oracle": "truth"}
ACTIONS = np.array([[0.2, 0.2], [0.05, 1.0], [9.0, 0.01], [0.1, 0.1]])


def answers() -> dict:
    """Observations (weighted sums), rewards, infos, gains and intervals, as plain values."""
    found: dict = {"environments": {}, "gains": {}, "tune": {}}
    seen = {}
    for name, settings in ENVIRONMENTS.items():
        envs = gymnasium.make_vec(yawrate_env.ENV_ID, num_envs=len(ACTIONS), **settings)
        seen[name], _ = envs.reset(seed=7)
        obs = seen[name].astype(np.float64)
        weights = np.cos(np.arange(obs.shape[2]))
        _, reward, *_, info = envs.step(ACTIONS)
        final = {k: v.tolist() for k, v in info["final_info"].items() if not k.startswith("_")}
        found["environments"][name] = {
            "observed": (obs @ weights).tolist(), "reward": reward.tolist(), "info": final,
        }  # fmt: skip
    for name in tuners.NAMES:
        tuner = tuners.load(name)
        obs = seen[SEES.get(name, "default")]
        found["gains"][name] = tuner.predict(obs)[0].tolist()
        if name != "oracle":
            known = {"v_x": obs[0, 2, 0]} if obs.shape[1] > 2 else {}
            result = tuner.tune(obs[0, 0], obs[0, 1], 0.001, **known)
            found["tune"][name] = {
                "intervals": ends(result.intervals),
                "exact_intervals": ends(result.exact_intervals),
                "verdict": result.verdict.value,
                "rung": result.rung.name,
            }
    return found


def ends(intervals: dict) -> list:
    """Values and ends of intervals."""
    return [[i.value, i.low, i.high] for i in intervals.values()]


if __name__ == "__main__":
    PATH.write_text(json.dumps(answers(), indent=1) + "\n")
