"""What Minari loads is what the environment gives."""

import gymnasium
import minari
import numpy as np
import pytest
from first_order import described, gauged
from first_order import plant as first_order

from tuners.data import BEHAVIOURS, DatasetError, export_minari
from tuners.data.minari_export import _buffers
from yawrate_env import ENV_ID, FEATURES_ID, PLANT_FEATURES_ID, PLANT_ID
from yawrate_env.loop.design import Status
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.task import Experiment, Prior, Task

SHORT = {"Ts": 0.01, "N": 1000}
TASK = Task(experiment=Experiment(**SHORT))
TRAIN = CONTEXT_SETS["train"]


@pytest.fixture(autouse=True)
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    return tmp_path


def loaded(episodes=40, **kwargs):
    export_minari("yawrate/mixture-v0", episodes, 3, **({"env_kwargs": SHORT} | kwargs))
    return minari.load_dataset("yawrate/mixture-v0")


@pytest.mark.parametrize("raw, name", [(False, FEATURES_ID), (True, ENV_ID)])
def test_episodes_are_the_environments(raw, name):
    dataset = loaded(raw=raw)
    assert dataset.total_episodes == dataset.total_steps == 40
    env = dataset.recover_environment()
    assert env.spec.id == name and env.unwrapped.task == TASK
    vehicles = TRAIN.draw(Prior(), 3, 0, 40).context
    options = dataset.storage.get_episode_metadata(range(40))
    for episode, metadata in zip(dataset.iterate_episodes(), options, strict=True):
        pins = metadata["options"]
        assert pins["mu_s"] == vehicles.mu_s[episode.id]
        shown, _ = env.reset(seed=int(episode.id), options=pins)
        assert episode.observations.shape == (2, *shown.shape)
        np.testing.assert_array_equal(episode.observations[0], episode.observations[1])
        assert env.observation_space.contains(episode.observations[0])
        assert env.action_space.contains(episode.actions[0])
        # The same vehicle with other noise.
        spread = 0.3 if raw else 2.0
        assert abs(episode.observations[0] - shown).max() < spread
        _, reward, terminated, truncated, _ = env.step(episode.actions[0])
        assert episode.rewards[0] == pytest.approx(reward, abs=1e-12)
        assert [terminated, truncated] == [True, False]
        assert episode.terminations.tolist() == [True] and episode.truncations.tolist() == [False]


def test_features_are_those_of_the_raw_episodes():
    raw, features = (gymnasium.make(name, **SHORT) for name in (ENV_ID, FEATURES_ID))
    pairs = zip(
        _buffers(raw, 10, 3, TRAIN, BEHAVIOURS, None),
        _buffers(features, 10, 3, TRAIN, BEHAVIOURS, None),
        strict=True,
    )
    for recording, compressed in pairs:
        shown = features.get_wrapper_attr("observation")(recording.observations[0])
        np.testing.assert_allclose(shown, compressed.observations[0], rtol=0, atol=1e-6)
        gains = features.get_wrapper_attr("action")(compressed.actions[0])
        np.testing.assert_allclose(gains, recording.actions[0], rtol=1e-15)
        assert recording.rewards == compressed.rewards


def test_behaviours_act_in_turn():
    dataset = loaded(80)
    rewards = np.array([episode.rewards[0] for episode in dataset.iterate_episodes()])
    actions = np.array([episode.actions[0] for episode in dataset.iterate_episodes()])
    by_name = {name: slice(k, None, 4) for k, name in enumerate(BEHAVIOURS)}
    oracle = loops(TASK, TRAIN.draw(Prior(), 3, 0, 80).context).design()
    assert (oracle.status == Status.OK).all()
    assert rewards[by_name["oracle"]].min() > -1e-4  # single precision
    assert (actions[by_name["nominal"]] == actions[2]).all()
    means = [rewards[by_name[name]].mean() for name in BEHAVIOURS]
    assert means[0] < means[2] < means[1] < means[3]
    assert actions[by_name["uniform"]].min() < -0.8 < 0.8 < actions[by_name["uniform"]].max()
    assert "uniform, perturbed, nominal, oracle" in dataset.storage.metadata["description"]


def test_a_larger_export_begins_with_the_smaller_one():
    env = gymnasium.make(FEATURES_ID, **SHORT)
    small, large = (list(_buffers(env, n, 3, TRAIN, BEHAVIOURS, None)) for n in (10, 300))
    for a, b in zip(small, large[:10], strict=True):
        np.testing.assert_array_equal(a.actions, b.actions)
        np.testing.assert_allclose(a.observations, b.observations, rtol=0, atol=1e-6)


# --- any other plant


def exported(episodes=40, plant="first_order:gauged", **kwargs):
    return export_minari("plant/mixture-v0", episodes, 3, plant=plant, **kwargs)


@pytest.mark.parametrize("raw, name", [(False, PLANT_FEATURES_ID), (True, PLANT_ID)])
def test_a_plants_episodes_are_its_environments(raw, name):
    exported(raw=raw)
    dataset = minari.load_dataset("plant/mixture-v0")
    env = dataset.recover_environment()
    assert env.spec.id == name and env.spec.kwargs == {"plant": "first_order:gauged"}
    assert env.unwrapped.plant is gauged
    rows = recorded(gauged, "train", 3, 40)  # those of the data set with this seed
    options = dataset.storage.get_episode_metadata(range(40))
    for episode, metadata in zip(dataset.iterate_episodes(), options, strict=True):
        pins = metadata["options"]
        assert list(pins.values()) == rows.theta[episode.id].tolist()
        shown, _ = env.reset(seed=int(episode.id), options=pins)
        assert episode.observations.shape == (2, *shown.shape)
        np.testing.assert_array_equal(episode.observations[0], episode.observations[1])
        assert env.observation_space.contains(episode.observations[0])
        assert env.action_space.contains(episode.actions[0])
        if raw:
            expected = rows.y[episode.id].astype(np.float32)
            np.testing.assert_array_equal(episode.observations[0][1], expected)
        _, reward, terminated, truncated, info = env.step(episode.actions[0])
        assert episode.rewards[0] == pytest.approx(reward, abs=1e-12) and not info["clipped"]
        assert [terminated, truncated] == [True, False]


def test_behaviours_act_on_a_plant_in_turn():
    episodes = list(exported(80).iterate_episodes())
    rewards = np.array([episode.rewards[0] for episode in episodes])
    actions = np.array([episode.actions[0] for episode in episodes])
    means = [rewards[k::4].mean() for k in range(4)]  # uniform, perturbed, nominal, oracle
    assert means[0] < means[2] < means[1] < means[3]
    assert rewards[3::4].min() > -1e-4  # single precision
    assert (actions[2::4] == actions[2]).all()


def test_a_plant_with_one_gain_has_one_action():
    dataset = exported(8, "first_order:lone")
    assert {episode.actions.shape for episode in dataset.iterate_episodes()} == {(1, 1)}


def test_plants_without_gains_are_acted_on_as_the_nominal_one():
    def partly(theta):
        return np.where(theta[:, :1] > 1.6, np.nan, first_order.design(theta))

    env = gymnasium.make(PLANT_FEATURES_ID, plant=described(design=partly))
    buffers = list(_buffers(env, 60, 3, TRAIN, ("nominal", "oracle"), None))
    without = [buffer for buffer in buffers[1::2] if buffer.options["K"] > 1.6]
    assert without and all((buffer.actions == buffers[0].actions).all() for buffer in without)


@pytest.mark.parametrize(
    "kwargs, message",
    [
        ({"plant": described(entry="")}, 'must find its plant again: give the plant entry="'),
        ({"plant": "gone:plant"}, "no module 'gone'"),
        ({"contexts": CONTEXT_SETS["extrapolation"]}, "has vehicles of its own"),
    ],
)
def test_plants_that_cannot_be_exported_are_refused(kwargs, message, root):
    with pytest.raises(ValueError, match=message):
        exported(**kwargs)
    assert list(root.iterdir()) == []


def test_progress():
    calls = []
    loaded(300, behaviours=("oracle",), progress=lambda *call: calls.append(call))
    assert calls == [("exporting", 256, 300), ("exporting", 300, 300)]


def test_a_name_that_is_taken_is_refused_and_kept():
    loaded(4)
    with pytest.raises(DatasetError, match="has yawrate/mixture-v0 already"):
        loaded(5)
    assert minari.load_dataset("yawrate/mixture-v0").total_episodes == 4


def test_a_failure_leaves_nothing(root):
    def fail(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        loaded(4, progress=fail)
    assert minari.list_local_datasets() == {}
    assert loaded(4).total_episodes == 4


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"episodes": 100_001}, "episodes = 100001 must be .*at most 100000.*generate"),
        ({"episodes": 0}, "episodes = 0"),
        ({"behaviours": ()}, r"behaviours = \(\) must be some of"),
        ({"behaviours": "uniform"}, "behaviours = 'uniform' must be some of"),
        ({"contexts": "train"}, "contexts = 'train' is not of type ContextSet"),
        ({"raw": "no"}, "raw = 'no' must be True or False"),
        ({"env_kwargs": [1]}, "env_kwargs = .* is not of type dict"),
        ({"plant": described(noise=0.5)}, "not the first_order:plant .*: its noise differs"),
        ({"behaviours": ("expert",)}, "behaviour = 'expert'"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message, root):
    with pytest.raises(ValueError, match=message):
        loaded(**arguments)
    assert list(root.iterdir()) == []


@pytest.mark.parametrize("name", ["mixture", "../mixture-v0", "two words-v0", "", None])
def test_names_that_minari_could_not_list_are_refused(name, root):
    with pytest.raises(ValueError, match="dataset_id = .* is no name of Minari's. Give"):
        export_minari(name, 4)
    assert list(root.iterdir()) == []
