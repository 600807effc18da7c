"""Re-calibration while driving: the rules of every environment, for an episode of many steps."""

import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from every_environment import assert_identical
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from yawrate_env import RECALIBRATION_ID

SHORT = {"windows": 3, "window": 1.0}
CASES = {
    "short": SHORT,
    "probing": SHORT | {"probing": 0.02, "delay_samples": 1},
    "jumpy": SHORT | {"jump_every": 1.0, "v_x": 15.0, "mu_s": [0.3, 1.3]},
}
PARAMETERS = "mu_s", "M_delta", "v_x"
every_case = pytest.mark.parametrize("case", CASES)


def scalar(case="short", **kwargs):
    return gymnasium.make(RECALIBRATION_ID, **(CASES[case] | kwargs))


def native(count, case="short", **kwargs):
    return gymnasium.make_vec(RECALIBRATION_ID, num_envs=count, **(CASES[case] | kwargs))


def action(env, seed=0):
    """Somewhat beyond the box; strong gains are unstable on some vehicles."""
    space = getattr(env, "single_action_space", env.action_space)
    values = np.random.default_rng(seed).uniform(-1.2, 1.2, (getattr(env, "num_envs", 1), 4))
    values = np.abs(values[:, : space.shape[0]]) if seed == 1 else values[:, : space.shape[0]]
    return values.astype(np.float32) if hasattr(env, "num_envs") else values[0].astype(np.float32)


def keep(env):
    return np.full(env.action_space.shape, -1, np.float32)


@every_case
def test_gymnasiums_checker_minds_nothing(case):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(scalar(case).unwrapped, skip_render_check=True)


def test_a_drive_is_truncated_after_its_windows():
    env = scalar()
    obs, info = env.reset(seed=0)
    assert info == {} and env.observation_space.contains(obs)
    for left in (2, 1, 0):
        obs, reward, terminated, truncated, info = env.step(keep(env))
        assert env.observation_space.contains(obs)
        assert type(reward) is float and -4 <= reward <= 0
        assert terminated is False and truncated is (left == 0)
        assert {type(value) for value in info.values()} == {bool, float}
        assert info["changed"] is False and info["cost"] in (0.0, 1.0)
    with pytest.raises(ResetNeeded):
        env.unwrapped.step(keep(env))
    with pytest.raises(ResetNeeded):
        scalar().unwrapped.step(keep(env))


def test_unstable_loops_end_the_drive_and_cost():
    env = native(256, windows=50)
    env.reset(seed=0)
    strong = np.ones((256, 3), np.float32)
    _, reward, terminated, truncated, info = env.step(strong)
    assert 0 < terminated.sum() < 256 and not truncated.any()
    assert (reward[terminated] == -5).all() and (reward[~terminated] > -5).all()
    assert not info["final_info"]["stable"][terminated].any() and info["stable"][~terminated].all()
    assert (info["final_info"]["cost"][terminated] == 1).all()
    low = info["phase_margin"][~terminated] < 45
    np.testing.assert_array_equal(info["cost"][~terminated], low)
    assert all(env.single_observation_space.contains(obs) for obs in info["final_obs"][terminated])
    assert np.isfinite(env.step(-strong)[0]).all()


def test_rewards_are_margin_errors_less_the_price():
    env = scalar(price=0.125, friction_walk=0.0, speed_walk=0.0, jump_every=1e9).unwrapped
    env.reset(seed=3)
    reward, _, _, info = env.step(keep(env))[1:]
    assert reward == pytest.approx(0, abs=1e-9)  # the gains of the start still suit
    rightly = env.interface.actions(np.array([[info["oracle_kp"], info["oracle_Ti"]]]))[0]
    reward, _, _, info = env.step(rightly + [0, -0.4, 0])[1:]
    e = np.hypot((info["phase_margin"] - 60) / 10, (info["crossover"] - 1.5) / 0.25)
    assert info["changed"] and e > 0.5
    assert reward == pytest.approx(-e / (1 + e / 4) - 0.125)
    reward, _, _, info = env.step(rightly)[1:]
    assert reward == pytest.approx(-0.125, abs=1e-6)  # single precision of an action


def test_probing_informs_and_is_paid_in_comfort():
    base = {"windows": 1, "window": 5.0, "comfort": 0.5}
    quiet = {"friction_walk": 0.0, "speed_walk": 0.0, "jump_every": 1e9}
    still, probed = (native(64, "probing", **base, **quiet) for _ in range(2))
    spreads, rewards = [], []
    for env, amplitude in ((still, 0.0), (probed, 1.0)):
        env.reset(seed=0)
        actions = np.tile(np.float32([0, 0, -1, amplitude]), (64, 1))
        _, reward, *_, info = env.step(actions)
        obs = np.stack(info["final_obs"])
        spreads.append(obs[:, 2:4].mean(axis=0))
        rewards.append(reward.mean())
    assert (spreads[1] < spreads[0] - 0.05).all()  # logarithms of standard deviations
    assert rewards[1] < rewards[0] - 0.05


def test_observations_can_be_turned_back():
    env = native(64).unwrapped
    obs, _ = env.reset(seed=5)
    interface = env.drives
    found = interface.estimates(obs)
    spread = np.sqrt(np.einsum("bii->bi", found.covariance))
    prior = interface.drives.estimator.prior
    assert (spread <= np.sqrt(prior.variance) * (1 + 1e-5)).all()
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
    assert (found.misfit > 20).all()  # of 100 samples
    *_, info = env.step(interface.actions(interface.gains(obs)))
    kp = info["kp"]
    np.testing.assert_allclose(interface.gains(obs)[:, 0], kp, rtol=1e-5)
    np.testing.assert_allclose(interface.speeds(obs), info["v_x"], rtol=1e-5)
    F, i = found.information(prior)
    true = np.log(np.stack([info["mu_s"], info["M_delta"] + 1895.0], axis=1))
    error = np.linalg.solve(F, i[..., None])[..., 0] - true
    # The windows' own estimates scatter by what they say; walks add a little.
    assert np.median(np.einsum("bi,bij,bj->b", error, F, error)) < 3


@every_case
@pytest.mark.parametrize("count", [1, 7])
def test_native_batch_is_gymnasiums_loop_over_environments(case, count):
    ours = native(count, case)
    theirs = gymnasium.make_vec(
        RECALIBRATION_ID, num_envs=count, vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}, **CASES[case],
    )  # fmt: skip
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert_identical(ours.reset(seed=10), theirs.reset(seed=10))
    for k in range(9):
        assert_identical(ours.step(action(ours, k)), theirs.step(action(ours, k)))
    assert_identical(ours.reset(), theirs.reset())
    mask = np.arange(count) % 2 == 0
    options = [{"reset_mask": mask, "mu_s": 0.5} for _ in range(2)]
    assert_identical(ours.reset(options=options[0]), theirs.reset(options=options[1]))
    assert_identical(ours.step(action(ours)), theirs.step(action(ours)))


def test_seeds_repeat_drives_and_specs_survive_json():
    env = scalar()
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    for each in (env, again):
        each.reset(seed=4)
    for k in range(3):
        assert_identical(env.step(action(env, k)), again.step(action(env, k)))
    assert (env.reset()[0] == again.reset()[0]).all()
    assert (env.reset(seed=4)[0] != env.reset(seed=5)[0]).any()


def test_pickles_go_on_where_they_were():
    env = scalar(windows=9).unwrapped
    env.reset(seed=2)
    env.step(action(env))
    again = pickle.loads(pickle.dumps(env))
    for k in range(2):
        assert_identical(env.step(action(env, k)), again.step(action(env, k)))


def test_options_pin_the_start():
    still = {"friction_walk": 0.0, "speed_walk": 0.0, "jump_every": 1e9}
    env = native(3, windows=1, **still)
    pins = {"mu_s": [0.4, 0.5, 0.6], "M_delta": 10.0, "v_x": 20.0}
    env.reset(seed=0, options=pins)
    info = env.step(np.full((3, 3), -1.0))[4]["final_info"]
    assert info["mu_s"].tolist() == pins["mu_s"] and info["v_x"].tolist() == [20.0] * 3
    for options, name in (({"mass": 1}, "mass"), ({"mu_s": -1}, "mu_s"),
                          ({"v_x": [20, 20]}, "v_x"), (5, "options")):  # fmt: skip
        with pytest.raises(ValueError, match=name):
            env.reset(options=options)


@pytest.mark.parametrize(
    ("name", "value"),
    [("windows", 0), ("window", -1.0), ("price", -0.1), ("probing", -0.1), ("comfort", np.nan),
     ("mu_s", [1, 0.5]), ("friction_walk", -1.0), ("jump_every", 0.0), ("noise", -1.0),
     ("delay_samples", -1), ("phase_margin", 0.0), ("vehicle", {"mass": 1}), ("v_x", 0.0),
     ("Ts_control", 0.0)],
)  # fmt: skip
def test_arguments_are_checked(name, value):
    with pytest.raises((ValueError, gymnasium.error.Error), match=name):
        gymnasium.make(RECALIBRATION_ID, **{name: value}).reset()


def test_bad_actions_leave_drives_as_they_are():
    env = native(3)
    env.reset(seed=0)
    expected = env.step(action(env))
    env.reset(seed=0)
    for bad in (np.full((3, 3), np.nan), np.zeros((3, 2)), np.zeros(3), None, "fast"):
        with pytest.raises(ValueError, match="action"):
            env.step(bad)
    assert_identical(env.step(action(env)), expected)


def test_stable_baselines3_gets_each_windows_info_and_the_last_observation():
    from tuners.agents.sb3_vec_env import Sb3VecEnv

    one, batch = Sb3VecEnv(native(2)), native(2)
    one.seed(3)
    np.testing.assert_array_equal(one.reset(), batch.reset(seed=[3, 4])[0])
    actions = np.full((2, 3), -1.0)
    for left in (2, 1, 0):
        obs, rewards, dones, infos = one.step(actions)
        shown, expected, terminated, truncated, info = batch.step(actions)
        np.testing.assert_array_equal(obs, shown)
        np.testing.assert_allclose(rewards, expected, rtol=1e-6)
        assert dones.all() == (left == 0) and not terminated.any()
        told = info if left else info["final_info"]
        assert [each["phase_margin"] for each in infos] == told["phase_margin"].tolist()
        assert [each["TimeLimit.truncated"] for each in infos] == truncated.tolist()
    for each, last in zip(infos, info["final_obs"], strict=True):
        np.testing.assert_array_equal(each["terminal_observation"], last)


def test_the_vehicles_to_come_are_those_that_the_step_tells():
    env = native(3)
    with pytest.raises(ResetNeeded):
        _ = env.coming_theta
    env.reset(seed=0)
    theta = env.coming_theta
    *_, info = env.step(np.full((3, 3), -1.0))
    np.testing.assert_array_equal(theta, np.stack([info[name] for name in PARAMETERS], axis=1))
