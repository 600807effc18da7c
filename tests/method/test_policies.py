"""Other people's policies as tuners: factories and Stable-Baselines3 models."""

import csv
import sys
import zipfile

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner
from evaluate import main as program
from first_order import gauged

import tuners
from tuners.agents import policies
from tuners.tuner.evaluation import evaluate
from tuners.tuner.recording import Recording
from yawrate_env import FEATURES_ID
from yawrate_env.env.tuning_env import plant_env
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.plant import episodes

SHORT = {"N": 500}
SAC, PPO = "stable_baselines3:SAC", "stable_baselines3:PPO"
AGENT = """
import numpy as np
import tuners

class Fixed:
    def predict(self, obs, state=None, episode_start=None, deterministic=True):
        return np.tile([0.23, 0.28], (len(obs), 1)), state

class Wrong(Fixed):
    def predict(self, *args, **kwargs):
        actions, state = super().predict(*args, **kwargs)
        return actions[:, :1], state

def shipped():
    return tuners.load("ts-ff")

number = 1
"""


class Answers:
    """A policy that answers what it is told to and keeps what it was shown."""

    def __init__(self, answer):
        self.answer, self.seen = answer, []

    def predict(self, obs, state=None, episode_start=None, deterministic=True):
        self.seen.append((obs, state, episode_start, deterministic))
        return self.answer


def recorded(env, count):
    """Recordings of test episodes, with the truth, and their parameters."""
    found = episodes.recorded(env.plant, "test", 0, count)
    return Recording(found.u, found.y, env.plant.Ts, found.theta), found.theta


def single(env, seed):
    """The recording of an episode, and its observation."""
    obs, _ = env.reset(seed=seed)
    u, y, theta = env.interface.recordings(obs[None])
    return Recording(u, y, env.interface.Ts, theta), obs


@pytest.fixture
def agents(tmp_path, monkeypatch):
    """A folder with a user's module, being the current one."""
    (tmp_path / "my_agents.py").write_text(AGENT)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield tmp_path
    sys.modules.pop("my_agents", None)


ENVIRONMENTS = {
    "default": lambda: PITuningEnv(**SHORT),
    "speed": lambda: PITuningEnv(visible="speed", v_x=[10, 30], register="random", **SHORT),
    "context, decimated": lambda: PITuningEnv(visible="context", decimate=7),
    "another plant": lambda: plant_env(gauged),
}


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_a_policy_observes_what_the_environment_shows(name):
    env = ENVIRONMENTS[name]()
    for seed in range(2):
        recording, expected = single(env, seed)
        if env.interface.decimate == 1:
            np.testing.assert_array_equal(policies.observations(recording, env), [expected])
    recording, theta = recorded(env, 3)
    shown = policies.observations(recording, env)
    assert shown.dtype == expected.dtype and shown.shape[1:] == env.observation_space.shape
    rows = theta[:, env.plant.indices(env.interface.visible)].astype(np.float32)
    np.testing.assert_allclose(shown[:, 2:, 0], rows, rtol=1e-6)


def test_the_truth_is_shown_only_where_it_is_asked_for():
    recording, theta = recorded(PITuningEnv(**SHORT), 3)
    for visible, rows in (("episode", 2), ("context", 5)):
        policy = Answers((np.ones((3, 2)), None))
        policies.Player("p", policy, PITuningEnv(**SHORT, visible=visible)).act(recording)
        ((obs, state, start, deterministic),) = policy.seen
        assert obs.shape == (3, rows, 500)
        assert state is None and start.all() and len(start) == 3 and deterministic is True
    np.testing.assert_array_equal(obs[:, 3, 0], theta[:, 0].astype(np.float32))


@pytest.mark.parametrize("name", ["default", "another plant"])
def test_actions_are_applied_as_the_environment_applies_them(name):
    env = ENVIRONMENTS[name]()
    recording, _ = recorded(env, 1)
    for action in ([0.2, 0.3], [-4.0, 1e9], [1e3, 0.0]):
        gains = policies.Player("p", Answers((np.array(action), None)), env).act(recording)
        env.reset(seed=0)
        info = env.step(np.array(action))[4]
        np.testing.assert_array_equal(gains, [[info["kp"], info["Ti"]]])


def test_wrong_answers_are_refused():
    env, several = PITuningEnv(**SHORT), np.full((3, 2), np.nan)
    for answer in (np.ones((3, 2)), ([1.0, 2.0], None), (several, None), ("gains", None)):
        with pytest.raises(ValueError, match="^p: "):
            policies.Player("p", Answers(answer), env).act(recorded(env, 3)[0])


def test_a_tuner_as_a_policy_is_evaluated_like_the_tuner(agents):
    env = PITuningEnv()
    players = {
        "tuner": tuners.load("ts-ff"),
        "policy": policies.of_factory("my_agents:shipped", env),
    }
    own, foreign = evaluate(players, env.plant, "test", episodes=20, seed=0, batch=8)
    # Observations are float32, which is far finer than the noise.
    np.testing.assert_allclose(foreign.gains, own.gains, rtol=1e-5)
    np.testing.assert_allclose(foreign.metrics, own.metrics, atol=1e-3)


def test_wrong_factories_are_refused(agents):
    wrong = "absent:Fixed", "my_agents:Absent", "my_agents:number", "types:SimpleNamespace"
    for spec in ("my_agents", *wrong):
        with pytest.raises(ValueError, match=f"^'?{spec}"):
            policies.of_factory(spec, PITuningEnv(**SHORT))


def test_an_error_within_a_users_module_is_not_hidden(agents):
    (agents / "broken_agents.py").write_text("import my_agents\nmy_agents.absent\n")
    with pytest.raises(AttributeError, match="absent"):
        policies.of_factory("broken_agents:Fixed", PITuningEnv(**SHORT))


def saved(name, folder, env=FEATURES_ID, policy="MlpPolicy", **settings):
    """An untrained model of Stable-Baselines3 or sb3-contrib, its file and its class."""
    import sb3_contrib
    import stable_baselines3

    home = stable_baselines3 if hasattr(stable_baselines3, name) else sb3_contrib
    made = gymnasium.make(env, **settings) if isinstance(env, str) else env
    model = getattr(home, name)(policy, made, policy_kwargs={"net_arch": [8]}, device="cpu", seed=0)
    model.save(folder / f"{name}.zip")
    return model, str(folder / f"{name}.zip"), f"{home.__name__}:{name}"


@pytest.mark.parametrize("name", ["PPO", "SAC", "DDPG", "TQC", "TRPO"])
def test_a_saved_model_predicts_as_before(name, tmp_path):
    model, path, algorithm = saved(name, tmp_path, **SHORT)
    player = policies.of_sb3(path, PITuningEnv(**SHORT), algorithm)
    obs, _ = gymnasium.make(FEATURES_ID, **SHORT).reset(seed=3)
    np.testing.assert_array_equal(
        player.policy.predict(obs, deterministic=True)[0], model.predict(obs, deterministic=True)[0]
    )


@pytest.mark.parametrize("features", ["laguerre", "armax"])
def test_a_model_of_features_does_what_it_does_in_its_environment(features, tmp_path):
    model, path, _ = saved("SAC", tmp_path, features=features)
    player = policies.of_sb3(path, PITuningEnv(), SAC)
    env, raw = gymnasium.make(FEATURES_ID, features=features), PITuningEnv()
    for seed in range(2):
        observed, _ = env.reset(seed=seed)
        recording, _ = single(raw, seed)
        info = env.step(model.predict(observed, deterministic=True)[0])[4]
        np.testing.assert_allclose(player.act(recording), [[info["kp"], info["Ti"]]], rtol=1e-6)


@pytest.mark.parametrize("env", [PITuningEnv(N=1000), plant_env(gauged)])
def test_a_model_of_recordings_acts_in_physical_units(env, tmp_path):
    # Its replay memory would take 8 GB, were it made again to act.
    model, path, _ = saved("SAC", tmp_path, env)
    player = policies.of_sb3(path, env, SAC)
    assert player.policy.buffer_size == 1
    recording, obs = single(env, 1)
    info = env.step(model.predict(obs, deterministic=True)[0])[4]
    np.testing.assert_allclose(player.act(recording), [[info["kp"], info["Ti"]]], rtol=1e-6)


def test_models_of_other_environments_are_refused(tmp_path):
    for settings in ({"env": "yawrate/PITuning-v0", "N": 300}, {"env": "Pendulum-v1"}):
        _, path, _ = saved("PPO", tmp_path, **settings)
        with pytest.raises(ValueError, match="PPO.zip takes observations of shape"):
            policies.of_sb3(path, PITuningEnv(**SHORT), PPO)


def test_actions_of_another_kind_are_refused():
    env = PITuningEnv(**SHORT)
    for space in (gymnasium.spaces.Box(-2.0, 2.0, (2,)), gymnasium.spaces.Discrete(2)):
        with pytest.raises(ValueError, match="model.zip acts in"):
            policies._actions("model.zip", space, env)


@pytest.mark.parametrize("content", [None, b"", b"not a zip", {}, {"data": "[1]"}, {"data": "{"}])
def test_files_of_another_kind_are_refused(content, tmp_path):
    path = tmp_path / "model.zip"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        with zipfile.ZipFile(path, "w") as file:
            for name, text in content.items():
                file.writestr(name, text)
    with pytest.raises(ValueError, match=r"^sb3 = .*model\.zip"):
        policies.of_sb3(str(path), PITuningEnv(**SHORT), SAC)


def test_the_algorithm_is_named(tmp_path):
    _, path, _ = saved("PPO", tmp_path, **SHORT)
    env = PITuningEnv(**SHORT)
    with pytest.raises(ValueError, match="--algo"):
        policies.of_sb3(path, env, SAC)
    with pytest.raises(ValueError, match="^algo"):
        policies.chosen([], [path], None, env)
    assert list(policies.chosen([], [path], PPO, env)) == [path]


def script(*arguments):
    """Run scripts/evaluate.py in this process and the current folder."""
    return CliRunner().invoke(program, [*map(str, arguments), "--out", "rows.csv"])


def test_policies_and_models_go_through_the_script(agents):
    saved("PPO", agents)
    done = script("--policy", "my_agents:Fixed", "--sb3", "PPO.zip", "--algo", PPO,
                  "--tuner", "nominal", "--episodes", 3)  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert policies.TRUSTED_ONLY in done.stderr
    with open("rows.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [r["tuner"] for r in rows[::3]] == ["nominal", "my_agents:Fixed", "PPO.zip"]
    assert len(rows) == 9 and {r["kp"] for r in rows[3:6]} == {"0.23"}
    assert len({r["kp"] for r in rows[6:]}) == 3
    assert rows[0]["mu_s"] == rows[3]["mu_s"] == rows[6]["mu_s"]
    for wrong in (["--sb3", "PPO.zip"], ["--policy", "my_agents:Wrong", "--episodes", "2"]):
        (agents / "rows.csv").unlink(missing_ok=True)
        done = script(*wrong)
        assert done.exit_code == 2 and done.stdout == "" and "Traceback" not in done.stderr
        assert isinstance(done.exception, SystemExit)
        assert not (agents / "rows.csv").exists()
