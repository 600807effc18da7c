"""What is wrong with a plant's description, found before any work is done with it."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tuners.plants.figure import Figure
from yawrate_env import validation

if TYPE_CHECKING:
    from tuners.plants.plant import Plant

Array = NDArray[np.float64]

RELATIVE_ERROR = 0.3
"""Of a gain: what counts as one where the plant has no judge."""


def check_settings(plant: "Plant") -> None:
    """Everything that can be checked without calling anything; normalises what it can."""
    if not isinstance(plant.prior, Mapping) or not plant.prior:
        raise ValueError('prior must name at least one parameter, as in {"J": (0.01, 0.03)}.')
    prior = {name: validation.interval(f"prior {name}", r) for name, r in plant.prior.items()}
    for name, slack in plant.measured.items():
        validation.one_of("measured parameter", name, tuple(prior))
        validation.number(f"measured {name}", slack, at_least=0.0, remedy="Say how far outside "
                          "the prior it may lie.")  # fmt: skip
    for name in plant.search_limits:
        validation.one_of("search_limits' parameter", name, tuple(prior))
    u = np.array(validation.finite_array("u", plant.u, shape=(None,)))  # a copy of its own
    Ts = validation.number("Ts", plant.Ts, above=0.0, remedy="Give the sampling time in seconds.")
    if plant.crossover is not None:
        validation.number("crossover", plant.crossover, above=0.0, at_most=0.5 / Ts,
                          remedy="Give it in Hz, below half the sampling rate.")  # fmt: skip
    for signal, largest in zip(("input", "output"), plant.plausible, strict=True):
        if not largest == np.inf:
            validation.number(f"plausible {signal}", largest, above=0.0, remedy="Say what is too "
                              "large to be.")  # fmt: skip
    if isinstance(plant.gains, str) or not plant.gains:
        raise ValueError(f'gains = {plant.gains!r} must be names, as in ("kp", "Ti").')
    if (plant.judge is None) != (not plant.figures):
        raise ValueError(
            "judge and figures belong together. Give figures the names of what judge returns and "
            'the errors that count as one, as in {"phase margin [deg]": 10.0}.'
        )
    figures = plant.figures or {f"relative error of {name}": RELATIVE_ERROR for name in plant.gains}
    if plant.target is not None:
        target = validation.finite_array("target", plant.target, shape=(len(figures),))
        object.__setattr__(plant, "target", tuple(target.tolist()))
    figures = {name: _figure(name, value) for name, value in figures.items()}
    if not callable(plant.noise):
        validation.number("noise", plant.noise, at_least=0.0, remedy="Give a standard deviation.")
    values = {
        "prior": prior,
        "u": u,
        "Ts": Ts,
        "gains": tuple(plant.gains),
        "figures": figures,
        "measured": dict(plant.measured),
    }
    for name, value in values.items():
        object.__setattr__(plant, name, value)


def _figure(name: str, value: float | Figure) -> Figure:
    if isinstance(value, Figure):
        return value
    remedy = "Give the error that counts as one."
    return Figure(validation.number(f"figure {name}", value, above=0.0, remedy=remedy))


def check_functions(plant: "Plant") -> None:
    """One trial call of each, in the middle of the prior and for two plants at once."""
    theta = np.repeat(plant.middle, 2, axis=0)
    width, f = len(plant.u), len(plant.figures)

    def tried(name: str, call: Callable[[], Any], columns: int) -> Array:
        try:
            values = call()
        except ValueError as error:
            hint = "" if not plant.batched else " For functions of one plant set batched=False."
            raise ValueError(f"{name} failed in the middle of the prior: {error}{hint}") from error
        return validation.finite_array(f"{name} in the prior's middle", values, shape=(2, columns))

    y = tried("simulate", lambda: plant.respond(theta), width)
    if not np.array_equal(y, plant.respond(theta)):
        raise ValueError("simulate is random where rng is None. Use rng for all that is random.")
    if plant.excite is not None:
        u = tried("excite", lambda: plant.inputs(np.array([1, 2], np.uint64)), width)
        tried("simulate", lambda: plant.respond(theta, u), width)
    tried("noise", lambda: plant.sigma(y)[:, None], 1)
    gains = tried("design", lambda: np.nan_to_num(plant.oracle(theta)), len(plant.gains))
    if np.isnan(plant.oracle(theta)).any():  # there are none for the plant in the middle
        return
    encoded = plant.coordinates.encode(gains)
    decoded = plant.coordinates.decode(np.asarray(encoded))
    if not np.allclose(decoded, gains, rtol=1e-6):
        raise ValueError(
            f"gains {gains[0]} do not survive coordinates' encode and decode, which give "
            f"{decoded[0]}. The default is for positive gains: give coordinates of your own."
        )
    tried("judge", lambda: plant.judged(theta, gains), f)
