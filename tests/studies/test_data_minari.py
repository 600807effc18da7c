"""What Minari loads is what the environment gives."""

import gymnasium
import minari
import numpy as np
import pytest
from data_sets import cars
from first_order import described, gauged
from first_order import plant as first_order

from tuners.data import BEHAVIOURS, DatasetError, export_minari
from tuners.data.minari_export import _buffers
from yawrate_env import ENV_ID, FEATURES_ID, PLANT_FEATURES_ID, PLANT_ID
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

SHORT = {"Ts": 0.01, "N": 1000}
VEHICLES = yaw_rate(Task(experiment=Experiment(**SHORT)))
NAME = "yawrate/mixture-v0"


@pytest.fixture(autouse=True)
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    return tmp_path


def exported(episodes=40, plant=None, name=NAME, **kwargs):
    kwargs = {"env_kwargs": SHORT if plant is None else None, "plant": plant} | kwargs
    return export_minari(name, episodes, 3, **kwargs)


@pytest.mark.parametrize(
    "entry, plant, raw, name",
    [
        (None, VEHICLES, False, FEATURES_ID),
        (None, VEHICLES, True, ENV_ID),
        ("first_order:gauged", gauged, False, PLANT_FEATURES_ID),
        ("first_order:gauged", gauged, True, PLANT_ID),
    ],
)
def test_episodes_are_the_environments(entry, plant, raw, name):
    exported(12, entry, raw=raw)
    dataset = minari.load_dataset(NAME)
    assert dataset.total_episodes == dataset.total_steps == 12
    env = dataset.recover_environment()
    assert env.spec.id == name and env.unwrapped.plant.arguments == plant.arguments
    rows = recorded(plant, "train", 3, 12)  # those of the data set with this seed
    options = dataset.storage.get_episode_metadata(range(12))
    for episode, metadata in zip(dataset.iterate_episodes(), options, strict=True):
        pins = metadata["options"]
        assert pins == dict(zip(plant.prior, rows.theta[episode.id], strict=True))
        shown, _ = env.reset(seed=int(episode.id), options=pins)
        assert episode.observations.shape == (2, *shown.shape)
        np.testing.assert_array_equal(episode.observations[0], episode.observations[1])
        assert env.observation_space.contains(episode.observations[0])
        assert env.action_space.contains(episode.actions[0])
        if entry is None:  # the same vehicle with other noise
            assert abs(episode.observations[0] - shown).max() < (0.3 if raw else 2.0)
        if raw:
            expected = rows.y[episode.id].astype(np.float32)
            np.testing.assert_array_equal(episode.observations[0][1], expected)
        _, reward, terminated, truncated, info = env.step(episode.actions[0])
        assert episode.rewards[0] == pytest.approx(reward, abs=1e-12) and not info["clipped"]
        assert [terminated, truncated] == [True, False]
        assert episode.terminations.tolist() == [True] and episode.truncations.tolist() == [False]


def test_features_are_those_of_the_raw_episodes():
    raw, features = (gymnasium.make(name, **SHORT) for name in (ENV_ID, FEATURES_ID))
    pairs = zip(
        _buffers(raw, 10, 3, "train", BEHAVIOURS, None),
        _buffers(features, 10, 3, "train", BEHAVIOURS, None),
        strict=True,
    )
    for recording, found in pairs:
        shown = features.get_wrapper_attr("observation")(recording.observations[0])
        np.testing.assert_allclose(shown, found.observations[0], rtol=0, atol=1e-6)
        gains = features.get_wrapper_attr("action")(found.actions[0])
        np.testing.assert_allclose(gains, recording.actions[0], rtol=1e-15)
        assert recording.rewards == found.rewards


def test_behaviours_act_in_turn():
    dataset = exported(60, "first_order:gauged")
    episodes = list(dataset.iterate_episodes())
    rewards = np.array([episode.rewards[0] for episode in episodes])
    actions = np.array([episode.actions[0] for episode in episodes])
    means = [rewards[k::4].mean() for k in range(4)]  # uniform, perturbed, nominal, oracle
    assert means[0] < means[2] < means[1] < means[3]
    assert rewards[3::4].min() > -1e-4  # single precision
    assert (actions[2::4] == actions[2]).all()
    assert actions[::4].min() < -0.8 < 0.8 < actions[::4].max()
    assert "uniform, perturbed, nominal, oracle" in dataset.storage.metadata["description"]


def test_a_larger_export_begins_with_the_smaller_one():
    env = gymnasium.make(FEATURES_ID, **SHORT)
    small, large = (list(_buffers(env, n, 3, "train", BEHAVIOURS, None)) for n in (10, 150))
    for a, b in zip(small, large[:10], strict=True):
        np.testing.assert_array_equal(a.actions, b.actions)
        np.testing.assert_allclose(a.observations, b.observations, rtol=0, atol=1e-6)


def test_plants_without_gains_get_the_nominal_ones():
    def partly(theta):
        return np.where(theta[:, :1] > 1.6, np.nan, first_order.design(theta))

    env = gymnasium.make(PLANT_FEATURES_ID, plant=described(design=partly))
    buffers = list(_buffers(env, 60, 3, "train", ("nominal", "oracle"), None))
    without = [buffer for buffer in buffers[1::2] if buffer.options["K"] > 1.6]
    assert without and all((buffer.actions == buffers[0].actions).all() for buffer in without)


def test_a_name_that_is_taken_is_refused_and_a_failure_leaves_nothing():
    def fail(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        exported(4, progress=fail)
    assert minari.list_local_datasets() == {}
    calls = []
    dataset = exported(130, "first_order:lone", progress=lambda *call: calls.append(call))
    assert calls == [("exporting", done, 130) for done in (128, 130)]
    assert {episode.actions.shape for episode in dataset.iterate_episodes()} == {(1, 1)}
    with pytest.raises(DatasetError, match=f"has {NAME} already"):
        exported(5)
    assert minari.load_dataset(NAME).total_episodes == 130


@pytest.mark.parametrize(
    "arguments, name",
    [
        ({"episodes": 100_001}, "episodes = 100001 must be .*at most 100000.*generate"),
        ({"behaviours": ()}, "behaviours"),
        ({"behaviours": "uniform"}, "behaviours"),
        ({"behaviours": ("expert",)}, "'expert'"),
        ({"set": "extrapolation", "plant": "first_order:gauged"}, "extrapolation"),
        ({"raw": "no"}, "raw"),
        ({"env_kwargs": [1]}, "env_kwargs"),
        ({"plant": described(noise=0.5)}, "not the first_order:plant .*: its noise differs"),
        ({"plant": described(entry="")}, "entry"),
        ({"plant": "gone:plant"}, "no module 'gone'"),
        ({"plant": cars}, "arguments"),
        *(({"name": name}, "dataset_id") for name in ("mixture", "../mixture-v0", "a b-v0", None)),
    ],
)
def test_wrong_arguments_are_refused(arguments, name, root):
    with pytest.raises(ValueError, match=name):
        exported(**arguments)
    assert list(root.iterdir()) == []
