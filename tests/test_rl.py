"""The reinforcement-learning tuner: its training, its checkpoints and what is kept of it."""

from functools import cache

import numpy as np
import pytest
import torch
from recordings import ROOT, observations, recorded
from imports import modules_after

import tuners
from tuners.agents import training as rl_training
from tuners.agents.feature_map import FeatureMap
from tuners.agents.rl_tuner import ALGORITHMS, RLTuner, Training
from tuners.agents.training import _actor, _Average, of_vehicles
from tuners.features.laguerre import Laguerre
from tuners.learners.actor import Actor
from tuners.tuner.evaluation import evaluate
from yawrate_env.loop.design import Design
from yawrate_env.plant.reward import margin_error
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.yaw_rate import yaw_rate

SHORT = {"Ts": 0.01, "N": 300}
# SAC and TD3 start to learn after 512 episodes.
EPISODES = 544


def settings(algorithm="sac", episodes=EPISODES, **others):
    return Training(algorithm, episodes=episodes, **others)


def trained(algorithm="sac", episodes=EPISODES, kwargs=None, seed=0, **others):
    return rl_training.train(
        SHORT | (kwargs or {}), settings(algorithm, episodes, seed=seed), **others
    )


def assert_same(a, b):
    assert set(a.arrays()) == set(b.arrays())
    for name, array in a.arrays().items():
        np.testing.assert_array_equal(array, b.arrays()[name])


def differ(a, b):
    return any((array != b.arrays()[name]).any() for name, array in a.arrays().items())


@cache
def default(algorithm):
    return trained(algorithm)[-1][1]


@pytest.fixture
def agent():
    return default("sac")


# --- training


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_training_gives_snapshots_and_the_end(algorithm):
    calls = []
    found = trained(algorithm, at=(536, 160, 16), episodes=560,
                    progress=lambda what, done, of: calls.append((what, done, of)))  # fmt: skip
    # PPO ends with a whole rollout of 256.
    assert [n for n, _ in found] == [16, 160, 536, 768 if algorithm == "ppo" else 560]
    assert [t.training["episodes"] for _, t in found] == [16, 160, 544, found[-1][0]]
    tuner = found[-1][1]
    assert tuner.training["algorithm"] == algorithm and tuner.training["num_envs"] == 16
    assert differ(found[0][1], found[-1][1])
    done = [d for _, d, _ in calls]
    assert {(what, of) for what, _, of in calls} == {("training rl", 560)}
    assert done == sorted(done) and done[-1] == 560


def test_nothing_is_learned_from_random_actions_only():
    (_, early), (_, late) = trained(at=(16,), episodes=512)
    assert not differ(early, late)


@pytest.mark.parametrize("algorithm", ["sac", "ppo"])
def test_a_seed_gives_the_same_agent_again_and_another_another(algorithm):
    (_, again), (_, other) = (trained(algorithm, seed=s)[-1] for s in (0, 1))
    assert_same(default(algorithm), again)
    assert differ(default(algorithm), other)


def test_agents_of_other_seeds_see_other_episodes():
    seen = []
    for seed in range(3):
        run = of_vehicles(SHORT, settings(seed=seed), None, None)
        run.env.reset()
        seen += run.env.env.unwrapped.np_random_seed
    assert len(set(seen)) == 3 * 16


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_training_never_reads_the_oracles_gains(algorithm, monkeypatch):
    expected = default(algorithm)

    def blind(self):
        nothing = np.full(len(self.plant.A), np.nan)
        return Design(nothing, nothing, np.full(len(nothing), 2))

    monkeypatch.setattr(Loops, "oracle", blind)
    assert_same(trained(algorithm)[-1][1], expected)


def test_rewards_are_what_is_learned_from(monkeypatch):
    # The counterpart of the test above: it would see a difference.
    expected = default("sac")
    monkeypatch.setattr("yawrate_env.vehicle.judge.reward", lambda pm, *_: np.zeros(len(pm)))
    assert differ(trained()[-1][1], expected)


@pytest.mark.slow
def test_a_thousand_episodes_teach_a_lot():
    (_, start), (_, end) = trained(kwargs={"N": 1000}, at=(500,), episodes=1000)
    found = evaluate(
        {"start": start, "end": end}, end.task, CONTEXT_SETS["test"],
        episodes=200, seed=0, batch=200,
    )  # fmt: skip
    before, after = (
        np.mean(margin_error(e.phase_margin, e.crossover, end.task.target)) for e in found
    )
    assert found[1].stable.all()
    assert after < 0.5 * before


def test_the_log_is_tensorboards(tmp_path):
    trained("ppo", episodes=256, log=str(tmp_path))
    assert list(tmp_path.rglob("events.out.tfevents.*"))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"algorithm": "dqn"}, "algorithm = 'dqn'"),
        ({"compressor": "fourier"}, "compressor = 'fourier'"),
        ({"compressor": "regularised"}, "Choose one of laguerre, armax, response"),
        ({"episodes": 8}, "episodes = 8"),
        ({"num_envs": 0}, "num_envs = 0"),
        ({"seed": -1}, "seed = -1"),
    ],
)
def test_wrong_settings_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        Training(**wrong)


@pytest.mark.parametrize("wrong", [{"visible": "context"}, {"decimate": 2}])
def test_tuners_see_recordings_only(wrong):
    with pytest.raises(ValueError, match="Use visible='episode' or 'speed', decimate=1"):
        trained(kwargs=wrong)


# --- checkpoints


class Interrupted(Exception):
    pass


def interrupted(algorithm, checkpoint, at):
    """A training that stops 16 episodes after its checkpoint."""

    def stop(what, done, of):
        if done > at:
            raise Interrupted

    with pytest.raises(Interrupted):
        trained(algorithm, at=(at,), checkpoint=checkpoint, episodes=576, progress=stop)


def seeds_of(run):
    run.env.reset()
    return set(run.env.env.unwrapped.np_random_seed)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_resumed_training_goes_on_where_it_was(algorithm, tmp_path):
    checkpoint = tmp_path / "checkpoint"  # Stable-Baselines3 would add .zip
    interrupted(algorithm, checkpoint, at=528)
    files = {"checkpoint" + end for end in ("", ".average.pt", ".buffer.pkl", ".origin")}
    files -= {"checkpoint.buffer.pkl"} if algorithm == "ppo" else set()
    assert {path.name for path in tmp_path.iterdir()} == files

    run = of_vehicles(SHORT, settings(algorithm, 576), None, checkpoint)
    assert run.model.num_timesteps == 528 and run.average.batches == 33
    if algorithm != "ppo":
        assert run.model.replay_buffer.size() == 32  # the batch of the checkpoint is lost
    fresh = of_vehicles(SHORT, settings(algorithm, 576), None, None)
    assert not seeds_of(run) & seeds_of(fresh)  # never the same episodes twice

    found = trained(algorithm, episodes=576, checkpoint=checkpoint, at=(16, 528, 544))
    assert [n for n, _ in found] == [544, 784 if algorithm == "ppo" else 576]
    assert found[-1][1].training["episodes"] == found[-1][0]


def test_a_finished_training_is_found_as_it_was(tmp_path):
    checkpoint = tmp_path / "agent.zip"
    (_, first), (_, again) = (trained(checkpoint=checkpoint)[-1] for _ in range(2))
    assert_same(first, again)


@pytest.mark.parametrize("others", [{"algorithm": "td3"}, {"compressor": "armax"}])
def test_checkpoints_of_other_settings_are_refused(others, tmp_path):
    checkpoint = tmp_path / "agent.zip"
    trained("sac", episodes=32, checkpoint=checkpoint)
    with pytest.raises(ValueError, match="is no checkpoint of .* Resume with the settings"):
        rl_training.train(SHORT, Training(**{"episodes": 64} | others), checkpoint=checkpoint)


@pytest.mark.parametrize(
    "others, words",
    [({"N": 400}, "another plant: its "), ({"nonlinear": True}, "nonlinear is False, not True")],
)
def test_checkpoints_of_other_vehicles_are_refused(others, words, tmp_path):
    checkpoint = tmp_path / "agent.zip"
    trained("sac", episodes=32, checkpoint=checkpoint)
    with pytest.raises(ValueError, match=f"is no checkpoint of .*{words}.* Resume with"):
        trained("sac", 64, others, checkpoint=checkpoint)


def test_other_files_are_no_checkpoints(tmp_path):
    path = tmp_path / "agent.zip"
    path.write_bytes(b"PK, but nothing more")
    with pytest.raises(ValueError, match="is no checkpoint of sac"):
        trained(checkpoint=path)


# --- the actor


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_arrays_act_as_the_model_does(algorithm):
    run = of_vehicles(SHORT, settings(algorithm), None, None)
    run.learn((), None)
    features = np.random.default_rng(0).normal(size=(20, 10)).astype(np.float32)
    expected, _ = run.model.predict(features, deterministic=True)
    # The network calculates in float32.
    np.testing.assert_allclose(_actor(run.model, {})(features), expected, rtol=0, atol=1e-5)


def test_an_actor_by_hand():
    layers = [(np.array([[1.0], [-1.0]]), np.array([0.0, 0.5])),
              (np.array([[2.0, 1.0]]), np.array([0.25]))]  # fmt: skip
    x = np.array([[1.0], [-2.0]])
    relu = np.array([[2 + 0 + 0.25], [0 + 2.5 + 0.25]])
    np.testing.assert_allclose(Actor(layers, "relu", True)(x), np.tanh(relu))
    np.testing.assert_allclose(Actor(layers, "relu", False)(x), 1.0)
    tanh = 2 * np.tanh(x) + np.tanh(0.5 - x) + 0.25
    np.testing.assert_allclose(Actor(layers, "tanh", False)(x), np.clip(tanh, -1, 1))


def test_the_average_forgets_the_beginning_and_smooths_the_end():
    module, average = torch.nn.Linear(1, 1), _Average()

    def after(count, value):
        for k in range(count):
            for p in module.parameters():
                p.data.fill_(value(k))
            average.update(module)
        return float(average.weights["weight"])

    assert after(10, lambda k: k) == 9  # as good as the last
    assert after(90, lambda k: 1.0) == pytest.approx(1.0, abs=1e-5)  # the 9 is forgotten
    assert after(5000, lambda k: (-1.0) ** k) == pytest.approx(0, abs=0.01)
    # A step decays by 0.995 a batch from then on.
    assert after(200, lambda k: 1.0) == pytest.approx(1 - 0.995**200, abs=0.01)


# --- the tuner


def test_saving_keeps_everything(agent, tmp_path):
    agent.save(tmp_path / "rl.tuner")
    again = tuners.load(tmp_path / "rl.tuner")
    assert isinstance(again, RLTuner)
    assert_same(agent, again)
    assert again.training == agent.training and again.task == agent.task
    obs = np.random.default_rng(0).normal(0, 0.1, (4, 2, 300))
    np.testing.assert_array_equal(agent.predict(obs)[0], again.predict(obs)[0])
    one, other = (t.tune(obs[0, 0], obs[0, 1], 0.01) for t in (agent, again))
    assert one == other


def test_files_from_before_speeds_were_visible_still_load(agent, tmp_path, monkeypatch):
    before = agent.settings()
    del before["visible"]
    monkeypatch.setattr(RLTuner, "settings", lambda self: before)
    agent.save(tmp_path / "rl.tuner")
    assert_same(agent, tuners.load(tmp_path / "rl.tuner"))


def test_using_it_needs_what_trained_it_no_more(agent, tmp_path):
    agent.save(tmp_path / "rl.tuner")
    loaded = modules_after(
        "import numpy as np, tuners; from yawrate_env.signals.excitation import prbs; "
        f"u = prbs(300, 0.01, 0.1, 0.02)[0]; tuners.load({str(tmp_path / 'rl.tuner')!r})"
        ".tune(u, u, 0.01)"
    )
    assert "tuners" in loaded
    learning = {"torch", "stable_baselines3", "sb3_contrib", "xgboost", "cloudpickle"}
    assert not loaded & (learning | {"matplotlib", "control"})


def test_one_answer_is_one_of_the_batch(agent):
    obs = np.random.default_rng(1).normal(0, 0.1, (3, 2, 300))
    together, _ = agent.predict(obs)
    for row, expected in zip(obs, together, strict=True):
        np.testing.assert_allclose(agent.predict(row)[0], expected, rtol=1e-5)


def test_an_unusable_recording_is_said_to_be(agent):
    found = agent.tune(np.zeros(300), np.ones(300), 0.01)
    assert not found.converged and found.notes


def test_speeds_can_be_a_feature(tmp_path):
    kwargs = {"v_x": [10.0, 30.0], "visible": "speed"}
    (_, found), *_ = trained("ppo", episodes=256, kwargs=kwargs)
    assert found.visible == ("v_x",)
    found.save(tmp_path / "rl.tuner")
    again = tuners.load(tmp_path / "rl.tuner")
    given = recorded(2)
    u, y = given.u[0, ::10][:300], given.y[0, ::10][:300]
    slow, fast = (again.tune(u, y, 0.01, v_x=v) for v in (12.0, 28.0))
    assert slow.kp != fast.kp
    assert slow == found.tune(u, y, 0.01, v_x=12.0)
    with pytest.raises(ValueError, match="v_x is needed"):
        again.tune(u, y, 0.01)


def test_one_speed_need_not_be_given():
    (_, found), *_ = trained("ppo", episodes=256, kwargs={"visible": "speed"})
    given = recorded(1)
    u, y = given.u[0, ::10][:300], given.y[0, ::10][:300]
    assert found.tune(u, y, 0.01).kp == found.tune(u, y, 0.01, v_x=20.0).kp


SHIPPED = ROOT / "tuners" / "models" / "rl.tuner"


@pytest.mark.parametrize("path", [SHIPPED] if SHIPPED.exists() else [])
def test_the_shipped_agent_keeps_its_features(path):
    tuner = tuners.load("rl")
    features = FeatureMap.of(yaw_rate(tuner.task), Laguerre())
    np.testing.assert_allclose(tuner.features.mean, features.mean, rtol=1e-6)
    np.testing.assert_allclose(tuner.features.scale, features.scale, rtol=1e-6)
    actions, _ = tuner.predict(observations(recorded(20)))
    verdict = loops(tuner.task, recorded(20).context).evaluate(*actions.T)
    np.testing.assert_allclose(verdict.margins.phase_margin, 60, atol=1.0)
    np.testing.assert_allclose(verdict.margins.crossover, 1.5, atol=0.03)
