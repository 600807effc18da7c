"""The nonlinear study: its scores, its tables' numbers, and what it is timed against."""

import json
import math
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from recordings import ROOT

from studies import nonlinear, nonlinear_plots, nonlinear_speed, plots
from studies.draws import draw
from studies.nonlinear import GRAY, LINEAR, MISTAKEN, NONLINEAR, ORACLE, Score
from tuners import RECIPES
from yawrate_env.batch import take
from yawrate_env.vehicle.nonlinear import NonlinearTwin
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.yaw_rate import yaw_rate

NAMES = (LINEAR, GRAY, NONLINEAR, MISTAKEN, ORACLE)


def scores():
    """Errors that grow with the amplitude, ten times less for the tuner of the right twin."""
    return [
        Score(name, amplitude, low, 10, 0, amplitude * (0.1 if name == NONLINEAR else 1.0),
              0.1 * amplitude * (0.2 if name == NONLINEAR else 1.0), 3.0, 1.2, 1, 1.5)
        for amplitude in (1.0, 4.0) for name in NAMES for low in (False, True)
    ]  # fmt: skip


def test_the_page_shows_the_default_arguments():
    page = (ROOT / "docs" / "nonlinear.md").read_text()
    made = NonlinearTwin()
    for name in ("tyre", "body", "limits"):
        (text,) = re.findall(rf"\| `{name}=(\{{.*?\}})`", page)
        assert json.loads(text) == pytest.approx(asdict(getattr(made, name)), rel=1e-3)


def silent(*_):
    pass


def test_tables_and_json_hold_every_score_and_compare_the_twins():
    found = nonlinear.factors(scores())
    assert [(amplitude, low) for amplitude, low, *_ in found] == [
        (1.0, False), (1.0, True), (4.0, False), (4.0, True)
    ]  # fmt: skip
    np.testing.assert_allclose([row[2:] for row in found], [(10, 5)] * 4)
    text = nonlinear.to_markdown(scores())
    assert all(text.count(f"| {name} |") == 4 for name in NAMES)
    assert "| ±4° | low friction | 10.0 | 5.0 |" in text
    content = json.loads(nonlinear.to_json(scores(), [], training=60, seed=3))
    assert len(content["rows"]) == 20 and content["conditions"]["seed"] == 3
    assert content["conditions"]["task"]["twin"]["tyre"]["friction"] == 0.99


def test_the_picture_shows_tyre_response_and_both_errors(tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "DPI", 20)
    picture = nonlinear_plots.overview(scores())
    assert [axes.get_title(loc="left") for axes in picture.get_axes()[:2]] == [
        "Front axle", "±4° on $\\mu_s$ = 0.35"
    ]  # fmt: skip
    (legend,) = picture.subfigs[1].legends
    shown = [text.get_text() for text in legend.get_texts()]
    assert shown == [LINEAR, NONLINEAR, GRAY, MISTAKEN]
    plots.save(picture, tmp_path / "nonlinear.png")


def test_scipys_loop_agrees_with_what_it_is_timed_against():
    task = nonlinear.task_at(4.0)
    task = replace(task, experiment=replace(task.experiment, N=500))
    drawn = draw(yaw_rate(task), "test", 0, 0, 3)
    u, context = drawn.u, context_of(drawn.theta)
    few = take(context, slice(0, 1))
    truth = nonlinear_speed._loop(task, few, u, True, "DOP853", 1e-12)
    method, tolerance, error = nonlinear_speed._fastest(task, few, u, True, truth)
    assert error < nonlinear_speed.ERROR and tolerance in nonlinear_speed.TOLERANCES
    assert np.abs(nonlinear_speed.driven(task, context, u)[:1] - truth).max() < 1e-8
    assert method in nonlinear_speed.METHODS


@pytest.mark.slow
def test_training_on_the_nonlinear_twin_pays_at_four_degrees(monkeypatch):
    few = replace(RECIPES[nonlinear.RECIPE], noise_draws=4)
    monkeypatch.setattr(nonlinear, "RECIPE", few)
    found = nonlinear.study(24, 0, silent, training=60, amplitudes=(4.0,))
    for _, _, margin, crossover in nonlinear.factors(found):
        assert margin > 20 and crossover > 20  # hundreds with more vehicles
    assert all(math.isfinite(s.tracking_error) and s.unstable == 0 for s in found)
    by = {(s.tuner, s.low_friction): s.trusted for s in found}
    assert by[NONLINEAR, False] > 0.98 and by[NONLINEAR, True] > 0.95
    assert by[LINEAR, False] == by[MISTAKEN, True] == 0.0
    assert by[GRAY, False] == 0.0 and by[ORACLE, False] is None
    margin = {(s.tuner, s.low_friction): s.phase_margin for s in found}
    assert margin[ORACLE, False] < 1e-10 < margin[GRAY, False]
    mu_s = draw(yaw_rate(nonlinear.task_at(4.0)), "test", 0, 0, 24).theta[:, 0]
    episodes = {s.low_friction: s.episodes for s in found}
    assert episodes == {False: 24, True: (mu_s < 0.5).sum()} and 0 < episodes[True] < 24
