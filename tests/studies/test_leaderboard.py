"""The leaderboard: a policy's file by five lines, its page, and what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest

from studies import leaderboard
from tuners.agents.leaderboard import Entry, score
from yawrate_env import ENV_ID, FEATURES_ID, RECALIBRATION_ID
from yawrate_env.env.recalibration_env import PIRecalibrationEnv


class Constant:
    def __init__(self, *action):
        self.action, self.calls = action, []

    def predict(self, obs, state=None, episode_start=None, deterministic=True):
        self.calls.append((len(obs), state, episode_start.all()))
        return np.tile(self.action, (len(obs), 1)), (state or 0) + 1


def test_the_five_lines_of_the_page_make_the_file_that_its_table_shows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (lines,) = re.findall(r"```python\n(.*?)```", leaderboard.page([]), re.DOTALL)
    assert len(lines.strip().splitlines()) == 5
    exec(lines, {})
    (entry,) = leaderboard.entries(tmp_path / "results" / "leaderboard")
    assert (entry.env, entry.name, entry.episodes) == (ENV_ID, "mine", 1500)
    assert {"yawrate", "gymnasium", "numpy", "python"} == set(entry.versions)
    assert "| 1 | `mine` | " in leaderboard.page([entry])


def test_scores_are_means_over_the_episodes_of_their_seeds():
    policy = Constant(0.0, 0.0, -1.0)  # keeps the gains
    entry = score(RECALIBRATION_ID, "keep", {3: policy}, learned_from="nothing", episodes=3)
    assert policy.calls[:2] == [(3, None, True), (3, 1, False)] and len(policy.calls) == 50
    env, returns, cost = PIRecalibrationEnv(), [], 0.0
    for seed in range(3):
        env.reset(seed=seed)
        steps = [env.step(np.array([0.0, 0.0, -1.0])) for _ in range(50)]
        returns.append(sum(step[1] for step in steps))
        cost += sum(step[4]["cost"] for step in steps)
    (run,) = entry.runs
    assert run.seed == 3 and run.unstable == 0 and run.low <= run.mean <= run.high
    assert run.mean == pytest.approx(np.mean(returns), abs=1e-6)
    assert run.cost == pytest.approx(cost / 150)


def test_it_does_not_pay_to_end_a_drive_by_an_unstable_loop():
    entry = score(RECALIBRATION_ID, "wild", {0: Constant(1.0, 1.0, 1.0)}, learned_from="",
                  episodes=20)  # fmt: skip
    (run,) = entry.runs
    assert 0.5 < run.unstable < 1 and -251 < run.mean < -150 and run.cost == 1
    (run,) = score(FEATURES_ID, "x", {0: Constant(0.0, 0.0)}, learned_from="", episodes=300).runs
    assert run.unstable == 0 and -2 < run.mean < 0


def test_files_are_read_as_written_and_the_page_ranks_them(tmp_path):
    entry = score(FEATURES_ID, "a", {0: Constant(0.0, 0.0), 1: Constant(0.1, 0.0)},
                  learned_from="nothing", training=3.0, episodes=9)  # fmt: skip
    assert Entry.load(entry.save(tmp_path)) == entry
    worse = replace(entry, name="b", runs=tuple(replace(r, mean=r.mean - 1) for r in entry.runs))
    page = leaderboard.page([worse, entry])
    assert page.index("`a` (9 episodes)") < page.index("`b` (9 episodes)")


def test_the_filter_is_above_the_window_alone():
    made, found = PIRecalibrationEnv().interface, []
    for remembers in (True, False):
        policy = leaderboard.Ruled(made, remembers)
        entry = score(RECALIBRATION_ID, "x", {0: policy}, learned_from="", episodes=24)
        found.append(entry.runs[0].mean)
    assert found[0] > 0.8 * found[1] > 1.6 * -10  # returns are negative


@pytest.mark.parametrize(
    "arguments, name",
    [
        ({"env": "CartPole-v1"}, "env"),
        ({"name": "../mine"}, "name"),
        ({"policies": {}}, "policies"),
        ({"episodes": -1}, "episodes"),
    ],
)
def test_wrong_arguments_are_refused(arguments, name):
    given = {"env": ENV_ID, "name": "mine", "policies": {0: Constant(1, 1)}} | arguments
    with pytest.raises(ValueError, match=name):
        score(**given, learned_from="nothing")
