"""One tuner over all speeds: as a policy, its schedule, its accuracy, a wrong schedule."""

import json

import gymnasium
import numpy as np
import pytest

import tuners
import yawrate_env
from studies import draws, pictures, plots, schedule, schedule_page
from studies.bounds import bound_on
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

RANGE = (10.0, 33.0)
PLANT = yaw_rate(Task(prior=Prior(v_x=RANGE)))
GRAY = tuners.load("gb", PLANT)
# Phase margin [deg] and crossover [Hz] of every loop below: two to three times what was measured.
NEAR = (0.3, 0.005)


@pytest.fixture(scope="module")
def learned():
    return tuners.load("ts-ff-lag-vx")


@pytest.fixture(scope="module")
def rows(learned):
    return [
        schedule.schedule(learned, *v, [10.0, 15.0, 20.0, 25.0, 30.0, 33.0])
        for v in schedule.vehicles(PLANT)
    ]


def test_it_acts_where_the_speed_is_part_of_the_observation(learned):
    envs = gymnasium.make_vec(yawrate_env.ENV_ID, num_envs=24, visible="speed", v_x=list(RANGE))
    obs, _ = envs.reset(seed=3)
    assert obs.shape[1] == 3 and np.ptp(obs[:, 2, 0]) > 10
    actions, _ = learned.predict(obs)
    np.testing.assert_allclose(learned.predict(obs[0])[0], actions[0], rtol=1e-9)
    *_, step_info = envs.step(actions)
    info = step_info["final_info"]
    assert info["stable"].all()
    assert abs(info["phase_margin"] - 60).max() < NEAR[0]
    assert abs(info["crossover"] - 1.5).max() < NEAR[1]
    envs.close()


def test_without_the_speed_it_says_what_is_missing(learned):
    with gymnasium.make(yawrate_env.ENV_ID, v_x=list(RANGE)) as env:
        obs, _ = env.reset(seed=0)
        with pytest.raises(ValueError, match="v_x is needed"):
            learned.predict(obs)


def test_the_schedule_is_the_oracles_within_the_tuners_accuracy(rows):
    assert schedule.vehicles(PLANT) == [
        (pytest.approx(0.7), 150.0), (0.3, 0.0), (0.3, 300.0), (1.1, 0.0), (1.1, 300.0),
    ]  # fmt: skip
    for row in rows:
        assert np.abs(np.array(row.phase_margin) - 60).max() < NEAR[0]
        assert np.abs(np.array(row.crossover) - 1.5).max() < NEAR[1]
        np.testing.assert_allclose(row.kp, row.oracle_kp, rtol=NEAR[1])
        count = len(row.v_x)
        theta = np.stack([np.full(count, row.mu_s), np.full(count, row.M_delta), row.v_x], axis=1)
        gains = np.stack([row.oracle_kp, row.oracle_Ti], axis=1)
        np.testing.assert_allclose(PLANT.errors(theta, gains), 0, atol=1e-6)


def test_bins_hold_all_episodes_and_their_own_bound():
    edges, episodes = [10.0, 21.0, 33.0], 60
    calls = []
    bins = schedule.accuracy(GRAY, edges, episodes=episodes, progress=lambda *c: calls.append(c))
    assert sum(b.episodes for b in bins) == episodes and calls[-1][1:] == (episodes, episodes)
    v_x = draws.draw(PLANT, "test", 0, 0, episodes).theta[:, 2]
    bound = bound_on(PLANT, "test", 0, episodes)
    for b in bins:
        inside = (v_x >= b.low) & (v_x < b.high)
        assert b.episodes == inside.sum()
        assert b.phase_margin.bound == pytest.approx(np.sqrt((bound[inside, 0] ** 2).mean()))
        # Four standard errors of a ratio over that many episodes, of two parameters' errors.
        assert b.phase_margin.ratio == pytest.approx(1, abs=4 / np.sqrt(2 * b.episodes))
    with pytest.raises(ValueError, match="episodes = 0"):
        schedule.accuracy(GRAY, edges, episodes=0)


def test_a_metre_a_second_costs_three_to_four_degrees(rows, tmp_path, monkeypatch):
    found = schedule.price("gb", tuners.load("gb"), 20.0, episodes=20)
    errors = [c.phase_margin.rms for c in found.cells]
    assert 2.5 < found.degrees < 4.5
    assert errors[3] < 0.02 and errors == sorted(errors[:4], reverse=True) + sorted(errors[4:])
    assert [c.trusted_misses for c in found.cells] == [0] * 7

    monkeypatch.setattr(plots, "DPI", 20)
    bins = schedule.accuracy(GRAY, [10.0, 20.0, 33.0], episodes=20)
    schedule_page.write(rows, bins, [found], 20, 0, tmp_path)
    read = json.loads((tmp_path / "schedule.json").read_text())
    assert len(read["schedule"]) == 5 and len(read["accuracy"]) == 2
    assert read["wrong_speed"][0]["degrees"] == pytest.approx(found.degrees)
    text = (tmp_path / "schedule.md").read_text()
    assert "| 10 to 20 |" in text and "| `gb` | 20 m/s |" in text
    figure = pictures.schedule(rows, bins, [found])
    kp, Ti, errors, wrong = figure.axes
    assert len(kp.get_lines()) == len(Ti.get_lines()) == 2 * len(rows)
    np.testing.assert_array_equal(kp.get_lines()[0].get_ydata(), rows[0].oracle_kp)
    np.testing.assert_array_equal(kp.get_lines()[1].get_ydata(), rows[0].kp)
    assert errors.get_yscale() == "log" and wrong.get_ylim()[0] == 0
    plots.save(figure, tmp_path / "schedule.png")
