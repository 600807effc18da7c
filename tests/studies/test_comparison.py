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
from studies.metrics import bootstrap_interval
from tuners.agents import training as rl_training
from tuners.agents.settings import Training
from tuners.tuner.evaluation import Evaluation
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate


def made(name="sac", episodes=1000, seed=0, error=0.1, std=0.5, seconds=9.0):
    return Score(name, episodes, seed, error, (60.1, std), (1.49, 0.01), 0, seconds)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([3.0], 3.0),
        ([1.0, 2.0], 1.5),
        ([0.0, 6.0, 30.0], (0.25 / 3 * 0 + 6 / 3 + 0.25 / 3 * 30) / 0.5),
        ([1000.0, 1.0, 2.0, -100.0], 1.5),  # the middle two
        ([9.0, 1.0, 2.0, 3.0, 0.0], (0.15 * 1 + 0.2 * 2 + 0.15 * 3) / 0.5),
    ],
)
def test_interquartile_mean_of_a_few(values, expected):
    assert interquartile_mean(np.array(values)) == pytest.approx(expected)


@pytest.mark.parametrize("count", [8, 12, 40])
def test_interquartile_mean_is_the_trimmed_mean_where_quarters_are_whole(count):
    values = np.random.default_rng(count).normal(size=(3, count))
    np.testing.assert_allclose(interquartile_mean(values), trim_mean(values, 0.25, axis=1))


def test_interquartile_mean_is_equivariant_and_ignores_the_order():
    values = np.random.default_rng(0).normal(size=7)
    expected = interquartile_mean(values)
    assert interquartile_mean(values[::-1]) == pytest.approx(expected)
    assert interquartile_mean(3 * values + 2) == pytest.approx(3 * expected + 2)
    assert interquartile_mean(-values) == pytest.approx(-expected)


def test_interval_has_the_width_of_a_trimmed_normal_mean():
    values = np.random.default_rng(2).normal(size=2000)
    low, high = bootstrap_interval(values, interquartile_mean)
    # Asymptotic variance of the 25 % trimmed mean of a normal sample: 1.195/n.
    assert (high - low) == pytest.approx(2 * 1.96 * np.sqrt(1.195 / 2000), rel=0.1)


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
    assert found.crossover == pytest.approx((1.625, pytest.approx(np.std(fc))))
    assert found.unstable == 1
    metrics[0, 0] = np.nan
    assert np.isnan(comparison.score(given, 500, 3).error)


def test_sizes_end_where_the_training_does():
    assert comparison.sizes(20_000) == [500, 1000, 2000, 5000, 10_000, 20_000]
    assert comparison.sizes(3000) == [500, 1000, 2000, 3000]
    assert comparison.sizes(100) == [100]


# --- tables and files


def seeds(name="sac", stds=(0.3, 0.1, 0.2), **others):
    return [made(name, seed=i, std=std, **others) for i, std in enumerate(stds)]


def test_written_scores_can_be_read(tmp_path):
    comparison.write(seeds(), 1000, tmp_path / "new")
    read = json.loads((tmp_path / "new" / "rl.json").read_text())
    assert [Score(**r).seed for r in read] == [0, 1, 2]
    assert read[0]["phase_margin"] == [60.1, 0.3]
    assert (tmp_path / "new" / "rl.md").read_text() == comparison.to_markdown(seeds(), 1000)


class Saved:
    def __init__(self, content):
        self.content = content

    def save(self, path):
        path.write_text(self.content)


@pytest.fixture
def training(monkeypatch):
    """A training that only counts."""
    asked = []

    def snapshots(settings, plant, at, *, progress=None):
        asked.append((settings, at))
        return [(n, Saved(f"{settings.seed} {n} of {at[-1]}")) for n in at]

    monkeypatch.setattr(rl_training, "snapshots", snapshots)
    return asked


def test_agents_are_trained_once(training, tmp_path):
    settings = Training(episodes=1500, seed=4)
    first = comparison.agents(settings, tmp_path / "rl")
    assert list(first) == [500, 1000, 1500]
    assert first == comparison.agents(settings, tmp_path / "rl")
    ((asked, at),) = training
    assert (asked.seed, asked.episodes, at) == (4, 1500, (500, 1000, 1500))
    for n, (path, seconds) in first.items():
        assert path.name == f"sac-laguerre-4-{n}.tuner" and seconds >= 0
        assert path.read_text() == f"4 {n} of 1500"


def test_agents_of_another_length_are_trained_again(training, tmp_path):
    # The learning rate falls over the whole training: its first part is not a shorter one.
    comparison.agents(Training(episodes=1500), tmp_path)
    found = comparison.agents(Training(episodes=2000), tmp_path)
    assert len(training) == 2
    assert found[500][0].read_text() == "0 500 of 2000"


@pytest.mark.slow
def test_everything_is_trained_and_tested(tmp_path, monkeypatch):
    torch.set_num_threads(1)
    monkeypatch.setattr(comparison, "EPISODES", (60, 256))
    monkeypatch.setattr(comparison, "TEST_EPISODES", 30)
    calls = []

    def found():
        return comparison.compare(
            [("ppo", "laguerre")], 2, 256, tmp_path, lambda *c: calls.append(c)
        )

    scores = found()
    listed = [(s.name, s.episodes, s.seed) for s in scores]
    assert listed == [
        *((name, 0, 0) for name in ("gb", "oracle", "nominal")),
        *((name, n, 0) for n in (60, 256) for name in ("ts-gbm", "ts-ff")),
        *(("ppo-laguerre", n, seed) for seed in (0, 1) for n in (60, 256)),
    ]
    by_name = {s.name: s for s in scores}
    assert by_name["oracle"].error < 1e-9 < by_name["gb"].error < by_name["nominal"].error
    assert all((s.seconds > 0) == (s.name == "ppo-laguerre") for s in scores)
    assert "training rl" in {what for what, _, _ in calls}
    monkeypatch.setattr(rl_training, "snapshots", None)  # found again
    assert found()[-4:] == scores[-4:]


# --- the picture


def all_scores():
    scores = [made(name, 0, error=e, std=e, seconds=0.0)
              for name, e in (("gb", 1e-4), ("oracle", 0.0), ("nominal", 1.0))]  # fmt: skip
    for n in (500, 1000, 2000):
        scores += [made(name, n, error=1 / n, std=2 / n, seconds=0.0) for name in ("ts-ff",)]
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


def test_learning_curves_leave_out_what_is_undefined(tmp_path):
    scores = [*all_scores(), *(made("ppo", n, error=np.nan, std=1 / n) for n in (500, 1000))]
    scores = [replace(s, error=np.nan) if s.episodes == 500 else s for s in scores]
    figure = curve_plots.learning_curves(scores)
    assert ["ppo" in texts(axes) for axes in figure.axes] == [False, True]
    plots.save(figure, tmp_path / "curves.png")


def test_one_seed_has_no_interval(tmp_path):
    figure = curve_plots.learning_curves([s for s in all_scores() if s.seed == 0])
    assert "one seed" in figure.get_supxlabel()
    plots.save(figure, tmp_path / "curves.png")


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ([], []),
        ([0.1, 0.5], [0.1, 0.5]),
        ([0.5, 0.5], [0.45, 0.55]),
        ([0.1, 0.5, 0.52, 0.9], [0.1, 0.46, 0.56, 0.9]),
        ([0.3, 0.45, 0.45, 0.45], [0.2625, 0.3625, 0.4625, 0.5625]),  # they push the first
    ],
)
def test_names_keep_apart(wanted, expected):
    assert curve_plots.apart(np.array(wanted), 0.1) == pytest.approx(expected)
