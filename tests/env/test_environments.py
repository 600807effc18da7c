"""What every environment keeps, whatever its plant: one suite over all ids."""

import pickle
import warnings
from functools import cache

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import yawrate_env

RICH = {
    "register": "random",
    "visible": "context",
    "decimate": 4,
    "v_x": [10, 33],
    "delay_samples": 1,
    "amplitude": 0.06,
    "N": 500,
}
SHORT = {"Ts": 0.01, "N": 300}  # the least that ARMAX takes
CASES = {
    "vehicle": (yawrate_env.ENV_ID, {"N": 500}),
    "vehicle, rich": (yawrate_env.ENV_ID, RICH),
    "vehicle, printed": (
        yawrate_env.ENV_ID,
        {"controller": "printed", "mu_s": 0.6, "snr_db": 10.0, "N": 500},
    ),
    "nonlinear": (yawrate_env.NONLINEAR_ID, {"N": 500}),
    "nonlinear, rich": (yawrate_env.NONLINEAR_ID, RICH),
    "plant": (yawrate_env.PLANT_ID, {"plant": "first_order:plant"}),
    "plant, measured": (yawrate_env.PLANT_ID, {"plant": "first_order:gauged"}),
    "plant, one gain": (yawrate_env.PLANT_ID, {"plant": "first_order:lone"}),
    "plant, channels": (yawrate_env.PLANT_ID, {"plant": "two_by_two:plant"}),
    "features": (yawrate_env.FEATURES_ID, SHORT),
    "features, armax": (yawrate_env.FEATURES_ID, SHORT | {"features": "armax", "decimate": 4}),
    "features, random": (
        yawrate_env.FEATURES_ID,
        SHORT | {"register": "random", "v_x": [10, 33], "visible": "speed"},
    ),
    "features, context": (
        yawrate_env.FEATURES_ID,
        SHORT | {"visible": "context", "delay_samples": 1},
    ),
    "features, nonlinear": (yawrate_env.FEATURES_ID, SHORT | {"nonlinear": True, "decimate": 3}),
    "plant features": (yawrate_env.PLANT_FEATURES_ID, {"plant": "first_order:gauged"}),
    "plant features, channels": (yawrate_env.PLANT_FEATURES_ID, {"plant": "two_by_two:plant"}),
    "plant features, armax": (
        yawrate_env.PLANT_FEATURES_ID,
        {"plant": "first_order:plant", "features": "armax"},
    ),
}
IDS = ("vehicle", "nonlinear", "plant", "features", "plant features")
"""One case of each."""

every_case = pytest.mark.parametrize("case", CASES)
every_id = pytest.mark.parametrize("case", IDS)


def scalar(case):
    name, kwargs = CASES[case]
    return gymnasium.make(name, **kwargs)


shared = cache(scalar)
"""The same environment for every test that seeds it."""


def native(case, count):
    name, kwargs = CASES[case]
    return gymnasium.make_vec(name, num_envs=count, **kwargs)


def gymnasiums(case, count):
    name, kwargs = CASES[case]
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    return gymnasium.make_vec(
        name, num_envs=count, vectorization_mode="sync", vector_kwargs=same_step, **kwargs
    )


def action(env, seed=0):
    """Log-uniform or uniform over somewhat more than the box: some are clipped or unstable."""
    space = getattr(env, "single_action_space", env.action_space)
    count, rng = getattr(env, "num_envs", 1), np.random.default_rng(seed)
    low, high = (end.astype(float) for end in (space.low, space.high))
    unit = rng.uniform(-0.05, 1.05, (count, len(low)))
    if (low > 0).all():
        values = low * (high / low) ** unit
    else:
        values = (low + (high - low) * unit).astype(np.float32)
    return values if hasattr(env, "num_envs") else values[0]


def parameters(env):
    """A value within the prior for each parameter that it leaves open."""
    plant = env.unwrapped.plant
    return {n: low + 0.3 * (high - low) for n, (low, high) in plant.prior.items() if low < high}


def episode(env, **reset):
    obs, _ = env.reset(**reset)
    return obs, env.step(action(env))


def assert_identical(a, b, atol=0.0):
    """Equal in type, shape and nested keys, and to the bit; float32 observations to `atol`."""
    assert type(a) is type(b)
    if a is None:
        return
    if isinstance(a, dict):
        assert set(a) == set(b)
        for key in a:
            assert_identical(a[key], b[key], atol)
    elif isinstance(a, tuple) or (isinstance(a, np.ndarray) and a.dtype == object):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            assert_identical(one, other, atol)
    else:
        assert np.asarray(a).dtype == np.asarray(b).dtype
        near = atol if np.asarray(a).dtype == np.float32 else 0.0
        np.testing.assert_allclose(a, b, rtol=0, atol=near)


def tolerance(case):
    """Matrix products of several right-hand sides round otherwise than of one."""
    return 1e-5 if "features" in case else 0.0


# --- one environment


@every_case
def test_gymnasiums_checker_minds_units_and_wrappers_only(case):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        env = scalar(case)
        check_env(env if "features" in case else env.unwrapped, skip_render_check=True)
    # Gains are in physical units; and it prefers bare environments to wrapped ones.
    known = "different from the unwrapped version", "symmetric and normalized space"
    messages = [str(warning.message) for warning in caught]
    assert messages and all(any(text in m for text in known) for m in messages), messages


@every_case
def test_one_step_ends_the_episode_and_tells_all(case):
    env = shared(case)
    obs, (final_obs, reward, terminated, truncated, info) = episode(env, seed=0)
    assert env.observation_space.contains(obs) and obs.dtype == np.float32
    np.testing.assert_array_equal(final_obs, obs)
    assert terminated is True and truncated is False
    assert type(reward) is float and -5 <= reward <= 0
    plant = env.unwrapped.plant
    assert [*plant.gains, "clipped"] == list(info)[: len(plant.gains) + 1]
    assert list(info)[-len(plant.prior) :] == list(plant.prior)
    assert not any("[" in name for name in info)  # units
    for name, value in info.items():
        assert type(value) is (bool if name in ("clipped", "stable") else np.float64)
    for name, (low, high) in plant.prior.items():
        assert low <= info[name] <= high
    with pytest.raises(ResetNeeded, match="one step"):
        env.unwrapped.step(action(env.unwrapped))
    env.unwrapped.reset(seed=0)
    oracle = np.array([info[f"oracle_{name}"] for name in plant.gains])
    _, reward, _, _, info = env.unwrapped.step(oracle)
    assert reward == pytest.approx(0, abs=1e-8) and info["stable"] and not info["clipped"]


@every_case
def test_specs_survive_json(case):
    env = shared(case)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.spec == env.spec
    first, second = episode(env, seed=1), episode(again, seed=1)
    np.testing.assert_array_equal(first[0], second[0])
    assert first[1][1:] == second[1][1:]


@every_id
def test_pickles_continue_where_they_were(case):
    env = shared(case).unwrapped
    env.reset(seed=2)
    started = pickle.loads(pickle.dumps(env))
    assert started.step(action(env))[4] == env.step(action(env))[4]
    ended = pickle.loads(pickle.dumps(env))
    for _ in range(2):
        obs = env.reset()[0]
        for again in (started, ended):
            np.testing.assert_array_equal(again.reset()[0], obs)


@every_id
def test_a_seed_repeats_the_episodes_after_it(case):
    env, again = shared(case), scalar(case)
    seen = set()
    for seed in (0, None, None, 0):
        obs, (_, reward, _, _, info) = episode(env, seed=seed)
        other, (_, other_reward, _, _, other_info) = episode(again, seed=seed)
        np.testing.assert_array_equal(obs, other)
        assert (reward, info) == (other_reward, other_info)
        seen.add(obs.tobytes())
    assert len(seen) == 3


@every_id
def test_returned_observations_are_the_callers_own(case):
    env = shared(case)
    obs, _ = env.reset(seed=0)
    kept = obs.copy()
    obs[:] = 0
    np.testing.assert_array_equal(env.step(action(env))[0], kept)
    env.close()
    env.close()


@every_id
def test_options_pin_values_and_leave_the_rest_of_the_draw(case):
    env = shared(case)
    free = episode(env, seed=4)
    for name, value in parameters(env).items():
        info = episode(env, seed=4, options={name: value})[1][4]
        for other in env.unwrapped.plant.prior:
            assert info[other] == (value if other == name else free[1][4][other])
    drawn = {name: free[1][4][name] for name in parameters(env)}
    np.testing.assert_array_equal(episode(env, seed=4, options=drawn)[0], free[0])
    assert episode(env)[1][4] != free[1][4]  # for one episode only


@every_id
def test_a_width_shrinks_every_range_about_its_middle(case):
    env = native(case, 64)
    plant = env.unwrapped.plant

    def drawn(**options):
        env.reset(seed=5, options=options)
        info = env.step(action(env))[4]["final_info"]
        return np.stack([info[name] for name in plant.prior], axis=1)

    whole, middle = drawn(), np.mean(plant.ranges, axis=0)
    np.testing.assert_allclose(drawn(width=0.5) - middle, (whole - middle) / 2, atol=1e-9)
    np.testing.assert_array_equal(drawn(width=1.0), whole)
    np.testing.assert_allclose(drawn(width=0.0), np.tile(middle, (64, 1)))
    each = np.linspace(0, 1, 64)
    np.testing.assert_allclose(
        drawn(width=each) - middle, each[:, None] * (whole - middle), atol=1e-9
    )
    (name, value), *_ = parameters(env).items()
    pinned = drawn(width=0.5, **{name: value})  # a pin is a pin
    assert (pinned[:, list(plant.prior).index(name)] == value).all()
    one = shared(case)
    one.reset(seed=5, options={"width": 0.5})
    info = one.step(action(one))[4]
    np.testing.assert_array_equal([info[name] for name in plant.prior], drawn(width=0.5)[0])
    for bad in (-0.1, 1.5, np.nan, "half"):
        with pytest.raises(ValueError, match="width"):
            one.reset(options={"width": bad})


@every_id
def test_cost_is_one_where_a_loop_is_nearly_unstable(case):
    env = native(case, 64)
    env.reset(seed=0)
    info = env.step(action(env))[4]["final_info"]
    with np.errstate(invalid="ignore"):
        low = ~info["stable"] | (info.get("phase_margin", np.full(64, 60.0)) < 45)
    np.testing.assert_array_equal(info["cost"], low.astype(float))
    assert info["cost"].any() or "phase_margin" not in info
    env.reset(seed=0)
    base = env.unwrapped
    _, _, _, _, info = base.step(np.stack([info[f"oracle_{n}"] for n in base.plant.gains], axis=1))
    assert not info["final_info"]["cost"].any()


BAD_OPTIONS = [
    (lambda name, value: {"mass": value}, "mass"),
    (lambda name, value: {name: np.nan}, "{name}.* nan"),
    (lambda name, value: {name: -1e9}, "{name} = -1e"),
    (lambda name, value: {name: [value, value]}, r"{name} has shape \(2,\)"),
    (lambda name, value: {name: "much"}, "{name}"),
    (lambda name, value: {name: True}, "{name}"),
    (lambda name, value: "abc", "options = 'abc'"),
    (lambda name, value: 5, "options = 5"),
]


@every_id
def test_bad_options_are_refused_and_leave_the_episode_open(case):
    env = shared(case).unwrapped
    expected = episode(env, seed=0)[1][1]
    env.reset(seed=0)
    (name, value), *_ = parameters(env).items()
    for values, message in BAD_OPTIONS:
        with pytest.raises(ValueError, match=message.format(name=name)):
            env.reset(options=values(name, value))
    assert env.step(action(env))[1] == expected


BAD_ACTIONS = [
    lambda good: np.full_like(good, np.nan),
    lambda good: np.full_like(good, np.inf),
    lambda good: good[..., :-1],
    lambda good: np.concatenate([good, good], axis=-1),
    lambda good: good[None],
    lambda good: "fast",
    lambda good: None,
]


@every_id
def test_bad_actions_are_refused_and_leave_episodes_open(case):
    for env in (shared(case), native(case, 3)):
        env = getattr(env, "env", env)
        _, expected = episode(env, seed=0)
        env.reset(seed=0)
        for bad in BAD_ACTIONS:
            with pytest.raises(ValueError, match="action"):
                env.step(bad(action(env)))
        assert_identical(env.step(action(env)), expected)


@every_id
def test_reset_comes_first(case):
    env = scalar(case).unwrapped
    with pytest.raises(ResetNeeded):
        env.step(action(env))
    batch = native(case, 2)
    with pytest.raises(ResetNeeded, match="before the first step"):
        batch.step(action(batch))
    with pytest.raises(ResetNeeded, match="every sub-environment"):
        batch.reset(options={"reset_mask": np.array([True, False])})


# --- a batch


@pytest.mark.parametrize(
    ("case", "count"),
    [*((c, 2 if "features" in c else 17) for c in CASES), *((c, 1) for c in IDS)],
)
def test_native_batch_is_gymnasiums_loop_over_environments(case, count):
    ours, theirs, near = native(case, count), gymnasiums(case, count), tolerance(case)
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    for space in ("single_observation_space", "single_action_space"):
        assert getattr(ours, space) == getattr(theirs, space)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert_identical(ours.reset(seed=10), theirs.reset(seed=10), near)
    for k in range(3):
        assert_identical(ours.step(action(ours, k)), theirs.step(action(ours, k)), near)
    assert_identical(ours.reset(), theirs.reset(), near)


@every_id
def test_partial_resets_renew_seed_and_pin_the_masked_only(case):
    ours, theirs, near = native(case, 3), gymnasiums(case, 3), tolerance(case)
    for env in (ours, theirs):
        env.reset(seed=1)
        env.step(action(ours))
    (name, value), *_ = parameters(ours).items()
    mask = np.array([True, False, True])
    before = ours.step(action(ours, 1))[0]
    theirs.step(action(ours, 1))
    for more in ({}, {"seed": 50}):
        # Gymnasium's loop takes the mask out of the dictionary.
        options = [{"reset_mask": mask, name: value} for _ in range(2)]
        after = ours.reset(options=options[0], **more)
        assert_identical(after, theirs.reset(options=options[1], **more), near)
        assert "reset_mask" in options[0]
        same = (after[0] == before).reshape(3, -1).all(axis=1)
        np.testing.assert_array_equal(same, ~mask)
    found, expected = ours.step(action(ours, 2)), theirs.step(action(ours, 2))
    assert_identical(found, expected, near)
    np.testing.assert_array_equal(found[4]["final_info"][name] == value, mask)
    np.testing.assert_array_equal(np.stack(found[4]["final_obs"]), after[0])


@every_id
def test_options_pin_one_value_for_all_or_one_for_each(case):
    env = native(case, 3)
    (name, value), *rest = parameters(env).items()
    each = value * np.array([1.0, 1.01, 1.02])
    env.reset(seed=0, options={name: each, **dict(rest)})
    truth = env.step(action(env))[4]["final_info"]
    assert truth[name].tolist() == each.tolist()
    for other, one in rest:
        assert truth[other].tolist() == [one] * 3
    mask = np.array([False, True, True])
    env.reset(options={"reset_mask": mask, name: each})
    truth = env.step(action(env))[4]["final_info"][name]
    np.testing.assert_array_equal(truth == each, mask)
    assert (env.step(action(env))[4]["final_info"][name] != each).all()  # for one episode only


@every_id
def test_seeds_may_be_listed_and_generators_are_the_sub_environments(case):
    ours, theirs = native(case, 3), gymnasiums(case, 3)
    for seeds in (0, [4, 4, 9], [7, None, 8], (1, 2, 3)):
        assert_identical(ours.reset(seed=seeds), theirs.reset(seed=seeds), tolerance(case))
    assert ours.unwrapped.np_random_seed == (1, 2, 3)
    one = shared(case)
    one.reset(seed=2)
    state = ours.unwrapped.np_random[1].bit_generator.state
    assert state == one.unwrapped.np_random.bit_generator.state


@every_id
def test_unseeded_batches_differ(case):
    assert len({row.tobytes() for _ in range(2) for row in native(case, 3).reset()[0]}) == 6


@every_id
def test_returned_arrays_are_the_callers_own(case):
    env = native(case, 2)
    env.reset(seed=0)
    expected = [env.step(action(env, k)) for k in range(2)]
    env.reset(seed=0)[0][:] = 0
    for k in range(2):
        found = env.step(action(env, k))
        assert_identical(found, expected[k])
        found[0][:] = 0
        for values in found[4]["final_info"].values():
            values[:] = 0


def gymnasiums_in(mode, case, count):
    name, kwargs = CASES[case]
    vector = {"autoreset_mode": mode}
    return gymnasium.make_vec(
        name, num_envs=count, vectorization_mode="sync", vector_kwargs=vector, **kwargs
    )


@every_id
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_other_autoreset_modes_are_gymnasiums(case, mode):
    name, kwargs = CASES[case]
    ours = gymnasium.make_vec(name, num_envs=3, autoreset_mode=mode.value, **kwargs)
    theirs, near = gymnasiums_in(mode, case, 3), tolerance(case)
    assert ours.autoreset_mode is ours.metadata["autoreset_mode"] is mode
    first, others = (np.array(mask) for mask in ([True, False, False], [False, True, True]))
    assert_identical(ours.reset(seed=3), theirs.reset(seed=3), near)
    assert_identical(ours.step(action(ours)), theirs.step(action(ours)), near)
    if mode is AutoresetMode.DISABLED:
        with pytest.raises(ResetNeeded):
            ours.step(action(ours))
    for mask in (first, others):  # from now on they may be out of step
        options = [{"reset_mask": mask.copy()} for _ in range(2)]
        assert_identical(ours.reset(options=options[0]), theirs.reset(options=options[1]), near)
        if mode is AutoresetMode.NEXT_STEP:
            assert_identical(ours.step(action(ours, 1)), theirs.step(action(ours, 1)), near)
    assert_identical(ours.step(action(ours, 2)), theirs.step(action(ours, 2)), near)


@every_id
def test_batches_and_their_wrappers_say_when_they_reset(case):
    env = native(case, 1)
    assert env.autoreset_mode is env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    name, kwargs = CASES[case]
    with pytest.raises(ValueError, match="autoreset_mode"):
        gymnasium.make_vec(name, num_envs=1, autoreset_mode="never", **kwargs)


BAD_RESETS = [
    ({"seed": [1, 2]}, "2 seeds for 3"),
    ({"seed": [1, 2, -3]}, r"seed\[2\] = -3"),
    ({"seed": [1, 2.5, 3]}, r"seed\[1\] = 2.5"),
    ({"seed": 1.5}, "seed = 1.5"),
    ({"seed": "123"}, "seed = '123'"),
    ({"options": "abc"}, "options = 'abc'"),
    ({"options": {"mass": 1.0}}, "mass"),
    ({"options": {"reset_mask": np.array([1, 0, 1])}}, "reset_mask"),
    ({"options": {"reset_mask": np.array([True, False])}}, "reset_mask"),
    ({"options": {"reset_mask": np.zeros(3, dtype=bool)}}, "reset_mask"),
    ({"options": {"reset_mask": np.ones((3, 1), dtype=bool)}}, "reset_mask"),
]


@every_id
def test_bad_resets_of_a_batch_are_refused(case):
    env = native(case, 3)
    env.reset(seed=0)
    (name, value), *_ = parameters(env).items()
    pins = [({"options": {name: [value, value, *more]}}, name) for more in ([], [-1e9])]
    for reset, named in BAD_RESETS + pins:
        with pytest.raises(ValueError, match=named):
            env.reset(**reset)
    id, kwargs = CASES[case]
    for count in (0, 2.5, 2_000_000):
        with pytest.raises(ValueError, match=f"num_envs = {count:g}".replace("+", r"\+")):
            gymnasium.make_vec(id, num_envs=count, **kwargs)
