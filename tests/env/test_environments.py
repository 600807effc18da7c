"""What every environment keeps, whatever its plant: one suite over all ids."""

import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from every_environment import (
    action,
    assert_identical,
    episode,
    every_case,
    every_id,
    native,
    parameters,
    scalar,
    shared,
)
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env


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
