import tracemalloc

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from yawrate_env.env.nonlinear_env import PITuningNonlinearEnv, PITuningNonlinearVectorEnv
from yawrate_env.env.vector_env import PITuningVectorEnv
from yawrate_env.env.yaw_rate_env import PITuningEnv

ENVIRONMENTS = {
    "yawrate/PITuning-v0": (PITuningEnv, PITuningVectorEnv),
    "yawrate/PITuningNonlinear-v0": (PITuningNonlinearEnv, PITuningNonlinearVectorEnv),
}
ID, Env, VectorEnv = "yawrate/PITuning-v0", PITuningEnv, PITuningVectorEnv
VARIANTS = {
    "default": {},
    "rich": {
        "register": "random",
        "visible": "context",
        "decimate": 4,
        "v_x": [10, 33],
        "delay_samples": 1,
        "amplitude": 0.06,
    },
    "printed": {"controller": "printed", "mu_s": 0.6, "snr_db": 10.0},
}


@pytest.fixture(autouse=True, params=ENVIRONMENTS)
def environment(request, monkeypatch):
    """Run every test over every environment, as `ID`, `Env` and `VectorEnv`."""
    scalar, vector = ENVIRONMENTS[request.param]
    for name, value in {"ID": request.param, "Env": scalar, "VectorEnv": vector}.items():
        monkeypatch.setitem(globals(), name, value)


def native(count, **kwargs):
    return gymnasium.make_vec(ID, num_envs=count, **{"N": 500} | kwargs)


def gymnasiums(mode, count, **kwargs):
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    return gymnasium.make_vec(
        ID,
        num_envs=count,
        vectorization_mode=mode,
        vector_kwargs=same_step,
        **{"N": 500} | kwargs,
    )


def actions(count, seed):
    """Log-uniform over somewhat more than the action box: some are clipped, many unstable."""
    rng = np.random.default_rng(seed)
    return 10 ** rng.uniform([-3.3, -3.3], [1.3, 2.3], (count, 2))


def assert_identical(a, b):
    """Equal to the bit, in type, shape and nested keys."""
    assert type(a) is type(b)
    if isinstance(a, dict):
        assert set(a) == set(b)
        for key in a:
            assert_identical(a[key], b[key])
    elif isinstance(a, tuple) or (isinstance(a, np.ndarray) and a.dtype == object):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            assert_identical(one, other)
    else:
        assert np.asarray(a).dtype == np.asarray(b).dtype
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", VARIANTS)
@pytest.mark.parametrize("count", [1, 5, 17])
def test_native_batch_is_gymnasiums_loop_over_environments(name, count):
    ours, theirs = native(count, **VARIANTS[name]), gymnasiums("sync", count, **VARIANTS[name])
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    for space in ("single_observation_space", "single_action_space"):
        assert getattr(ours, space) == getattr(theirs, space)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert_identical(ours.reset(seed=10), theirs.reset(seed=10))
    for k in range(5):
        assert_identical(ours.step(actions(count, k)), theirs.step(actions(count, k)))
    assert_identical(ours.reset(), theirs.reset())


@pytest.mark.parametrize("name", VARIANTS)
def test_each_row_is_a_scalar_environment(name):
    batch, ones = (
        native(17, **VARIANTS[name]),
        [Env(**{"N": 500} | VARIANTS[name]) for _ in range(17)],
    )
    obs, _ = batch.reset(seed=30)
    for i, one in enumerate(ones):
        np.testing.assert_array_equal(obs[i], one.reset(seed=30 + i)[0])
    for k in range(5):
        obs, rewards, terminated, truncated, infos = batch.step(actions(17, k))
        assert terminated.all() and not truncated.any()
        for i, one in enumerate(ones):
            final_obs, reward, _, _, info = one.step(actions(17, k)[i])
            np.testing.assert_array_equal(infos["final_obs"][i], final_obs)
            assert rewards[i] == reward
            for key, value in info.items():
                np.testing.assert_array_equal(infos["final_info"][key][i], value)
            np.testing.assert_array_equal(obs[i], one.reset()[0])


def test_partial_reset_pins_each_row_to_its_own_value():
    env = native(4)
    env.reset(seed=3)
    mask = np.array([False, True, False, True])
    env.reset(options={"reset_mask": mask, "mu_s": [0.35, 0.45, 0.55, 0.65]})
    truth = env.step(actions(4, 0))[4]["final_info"]["mu_s"]
    assert truth[mask].tolist() == [0.45, 0.65]


# From Python 3.12 on forking warns where any thread runs, those of NumPy's BLAS included.
@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
def test_worker_processes_forked_after_the_kernels_ran_give_the_same():
    ours = native(3)
    native(40).reset(seed=0)  # kernels on several threads, before the fork
    theirs = gymnasiums("async", 3)
    try:
        assert_identical(ours.reset(seed=5), theirs.reset(seed=5))
        for k in range(5):
            assert_identical(ours.step(actions(3, k)), theirs.step(actions(3, k)))
    finally:
        theirs.close()


def test_partial_reset_renews_the_masked_only():
    ours, theirs = native(5), gymnasiums("sync", 5)
    for env in (ours, theirs):
        env.reset(seed=1)
        env.step(actions(5, 0))
    mask = np.array([True, False, False, True, False])
    before = ours.step(actions(5, 1))[0]
    theirs.step(actions(5, 1))
    after = ours.reset(options={"reset_mask": mask})
    assert_identical(after, theirs.reset(options={"reset_mask": mask}))
    np.testing.assert_array_equal((after[0] == before).all(axis=(1, 2)), ~mask)
    assert_identical(ours.step(actions(5, 2)), theirs.step(actions(5, 2)))


def test_partial_reset_seeds_and_pins_the_masked_only():
    ours, theirs = native(4), gymnasiums("sync", 4)
    for env in (ours, theirs):
        env.reset(seed=2)
    mask = np.array([False, True, False, True])
    arguments = [
        {"seed": 50, "options": {"reset_mask": mask, "mu_s": 0.4}} for _ in range(2)
    ]  # Gymnasium's loop takes the mask out of the dictionary
    assert_identical(ours.reset(**arguments[0]), theirs.reset(**arguments[1]))
    assert "reset_mask" in arguments[0]["options"]
    pinned = ours.step(actions(4, 0))[4]["final_info"]["mu_s"] == 0.4
    np.testing.assert_array_equal(pinned, mask)


@pytest.mark.parametrize("seeds", [[4, 4, 9], [7, None, 8], (1, 2, 3)])
def test_seeds_may_be_listed(seeds):
    ours, theirs = native(3), gymnasiums("sync", 3)
    assert_identical(ours.reset(seed=0), theirs.reset(seed=0))
    assert_identical(ours.reset(seed=seeds), theirs.reset(seed=seeds))
    assert_identical(ours.step(actions(3, 0)), theirs.step(actions(3, 0)))


def test_generators_and_seeds_are_the_sub_environments():
    env = native(3)
    env.reset(seed=11)
    assert env.np_random_seed == (11, 12, 13)
    states = [generator.bit_generator.state for generator in env.np_random]
    one = Env(N=500)
    one.reset(seed=12)
    assert states[1] == one.np_random.bit_generator.state


def test_unseeded_batches_differ():
    first, second = (native(3).reset()[0] for _ in range(2))
    assert len({row.tobytes() for row in [*first, *second]}) == 6


def test_options_pin_one_value_for_all_or_one_for_each():
    env = native(3)
    env.reset(seed=0, options={"mu_s": [0.4, 0.5, 0.6], "v_x": 15.0})
    truth = env.step(actions(3, 0))[4]["final_info"]
    assert truth["mu_s"].tolist() == [0.4, 0.5, 0.6]
    assert truth["v_x"].tolist() == [15, 15, 15]
    assert (env.step(actions(3, 0))[4]["final_info"]["v_x"] == 20).all()  # for one episode only


def test_returned_arrays_are_the_callers_own():
    env, untouched = native(2), native(2)
    obs, _ = env.reset(seed=0)
    untouched.reset(seed=0)
    obs[:] = 0
    first = env.step(actions(2, 0))
    assert_identical(first, untouched.step(actions(2, 0)))
    first[0][:] = 0
    first[4]["final_info"]["mu_s"][:] = 0
    assert_identical(env.step(actions(2, 1)), untouched.step(actions(2, 1)))


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.ones((2, 2)), r"action has shape \(2, 2\), wanted \(3, 2\)"),
        (np.ones(2), r"action has shape \(2,\), wanted \(3, 2\)"),
        (np.full((3, 2), np.nan), "action has nan"),
    ],
)
def test_bad_actions_are_refused_and_leave_the_episodes_open(bad, message):
    env, untouched = native(3), native(3)
    for e in (env, untouched):
        e.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(bad)
    assert_identical(env.step(actions(3, 0)), untouched.step(actions(3, 0)))


@pytest.mark.parametrize(
    "mask",
    [
        np.array([1, 0, 1]),
        np.array([True, False]),
        np.zeros(3, dtype=bool),
        np.ones((3, 1), dtype=bool),
    ],
    ids=["integers", "short", "none", "column"],
)
def test_bad_masks_are_refused(mask):
    env = native(3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"reset_mask.*boolean array of shape \(3,\)"):
        env.reset(options={"reset_mask": mask})


def test_the_first_reset_is_of_all():
    env = native(2)
    with pytest.raises(ResetNeeded, match="before the first step"):
        env.step(actions(2, 0))
    with pytest.raises(ResetNeeded, match="every sub-environment"):
        env.reset(options={"reset_mask": np.array([True, False])})


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: native(0), "num_envs = 0"),
        (lambda: native(2.5), "num_envs = 2.5"),
        (lambda: native(2, crossover=60.0), "crossover = 60"),
        (lambda: native(2, render_mode="human"), "render_mode = 'human'"),
        (lambda: native(3).reset(seed=[1, 2]), "2 seeds for 3 sub-environments"),
        (lambda: native(3).reset(seed=[1, 2, -3]), r"seed\[2\] = -3 must be"),
        (lambda: native(3).reset(seed=[1, 2.5, 3]), r"seed\[1\] = 2.5 must be a whole number"),
        (lambda: native(3).reset(seed=1.5), "seed = 1.5 must be a whole number"),
        (lambda: native(3).reset(seed="123"), "seed = '123' is not a number"),
        (lambda: native(3).reset(options="abc"), "reset options = 'abc' are not a dictionary"),
        (lambda: native(2_000_000), r"num_envs = 2e\+06 must be .* at most 1e\+06"),
        (lambda: native(3).reset(options={"mu": 1.0}), "'mu' is unknown"),
        (lambda: native(3).reset(options={"mu_s": [0.5, 0.6]}), r"mu_s has shape \(2,\)"),
        (lambda: native(3).reset(options={"mu_s": [0.5, 0.6, 0.0]}), "mu_s = 0 must"),
    ],
)
def test_bad_parameters_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_thousand_environments_in_one_batch():
    env = VectorEnv(1000, N=200)
    obs, _ = env.reset(seed=0)
    assert obs.shape == (1000, 2, 200) and env.observation_space.contains(obs)
    one = Env(N=200)
    for i in (0, 511, 999):
        np.testing.assert_array_equal(obs[i], one.reset(seed=i)[0])


def most_memory(num_envs, steps):
    """Largest memory that a run takes beyond what was there before [B]."""
    env = VectorEnv(num_envs, N=2000)
    tracemalloc.start()
    env.reset(seed=0)
    for _ in range(steps):
        env.step(np.full((num_envs, 2), 0.2))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


def test_memory_grows_with_the_number_of_environments_only():
    VectorEnv(16, N=2000).reset(seed=0)  # what is made once
    few = most_memory(64, 2)
    assert most_memory(64, 20) < 1.1 * few
    assert most_memory(256, 2) < 4.4 * few
    # The observations that are returned, and about as much again on the way to them.
    assert few < 4 * 64 * 2 * 2000 * 4
