"""Features instead of recordings, actions in [-1, 1]: the two maps and their wrappers."""

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import FlattenObservation, RescaleAction
from recordings import ROOT, recorded

from tuners.agents.feature_map import ActionMap, FeatureMap
from tuners.agents.wrappers import Compressed, CompressedVector, LoopAction, LoopActionVector
from tuners.features import compressor
from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.learners.actor import LIMIT
from tuners.tuner.recording import Recording
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLAIN, FEATURES = "yawrate/PITuning-v0", "yawrate/PITuningFeatures-v0"
SHORT = {"Ts": 0.01, "N": 300}  # the least that ARMAX takes
VARIANTS = {
    "laguerre": {},
    "armax": {"compressor": "armax"},
    "random": {"register": "random", "v_x": [10, 33], "visible": "speed"},
    "context": {"visible": "context", "delay_samples": 1},
    "decimated": {"decimate": 3, "register": "random"},
    "armax decimated": {"compressor": "armax", "decimate": 4},
}


def scalar(**kwargs):
    return gymnasium.make(FEATURES, **SHORT | kwargs)


def batch(count, **kwargs):
    return gymnasium.make_vec(FEATURES, num_envs=count, **SHORT | kwargs)


def plain(**kwargs):
    return gymnasium.make(PLAIN, **SHORT | kwargs)


def plain_batch(count=2, **kwargs):
    return gymnasium.make_vec(PLAIN, num_envs=count, **SHORT | kwargs)


def actions(count, seed):
    """Somewhat more than the action box."""
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (count, 2)).astype(np.float32)


def contexts(task, count=300):
    return CONTEXT_SETS["test"].draw(task.prior, 0, 0, count).context


# --- the environment with both wrappers


@pytest.mark.parametrize("package", ["yawrate_env", "tuners"])
def test_either_import_registers_it(package):
    program = f"import gymnasium, {package}; gymnasium.make('{FEATURES}', N=500).reset(seed=0)"
    subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=ROOT, check=True)


@pytest.mark.parametrize("name", VARIANTS)
def test_gymnasiums_checker_minds_the_wrappers_only(name):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(scalar(**VARIANTS[name]), skip_render_check=True)
    messages = [str(warning.message) for warning in caught]
    # It prefers bare environments, and this one is made of wrappers.
    assert len(messages) == 1 and "different from the unwrapped version" in messages[0], messages


@pytest.mark.parametrize("name", VARIANTS)
@pytest.mark.parametrize(("count", "rows"), [(1, [0]), (11, [0, 7, 10])])
def test_each_row_of_the_batch_is_a_scalar_environment(name, count, rows):
    many, ones = batch(count, **VARIANTS[name]), {i: scalar(**VARIANTS[name]) for i in rows}
    for space in ("observation_space", "action_space"):
        assert getattr(many, f"single_{space}") == getattr(ones[0], space)
    obs, info = many.reset(seed=40)
    assert info == {} and many.observation_space.contains(obs)
    # Matrix products of several right-hand sides round otherwise than of one.
    same = {"rtol": 0, "atol": 1e-5}
    for i, one in ones.items():
        np.testing.assert_allclose(obs[i], one.reset(seed=40 + i)[0], **same)
    for k in range(3):
        before = obs
        obs, rewards, terminated, truncated, infos = many.step(actions(count, k))
        assert terminated.all() and not truncated.any()
        assert infos["_final_obs"].all() and infos["final_obs"].dtype == object
        np.testing.assert_array_equal(np.stack(infos["final_obs"]), before)
        for i, one in ones.items():
            final_obs, reward, _, _, info = one.step(actions(count, k)[i])
            np.testing.assert_allclose(infos["final_obs"][i], final_obs, **same)
            assert rewards[i] == reward
            assert set(info) == {key for key in infos["final_info"] if key[0] != "_"}
            for key, value in info.items():
                np.testing.assert_array_equal(infos["final_info"][key][i], value)
            np.testing.assert_allclose(obs[i], one.reset()[0], **same)


def test_either_order_gives_the_same():
    one, other = Compressed(LoopAction(plain())), LoopAction(Compressed(plain()))
    many = CompressedVector(LoopActionVector(plain_batch())), batch(2)
    for a, b in ((one, other), many):
        assert a.observation_space == b.observation_space and a.action_space == b.action_space
        np.testing.assert_array_equal(a.reset(seed=1)[0], b.reset(seed=1)[0])
        action = actions(2, 0) if a is many[0] else actions(2, 0)[0]
        x, y = a.step(action), b.step(action)
        np.testing.assert_array_equal(x[0], y[0])
        np.testing.assert_array_equal(x[1], y[1])


@pytest.mark.parametrize("kwargs", [*VARIANTS.values(), {"phase_margin": 50.0, "mu_s": [0.4, 0.9]}])
def test_specs_survive_json(kwargs):
    env = scalar(**kwargs)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.spec == env.spec
    np.testing.assert_array_equal(env.reset(seed=2)[0], again.reset(seed=2)[0])
    assert env.step(actions(1, 0)[0])[1] == again.step(actions(1, 0)[0])[1]


def test_specs_keep_the_compressors_settings():
    env = LoopAction(Compressed(plain(), "laguerre", order=6, pole=9.0))
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.observation_space.shape == (6,)
    np.testing.assert_array_equal(env.reset(seed=2)[0], again.reset(seed=2)[0])


def test_partial_resets_and_pins_reach_the_environment():
    env = batch(4)
    before, _ = env.reset(seed=3)
    mask = np.array([False, True, False, True])
    after, _ = env.reset(options={"reset_mask": mask, "mu_s": [0.35, 0.45, 0.55, 0.65]})
    np.testing.assert_array_equal((before == after).all(axis=1), ~mask)
    info = env.step(actions(4, 0))[4]
    assert info["final_info"]["mu_s"][mask].tolist() == [0.45, 0.65]
    np.testing.assert_array_equal(np.stack(info["final_obs"]), after)


def test_what_is_shown_belongs_to_the_caller():
    env = batch(2)
    obs, _ = env.reset(seed=0)
    kept = obs.copy()
    obs[:] = 0
    np.testing.assert_array_equal(np.stack(env.step(actions(2, 0))[4]["final_obs"]), kept)


def test_environments_do_not_share_their_spaces_generators():
    for one, other in ((scalar(), scalar()), (batch(2), batch(2))):
        for space in ("action_space", "observation_space"):
            getattr(one, space).seed(0)
            expected = getattr(one, space).sample()
            getattr(one, space).seed(0)
            getattr(other, space).seed(1)
            np.testing.assert_array_equal(getattr(one, space).sample(), expected)


def test_the_first_reset_comes_first():
    with pytest.raises(ResetNeeded):
        batch(2).step(actions(2, 0))
    with pytest.raises(ResetNeeded):
        scalar().step(actions(1, 0)[0])


class Foreign(gymnasium.Env):
    observation_space = action_space = gymnasium.spaces.Box(-1, 1, (2,))


@pytest.mark.parametrize(
    ("wrap", "env", "remedy"),
    [
        (Compressed, Foreign, "Foreign cannot be wrapped here"),
        (LoopAction, Foreign, "Foreign cannot be wrapped here"),
        (Compressed, plain_batch, r"gymnasium.make\("),
        (LoopAction, plain_batch, r"gymnasium.make\("),
        (CompressedVector, plain, r"gymnasium.make_vec\("),
        (LoopActionVector, plain, r"gymnasium.make_vec\("),
        (CompressedVector, lambda: None, "NoneType cannot be wrapped"),
        (Compressed, lambda: Compressed(plain()), "changed the observation_space already"),
        (Compressed, lambda: FlattenObservation(plain()), "changed the observation_space"),
        (LoopAction, lambda: LoopAction(plain()), "changed the action_space already"),
        (LoopAction, lambda: RescaleAction(plain(), -1, 1), "changed the action_space"),
        (CompressedVector, lambda: batch(2), "changed the single_observation_space"),
        (LoopActionVector, lambda: batch(2), "changed the single_action_space"),
    ],
)
def test_wrong_environments_are_refused(wrap, env, remedy):
    with pytest.raises(ValueError, match=remedy) as raised:
        wrap(env())
    assert f'("{PLAIN}")' in str(raised.value)


@pytest.mark.parametrize("wrap", [CompressedVector, LoopActionVector])
def test_gymnasiums_own_batches_are_refused(wrap):
    theirs = gymnasium.make_vec(
        PLAIN, num_envs=2, vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}, **SHORT,
    )  # fmt: skip
    with pytest.raises(ValueError, match="SyncVectorEnv cannot be wrapped"):
        wrap(theirs)


@pytest.mark.parametrize("make", [scalar, lambda **kwargs: batch(2, **kwargs)])
def test_unknown_compressors_are_refused(make):
    with pytest.raises(ValueError, match="compressor = 'fourier'.*armax.*laguerre"):
        make(compressor="fourier")


def test_unknown_settings_are_refused():
    with pytest.raises(ValueError, match="compressor 'laguerre'.*poles"):
        Compressed(plain(), "laguerre", poles=3)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([np.nan, 0], "action has nan"),
        ([0], "action has shape"),
        ([0, 0, 0], "action has shape"),
        ("fast", "not an array of numbers"),
    ],
)
def test_bad_actions_are_refused(action, message):
    one, many = scalar().unwrapped, batch(2)
    for env, given in ((LoopAction(one), action), (many, [action, action])):
        env.reset(seed=0)
        with pytest.raises(ValueError, match=message):
            env.step(np.array(given))


# --- features


def vehicles(first_stage, **kwargs):
    return FeatureMap.of(yaw_rate(Task()), first_stage, **kwargs)


def shown(recording, names=()):
    """As a map takes it."""
    return recording.u, recording.y, recording.Ts, recording.beside(names)


@pytest.mark.parametrize("name", VARIANTS)
def test_features_are_standardised_over_the_prior(name):
    obs, _ = batch(400, **VARIANTS[name]).reset(seed=0)
    spread = obs.std(axis=0)
    varied = spread > 1e-3  # a visible constant is zero
    assert varied.sum() >= 6
    # Means of 400 draws less means of 512: within 4.5 of their standard deviation, 0.067.
    np.testing.assert_allclose(obs.mean(axis=0), 0, atol=0.3)
    np.testing.assert_allclose(spread[varied], 1, atol=0.25)
    assert np.abs(obs).max() < LIMIT


@pytest.mark.parametrize("first_stage", [Laguerre(), Armax()], ids=["laguerre", "armax"])
def test_features_are_the_compressors(first_stage):
    given = recorded(6)
    found = vehicles(first_stage)
    features, usable = found(*shown(given))
    raw, _ = first_stage(given.u, given.y, given.Ts)
    assert usable.all() and features.dtype == np.float32
    np.testing.assert_allclose(features * found.scale + found.mean, raw, rtol=1e-5, atol=1e-7)


def test_the_visible_context_is_appended():
    given, names = recorded(6), ("v_x", "mu_s", "M_delta")
    found = vehicles(Laguerre(), beside=lambda theta: theta[:, [2, 0, 1]])
    values, _ = found.raw(*shown(given, names))
    assert values.shape == (6, 13)
    for column, name in zip(values.T[-3:], names, strict=True):
        np.testing.assert_array_equal(column, getattr(given.context, name))
    np.testing.assert_array_equal(found(*shown(given, names))[0][:, 10], 0)  # one speed only
    untold = Recording(given.u, given.y, given.Ts, given.v_x)
    with pytest.raises(ValueError, match="must come with v_x, mu_s, M_delta"):
        untold.beside(names)
    np.testing.assert_array_equal(untold.beside(("v_x",)), given.v_x[:, None])
    with pytest.raises(ValueError, match="must come with v_x"):
        Recording(given.u, given.y, given.Ts).beside(("v_x",))


def test_unusable_recordings_give_zeros_and_say_so():
    given = recorded(2)
    features, usable = vehicles(Laguerre())(np.zeros_like(given.u), *shown(given)[1:])
    assert not usable.any() and not features.any()


def test_outliers_are_clipped():
    given = recorded(2)
    u, y, *rest = shown(given)
    features, _ = vehicles(Laguerre())(u, 100 * y, *rest)
    assert np.abs(features).max() == LIMIT


def test_no_usable_features_at_all_is_an_error(monkeypatch):
    nothing = lambda self, u, y, Ts: (np.full((len(y), 6), np.nan), np.zeros(len(y), bool))  # noqa: E731
    monkeypatch.setattr(Armax, "__call__", nothing)
    with pytest.raises(ValueError, match="Armax finds no usable features"):
        vehicles(Armax())


def test_compressors_by_name():
    assert compressor("laguerre", order=8) == Laguerre(order=8)
    assert compressor("armax") == Armax()


@pytest.mark.parametrize(
    "name, first",
    [
        ("laguerre", [0.5536585, 0.76594, -0.53654927, -0.6710978, 0.5273979]),
        ("armax", [0.53342044, -0.57042754, 0.45965064, 0.54136497, -0.390725]),
    ],
)
def test_features_are_what_they_always_were(name, first):
    np.testing.assert_allclose(scalar(compressor=name).reset(seed=0)[0][:5], first, atol=1e-5)


# --- actions

TASKS = {
    "default": Task(),
    "speeds": Task(prior=Prior(v_x=(10.0, 33.0))),
    "low margin": Task(target=Target(phase_margin=40.0)),
    "printed": Task(target=Target(controller="printed")),
}


@pytest.mark.parametrize("name", TASKS)
def test_the_range_holds_every_oracle_with_room_to_spare(name):
    task = TASKS[name]
    oracle = loops(task, contexts(task)).design()
    gains = np.stack([oracle.kp, oracle.Ti], axis=1)
    used = (found := ActionMap.of(yaw_rate(task))).actions(gains)
    assert np.abs(used).max() < 1
    np.testing.assert_allclose(found.gains(used), gains, rtol=1e-9)
    assert np.ptp(used, axis=0).min() > 0.4  # nor is it so wide that nothing can be resolved


FROZEN = {
    "default": [-1.9993818650418442, -0.4273901474141522, -75.0, 0.243796568533, 0.070509374048],
    "speeds": [-2.361839700987645, -0.421745394562924, -75.0, 0.223621132628, 0.070509374048],
    "low margin": [-1.9993818650418442, -0.4273901474141522, -78.3549104655, 0.227467369795,
                   0.063980470071],
    "printed": [-1.9993818650418442, -0.4273901474141522, -75.0, 0.795046228721, 0.159429104018],
}  # fmt: skip
"""Log magnitudes, steepest phase [deg], and (kp, Ti) of (0.5, -0.5), of the first version."""


@pytest.mark.parametrize("name", TASKS)
def test_actions_mean_what_they_always_did(name):
    found = ActionMap.of(yaw_rate(TASKS[name]))
    gains = found.gains(np.array([[0.5, -0.5]]))[0]
    now = [found.low[0], found.high[0], np.degrees(found.low[1]), *gains]
    np.testing.assert_allclose(now, FROZEN[name], rtol=1e-9)
    assert np.degrees(found.high[1]) == pytest.approx(-0.5)


@pytest.mark.parametrize("name", TASKS)
def test_actions_go_to_gains_and_back(name):
    found = ActionMap.of(yaw_rate(TASKS[name]))
    given = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    np.testing.assert_allclose(found.actions(found.gains(given)), given, rtol=0, atol=1e-9)


def test_corners_are_gains_that_the_environment_takes():
    found = ActionMap.of(yaw_rate(Task()))
    corners = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    gains = found.gains(corners)
    assert ((gains >= [1e-3, 1e-3]) & (gains <= [10, 100])).all()
    np.testing.assert_array_equal(found.gains(3 * corners), gains)  # clipped
    env = scalar()
    for corner, (kp, Ti) in zip(corners, gains, strict=True):
        env.reset(seed=0)
        info = env.step(corner.astype(np.float32))[4]
        assert not info["clipped"]
        assert (info["kp"], info["Ti"]) == pytest.approx((kp, Ti), rel=1e-12)


def test_a_step_in_phase_is_a_step_in_phase_margin():
    # Design.md, section 3: at the target crossover the phase is the margin, one to one.
    env = LoopAction(plain(mu_s=0.7, M_delta=150.0))
    env.reset(seed=0)
    info = env.step(np.zeros(2))[4]
    oracle = env.map.actions(np.array([[info["oracle_kp"], info["oracle_Ti"]]]))[0]
    step = np.array([0.0, np.radians(5.0) / (env.map.high[1] - env.map.low[1]) * 2])
    env.reset(seed=0)
    assert env.step(oracle - step)[4]["phase_margin"] == pytest.approx(55, abs=1e-6)


def test_the_nonlinear_environment_is_wrapped_alike():
    name = "yawrate/PITuningNonlinear-v0"
    kwargs = SHORT | {"amplitude": 0.07}
    one = LoopAction(Compressed(gymnasium.make(name, **kwargs)))
    many = LoopActionVector(CompressedVector(gymnasium.make_vec(name, num_envs=3, **kwargs)))
    obs, _ = one.reset(seed=0)
    assert one.observation_space.contains(obs)
    np.testing.assert_array_equal(many.reset(seed=0)[0][0], obs)
    action = np.zeros((3, 2), dtype=np.float32)
    assert many.step(action)[1][0] == one.step(action[0])[1]
    plain, _ = LoopAction(Compressed(gymnasium.make(PLAIN, **kwargs))).reset(seed=0)
    assert np.abs(plain - obs).max() > 0.01  # features of another vehicle


def test_features_of_the_nonlinear_vehicle():
    hard = {"nonlinear": True, "amplitude": 0.07, "Ts": 0.01, "N": 300}
    one, batch = gymnasium.make(FEATURES, **hard), gymnasium.make_vec(FEATURES, 2, **hard)
    own = one.reset(seed=4)[0]
    np.testing.assert_array_equal(batch.reset(seed=4)[0][0], own)
    linear = gymnasium.make(FEATURES, **(hard | {"nonlinear": False}))
    assert np.abs(linear.reset(seed=4)[0] - own).max() > 0.1
