"""Learners beside the agents that gather episodes: from Minari's sets, and from raw samples."""

import numpy as np
import pytest
from first_order import plant

from studies import comparison, offline, transformer
from studies.comparison import Score
from tuners.tuner.evaluation import evaluate

SMALL = transformer.Settings(decimate=2, samples=25, layers=1, width=16, heads=2, epochs=25,
                             batch=32, rate=5e-3)  # fmt: skip


def silent(*_):
    pass


def test_tokens_are_averages_piece_by_piece():
    u, y = np.arange(100.0)[None], np.stack([np.arange(100.0), -np.arange(100.0)])
    found = transformer.tokens(u, y, SMALL, (1.0, 2.0))
    assert found.shape == (2, 2, 50) and found.dtype == np.float32
    np.testing.assert_allclose(found[1, 1, :25], 50.5 + 2 * np.arange(25))
    np.testing.assert_allclose(found[1, :, 25:], -found[0, :, :25] / 2)


@pytest.mark.slow
def test_a_transformer_learns_gains_from_samples():
    tuner = transformer.trained(plant, 700, 0, SMALL, silent)
    (found,) = evaluate({"x": tuner}, plant, "test", episodes=200, seed=0, batch=50)
    oracle, gains = plant.oracle(found.theta), found.gains
    spread = np.log(oracle).std(axis=0)
    error = np.sqrt(((np.log(gains) - np.log(oracle)) ** 2).mean(axis=0))
    assert (error < 0.3 * spread).all()


@pytest.fixture
def sets(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


@pytest.mark.slow
def test_offline_agents_are_scored_and_find_their_sets_again(sets):
    calls = []
    found = list(offline.scores(400, 1, lambda *call: calls.append(call)))
    assert [s.name for s in found] == list(offline.AGENTS)
    by_name = {s.name: s for s in found}
    assert by_name["naf-offline"].error < 0.5 * by_name["bc-offline"].error
    assert {what for what, _, _ in calls} == {"exporting", *offline.AGENTS}
    calls.clear()
    offline.dataset("mixture", 400, lambda *call: calls.append(call))
    assert calls == []


def test_cloning_gives_the_mean_action():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(2000, 2))
    a = 0.5 * np.tanh(x) + rng.choice([-0.3, 0.3], x.shape)
    off = offline.cloned(x, a, 0)(x[:200]) - 0.5 * np.tanh(x[:200])
    assert np.sqrt((off**2).mean()) < 0.06  # the actions scatter by 0.3


def test_they_have_a_table_of_their_own():
    def made(name):
        return Score(name, 1000, 0, 0.1, (60.0, 0.1), (1.5, 0.01), 0, 3.0)

    alone = comparison.to_markdown([made("sac-laguerre")])
    both = comparison.to_markdown([made("sac-laguerre"), made("naf-offline")])
    assert both.startswith(alone) and "naf-offline" not in alone
    assert "| `naf-offline` | 1000 |" in both[len(alone) :]
    assert set(offline.AGENTS) | {transformer.NAME} == set(comparison.OTHERS)
