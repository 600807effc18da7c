"""The published contract of ``yawrate/PITuning-v0`` and its nonlinear twin."""

import tracemalloc

import gymnasium
import numpy as np
import pytest
from every_environment import assert_identical
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode

import yawrate_env
from yawrate_env.env.yaw_rate_env import (
    PITuningEnv,
    PITuningNonlinearEnv,
    PITuningNonlinearVectorEnv,
    PITuningVectorEnv,
)
from yawrate_env.plant.reward import reward
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

ACTION = np.array([0.2, 0.3])
INFO_KEYS = [
    *("kp", "Ti", "clipped", "phase_margin", "crossover", "gain_margin", "stable", "cost"),
    *("oracle_kp", "oracle_Ti", "mu_s", "M_delta", "v_x"),
]

both = pytest.mark.parametrize("kind", [PITuningEnv, PITuningNonlinearEnv])


def episode(env, action=ACTION, **reset):
    obs, _ = env.reset(**reset)
    return obs, env.step(action)


def short(kind=PITuningEnv, **kwargs):
    """Half a second at 1 kHz, to save time."""
    return kind(**{"N": 500} | kwargs)


@both
def test_spaces(kind):
    env = kind()
    assert env.observation_space.shape == (2, 10_000)
    assert env.observation_space.dtype == np.float32
    assert env.action_space.low.tolist() == [0.001, 0.001]
    assert env.action_space.high.tolist() == [10, 100]
    obs, info = env.reset(seed=0)
    assert env.observation_space.contains(obs) and info == {}
    np.testing.assert_array_equal(np.unique(obs[0]), np.float32([-1, 1]) * np.float32(np.pi / 180))
    assert list(env.step(ACTION)[4]) == INFO_KEYS


@both
def test_frozen_episode(kind):
    # Not an independent reference but a promise: who changes these numbers changes the
    # environment's version (CONTRIBUTING.md). Yaw rates are float32, written to 8 decimals.
    obs, (_, reward, _, _, info) = episode(kind(), seed=0)
    assert [info["mu_s"], info["M_delta"]] == pytest.approx(
        [0.8095693498571634, 80.9360141291611], rel=1e-12
    )
    yaw_rates = {
        PITuningEnv: [0.00293841, 0.00018343, 0.00092454, -0.03372409],
        PITuningNonlinearEnv: [0.00293028, 0.00018292, 0.00095414, -0.03351492],
    }
    assert obs[1, [0, 1, 5000, 9999]] == pytest.approx(yaw_rates[kind], abs=1e-8)
    assert reward == pytest.approx(-1.1299680511, rel=1e-8)


@both
@pytest.mark.parametrize("action", [ACTION, np.array([10.0, 0.001])], ids=["stable", "unstable"])
def test_the_outcome_is_that_of_the_linear_loop(kind, action):
    found, info = (result := episode(short(kind), action, seed=3)[1])[1], result[4]
    around = loops(Task(), Context.of(info["mu_s"], info["M_delta"], info["v_x"]))
    expected, oracle = around.evaluate(*action[:, None]), around.design()
    for name in ("phase_margin", "crossover", "gain_margin"):
        assert info[name] == getattr(expected.margins, name)[0]  # of unstable loops too
    assert info["stable"] == expected.stable[0]
    assert (info["oracle_kp"], info["oracle_Ti"]) == (oracle.kp[0], oracle.Ti[0])
    scaled = np.array([[(info["phase_margin"] - 60) / 10, (info["crossover"] - 1.5) / 0.25]])
    assert found == (reward(scaled)[0] if info["stable"] else -5)


@pytest.mark.parametrize(
    "kwargs",
    [
        {"delay_samples": 1, "phase_margin": 50.0},
        {"controller": "printed", "phase_margin": 40.0, "v_x": 30.0},
        {"Ts_control": 0.001, "crossover": 2.0, "vehicle": {"J_z": 2000.0, "C_f": 110e3}},
    ],
    ids=str,
)
def test_the_oracles_gains_meet_the_target(kwargs):
    env = short(**kwargs)
    info = episode(env, seed=1)[1][4]
    oracle = np.array([info["oracle_kp"], info["oracle_Ti"]])
    _, reward, _, _, info = episode(env, oracle, seed=1)[1]
    assert reward == pytest.approx(0, abs=1e-8)
    assert info["phase_margin"] == pytest.approx(kwargs.get("phase_margin", 60), rel=1e-8)
    assert info["crossover"] == pytest.approx(kwargs.get("crossover", 1.5), rel=1e-8)


def test_actions_outside_the_box_are_clipped_and_said_to_be():
    for action, applied, clipped in (
        ([0.001, 100.0], [0.001, 100.0], False),
        ([0.0, 1.0], [0.001, 1.0], True),
        ([-5.0, 1e6], [0.001, 100.0], True),
        ([1.0, 100.001], [1.0, 100.0], True),
    ):
        info = episode(short(), np.array(action), seed=0)[1][4]
        assert ([info["kp"], info["Ti"]], info["clipped"]) == (applied, clipped)


@both
def test_vehicles_outside_the_prior_may_be_pinned_if_they_exist(kind):
    env = short(kind, M_delta=100.0)
    env.reset(seed=0)
    for options, name in (
        ({"mu_s": 0.0}, "mu_s = 0 "),
        ({"v_x": -1.0}, "v_x = -1 "),
        ({"v_x": 2e3}, "v_x = 2000 "),
        ({"M_delta": -5000.0}, r"M_0 \+ M_delta"),
    ):
        with pytest.raises(ValueError, match=name):
            env.reset(options=options)
    assert env.step(ACTION)[4]["M_delta"] == 100
    pins = {"mu_s": 1.6, "M_delta": 900.0, "v_x": 35.0}
    info = episode(env, seed=0, options=pins)[1][4]
    assert {name: info[name] for name in pins} == pins


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"N": 199}, "N = 199"),
        ({"amplitude": 1e-7}, "amplitude = 1e-07"),
        ({"Ts_control": 0.0}, "Ts_control = 0"),
        ({"crossover": 60.0}, "crossover = 60"),  # above the Nyquist frequency of 50 Hz
        ({"mu_s": 1e-4}, "mu_s = 0.0001"),
        ({"M_delta": -2000.0}, "M_delta = -105"),
        ({"vehicle": {"J_z": 1e-3}}, "J_z = 0.001"),
        ({"vehicle": {"mass": 1.0}}, "vehicle = {'mass': 1.0}"),
        ({"visible": "all"}, "visible = 'all'"),
        ({"decimate": 0}, "decimate = 0"),
        ({"decimate": 6000}, "decimate = 6000"),
        ({"render_mode": "ansi"}, "render_mode = 'ansi'"),
    ],
    ids=str,
)
def test_bad_parameters_are_refused(kwargs, message):
    for make in (PITuningEnv, PITuningNonlinearEnv):
        with pytest.raises(ValueError, match=rf"\b{message}"):
            make(**kwargs)


def test_bad_parameters_of_a_batch_are_refused():
    for kwargs, name in (({"crossover": 60.0}, "crossover"), ({"render_mode": "human"}, "render")):
        with pytest.raises(ValueError, match=name):
            gymnasium.make_vec(yawrate_env.ENV_ID, num_envs=2, **kwargs)


@both
@pytest.mark.parametrize(
    "kwargs",
    [
        {"crossover": 5.0},  # the oracle's loop around the vehicle in mid-prior is unstable
        {"Ts_control": 1.0, "crossover": 0.02},  # it has no gains
        {"N": 4, "bit_time": 0.001},  # too short to tell a vehicle from
        {"Ts": 0.4, "bit_time": 0.4},  # sampled more slowly than the crossover
    ],
    ids=str,
)
def test_tasks_that_no_tuner_solves_have_episodes_nevertheless(kind, kwargs):
    obs, (_, reward, *_) = episode(short(kind, **kwargs), seed=0)
    assert np.isfinite(obs).all() and -5 <= reward <= 0


@both
def test_saturation_keeps_diverging_vehicles_in_the_space(kind):
    # An oversteering vehicle beyond its critical speed leaves any sensor's range in 10 s.
    env = kind(vehicle={"C_r": 30e3}, v_x=33.0)
    obs, (_, reward, *_) = episode(env, seed=0)
    assert np.isfinite(obs).all() and env.observation_space.contains(obs)
    assert np.abs(obs[1]).max() == 20 or kind is PITuningNonlinearEnv  # its tyres saturate first
    assert np.isfinite(reward)
    env = PITuningEnv(vehicle={"C_f": 1e7}, v_x=200.0)
    with np.errstate(all="ignore"), pytest.raises(ValueError, match="v_x = 200.* not finite"):
        env.reset(seed=0)


@both
def test_same_register_in_every_episode_and_random_on_request(kind):
    same, random = short(kind), short(kind, register="random")
    commands = [same.reset(seed=seed)[0][0] for seed in range(10)]
    assert all((u == commands[0]).all() for u in commands)
    commands = [random.reset(seed=seed)[0][0] for seed in range(10)]
    assert len({u.tobytes() for u in commands}) > 5  # 5 bits have 31 patterns


@both
@pytest.mark.parametrize(
    ("visible", "names", "decimate"),
    [("episode", (), 10), ("speed", ("v_x",), 1), ("context", ("v_x", "mu_s", "M_delta"), 10)],
)
def test_visible_rows(kind, visible, names, decimate):
    env = short(kind, visible=visible, v_x=[10, 33], decimate=decimate)
    obs, (*_, info) = episode(env, seed=6)
    assert obs.shape == env.observation_space.shape == (2 + len(names), 500 // decimate)
    assert env.observation_space.contains(obs)
    for row, name in zip(obs[2:], names, strict=True):
        np.testing.assert_array_equal(row, np.float32(info[name]))


@pytest.mark.parametrize("decimate", [7, 250])
def test_decimation_averages_blocks(decimate):
    whole = short().reset(seed=7)[0].astype(float)
    obs = short(decimate=decimate).reset(seed=7)[0]
    kept = 500 // decimate
    expected = whole[:, : kept * decimate].reshape(2, kept, decimate).mean(axis=2)
    assert obs.dtype == np.float32
    np.testing.assert_allclose(obs, expected, rtol=1e-6)


def test_the_nonlinear_vehicle_takes_its_parameters_as_plain_mappings():
    kwargs = {"tyre": {"friction": 0.8}, "body": {"height": 0.4}, "limits": {"rate": 0.5}}
    env = gymnasium.make(yawrate_env.NONLINEAR_ID, N=400, amplitude=0.1, **kwargs)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.task == env.unwrapped.task
    assert env.unwrapped.task.twin.tyre.friction == 0.8
    obs, other = env.reset(seed=0)[0], PITuningNonlinearEnv(N=400, amplitude=0.1).reset(seed=0)[0]
    assert np.abs(obs[1] - other[1]).max() > 1e-3
    with pytest.raises(ValueError, match="tyre = {'grip': 1}"):
        PITuningNonlinearEnv(tyre={"grip": 1})


# --- batches


@pytest.mark.parametrize("kind", [PITuningVectorEnv, PITuningNonlinearVectorEnv])
def test_a_thousand_seeds_give_a_thousand_episodes_in_any_batch(kind):
    env = kind(1000, N=200)
    obs, _ = env.reset(seed=0)
    assert obs.shape == (1000, 2, 200) and env.observation_space.contains(obs)
    assert len({row.tobytes() for row in obs}) == 1000
    one = kind.scalar(N=200)
    for i in (0, 511, 999):
        np.testing.assert_array_equal(obs[i], one.reset(seed=i)[0])


# From Python 3.12 on forking warns where any thread runs, those of NumPy's BLAS included.
@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
def test_worker_processes_forked_after_the_kernels_ran_give_the_same():
    name = yawrate_env.NONLINEAR_ID  # its kernel and the linear loop's
    ours = gymnasium.make_vec(name, num_envs=3, N=500)
    # Kernels on several threads, before the fork.
    gymnasium.make_vec(name, num_envs=40, N=500).reset(seed=0)
    theirs = gymnasium.make_vec(
        name, num_envs=3, N=500, vectorization_mode="async",
        vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP},
    )  # fmt: skip
    actions = np.array([[0.2, 0.3], [0.01, 1.0], [9.0, 0.002]])
    try:
        assert_identical(ours.reset(seed=5), theirs.reset(seed=5))
        for _ in range(3):
            assert_identical(ours.step(actions), theirs.step(actions))
    finally:
        theirs.close()


def most_memory(num_envs, steps):
    """Largest memory that a run takes beyond what was there before [B]."""
    env = PITuningVectorEnv(num_envs, N=2000)
    tracemalloc.start()
    env.reset(seed=0)
    for _ in range(steps):
        env.step(np.full((num_envs, 2), 0.2))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


def test_memory_grows_with_the_number_of_environments_only():
    PITuningVectorEnv(16, N=2000).reset(seed=0)  # what is made once
    few = most_memory(64, 2)
    assert most_memory(64, 12) < 1.1 * few
    assert most_memory(256, 2) < 4.4 * few
    # The observations that are returned, and about as much again on the way to them.
    assert few < 4 * 64 * 2 * 2000 * 4
