"""Drives that Minari loads are the environment's own, and scores have their ends."""

import minari
import numpy as np
import pytest

from tuners.data import DRIVE_BEHAVIOURS, DatasetError, export_drives, export_minari
from yawrate_env import RECALIBRATION_ID

SHORT = {"windows": 4, "window": 1.0}
NAME = "yawrate/drives-v0"


@pytest.fixture(autouse=True)
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("kwargs", [SHORT, SHORT | {"probing": 0.02}])
def test_every_drive_is_the_environments(kwargs):
    dataset = export_drives(NAME, 8, 3, env_kwargs=kwargs)
    env = dataset.recover_environment()
    assert env.spec.id == RECALIBRATION_ID and dataset.total_episodes == 8
    returns = np.zeros(8)
    for episode in dataset.iterate_episodes():
        shown, _ = env.reset(seed=3 + int(episode.id))
        np.testing.assert_array_equal(episode.observations[0], shown)
        for t, action in enumerate(episode.actions):
            shown, reward, terminated, truncated, _ = env.step(action)
            np.testing.assert_allclose(episode.observations[t + 1], shown, atol=1e-6)
            assert episode.rewards[t] == pytest.approx(reward, abs=1e-9)
            ended = episode.terminations[t], episode.truncations[t]
            assert ended == (terminated, truncated)
        assert terminated or truncated
        returns[episode.id] = episode.rewards.sum()
    uniform, perturbed, keep, oracle = returns.reshape(2, 4).mean(axis=0)
    assert uniform < perturbed < oracle and keep < oracle
    normal = minari.get_normalized_score(dataset, returns).reshape(2, 4).mean(axis=0)
    assert normal[3] == pytest.approx(1, abs=0.01) and normal[0] < normal[1] < 1


def test_a_drive_is_the_same_in_a_larger_set():
    small = export_drives(NAME, 3, 5, env_kwargs=SHORT)
    large = export_drives("yawrate/more-v0", 7, 5, env_kwargs=SHORT)
    for a, b in zip(small.iterate_episodes(), large.iterate_episodes(range(3)), strict=True):
        np.testing.assert_array_equal(a.actions, b.actions)


def test_one_step_sets_have_reference_scores_too():
    dataset = export_minari(NAME, 40, 3, env_kwargs={"Ts": 0.01, "N": 1000})
    metadata = dataset.storage.metadata
    assert metadata["ref_max_score"] == pytest.approx(0, abs=1e-6)
    rewards = np.array([episode.rewards[0] for episode in dataset.iterate_episodes()])
    scores = minari.get_normalized_score(dataset, rewards)
    assert scores[3::4] == pytest.approx(1, abs=1e-3) and abs(scores[::4].mean()) < 0.5


@pytest.mark.parametrize(
    "arguments, name",
    [
        ({"drives": 0}, "drives"),
        ({"behaviours": ("nominal",)}, "behaviour"),
        ({"behaviours": "oracle"}, "behaviours"),
        ({"env_kwargs": 3}, "env_kwargs"),
        ({"dataset_id": "drives"}, "dataset_id"),
    ],
)
def test_wrong_arguments_are_refused(arguments, name, root):
    with pytest.raises(ValueError, match=name):
        export_drives(**{"dataset_id": NAME, "drives": 2} | arguments)
    assert list(root.iterdir()) == [] and len(DRIVE_BEHAVIOURS) == 4


def test_a_name_that_is_taken_is_refused():
    export_drives(NAME, 1, env_kwargs=SHORT)
    with pytest.raises(DatasetError, match="drives-v0"):
        export_drives(NAME, 1, env_kwargs=SHORT)
