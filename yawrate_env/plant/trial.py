"""One trial call of each of a plant's functions, in the middle of the prior, before any work."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.plant.calls import call, said

if TYPE_CHECKING:
    from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_WORDS = np.array([1, 2], np.uint64)
_KEYS = np.arange(8, dtype=np.uint64).reshape(2, 4)


def check_functions(plant: "Plant") -> None:
    """For two plants at once; raises ``ValueError`` where an answer cannot be used."""
    theta = np.repeat(plant.middle, 2, axis=0)
    y, u = _check_simulator(plant, theta)
    sigma = _tried(plant, "noise", lambda: plant.sigma(y)[:, None], 1)
    validation.number("noise's least answer", sigma.min(), at_least=0.0, remedy="Give standard "
                      "deviations.")  # fmt: skip
    if plant.record is not None:
        _tried(plant, "record", lambda: plant.measure(theta, u, _KEYS), len(plant.u))
    none: list[bool] = []  # whether there are none for the plant in the middle

    def designed() -> Array:
        gains = plant.oracle(theta)
        none.append(bool(np.isnan(gains).any()))
        return np.where(np.isnan(gains), 0.0, gains)

    gains = _tried(plant, "design", designed, len(plant.gains))
    if none[0]:
        return
    _check_coordinates(plant, gains)
    _tried(plant, "evaluate", lambda: plant.metric_values(theta, gains), len(plant.counted))
    _said_where("loop", plant.closed_loop, theta[0], gains[0])


def _check_simulator(plant: "Plant", theta: Array) -> tuple[Array, Array]:
    """Outputs (2, N) of the experiment, and inputs (1 or 2, N) of two episodes."""
    width = len(plant.u)
    y = _tried(plant, "simulate", lambda: plant.respond(theta), width)
    if not np.array_equal(y, plant.respond(theta)):
        raise ValueError("simulate is random where rng is None. Use rng for all that is random.")
    if plant.excite is None:
        return y, plant.u[None]
    u = _tried(plant, "excite", lambda: plant.inputs(_WORDS), width)
    _tried(plant, "simulate", lambda: plant.respond(theta, u), width)
    return y, u


def _check_coordinates(plant: "Plant", gains: Array) -> None:
    encoded = np.asarray(_said_where(*_named("encode", plant, gains)))
    decoded = _said_where(*_named("decode", plant, encoded))
    decoded = validation.float_array("coordinates.decode's answer", decoded)
    if decoded.shape != gains.shape or not np.allclose(decoded, gains, rtol=1e-6):
        first = decoded.ravel()[: gains.shape[1]]
        raise ValueError(
            f"gains {gains[0]} do not survive coordinates' encode and decode, which give {first}. "
            "The default is for positive gains: give coordinates of your own."
        )


def _named(way: str, plant: "Plant", values: Array) -> tuple[Any, ...]:
    """What `_said_where` needs to call one of the coordinates' functions."""
    name = f"coordinates.{way}"
    return name, call, name, getattr(plant.parametrisation, way), values


def _tried(plant: "Plant", name: str, call: Callable[[], Any], columns: int) -> Array:
    """Finite answers (2, columns), or ``ValueError``."""
    hint = " For functions of one plant set batched=False." if plant.batched else ""
    values = _said_where(name, call, hint=hint)
    return validation.finite_array(f"{name} in the prior's middle", values, shape=(2, columns))


def _said_where(name: str, call: Callable[..., Any], *arguments: Any, hint: str = "") -> Any:
    """What the call gives; what it raises says where that was."""
    where = f"{name} failed in the middle of the prior"
    try:
        return call(*arguments)
    except ValueError as error:
        cause = error.__cause__  # None of a check, which says all there is to say
        detail = str(error).removesuffix(".") if cause is None else said(cause)
        raise ValueError(f"{where}: {detail}.{hint}") from cause or error
    except Exception as error:
        raise ValueError(f"{where}: {said(error)}.{hint}") from error
