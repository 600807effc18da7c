"""Trial call of each of a plant's functions when it is described, so that mistakes show at once.

`yawrate_env.plant.plant` imports this module, so the type `Plant` is not named here.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.plant.calls import call

Array = NDArray[np.float64]


def try_functions(plant: Any) -> None:
    """Call each function in the middle of the prior; ``ValueError`` for a bad answer."""
    try:
        _call_all(plant)
    except ValueError as error:
        hint = " For functions of one plant set batched=False." if plant.batched else ""
        why = str(error).removesuffix(".")
        raise ValueError(f"In the middle of the prior {why}.{hint}") from (error.__cause__ or error)


def _call_all(plant: Any) -> None:
    """Call every function for two plants in the middle of the prior, and check the answers."""
    theta, N = np.repeat(plant.middle, 2, axis=0), plant.samples
    u, y = plant.u[None], _checked("simulate", plant.answers(theta), len(plant.outputs_named) * N)
    if not np.array_equal(y, plant.answers(theta)):
        raise ValueError("simulate is random where rng is None. Use rng for all randomness.")
    if plant.excite is not None:
        u = plant.inputs(np.array([1, 2], np.uint64))
        _checked("excite", u.reshape(len(u), -1), plant.u.size)
        _checked("simulate", plant.answers(theta, u), y.shape[1])
    sigma = _checked("noise", plant.sigma(y)[:, None], 1)
    remedy = "Give standard deviations."
    validation.number("noise's lowest answer", sigma.min(), at_least=0.0, remedy=remedy)
    if plant.record is not None:
        keys = np.arange(8, dtype=np.uint64).reshape(2, 4)
        _checked("record", plant.measure(theta, u, keys), N)
    gains = plant.oracle(theta)
    none = np.isnan(gains)
    _checked("design", np.where(none, 0.0, gains), len(plant.gains))
    if none.any():  # no gains for this plant; there may be for others
        return
    _try_parametrisation(plant, gains)
    metrics = _checked("evaluate", plant.metric_values(theta, gains), len(plant.counted))
    _try_other_starts(plant, theta, gains, metrics)
    plant.closed_loop(theta[0], gains[0])


def _try_other_starts(plant: Any, theta: Array, gains: Array, metrics: Array) -> None:
    """Refuse a rule, or metrics, that depend on the state in which a recording begins."""
    begin = plant.indices(plant.initial)
    if not begin:
        return
    moved = theta.copy()
    moved[:, begin] = np.stack(plant.ranges)[:, begin]
    found = plant.oracle(moved), plant.metric_values(moved, gains)
    for name, one, other in zip(("design", "evaluate"), (gains, metrics), found, strict=True):
        if not np.array_equal(one, other):
            raise ValueError(
                f"{name} depends on {', '.join(plant.initial)}: an initial state is the "
                "recording's and no matter of the rule. Leave it out of initial, or of the function"
            )


def _try_parametrisation(plant: Any, gains: Array) -> None:
    encode, decode = plant.parametrisation.encode, plant.parametrisation.decode
    coordinates = np.asarray(call("parametrisation.encode", encode, gains))
    decoded = call("parametrisation.decode", decode, coordinates)
    decoded = validation.float_array("parametrisation.decode's answer", decoded)
    if decoded.shape != gains.shape or not np.allclose(decoded, gains, rtol=1e-6):
        raise ValueError(
            f"parametrisation does not give gains {gains[0]} back after encode and decode, but "
            f"{decoded.ravel()[: gains.shape[1]]}. The default is for positive gains: give a "
            "parametrisation of your own"
        )


def _checked(name: str, values: Any, width: int) -> Array:
    return validation.finite_array(f"{name}'s answer", values, shape=(2, width))
