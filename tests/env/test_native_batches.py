"""What every native batch of environments keeps: one suite over all ids."""

import gymnasium
import numpy as np
import pytest
from every_environment import (
    CASES,
    IDS,
    action,
    assert_identical,
    every_id,
    gymnasiums,
    native,
    parameters,
    shared,
    tolerance,
)
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode


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
