"""Random episodes: known by set, seed and number, however they are asked for."""

import numpy as np
import pytest
from first_order import SIGMA, U, by_one, described, design, plant, simulate

from yawrate_env.plant.episodes import SETS, episodes, integers_of, ranges_of, recorded, sample
from yawrate_env.plant.noise import snr
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

SHORT = Experiment(Ts=0.004, N=100)
CARS = yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0)), experiment=SHORT))


def test_episodes_do_not_depend_on_how_they_are_asked_for():
    whole = recorded(plant, "test", 3, 140)
    parts = list(episodes(plant, "test", 3, 60, 80))
    assert [len(part) for part in parts] == [68, 12]
    for name in ("number", "theta", "y"):
        part = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(getattr(whole, name)[60:], part)
    again = recorded(plant, "test", 3, 140, repeat=1)
    np.testing.assert_array_equal(whole.theta, again.theta)
    noise, other = whole.y - plant.respond(whole.theta), again.y - plant.respond(again.theta)
    assert abs(np.corrcoef(noise.ravel(), other.ravel())[0, 1]) < 0.02
    assert noise.std() == pytest.approx(SIGMA, rel=0.02)


def test_long_episodes_come_in_parts_of_blocks_and_are_the_same(monkeypatch):
    asked = CARS, "test", 3, 60, 80
    whole = list(episodes(*asked))
    monkeypatch.setattr("yawrate_env.plant.episodes._OUTPUTS", 0)
    parts = list(episodes(*asked))
    assert [len(part) for part in whole] == [68, 12]
    assert [len(part) for part in parts] == [4, 32, 32, 12]
    for name in ("number", "theta", "y"):
        one, other = (np.concatenate([getattr(p, name) for p in e]) for e in (whole, parts))
        np.testing.assert_array_equal(one, other)


def test_sets_share_no_episode_whatever_the_seeds():
    keys = {
        row.tobytes()
        for tag in SETS.values()
        for seed in range(20)
        for row in stream((tag, seed), 0, 20, integers_of(plant))
    }
    assert len(keys) == len(SETS) * 20 * 20
    (trained,), (tested,) = (episodes(plant, name, 3, 0, 1) for name in ("train", "test"))
    assert (trained.theta != tested.theta).all()


def test_extrapolation_lies_outside_the_prior_where_the_plant_says():
    mu_s, M_delta, v_x = recorded(CARS, "extrapolation", 0, 200).theta.T
    assert mu_s.min() >= 1.1 and M_delta.min() >= 300
    assert 10 <= v_x.min() < 11 and 32 < v_x.max() <= 33
    with pytest.raises(ValueError, match="extrapolation"):
        ranges_of(plant, "extrapolation")


def test_unknown_sets_are_refused_by_name():
    with pytest.raises(ValueError, match="'tset'.*train, test"):
        recorded(plant, "tset", 0, 1)


def test_what_is_random_in_the_simulator_is_the_episodes_own():
    def wandering(theta, u, rng):
        y = simulate(theta, u, None)
        return y if rng is None else y + rng.standard_normal((len(theta), 1))

    own = described(simulate=wandering)
    whole = recorded(own, "test", 3, 70)
    part = next(episodes(own, "test", 3, 66, 4))
    np.testing.assert_array_equal(whole.y[66:], part.y)
    levels = (whole.y - simulate(whole.theta, U, None)).mean(axis=1)
    assert len(np.unique(levels.round(9))) == len(levels) and 0.7 < levels.std() < 1.3


def test_functions_of_one_plant_give_the_same():
    single = described(simulate=by_one(simulate), design=by_one(design), batched=False)
    (batch,), (one,) = (episodes(p, "test", 0, 0, 5) for p in (plant, single))
    np.testing.assert_array_equal(batch.y, one.y)
    np.testing.assert_array_equal(plant.oracle(batch.theta), single.oracle(batch.theta))


def test_noise_by_signal_to_noise_ratio():
    own = described(noise=snr(20.0))
    clean = own.respond(sample(own, 3))
    np.testing.assert_allclose(own.sigma(clean) ** 2, (clean**2).mean(axis=1) / 100)


def undefined_above_one(theta, gains):
    return np.where(gains[:, :1] > 1.0, np.inf, gains[:, :1])


def test_rewards_are_graded_and_unstable_loops_get_the_least():
    theta = sample(plant, 4)
    right = plant.oracle(theta)
    assert plant.reward(theta, right) == pytest.approx(np.zeros(4))
    # 30 % of one gain count as one, which is worth -1/(1 + 1/4).
    assert plant.reward(theta, right * [1.3, 1.0]) == pytest.approx(-0.8 * np.ones(4))
    assert (plant.reward(theta, right * np.nan) == -5).all()
    own = described(
        evaluate=undefined_above_one, metrics={"gain": 1.0}, design=lambda t: 0.5 + 0 * t
    )
    gains = np.array([[2.0, 1.0], [0.5, 1.0], [np.nan, 1.0]])
    np.testing.assert_array_equal(own.reward(theta[:3], gains), [-4, 0, -5])
