"""The leaderboard: its page, made from one file an entry, and the project's own entries."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tuners
from studies import recalibration_agent
from studies.markdown import table
from studies.scoreboard import learned_from
from tuners.agents.leaderboard import EPISODES, Entry, score
from tuners.recalibration.belief import Belief
from tuners.recalibration.follower import Follower
from yawrate_env import ENV_ID, RECALIBRATION_ID
from yawrate_env.batch import replaced
from yawrate_env.env.recalibration_env import PIRecalibrationEnv
from yawrate_env.env.recalibration_interface import RecalibrationInterface
from yawrate_env.env.yaw_rate_interface import KP_RANGE, TI_RANGE

Progress = Callable[[str, int, int], Any]

EXAMPLE = """\
from tuners.agents.leaderboard import score
class Mine:
    def predict(self, obs, state=None, episode_start=None, deterministic=True):
        return [[0.2, 0.3]] * len(obs), state
score("yawrate/PITuning-v0", "mine", {0: Mine()}, learned_from="-").save("results/leaderboard")
"""
"""The five lines by which a policy gets a file."""

_PAGE = """\
# Leaderboard

Every row is a file in `results/leaderboard/`. Of an agent with several training seeds the row has
the median of their mean returns, and the worst; brackets hold the median seed's 95 % bootstrap
interval over episodes. All get the same episodes, those of `reset(seed=k)` for k from 0 on. Windows
that an unstable loop leaves undriven count -5 each, as it does: to end a drive must not pay. Times
are those of the machine that made the file, the project's own of one that was busy.

{boards}
## Yours

Five lines make the file; then `python scripts/leaderboard.py --page` makes this page:

```python
{example}```

A policy is anything with Stable-Baselines3's `predict`; `state` and `episode_start` are for those
that remember. The dictionary has one policy a training seed: give five, with `training=` seconds
each. In `learned_from` say what it learned from and knew beforehand. Send the one file as a pull
request.
"""

_BEST = {
    ENV_ID: "0, the design rule's with the vehicle known",
    RECALIBRATION_ID: "-0.5, the design rule's with every window's vehicle known",
}

_KNOWS = {
    "ts-ff-lag": "the simulator's labels",
    "ts-gbm-lag": "the simulator's labels",
    "gb": "the simulator",
    "bb": "no simulator",
    "nominal": "the mid-prior vehicle",
    "rl": "the rewards' form",
    "rl-sac": "rewards alone",
}
"""Tuners, and what they know."""


@dataclass(frozen=True, slots=True)
class Ruled:
    """The design rule on estimates of ``yawrate/PIRecalibration-v0``: a window's, or the filter's.

    Attributes
    ----------
    made : RecalibrationInterface
        Turns observations into estimates.
    remembers : bool
        Whether windows are combined.
    """

    made: RecalibrationInterface
    remembers: bool

    def predict(
        self, obs: Any, /, *, state: Belief | None, episode_start: Any, deterministic: bool
    ) -> tuple[Any, Belief]:
        """Actions, and the filter's belief."""
        follower = Follower.of(self.made.drives)
        fresh = np.flatnonzero(episode_start if self.remembers else np.ones(len(obs), np.bool_))
        before = follower.unknown(len(obs)) if state is None else state
        before = replaced(before, fresh, follower.unknown(len(fresh)))
        belief = follower.followed(before, self.made.estimates(obs))
        return self.made.actions(follower.gains(belief, self.made.speeds(obs))), belief


@dataclass(frozen=True, slots=True)
class Keep:
    """Keep the gains of the start."""

    def predict(self, obs: Any, /, **_: Any) -> tuple[Any, None]:
        """Actions that change nothing."""
        return np.full((len(obs), 3), -1.0), None


@dataclass(frozen=True, slots=True)
class RandomActions:
    """Actions drawn evenly from a box.

    Attributes
    ----------
    low, high : NDArray
        (m,) its bounds.
    rng : Generator
        Where they come from.
    """

    low: NDArray[Any]
    high: NDArray[Any]
    rng: np.random.Generator

    def predict(self, obs: Any, /, **_: Any) -> tuple[Any, None]:
        """Actions that know nothing."""
        return self.rng.uniform(self.low, self.high, (len(obs), len(self.low))), None


def own(windows: int, seeds: int, episodes: int | None, progress: Progress) -> list[Entry]:
    """The project's entries; agents of re-calibration are trained, the others are shipped."""
    made, found = PIRecalibrationEnv().interface, []
    low, high = np.array([KP_RANGE, TI_RANGE]).T
    todo: list[tuple[str, str, Callable[[], dict[int, Any]], str]] = [
        *((ENV_ID, name, lambda name=name: {0: tuners.load(name)},
           f"{learned_from(tuners.load(name)) or 'nothing'}; knows {what}")
          for name, what in _KNOWS.items()),
        (ENV_ID, "random", lambda: {0: RandomActions(low, high, np.random.default_rng(0))},
         "nothing"),
        (RECALIBRATION_ID, "keep", lambda: {0: Keep()}, "nothing; knows the gains of the start"),
        (RECALIBRATION_ID, "window-alone", lambda: {0: Ruled(made, False)},
         "nothing; knows simulator and rule"),
        (RECALIBRATION_ID, "filter", lambda: {0: Ruled(made, True)},
         "nothing; knows simulator, rule, walk and jumps"),
        (RECALIBRATION_ID, "recalibrator",
         lambda: {seed: recalibration_agent.trained(windows, seed, True) for seed in range(seeds)},
         f"{windows:,} rewards; knows their form, and the memory's"),
    ]  # fmt: skip
    for done, (env, name, policies, what) in enumerate(todo, 1):
        began = time.perf_counter()
        made_now = policies()
        taken = time.perf_counter() - began
        seconds = taken / len(made_now) if name == "recalibrator" else None
        found.append(
            score(env, name, made_now, learned_from=what, training=seconds, episodes=episodes)
        )
        progress("scoring", done, len(todo))
    return found


def entries(folder: Path) -> list[Entry]:
    """All files of a folder."""
    return [Entry.load(path) for path in sorted(folder.glob("*.json"))]


def page(found: Sequence[Entry]) -> str:
    """One table an environment, best first."""
    boards = []
    for env in EPISODES:
        rows = sorted((e for e in found if e.env == env), key=lambda e: -_median(e).mean)
        if rows:
            best = f" The best possible return is {_BEST[env]}." if env in _BEST else ""
            boards.append(f"## `{env}`\n\n{EPISODES[env]} episodes.{best}\n\n{_table(rows)}")
    return _PAGE.format(boards="\n".join(boards), example=EXAMPLE)


def _table(rows: Sequence[Entry]) -> str:
    heads = ("", "agent", "return", "worst seed", "unstable", "cost", "learned from", "seeds",
             "training [s]", "answers [s]", "yawrate", "commit")  # fmt: skip
    return table(heads, [_cells(rank, entry) for rank, entry in enumerate(rows, 1)])


def _cells(rank: int, entry: Entry) -> list[str]:
    middle, worst = _median(entry), min(run.mean for run in entry.runs)
    trial = "" if entry.episodes == EPISODES[entry.env] else f" ({entry.episodes} episodes)"
    return [
        str(rank),
        f"`{entry.name}`{trial}",
        f"{middle.mean:.4g} ({middle.low:.4g} to {middle.high:.4g})",
        f"{worst:.4g}",
        f"{max(run.unstable for run in entry.runs):.2%}",
        f"{middle.cost:.2%}",
        entry.learned_from,
        ", ".join(str(run.seed) for run in entry.runs),
        "" if entry.training is None else f"{entry.training:.0f}",
        f"{middle.seconds:.2g}",
        entry.versions["yawrate"],
        entry.commit or "",
    ]


def _median(entry: Entry) -> Any:
    """The run in the middle; of two the worse."""
    return sorted(entry.runs, key=lambda run: run.mean)[(len(entry.runs) - 1) // 2]
