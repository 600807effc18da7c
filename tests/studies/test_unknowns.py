"""The study of what the paper leaves open."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from studies import unknowns, unknowns_page
from studies.unknowns import PAPER, Setting
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.task import Task

BASE = Setting()


def row(factors=None, **changes):
    spreads = {name: list(np.multiply(values, (factors or {}).get(name, 1.0)))
               for name, values in PAPER.items()}  # fmt: skip
    return {"setting": asdict(replace(BASE, **changes)), "spreads": spreads, "without": 0.0}


def test_each_setting_is_changed_alone_and_once():
    settings = unknowns.one_at_a_time(BASE)
    assert settings[0] == BASE and len(set(settings)) == len(settings)
    differences = [sum(a != b for a, b in zip(asdict(s).values(), asdict(BASE).values(),
                       strict=True)) for s in settings[1:]]  # fmt: skip
    assert differences.count(1) == len(differences) - 1  # a slower recording slows the model too
    assert unknowns.at_random(5, 1) == unknowns.at_random(5, 1) != unknowns.at_random(5, 2)


def test_nothing_is_faster_than_the_recording():
    made = replace(BASE, Ts=0.01, bit_time=0.001).possible
    assert made.bit_time == made.Ts_armax == 0.01
    assert len(made.plant.u) == 1000


def test_the_distance_is_a_factor():
    assert unknowns.distance(row()) == pytest.approx(1)
    assert unknowns.distance(row(dict.fromkeys(PAPER, 0.5))) == pytest.approx(2)
    only = row({"gb": 1 / 26})
    assert unknowns.distance(only, ("ts-ff", "ts-gbm")) == pytest.approx(1)
    assert unknowns.distance(only) == pytest.approx(26 ** (1 / np.sqrt(3)))


def test_free_responses_offset_and_dead_time_are_told_from_the_vehicle():
    setting = replace(BASE, estimated=unknowns.DEAD_TIME)
    plant, theta = setting.plant, np.array([[0.7, 150.0, 20.0]])
    Q = np.linalg.qr(unknowns.nuisance(plant, setting, theta)[0].T)[0]
    found = plants(Task().vehicle, context_of(theta), plant.Ts)
    x, free = np.random.default_rng(0).standard_normal(6), []
    for _ in range(len(plant.u)):
        free.append(found.C.ravel()[:6] @ x)
        x = found.A[0] @ x
    late = plant.respond(theta, np.concatenate([plant.u[:1] * 0, plant.u[:-1]])[None])[0]
    for signal in (np.array(free), np.full(len(plant.u), 2.0), late - plant.respond(theta)[0]):
        left = signal - Q @ (Q.T @ signal)
        assert np.linalg.norm(left) < 1e-3 * np.linalg.norm(signal)


def test_a_gray_box_that_estimates_more_spreads_more_and_the_amplitude_changes_nothing():
    def spread(**changes):
        setting = replace(BASE, Ts=0.01, Ts_armax=0.01, **changes)
        return unknowns.gray_box(setting.plant, setting, 10, 0)

    levels = [spread(estimated=each) for each in unknowns.LEVELS["estimated"]]
    assert all((b >= a * (1 - 1e-9)).all() for a, b in zip(levels, levels[1:], strict=False))
    np.testing.assert_allclose(spread(amplitude=5.0), levels[0], rtol=1e-6)


def test_the_page_says_what_explains_and_what_does_not():
    far, near = row({"gb": 0.04}), row({"gb": 0.9}, v_x=30.0)
    assert "we do not know" in unknowns_page.page([far], 1500, 300, 0)
    text = unknowns_page.page([far, near], 1500, 300, 0)
    assert "we do not know" not in text and "v_x 30.0" in text
    assert len(unknowns_page.picture([far, near]).axes) >= 2


def test_rows_are_kept_and_other_sizes_refused(tmp_path, monkeypatch):
    made = []

    def row_of(setting, *sizes):
        made.append(setting)
        return row(v_x=setting.v_x)

    monkeypatch.setattr(unknowns, "row_of", row_of)
    path, settings = tmp_path / "u.json", [BASE, replace(BASE, v_x=30.0)]
    unknowns.study(settings[:1], path, 100, 10, 0)
    rows = unknowns.study(settings, path, 100, 10, 0)
    assert made == settings
    assert [r["setting"]["v_x"] for r in rows] == [20.0, 30.0]
    with pytest.raises(ValueError, match="vehicles"):
        unknowns.study(settings, path, 200, 10, 0)
