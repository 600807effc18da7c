import hashlib
import pickle
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import yawrate_env
from yawrate_env.env.nonlinear_env import PITuningNonlinearEnv
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

ENVIRONMENTS = {
    "yawrate/PITuning-v0": PITuningEnv,
    "yawrate/PITuningNonlinear-v0": PITuningNonlinearEnv,
}
ID, Env = "yawrate/PITuning-v0", PITuningEnv
ACTION = np.array([0.2, 0.3])
INFO_KEYS = [
    *("kp", "Ti", "clipped", "phase_margin", "crossover", "gain_margin", "stable"),
    *("oracle_kp", "oracle_Ti", "mu_s", "M_delta", "v_x"),
]


@pytest.fixture(autouse=True, params=ENVIRONMENTS)
def environment(request, monkeypatch):
    """Run every test over every environment, as `ID` and `Env`."""
    monkeypatch.setitem(globals(), "ID", request.param)
    monkeypatch.setitem(globals(), "Env", ENVIRONMENTS[request.param])


def short(**kwargs):
    """Half a second at 1 kHz, to save time."""
    return Env(**{"N": 500} | kwargs)


def episode(env, action=ACTION, **reset):
    obs, _ = env.reset(**reset)
    return obs, env.step(action)


def test_import_registers_the_environment_once():
    assert ID in (yawrate_env.ENV_ID, yawrate_env.NONLINEAR_ID) and ID in gymnasium.registry
    program = (
        "import importlib, gymnasium, yawrate_env; importlib.reload(yawrate_env); "
        f"gymnasium.make({ID!r})"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)
    program = "import gymnasium; gymnasium.make('yawrate_env:" + ID + "')"
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize(
    "kwargs", [{}, {"visible": "context", "v_x": [10, 33]}, {"register": "random", "decimate": 5}]
)
def test_gymnasiums_checker_minds_the_physical_action_units_only(kwargs):
    env = gymnasium.make(ID, **kwargs).unwrapped
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env, skip_render_check=True)
    messages = [str(warning.message) for warning in caught]
    assert len(messages) == 1, messages
    assert "recommend using a symmetric and normalized space" in messages[0]


def test_spaces():
    env = Env()
    assert env.observation_space.shape == (2, 10_000)
    assert env.observation_space.dtype == np.float32
    assert env.action_space.low.tolist() == [0.001, 0.001]
    assert env.action_space.high.tolist() == [10, 100]
    obs, info = env.reset(seed=0)
    assert env.observation_space.contains(obs) and obs.dtype == np.float32
    assert info == {}
    np.testing.assert_array_equal(np.unique(obs[0]), np.float32([-1, 1]) * np.float32(np.pi / 180))


def test_one_step_ends_the_episode_and_tells_all():
    env = short()
    obs, (final_obs, reward, terminated, truncated, info) = episode(env, seed=0)
    np.testing.assert_array_equal(final_obs, obs)
    assert terminated is True and truncated is False and type(reward) is float
    assert list(info) == INFO_KEYS
    for name in INFO_KEYS:
        assert type(info[name]) is (bool if name in ("clipped", "stable") else float)
    assert (info["kp"], info["Ti"], info["clipped"]) == (0.2, 0.3, False)


def test_outcome_is_the_judges():
    *_, info = (result := episode(short(), seed=3)[1])
    judge = loops(Task(), Context.of(info["mu_s"], info["M_delta"], info["v_x"]))
    verdict = judge.evaluate(*ACTION[:, None])
    assert result[1] == verdict.reward[0]
    assert info["phase_margin"] == verdict.margins.phase_margin[0]
    assert info["crossover"] == verdict.margins.crossover[0]
    assert info["gain_margin"] == verdict.margins.gain_margin[0]
    assert (info["oracle_kp"], info["oracle_Ti"]) == (judge.design().kp[0], judge.design().Ti[0])


@pytest.mark.parametrize(
    "kwargs",
    [
        {},
        {"delay_samples": 1, "phase_margin": 50.0},
        {"controller": "printed", "phase_margin": 40.0, "v_x": 30.0},
        {"Ts_control": 0.001, "crossover": 2.0, "phase_margin": 50.0},
        {"vehicle": {"J_z": 2000.0, "C_f": 110e3}},
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


def test_delay_and_printed_form_change_the_verdict():
    plain, delayed, printed = (
        episode(short(**kwargs), seed=0)[1][4]
        for kwargs in ({}, {"delay_samples": 1}, {"controller": "printed"})
    )
    assert delayed["crossover"] == pytest.approx(plain["crossover"], rel=1e-12)
    lost = 360 * plain["crossover"] * 0.01
    assert delayed["phase_margin"] == pytest.approx(plain["phase_margin"] - lost, rel=1e-9)
    assert printed["phase_margin"] != pytest.approx(plain["phase_margin"], abs=1)


@pytest.mark.parametrize(
    ("action", "applied", "clipped"),
    [
        ([0.001, 100.0], [0.001, 100.0], False),
        ([0.0, 1.0], [0.001, 1.0], True),
        ([-5.0, 1e6], [0.001, 100.0], True),
        ([1.0, 100.001], [1.0, 100.0], True),
    ],
)
def test_actions_outside_the_box_are_clipped_and_said_to_be(action, applied, clipped):
    info = episode(short(), np.array(action), seed=0)[1][4]
    assert [info["kp"], info["Ti"]] == applied
    assert info["clipped"] is clipped


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([np.nan, 1.0], "action has nan"),
        ([1.0, np.inf], "action has inf"),
        ([1.0], r"action has shape \(1, 1\), wanted \(1, 2\)"),
        ([[1.0, 1.0]], "action has shape"),
        ("fast", "action is not an array of numbers"),
        (None, "action has shape"),
    ],
)
def test_bad_actions_are_refused_and_leave_the_episode_open(action, message):
    env = short()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(action)
    assert env.step(ACTION)[1] == episode(short(), seed=0)[1][1]


def test_reset_is_needed_before_each_step():
    env = short()
    with pytest.raises(ResetNeeded, match="one step"):
        env.step(ACTION)
    episode(env, seed=0)
    with pytest.raises(ResetNeeded, match="one step"):
        env.step(ACTION)
    episode(env)


def test_returned_observations_are_the_callers_own():
    env = short()
    obs, _ = env.reset(seed=0)
    kept = obs.copy()
    obs[:] = 0
    final_obs = env.step(ACTION)[0]
    np.testing.assert_array_equal(final_obs, kept)


def test_a_seed_repeats_the_episodes_after_it():
    env, again = short(register="random"), short(register="random")
    for seed in (0, None, None, 0):
        obs, (_, reward, _, _, info) = episode(env, seed=seed)
        other, (_, other_reward, _, _, other_info) = episode(again, seed=seed)
        np.testing.assert_array_equal(obs, other)
        assert (reward, info) == (other_reward, other_info)


def test_a_thousand_seeds_give_a_thousand_episodes_twice():
    def digests(env):
        return [hashlib.sha256(env.reset(seed=s)[0].tobytes()).digest() for s in range(1000)]

    first = digests(short(N=200))
    assert first == digests(short(N=200))
    assert len(set(first)) == 1000


def test_frozen_episode():
    # Not an independent reference but a promise: who changes these numbers changes the
    # environment's version (CONTRIBUTING.md). Yaw rates are float32, written to 8 decimals.
    obs, (_, reward, _, _, info) = episode(Env(), seed=0)
    assert [info["mu_s"], info["M_delta"]] == pytest.approx(
        [0.8095693498571634, 80.9360141291611], rel=1e-12
    )
    yaw_rates = {
        PITuningEnv: [0.00293841, 0.00018343, 0.00092454, -0.03372409],
        PITuningNonlinearEnv: [0.00293028, 0.00018292, 0.00095414, -0.03351492],
    }
    assert obs[1, [0, 1, 5000, 9999]] == pytest.approx(yaw_rates[Env], abs=1e-8)
    assert reward == pytest.approx(-1.1299680511, rel=1e-8)


@pytest.mark.parametrize("pins", [{"mu_s": 0.5}, {"M_delta": 77.0, "v_x": 15.0}, {"v_x": 25}])
def test_options_pin_values_and_leave_the_rest_of_the_draw(pins):
    free = episode(short(v_x=[10, 33]), seed=4)[1][4]
    pinned = episode(short(v_x=[10, 33]), seed=4, options=pins)[1][4]
    for name in ("mu_s", "M_delta", "v_x"):
        assert pinned[name] == pins.get(name, free[name])


def test_pinning_to_the_drawn_values_changes_nothing():
    env = short()
    obs, (*_, info) = episode(env, seed=5)
    options = {name: info[name] for name in ("mu_s", "M_delta", "v_x")}
    np.testing.assert_array_equal(episode(env, seed=5, options=options)[0], obs)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mu": 0.5}, "'mu' is unknown. Use any of mu_s, M_delta, v_x"),
        ({"mu_s": 0.0}, "mu_s = 0 must be finite, above 0, at least 0.001"),
        ({"mu_s": np.nan}, "mu_s has nan"),
        ({"v_x": -1.0}, "v_x = -1 must be finite, above 0"),
        ({"v_x": [10.0, 20.0]}, r"v_x has shape \(2,\): give one number"),
        ({"v_x": "fast"}, "v_x = 'fast': give one number"),
        ("abc", "reset options = 'abc' are not a dictionary"),
        (5, "reset options = 5 are not a dictionary"),
        ({"M_delta": -5000.0}, r"M_0 \+ M_delta = .*above 0"),
    ],
)
def test_bad_options_are_refused_and_leave_the_episode_open(options, message):
    env = short(M_delta=100.0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)
    assert env.step(ACTION)[4]["M_delta"] == 100


@pytest.mark.parametrize(
    ("kwargs", "name", "value"),
    [
        ({"Ts": 0.0}, "Ts", "0"),
        ({"Ts": -0.001}, "Ts", "-0.001"),
        ({"N": 199}, "N", "199"),
        ({"N": 0}, "N", "0"),
        ({"N": 300.5}, "N", "300.5"),
        ({"N": 10**8}, "N", r"1e\+08"),
        ({"amplitude": 1e-7}, "amplitude", "1e-07"),
        ({"delay_samples": 201}, "delay_samples", "201"),
        ({"mu_s": 1e-4}, "mu_s", "0.0001"),
        ({"vehicle": {"J_z": 1e-3}}, "J_z", "0.001"),
        ({"vehicle": {"C_f": 1e9}}, "C_f", r"1e\+09"),
        ({"snr_db": np.nan}, "snr_db", "nan"),
        ({"snr_db": "30"}, "snr_db", "'30'"),
        ({"amplitude": -0.01}, "amplitude", "-0.01"),
        ({"amplitude": 1.0}, "amplitude", "1"),
        ({"bit_time": 0.0}, "bit_time", "0"),
        ({"register": "seven"}, "register", "'seven'"),
        ({"Ts_control": 0.0}, "Ts_control", "0"),
        ({"delay_samples": -1}, "delay_samples", "-1"),
        ({"delay_samples": 1.5}, "delay_samples", "1.5"),
        ({"phase_margin": 0.0}, "phase_margin", "0"),
        ({"phase_margin": 190.0}, "phase_margin", "190"),
        ({"crossover": 60.0}, "crossover", "60"),  # above the Nyquist frequency of 50 Hz
        ({"crossover": -1.0}, "crossover", "-1"),
        ({"controller": "pid"}, "controller", "'pid'"),
        ({"mu_s": 0.0}, "mu_s", "0"),
        ({"mu_s": [1.1, 0.3]}, "mu_s", r"\[1.1, 0.3\]"),
        ({"mu_s": [0.3, 0.7, 1.1]}, "mu_s", r"\[0.3, 0.7, 1.1\]"),
        ({"v_x": [-10.0, 20.0]}, "v_x", "-10"),
        ({"v_x": None}, "v_x", "None"),
        ({"M_delta": -2000.0}, "M_delta", "-105"),
        ({"vehicle": {"M_0": -1.0}}, "M_0", "-1"),
        ({"vehicle": {"mass": 1.0}}, "vehicle", "{'mass': 1.0}"),
        ({"visible": "all"}, "visible", "'all'"),
        ({"decimate": 0}, "decimate", "0"),
        ({"decimate": 6000}, "decimate", "6000"),
        ({"render_mode": "ansi"}, "render_mode", "'ansi'"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_bad_parameters_are_refused_by_the_constructor(kwargs, name, value):
    with pytest.raises(ValueError, match=rf"\b{name}\b.* (= )?{value}\b|\b{name} = {value}"):
        Env(**kwargs)


def test_bad_parameters_are_refused_by_make():
    with pytest.raises(ValueError, match="crossover = 60 must be finite, above 0, at most 45"):
        gymnasium.make(ID, crossover=60.0)


def test_a_yaw_rate_beyond_all_bounds_is_refused():
    env = PITuningEnv(vehicle={"C_f": 1e7}, v_x=200.0)
    with pytest.raises(ValueError, match="v_x = 200 m/s is not finite: .* unstable. Lower v_x"):
        env.reset(seed=0)


KWARGS = {"N": 400, "mu_s": [0.4, 0.8], "v_x": [10, 30], "vehicle": {"J_z": 2000.0}}


def test_spec_survives_json():
    env = gymnasium.make(ID, **KWARGS)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.spec.kwargs == env.spec.kwargs
    assert again.unwrapped.task == env.unwrapped.task
    np.testing.assert_array_equal(env.reset(seed=1)[0], again.reset(seed=1)[0])


@pytest.mark.parametrize("started", [False, True])
def test_pickle_continues_where_it_was(started):
    env = gymnasium.make(ID, **KWARGS).unwrapped
    env.reset(seed=2)
    if not started:
        env.step(ACTION)
    again = pickle.loads(pickle.dumps(env))
    if started:
        assert again.step(ACTION)[4] == env.step(ACTION)[4]
    for _ in range(3):
        np.testing.assert_array_equal(again.reset()[0], env.reset()[0])


def test_same_register_in_every_episode_and_random_on_request():
    same, random = short(), short(register="random")
    commands = [same.reset(seed=seed)[0][0] for seed in range(10)]
    assert all((u == commands[0]).all() for u in commands)
    commands = [random.reset(seed=seed)[0][0] for seed in range(10)]
    assert len({u.tobytes() for u in commands}) > 5  # 5 bits have 31 patterns


@pytest.mark.parametrize(
    ("visible", "names"),
    [("episode", ()), ("speed", ("v_x",)), ("context", ("v_x", "mu_s", "M_delta"))],
)
@pytest.mark.parametrize("decimate", [1, 10])
def test_visible_rows(visible, names, decimate):
    env = short(visible=visible, v_x=[10, 33], decimate=decimate)
    obs, (*_, info) = episode(env, seed=6)
    assert obs.shape == env.observation_space.shape == (2 + len(names), 500 // decimate)
    assert env.observation_space.contains(obs)
    for row, name in zip(obs[2:], names, strict=True):
        np.testing.assert_array_equal(row, np.float32(info[name]))


@pytest.mark.parametrize("decimate", [3, 7, 10, 250])
def test_decimation_averages_blocks(decimate):
    whole = short().reset(seed=7)[0].astype(float)
    obs = short(decimate=decimate).reset(seed=7)[0]
    kept = 500 // decimate
    expected = whole[:, : kept * decimate].reshape(2, kept, decimate).mean(axis=2)
    assert obs.dtype == np.float32
    np.testing.assert_allclose(obs, expected, rtol=1e-6)


def test_saturation_keeps_diverging_vehicles_in_the_space():
    # An oversteering vehicle beyond its critical speed leaves any sensor's range in 10 s.
    env = Env(vehicle={"C_r": 30e3}, v_x=33.0)
    obs, (_, reward, *_) = episode(env, seed=0)
    assert np.isfinite(obs).all() and env.observation_space.contains(obs)
    assert np.abs(obs[1]).max() == 20 or Env is PITuningNonlinearEnv  # its tyres saturate first
    assert np.isfinite(reward)


def test_close_may_be_called_twice():
    env = short()
    env.reset(seed=0)
    env.close()
    env.close()


def test_the_nonlinear_vehicle_takes_its_parameters_as_plain_mappings():
    kwargs = {"tyre": {"friction": 0.8}, "body": {"height": 0.4}, "limits": {"rate": 0.5}}
    env = gymnasium.make("yawrate/PITuningNonlinear-v0", N=400, amplitude=0.1, **kwargs)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.task == env.unwrapped.task
    assert env.unwrapped.task.twin.tyre.friction == 0.8
    obs, other = env.reset(seed=0)[0], PITuningNonlinearEnv(N=400, amplitude=0.1).reset(seed=0)[0]
    assert np.abs(obs[1] - other[1]).max() > 1e-3
    with pytest.raises(ValueError, match="tyre = {'grip': 1}: give any of shape, curvature"):
        PITuningNonlinearEnv(tyre={"grip": 1})


def test_large_commands_are_answered_differently_by_the_two_vehicles():
    for amplitude, differ in ((1e-4, False), (0.07, True)):
        one, other = (
            kind(N=2000, amplitude=amplitude, snr_db=200.0, mu_s=0.4).reset(seed=0)[0][1]
            for kind in (PITuningEnv, PITuningNonlinearEnv)
        )
        assert (np.abs(one - other).max() > 1e-2 * np.abs(one).max()) == differ
