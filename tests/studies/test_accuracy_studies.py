"""The accuracy studies: same data for less work, nothing lost when killed, honest tallies."""

import json

import numpy as np
import pytest

import tuners
from studies import budget, learning, learning_plot, million, nested
from studies.rows import errors, row
from tuners import RECIPES
from tuners.features.laguerre import Laguerre
from tuners.tuner.evaluation import evaluate
from tuners.tuner.examples import examples
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())


class Half:
    """The nominal gains, and none that a loop can run with for every second episode."""

    method = tuners.load("nominal").method

    def act(self, recording):
        actions = tuners.load("nominal").act(recording)
        actions[::2] = np.nan
        return actions


@pytest.fixture
def untrained(monkeypatch):
    """Replace every training by the fixed controller; a list of what was asked for."""
    asked = []

    def trained(recipe, plant, parts, vehicles, draws, progress=None):
        asked.append((recipe, vehicles, draws, len(nested.first(parts, vehicles, draws))))
        tuner = tuners.load("nominal", plant)
        tuner.training["noise_draws"] = draws
        return tuner

    monkeypatch.setattr(nested, "trained", trained)
    return asked


def test_nested_sets_are_what_separate_simulations_give():
    stage, wanted = Laguerre(4, 12.0), {20: 3, 150: 1}
    parts = nested.simulate(PLANT, stage, wanted)
    assert [len(part) for part in parts] == [150, 20, 20]
    for vehicles, draws in wanted.items():
        alone = examples(PLANT, vehicles, 0, stage, noise_draws=draws)
        found = nested.first(parts, vehicles, draws)
        for name in ("number", "features", "usable"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


def test_noise_draws_give_way_to_vehicles():
    lag = RECIPES["ts-ff-lag"]
    assert [nested.noise_draws(lag, m) for m in (100, 3000, 10_000, 100_000)] == [12, 12, 4, 1]
    assert nested.noise_draws(RECIPES["ts-ff"], 100) == 1


def test_a_row_counts_what_has_no_margin_and_leaves_it_out():
    off = np.array([[3.0, 0.1], [np.nan, np.nan], [4.0, 0.3]])
    found = row("x", off, np.ones((3, 2)), vehicles=7)
    counts = [found[name] for name in ("name", "vehicles", "episodes", "unstable")]
    assert counts == ["x", 7, 3, 1]
    assert found["phase_margin"]["rms"] == pytest.approx(12.5**0.5)
    assert found["phase_margin"]["ratio"] == pytest.approx(12.5**0.5)
    off = errors(Half(), PLANT, 6, 0)
    assert np.isnan(off[::2]).all() and np.isfinite(off[1::2]).all()


def test_learning_goes_on_where_it_was_cut_off(tmp_path, untrained):
    path = tmp_path / "learning.json"

    def learn(vehicles):
        return learning.learn(path, vehicles, episodes=4)

    before = learn([60])
    assert json.loads(path.read_text())["rows"] == before
    assert len(untrained) == 4 and {vehicles for _, vehicles, _, _ in untrained} == {60}
    assert sorted(rows for _, _, _, rows in untrained) == [60, 60, 720, 720]  # 12 noise draws
    untrained.clear()
    kept = json.loads(path.read_text())
    kept["rows"] = [r for r in kept["rows"] if r["name"] not in ("gb", "ts-ff")]
    path.write_text(json.dumps(kept))
    after = learn([60, 70])
    again = {(recipe.features, vehicles) for recipe, vehicles, _, _ in untrained}
    assert len(untrained) == 5 and (RECIPES["ts-ff"].features, 60) in again
    assert len(after) == 3 + 8 and len({(r["name"], r["vehicles"]) for r in after}) == 11
    with pytest.raises(ValueError, match="'episodes': 4.*not.*'episodes': 5.*Delete"):
        learning.learn(path, [60], episodes=5)

    axes = learning_plot.curves(after).axes
    assert len(axes) == 2
    for panel, metric in zip(axes, ("phase_margin", "crossover"), strict=True):
        drawn = {tuple(line.get_ydata()) for line in panel.get_lines()}
        values = {n: [r[metric]["rms"] for r in after if r["name"] == n] for n in learning.TUNERS}
        assert {tuple(v) for v in values.values()} <= drawn


def test_the_budget_adds_losses_step_by_step(untrained):
    rows = budget.budget(budget.Sizes(episodes=6, vehicles=60, many=70))
    steps = {t: [r["name"] for r in rows if r["tuner"] == t] for t in ("", *budget.TUNERS)}
    assert [len(s) for s in steps.values()] == [3, 5, 5, 6, 6]
    assert "averages" in steps["ts-ff"][0] and "averages" not in str(steps["ts-ff-lag"])
    for tuner in budget.TUNERS:
        informed = [r for r in rows if r["tuner"] == tuner and "information" in r["name"]]
        ratios = [1.0, *(r["phase_margin"]["ratio"] for r in informed)]
        assert (np.diff(ratios) > 0).all()
    # One best network a first stage, the own learner thrice; only the last predicts gains.
    assert len(untrained) == 2 * (1 + 2 * 3)
    assert sum(recipe.parametrisation == "gains" for recipe, *_ in untrained) == 4
    assert sum(recipe.learner == budget.BEST for recipe, *_ in untrained) == 2


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr(million, "CHUNK", 32)
    monkeypatch.setattr(million, "_BATCH", 16)


def test_a_killed_million_goes_on_to_the_same_end(tmp_path, small_chunks):
    players = {"nominal": tuners.load("nominal")}
    whole = million.run(players, 100, tmp_path / "whole.json")

    def die(what, done, of):
        raise KeyboardInterrupt

    for done in (32, 64):
        with pytest.raises(KeyboardInterrupt):
            million.run(players, 100, tmp_path / "killed.json", progress=die)
        assert json.loads((tmp_path / "killed.json").read_text())["done"] == done
    seen = []
    million.run(players, 100, tmp_path / "killed.json", progress=lambda *now: seen.append(now))
    assert seen == [("episodes", 96, 100), ("episodes", 100, 100)]
    assert (tmp_path / "killed.json").read_text() == (tmp_path / "whole.json").read_text()
    assert million.run(players, 100, tmp_path / "whole.json") == whole  # nothing left to do
    with pytest.raises(ValueError, match="another seed.*Delete"):
        million.run(players, 100, tmp_path / "whole.json", seed=5)


def test_the_tally_against_all_the_numbers(tmp_path, small_chunks):
    state = million.run({"nominal": tuners.load("nominal")}, 100, tmp_path / "m.json", seed=7)
    players = {"": tuners.load("nominal")}
    (found,) = evaluate(players, PLANT, "test", episodes=100, seed=7, batch=16)
    tally = state["tuners"]["nominal"]
    assert tally["unstable"] == (~found.stable).sum()
    names = ("phase_margin", 60.0), ("crossover", 1.5)
    for (name, target), values in zip(names, found.metrics.T, strict=True):
        entry = tally[name]
        for end, at in (("lowest", values.argmin()), ("highest", values.argmax())):
            assert entry[end]["episode"] == at and entry[end]["value"] == values[at]
            assert entry[end]["mu_s"] == found.theta[at, 0]
        off = np.sort(abs(values - target))
        assert entry["squares"] == pytest.approx((off**2).sum())
        for level, k in ((0.5, 49), (0.9, 89), (0.99, 98)):
            assert 1 <= million.quantile(entry, level) / off[k] <= million._GROWTH


def test_what_has_no_loop_is_counted_as_unstable(tmp_path, small_chunks):
    state = million.run({"half": Half()}, 40, tmp_path / "m.json")
    tally = state["tuners"]["half"]
    assert tally["unstable"] == 20 and sum(tally["crossover"]["histogram"].values()) == 20
    assert "Unstable loops: `half` 20" in million.to_markdown(state)
