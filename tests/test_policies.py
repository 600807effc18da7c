"""Anyone's policy in the same table: factories and Stable-Baselines3 models."""

import csv
import sys
import zipfile

import gymnasium
import numpy as np
import pytest
from test_scripts import run

import tuners
from tuners.agents import policies
from tuners.tuner.evaluation import evaluate
from tuners.tuner.recording import Recording
from yawrate_env.env import interaction
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import record

FEATURES = "yawrate/PITuningFeatures-v0"
SHORT = {"N": 500}
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
    draw = CONTEXT_SETS["test"].draw(env.task.prior, 0, 0, count)
    u, y = record(env.task, draw)
    return Recording(u, y, env.task.experiment.Ts, draw.context.v_x, draw.context), draw


@pytest.fixture
def agents(tmp_path, monkeypatch):
    """A folder with a user's module, being the current one."""
    (tmp_path / "my_agents.py").write_text(AGENT)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield tmp_path
    sys.modules.pop("my_agents", None)


@pytest.mark.parametrize(
    "kwargs",
    [
        {},
        {"visible": "speed", "v_x": [10, 30], "register": "random"},
        {"visible": "context", "decimate": 7},
    ],
    ids=["default", "speed", "context, decimated"],
)
def test_a_policy_is_shown_what_the_environment_shows(kwargs):
    env = PITuningEnv(**kwargs)
    recording, draw = recorded(env, 5)
    shown = policies.observations(recording, env)
    expected = interaction.observe(env.task, draw, env.visible, env.decimate)
    assert shown.dtype == expected.dtype and shown.shape[1:] == env.observation_space.shape
    np.testing.assert_array_equal(shown, expected)


def test_the_truth_is_shown_only_where_it_is_asked_for():
    recording, draw = recorded(PITuningEnv(**SHORT), 3)
    for visible, rows in (("episode", 2), ("context", 5)):
        policy = Answers((np.ones((3, 2)), None))
        policies.Player("p", policy, PITuningEnv(**SHORT, visible=visible)).act(recording)
        ((obs, state, start, deterministic),) = policy.seen
        assert obs.shape == (3, rows, 500)
        assert state is None and start.all() and len(start) == 3 and deterministic is True
    np.testing.assert_array_equal(obs[:, 3, 0], draw.context.mu_s.astype(np.float32))


def test_actions_are_applied_as_the_environment_applies_them():
    env = PITuningEnv(**SHORT)
    recording, _ = recorded(env, 1)
    for action in ([0.2, 0.3], [-4.0, 1e9], [1e3, 0.0]):
        gains = policies.Player("p", Answers((np.array(action), None)), env).act(recording)
        env.reset(seed=0)
        info = env.step(np.array(action))[4]
        np.testing.assert_array_equal(gains, [[info["kp"], info["Ti"]]])


@pytest.mark.parametrize(
    "answer, message",
    [
        (np.ones((3, 2)), "predict gave ndarray. Return .actions, state."),
        (([1.0, 2.0], None), r"p: actions has shape \(2,\), wanted \(3, 2\)"),
        ((np.ones((2, 2)), None), r"shape \(2, 2\), wanted \(3, 2\)"),
        ((np.full((3, 2), np.nan), None), "every value must be finite"),
        (("gains", None), "p: actions is not an array of numbers"),
    ],
)
def test_wrong_answers_are_refused(answer, message):
    env = PITuningEnv(**SHORT)
    with pytest.raises(ValueError, match=message):
        policies.Player("p", Answers(answer), env).act(recorded(env, 3)[0])


def test_a_tuner_as_a_policy_is_judged_like_the_tuner(agents):
    env = PITuningEnv()
    players = {
        "tuner": tuners.load("ts-ff"),
        "policy": policies.of_factory("my_agents:shipped", env),
    }
    own, foreign = evaluate(players, env.task, CONTEXT_SETS["test"], episodes=20, seed=0, batch=8)
    # Observations are float32, which is far finer than the noise.
    np.testing.assert_allclose(foreign.kp, own.kp, rtol=1e-5)
    np.testing.assert_allclose(foreign.phase_margin, own.phase_margin, atol=1e-3)


@pytest.mark.parametrize(
    "spec, message",
    [
        ("my_agents", "not of the form package.module:name"),
        (":Fixed", "not of the form package.module:name"),
        ("absent:Fixed", "No module named 'absent'. Run from the folder"),
        ("my_agents:Absent", "the module my_agents has no Absent"),
        ("my_agents:number", "not callable"),
        ("my_agents:Fixed.predict", "has no Fixed.predict"),
        ("types:SimpleNamespace", "made a SimpleNamespace, which has no predict"),
    ],
)
def test_wrong_factories_are_refused(agents, spec, message):
    with pytest.raises(ValueError, match=message):
        policies.of_factory(spec, PITuningEnv(**SHORT))


def test_an_error_within_a_users_module_is_not_hidden(agents):
    (agents / "broken_agents.py").write_text("import my_agents\nmy_agents.absent\n")
    with pytest.raises(AttributeError, match="absent"):
        policies.of_factory("broken_agents:Fixed", PITuningEnv(**SHORT))


def saved(name, folder, env_id=FEATURES, policy="MlpPolicy", **settings):
    """An untrained model of Stable-Baselines3 or sb3-contrib, and its file."""
    import sb3_contrib
    import stable_baselines3

    kind = getattr(stable_baselines3, name, None) or getattr(sb3_contrib, name)
    env = gymnasium.make(env_id, **settings)
    model = kind(policy, env, policy_kwargs={"net_arch": [8]}, device="cpu", seed=0)
    model.save(folder / f"{name}.zip")
    return model, str(folder / f"{name}.zip")


@pytest.mark.parametrize("name", ["PPO", "A2C", "SAC", "TD3", "DDPG", "TQC", "TRPO", "CrossQ"])
def test_the_algorithm_is_read_from_the_file(name, tmp_path):
    model, path = saved(name, tmp_path, **SHORT)
    env = PITuningEnv(**SHORT)
    player = policies.of_sb3(path, env)
    # A DDPG is a TD3 with other settings, and saved alike.
    assert type(player.policy).__name__ == {"DDPG": "TD3"}.get(name, name)
    features = gymnasium.make(FEATURES, **SHORT)
    obs, _ = features.reset(seed=3)
    np.testing.assert_array_equal(
        player.policy.predict(obs, deterministic=True)[0], model.predict(obs, deterministic=True)[0]
    )


@pytest.mark.parametrize("compressor", ["laguerre", "armax"])
def test_a_model_of_features_does_what_it_does_in_its_environment(compressor, tmp_path):
    model, path = saved("SAC", tmp_path, compressor=compressor)
    player = policies.of_sb3(path, PITuningEnv())
    env = gymnasium.make(FEATURES, compressor=compressor)
    for seed in range(3):
        features, _ = env.reset(seed=seed)
        raw, _ = PITuningEnv().reset(seed=seed)
        recording, _ = Recording.of_observations(raw, 0.001)
        info = env.step(model.predict(features, deterministic=True)[0])[4]
        np.testing.assert_allclose(player.act(recording), [[info["kp"], info["Ti"]]], rtol=1e-6)


def test_a_model_of_recordings_acts_in_physical_units(tmp_path):
    # Its replay memory would take 8 GB, were it made again to act.
    model, path = saved("SAC", tmp_path, "yawrate/PITuning-v0", N=1000)
    env = PITuningEnv(N=1000)
    player = policies.of_sb3(path, env)
    assert player.policy.buffer_size == 1
    obs, _ = env.reset(seed=1)
    info = env.step(model.predict(obs, deterministic=True)[0])[4]
    recording, _ = Recording.of_observations(obs, 0.001)
    np.testing.assert_allclose(player.act(recording), [[info["kp"], info["Ti"]]], rtol=1e-6)


def test_models_of_other_environments_are_refused(tmp_path):
    _, path = saved("PPO", tmp_path, "yawrate/PITuning-v0", N=300)
    with pytest.raises(ValueError, match=r"shape \(2, 300\), here they are .*--env-kwargs"):
        policies.of_sb3(path, PITuningEnv(**SHORT))
    _, path = saved("PPO", tmp_path, "Pendulum-v1")
    with pytest.raises(ValueError, match=r"observations of shape \(3,\)"):
        policies.of_sb3(path, PITuningEnv(**SHORT))


def test_actions_of_another_kind_are_refused():
    env = PITuningEnv(**SHORT)
    for space in (gymnasium.spaces.Box(-2.0, 2.0, (2,)), gymnasium.spaces.Discrete(2)):
        with pytest.raises(ValueError, match="model.zip acts in .* Train it in"):
            policies._reach("model.zip", space, env)


@pytest.mark.parametrize("content", [None, b"", b"not a zip", {}, {"data": "[1]"}, {"data": "{"}])
def test_files_of_another_kind_are_refused(content, tmp_path):
    path = tmp_path / "model.zip"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        with zipfile.ZipFile(path, "w") as file:
            for name, text in content.items():
                file.writestr(name, text)
    message = "There is no file" if content is None else "not a Stable-Baselines3 model"
    with pytest.raises(ValueError, match=message):
        policies.of_sb3(str(path), PITuningEnv(**SHORT))


def test_what_cannot_be_loaded_is_refused_with_the_remedy(tmp_path):
    _, good = saved("PPO", tmp_path, **SHORT)
    with pytest.raises(ValueError, match="cannot be loaded with stable_baselines3:SAC.*--algo"):
        policies.of_sb3(good, PITuningEnv(**SHORT), "stable_baselines3:SAC")
    strange = tmp_path / "strange.zip"
    with zipfile.ZipFile(strange, "w") as file:
        file.writestr("data", '{"weights": 1}')
    with pytest.raises(ValueError, match="does not tell its algorithm. Name its class"):
        policies.of_sb3(str(strange), PITuningEnv(**SHORT))


@pytest.mark.slow
def test_policy_and_model_go_through_the_script(agents):
    from stable_baselines3 import PPO

    env = gymnasium.make(FEATURES)
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=8, n_epochs=1, device="cpu", seed=0)
    model.learn(16)
    model.save("mine.zip")
    done = run("evaluate", "--policy", "my_agents:Fixed", "--sb3", "mine.zip", "--tuner", "nominal",
               "--episodes", 3, "--out", "rows.csv", cwd=agents)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert policies.TRUSTED_ONLY in done.stderr
    with open("rows.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [r["tuner"] for r in rows[::3]] == ["nominal", "my_agents:Fixed", "mine.zip"]
    assert len(rows) == 9 and {r["kp"] for r in rows[3:6]} == {"0.23"}
    assert len({r["kp"] for r in rows[6:]}) == 3
    assert rows[0]["mu_s"] == rows[3]["mu_s"] == rows[6]["mu_s"]
    assert [line.split(" ")[1] for line in done.stdout.splitlines()[2:5]] == [
        "`nominal`",
        "`my_agents:Fixed`",
        "`mine.zip`",
    ]


WRONG = {
    "nothing": ([], "nothing to evaluate: give --tuner, --policy or --sb3"),
    "no module": (["--policy", "absent:make"], "error: absent:make: No module named 'absent'. Run"),
    "no predict": (["--policy", "types:SimpleNamespace"], "which has no predict"),
    "no file": (["--sb3", "absent.zip"], "error: There is no file absent.zip"),
    "no model": (["--sb3", "my_agents.py"], "my_agents.py is not a Stable-Baselines3 model"),
    "wrong answer": (
        ["--policy", "my_agents:Wrong", "--episodes", "2"],
        "my_agents:Wrong: actions has shape (1, 1), wanted (1, 2)",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_policies_are_refused_in_one_line(case, agents):
    words, message = WRONG[case]
    done = run("evaluate", *words, "--out", "rows.csv", cwd=agents)
    assert done.returncode == 2 and done.stdout == "" and "Traceback" not in done.stderr
    assert message in done.stderr.splitlines()[-1]
    assert not (agents / "rows.csv").exists()
