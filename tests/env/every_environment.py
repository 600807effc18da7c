"""Every environment, and what its tests ask of all of them."""

from functools import cache

import gymnasium
import numpy as np
import pytest
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
