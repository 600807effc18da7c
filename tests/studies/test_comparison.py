"""Scores of agents and tuners, how seeds are summed up, and the learning curves."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from scipy.stats import trim_mean

from studies import comparison, curve_plots, palette, plots
from studies.comparison import Score, curve, interquartile_mean
from tuners.agents import training as rl_training
from tuners.agents.settings import Training
from tuners.tuner.evaluation import Evaluation
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate


def made(name="sac", episodes=1000, seed=0, error=0.1, std=0.5, seconds=9.0):
    return Score(name, episodes, seed, error, (60.1, std), (1.49, 0.01), 0, seconds)


def test_interquartile_mean():
    for values, expected in (
        ([3.0], 3.0),
        ([0.0, 6.0, 30.0], (0.25 / 3 * 0 + 6 / 3 + 0.25 / 3 * 30) / 0.5),
        ([1000.0, 1.0, 2.0, -100.0], 1.5),  # the middle two
        ([9.0, 1.0, 2.0, 3.0, 0.0], (0.15 * 1 + 0.2 * 2 + 0.15 * 3) / 0.5),
    ):
        assert interquartile_mean(np.array(values)) == pytest.approx(expected)
        assert interquartile_mean(-3 * np.array(values) + 2) == pytest.approx(2 - 3 * expected)
    values = np.random.default_rng(0).normal(size=(3, 12))  # whole quarters: the trimmed mean
    np.testing.assert_allclose(interquartile_mean(values), trim_mean(values, 0.25, axis=1))


def test_curve_has_a_point_a_size():
    scores = [made(episodes=n, seed=s, error=n + s) for n in (2000, 500) for s in range(5)]
    found = curve([*scores, made("other")], "sac", lambda s: s.error)
    assert list(found) == [500, 2000]
    for n, (middle, low, high) in found.items():
        assert middle == pytest.approx(n + 2)
        assert n <= low < middle < high <= n + 4


def test_scores_sum_up_the_margins():
    pm, fc = np.array([50.0, 60.0, 70.0, 60.0]), np.array([1.5, 1.5, 1.5, 2.0])
    plant, metrics = yaw_rate(Task()), np.stack([pm, fc], axis=1)
    stable = np.array([True, True, False, True])
    theta = np.repeat(plant.middle, 4, axis=0)
    given = Evaluation("x", plant, theta, metrics, metrics, stable, pm)
    found = comparison.score(given, 500, 3, 12.0)
    assert (found.name, found.episodes, found.seed, found.seconds) == ("x", 500, 3, 12.0)
    assert found.error == pytest.approx((1 + 0 + 1 + 2) / 4)
    assert found.phase_margin == pytest.approx((60, np.sqrt(50)))
    assert found.crossover == pytest.approx((1.625, np.std(fc)))
    assert found.unstable == 1
    metrics[0, 0] = np.nan
    assert np.isnan(comparison.score(given, 500, 3).error)


def test_written_scores_can_be_read(tmp_path):
    scores = [made(seed=i, std=std) for i, std in enumerate((0.3, 0.1, 0.2))]
    comparison.write(scores, tmp_path / "new")
    read = json.loads((tmp_path / "new" / "rl.json").read_text())
    assert [Score(**r).seed for r in read] == [0, 1, 2]
    assert read[0]["phase_margin"] == [60.1, 0.3]
    assert (tmp_path / "new" / "rl.md").read_text() == comparison.to_markdown(scores)
    # What is stored stays, unless it was found again.
    again = [made(seed=1, std=0.7), made("other")]
    kept = comparison.write(again, tmp_path / "new")
    assert [(s.name, s.seed, s.phase_margin[1]) for s in kept] == [
        ("sac", 0, 0.3), ("sac", 2, 0.2), ("sac", 1, 0.7), ("other", 0, 0.5),
    ]  # fmt: skip


def test_the_table_has_errors_with_bias_and_their_ratio_to_the_bound():
    bound = Score(comparison.BOUND, 0, 0, 0.0, (60.0, 0.05), (1.5, 0.01), 0)
    scores = [bound, *(made(seed=i, std=std) for i, std in enumerate((0.3, 0.1, 0.2)))]
    *_, median = comparison.to_markdown(scores).splitlines()
    margin, crossover = np.hypot(0.1, 0.2), np.hypot(0.01, 0.01)
    for value in (f"{margin:.3g}", f"{margin / 0.05:.3g} / {crossover / 0.01:.3g}", "median of 3"):
        assert value in median


class Saved:
    def __init__(self, content):
        self.content = content

    def save(self, path):
        path.write_text(self.content)


def test_agents_are_trained_once_for_each_length(monkeypatch, tmp_path):
    training = []

    def snapshots(settings, plant, at, *, progress=None):
        training.append((settings, at))
        return [(n, Saved(f"{settings.seed} {n} of {at[-1]}")) for n in at]

    monkeypatch.setattr(rl_training, "snapshots", snapshots)
    first = comparison.agents(Training(episodes=1500, seed=4), tmp_path / "rl")
    assert first == comparison.agents(Training(episodes=1500, seed=4), tmp_path / "rl")
    ((asked, at),) = training
    assert (asked.seed, asked.episodes, at) == (4, 1500, (500, 1000, 1500))
    for n, (path, seconds) in first.items():
        assert path.name == f"naf-laguerre-4-{n}.tuner" and seconds >= 0
        assert path.read_text() == f"4 {n} of 1500"
    # The learning rate falls over the whole training: its first part is not a shorter one.
    found = comparison.agents(Training(episodes=2000, seed=4), tmp_path / "rl")
    assert len(training) == 2 and found[500][0].read_text() == "4 500 of 2000"
    assert comparison.sizes(20_000) == [500, 1000, 2000, 5000, 10_000, 20_000]
    assert comparison.sizes(100) == [100]


@pytest.mark.slow
def test_everything_is_trained_and_tested(tmp_path, monkeypatch):
    torch.set_num_threads(1)
    monkeypatch.setattr(comparison, "EPISODES", (60, 128))
    monkeypatch.setattr(comparison, "TEST_EPISODES", 20)
    calls = []

    def found():
        return comparison.compare(
            [("ppo", "laguerre")], 2, 128, tmp_path, lambda *c: calls.append(c)
        )

    scores = found()
    listed = [(s.name, s.episodes, s.seed) for s in scores]
    assert listed == [
        *((name, 0, 0) for name in ("gb", "bb", "vrft", "frit", "oracle", "nominal")),
        (comparison.BOUND, 0, 0),
        *(("ff-laguerre", n, 0) for n in (60, 128)),
        *(("ppo-laguerre", n, seed) for seed in (0, 1) for n in (60, 128)),
    ]
    by_name = {s.name: s for s in scores}
    assert by_name["oracle"].error < 1e-9 < by_name["gb"].error < by_name["nominal"].error
    assert all((s.seconds > 0) == (s.name == "ppo-laguerre") for s in scores)
    assert "training rl-ppo" in {what for what, _, _ in calls}
    monkeypatch.setattr(rl_training, "snapshots", None)  # found again
    again = comparison.agents(Training("ppo", "laguerre", 128, seed=1), tmp_path)
    assert [seconds for _, seconds in again.values()] == [s.seconds for s in scores[-2:]]


def all_scores():
    scores = [made(name, 0, error=e, std=e, seconds=0.0)
              for name, e in (("gb", 1e-4), ("oracle", 0.0), ("nominal", 1.0))]  # fmt: skip
    for n in (500, 1000, 2000):
        scores.append(made("ts-ff", n, error=1 / n, std=2 / n, seconds=0.0))
        scores += [made("sac-laguerre", n, s, 99 / n + s, 9 / n + s) for s in range(3)]
    return scores


def texts(axes):
    return [text.get_text() for text in axes.texts]


def test_learning_curves_show_all_but_the_oracle():
    figure = curve_plots.learning_curves(all_scores())
    assert isinstance(figure, Figure) and figure.get_figwidth() == palette.WIDTH
    for axes, first in zip(figure.axes, (99 / 500, 9 / 500), strict=True):
        assert axes.get_xscale() == axes.get_yscale() == "log"
        assert texts(axes) == ["gb", "ts-ff", "nominal", "sac-laguerre"]  # from below
        drawn = {line.get_color(): line for line in axes.get_lines()}
        agent = drawn[palette.colour("sac-laguerre")]
        assert list(agent.get_xdata()) == [500, 1000, 2000]
        assert agent.get_ydata()[0] == pytest.approx(first + 1)
        assert drawn[palette.colour("ts-ff")].get_marker() == "o"
        assert list(drawn[palette.colour("gb")].get_ydata()) == [1e-4] * 2
        assert len(axes.collections) == 1  # the agent's band
        low, high = axes.get_ylim()
        assert low < 1e-4 and high > 2
    above, below = figure.axes
    assert "[1 = 10° or 0.25 Hz]" in above.get_ylabel() and "[deg]" in below.get_ylabel()
    assert "3 seeds" in figure.get_supxlabel() and "oracle" in figure.get_supxlabel()


def test_learning_curves_of_undefined_errors_and_of_one_seed(tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "DPI", 20)
    scores = [*all_scores(), *(made("ppo", n, error=np.nan, std=1 / n) for n in (500, 1000))]
    scores = [replace(s, error=np.nan) if s.episodes == 500 else s for s in scores]
    figure = curve_plots.learning_curves(scores)
    assert ["ppo" in texts(axes) for axes in figure.axes] == [False, True]
    plots.save(figure, tmp_path / "curves.png")
    figure = curve_plots.learning_curves([s for s in all_scores() if s.seed == 0])
    assert "one seed" in figure.get_supxlabel()
    plots.save(figure, tmp_path / "curves.png")
