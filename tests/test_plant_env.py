"""``yawrate/Plant-v0`` for a plant in closed form, and the command line for the same."""

import json

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner
from first_order import U, described, plant
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from imports import modules_after
from recordings import ROOT

import yawrate_env
from tuners.cli import main
from tuners.plants import Coordinates
from yawrate_env.env.plant_env import PlantEnv, action_space

ENTRY = "first_order:plant"


def make():
    return gymnasium.make(yawrate_env.PLANT_ID, plant=ENTRY)


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized:UserWarning")
def test_gymnasium_finds_nothing_wrong():
    env = make()
    check_env(env.unwrapped, skip_render_check=True)
    assert env.observation_space.shape == (2, len(U)) and env.action_space.shape == (2,)


def test_the_specification_survives_json():
    again = gymnasium.envs.registration.EnvSpec.from_json(make().spec.to_json())
    obs, _ = gymnasium.make(again).reset(seed=3)
    np.testing.assert_array_equal(obs, make().reset(seed=3)[0])


def test_the_oracles_gains_earn_nothing_less_than_all():
    env = make()
    _, info = env.reset(seed=0)
    assert info == {}
    *_, info = env.step(env.action_space.sample())
    env.reset(seed=0)
    gains = [info["oracle_kp"], info["oracle_Ti"]]
    _, reward, terminated, truncated, info = env.step(np.array(gains))
    assert reward == pytest.approx(0.0, abs=1e-12) and terminated and not truncated
    assert not info["clipped"] and info["stable"]
    assert info["kp"] == pytest.approx(info["T"] / (info["K"] * 0.3))


def test_the_observation_is_the_recording_of_the_plant():
    env = make()
    obs, _ = env.reset(seed=0, options={"K": 1.5, "T": 0.4})
    clean = plant.respond(np.array([[1.5, 0.4]]))[0]
    assert obs.dtype == np.float32
    np.testing.assert_allclose(obs[0], U)
    assert np.std(obs[1] - clean) == pytest.approx(plant.noise, rel=0.1)
    *_, info = env.step(np.array([1e3, 1e3]))
    assert (info["K"], info["T"], info["clipped"]) == (1.5, 0.4, True)
    assert info["kp"] == env.action_space.high[0]


def test_an_episode_has_one_step():
    env = PlantEnv(plant)
    with pytest.raises(ResetNeeded):
        env.step(np.ones(2))
    env.reset(seed=0)
    env.step(np.ones(2))
    with pytest.raises(ResetNeeded):
        env.step(np.ones(2))


@pytest.mark.parametrize(
    "do, words",
    [
        (lambda env: env.reset(options={"mass": 1.0}), "mass"),
        (lambda env: env.reset(options={"K": np.nan}), "K = nan must be finite"),
        (lambda env: env.reset(options={"K": [1.0, 2.0]}), "K has 2 values: give one, or 1"),
        (lambda env: env.step(np.ones(3)), "action has shape"),
        (lambda env: env.step(np.array([np.nan, 1.0])), "every value must be finite"),
    ],
)
def test_mistakes_are_named(do, words):
    env = PlantEnv(plant)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=words):
        do(env)


def test_a_batch_is_what_the_scalars_are():
    envs, ones = gymnasium.make_vec(yawrate_env.PLANT_ID, 3, plant=ENTRY), [make() for _ in "123"]
    assert envs.unwrapped.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    obs, info = envs.reset(seed=5, options={"T": [0.3, 0.4, 0.5]})
    expected = [e.reset(seed=5 + i, options={"T": 0.3 + 0.1 * i}) for i, e in enumerate(ones)]
    np.testing.assert_array_equal(obs, [first for first, _ in expected])
    for _ in range(2):
        before, actions = obs, envs.action_space.sample()
        obs, reward, terminated, truncated, info = envs.step(actions)
        results = [one.step(action) for one, action in zip(ones, actions, strict=True)]
        np.testing.assert_allclose(reward, [r for _, r, *_ in results], rtol=1e-12)
        assert terminated.all() and not truncated.any()
        for i, (*_, last) in enumerate(results):
            own = {name: info["final_info"][name][i] for name in last}
            assert own == pytest.approx(last, nan_ok=True)
        np.testing.assert_array_equal(np.stack(info["final_obs"]), before)
        np.testing.assert_array_equal(obs, [one.reset()[0] for one in ones])


def test_part_of_a_batch_is_reset():
    envs = gymnasium.make_vec(yawrate_env.PLANT_ID, 3, plant=ENTRY)
    before, _ = envs.reset(seed=1)
    after, _ = envs.reset(options={"reset_mask": np.array([False, True, False]), "K": 1.0})
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    assert (after[1] != before[1]).any()
    *_, info = envs.step(envs.action_space.sample())
    assert info["final_info"]["K"][1] == 1.0 != info["final_info"]["K"][0]
    with pytest.raises(ValueError, match=r"action has shape \(2, 2\)"):
        envs.step(np.ones((2, 2)))


def test_actions_reach_what_the_prior_needs_and_no_constant_is_a_point():
    space = action_space(plant)
    corners = plant.oracle(np.array([[0.5, 1.0], [2.0, 0.2]]))
    assert (space.low < corners).all() and (corners < space.high).all()
    assert (space.low > 0).all()

    def constant(theta):
        return np.tile([-1.0, 2.0], (len(theta), 1))

    fixed = action_space(
        described(design=constant, coordinates=Coordinates(lambda g: g, lambda x: x))
    )
    assert (fixed.low < [-1.0, 2.0]).all() and (fixed.high > [-1.0, 2.0]).all()


def test_the_environment_needs_no_learning():
    loaded = modules_after(
        "import sys; sys.path.insert(0, 'tests'); import gymnasium, yawrate_env; "
        f"gymnasium.make('yawrate/Plant-v0', plant='{ENTRY}').reset(seed=0)"
    )
    assert not loaded & {"torch", "xgboost", "stable_baselines3", "matplotlib", "control"}


def call(*arguments):
    done = CliRunner().invoke(main, list(map(str, arguments)), catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


def test_from_a_toml_file_to_trusted_gains(tmp_path):
    """As somebody does who has one file with a plant, in a folder of their own."""
    code = (ROOT / "tests" / "first_order.py").read_text()
    (tmp_path / "my_valve.py").write_text(code.replace("first_order:plant", "my_valve:plant"))
    (tmp_path / "my.toml").write_text('[plant]\nentry = "my_valve:plant"\n')
    tuner, log = tmp_path / "my.tuner", tmp_path / "log.csv"
    code, out, _ = call("train", "--vehicle", tmp_path / "my.toml", "-o", tuner, "--episodes", 60)
    assert code == 0 and "relative error of kp" in out and "(bound" in out, out

    y = plant.respond(np.array([[1.2, 0.5]]))[0] + 0.02 * np.random.default_rng(0).normal(size=500)
    rows = [f"{k * 0.02:.2f},{U[k]},{y[k]:.5f}" for k in range(500)]
    log.write_text("\n".join(["t,valve,flow [l/s]", *rows]))
    code, out, err = call("tune", log, "--tuner", tuner, "--json")
    found = json.loads(out)
    assert (code, err) == (0, "") and found["trusted"]
    assert found["gains"]["kp"] == pytest.approx(0.5 / (1.2 * 0.3), rel=0.1)
    code, out, _ = call("tune", log, "--tuner", tuner)
    assert code == 0 and "Trusted" in out

    log.write_text(
        "\n".join(["t,u,y", *(f"{k * 0.02:.2f},{U[k]},{-y[k]:.5f}" for k in range(500))])
    )
    code, out, _ = call("tune", log, "--tuner", tuner)
    assert code == 3 and "NOT TRUSTED" in out and "Best for every plant" in out


@pytest.mark.parametrize(
    "toml, words",
    [
        ("[plant]\n", "nothing else"),
        ('[plant]\nentry = "gone:plant"\n', "no module 'gone'"),
        ("[plant\n", "is not TOML"),
    ],
)
def test_a_bad_toml_file_is_one_line_of_error(tmp_path, toml, words):
    (tmp_path / "my.toml").write_text(toml)
    code, out, err = call("train", "--vehicle", tmp_path / "my.toml", "-o", tmp_path / "a.tuner")
    assert code == 1 and out == "" and words in err and err.count("\n") == 1


def test_the_input_to_drive_is_written(tmp_path):
    (tmp_path / "my.toml").write_text(f'[plant]\nentry = "{ENTRY}"\n')
    out = tmp_path / "u.csv"
    code, said, _ = call("excite", "--vehicle", tmp_path / "my.toml", "-o", out)
    assert code == 0 and "10 s of valve [%]" in said
    written = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_allclose(written[:, 1], U)
    np.testing.assert_allclose(np.diff(written[:, 0]), plant.Ts)
