"""What is wrong with a plant's description, found without calling any of its functions."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from yawrate_env import validation
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.names import check_names
from yawrate_env.plant.parametrisation import Parametrisation

if TYPE_CHECKING:
    from yawrate_env.plant.plant import Plant

RELATIVE_ERROR = 0.3
"""Of a gain: what counts as one where the plant has no judge."""

_RELATIVE = "relative error of "

SHORTEST = 16
"""Samples that an experiment has at least."""

_FUNCTIONS = {"simulate": False, "design": False, "evaluate": True, "excite": True, "record": True,
              "action_bounds": True, "loop": True}  # fmt: skip
"""Whether None may stand for them."""


class Filled(dict[str, Metric]):
    """Figures of a plant without a judge, which ``dataclasses.replace`` does not take for given."""


def check_settings(plant: "Plant") -> None:
    """Everything that can be checked without calling anything; normalises what it can."""
    _check_types(plant)
    prior = _prior(plant.prior)
    gains = _gains(plant.gains)
    figures = _figures(plant, gains)
    check_names(tuple(prior), gains, tuple(figures), tuple(plant.measured))
    values = {
        "prior": prior,
        "u": _input(plant.u),
        "Ts": validation.number(
            "Ts", plant.Ts, above=0.0, remedy="Give the sampling time in seconds."
        ),
        "gains": gains,
        "metrics": figures,
        "measured": _measured(plant.measured, prior),
        "search_limits": _search_limits(plant.search_limits, prior),
        "linear": validation.flag("linear", plant.linear),
        "batched": validation.flag("batched", plant.batched),
    }
    if plant.crossover is not None:
        validation.number("crossover", plant.crossover, above=0.0, below=0.5 / values["Ts"],
                          remedy="Give it in Hz, below half the sampling rate.")  # fmt: skip
    _check_plausible(plant.plausible)
    if plant.target is not None:
        target = validation.finite_array(
            "target", plant.target, shape=(sum(m.counts for m in figures.values()),)
        )
        values["target"] = tuple(target.tolist())
    if not callable(plant.noise):
        validation.number("noise", plant.noise, at_least=0.0, remedy="Give a standard deviation.")
    for name, value in values.items():
        object.__setattr__(plant, name, value)


def _check_types(plant: "Plant") -> None:
    for name, optional in _FUNCTIONS.items():
        validation.function(name, getattr(plant, name), optional=optional)
    remedy = "Give LOG, GAINS, loop(target) or Parametrisation(encode, decode)."
    validation.instance("coordinates", plant.parametrisation, Parametrisation, remedy=remedy)
    for name in ("encode", "decode"):
        validation.function(f"coordinates.{name}", getattr(plant.parametrisation, name))
    validation.function("coordinates.names", plant.parametrisation.names, optional=True)
    if plant.black_box is not None:
        order, pole = plant.black_box
        validation.count("black_box's order", order, remedy="Give some 20.")
        validation.number("black_box's pole", pole, above=0.0, remedy="Give it in rad/s.")
    if not isinstance(plant.entry, str):
        raise ValueError(f'entry = {plant.entry!r} must be a text, as in "my_plant:plant".')
    signals: Any = plant.signals
    if not isinstance(signals, Sequence) or isinstance(signals, str) or len(signals) != 2:
        raise ValueError(
            f'signals = {signals!r} must be two texts, as in ("voltage [V]", "speed [rad/s]").'
        )
    for name, signal in zip(("input", "output"), signals, strict=True):
        validation.text(f"signals' {name}", signal)
    object.__setattr__(plant, "signals", tuple(signals))


def _prior(prior: Any) -> dict[str, tuple[float, float]]:
    if not isinstance(prior, Mapping) or not prior:
        raise ValueError('prior must name at least one parameter, as in {"J": (0.01, 0.03)}.')
    for name in prior:
        validation.text("prior's parameter", name)
    return {name: validation.interval(f"prior {name}", r) for name, r in prior.items()}


def _gains(gains: Any) -> tuple[str, ...]:
    if isinstance(gains, str) or not isinstance(gains, Sequence) or not gains:
        raise ValueError(f'gains = {gains!r} must be names, as in ("kp", "Ti").')
    return tuple(validation.text(f"gains[{i}]", name) for i, name in enumerate(gains))


def _input(u: Any) -> Any:
    values = validation.finite_array("u", u, shape=(None,))
    remedy = "Describe a longer experiment."
    validation.count("number of samples of u", len(values), at_least=SHORTEST, remedy=remedy)
    if not values.any():
        raise ValueError("u is zero everywhere: nothing moves. Give an input that excites.")
    return np.array(values)  # the caller's may change


def _check_plausible(plausible: Any) -> None:
    if not isinstance(plausible, Sequence) or len(plausible) != 2:
        raise ValueError(
            f"plausible = {plausible!r} must be the largest input and output, as in (1.0, 20.0)."
        )
    for signal, largest in zip(("input", "output"), plausible, strict=True):
        if largest != np.inf:
            remedy = "Say what is too large to be."
            validation.number(f"plausible {signal}", largest, above=0.0, remedy=remedy)


def _measured(measured: Any, prior: Mapping[str, Any]) -> dict[str, float]:
    _check_mapping("measured", measured, '{"speed": 0.25}')
    found, remedy = {}, "Say how far outside the prior it may lie."
    for name, slack in measured.items():
        validation.one_of("measured parameter", name, tuple(prior))
        found[name] = validation.number(f"measured {name}", slack, at_least=0.0, remedy=remedy)
    return found


def _search_limits(
    limits: Any, prior: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    _check_mapping("search_limits", limits, '{"J": (0.001, 0.1)}')
    found = {}
    for name, value in limits.items():
        validation.one_of("search_limits' parameter", name, tuple(prior))
        low, high = found[name] = validation.interval(f"search_limits {name}", value)
        least, most = prior[name]
        if low > least or high < most:
            raise ValueError(
                f"search_limits {name} = [{low:g}, {high:g}] must contain the prior's "
                f"[{least:g}, {most:g}]. Widen the limits."
            )
    return found


def _figures(plant: "Plant", gains: tuple[str, ...]) -> dict[str, Metric]:
    """Those given, or where there is no judge the gains' relative errors."""
    _check_mapping("metrics", plant.metrics, '{"phase_margin [deg]": 10.0}')
    if plant.evaluate is None:
        return _of_gains(plant.metrics, gains)
    if not plant.metrics or isinstance(plant.metrics, Filled):
        raise ValueError(
            "judge and figures belong together. Give figures the names of what judge returns and "
            'the errors that count as one, as in {"phase_margin [deg]": 10.0}.'
        )
    for name in plant.metrics:
        validation.text("metrics' name", name)
    return {name: _figure(name, value) for name, value in plant.metrics.items()}


def _of_gains(figures: Mapping[str, float | Metric], gains: tuple[str, ...]) -> Filled:
    """Relative errors of gains, which figures may give the scale of."""
    if isinstance(figures, Filled):  # a description that was filled in, and has changed since
        figures = {name.removeprefix(_RELATIVE): value for name, value in figures.items()}
        figures = {name: value for name, value in figures.items() if name in gains}
    for name in figures:
        if name not in gains:
            raise ValueError(
                f"metrics' name = {name!r}: without a judge figures are the gains' relative "
                f"errors. Give a judge, or what counts as one of {', '.join(gains)}."
            )
    scales = {name: figures.get(name, RELATIVE_ERROR) for name in gains}
    return Filled({f"{_RELATIVE}{name}": _figure(name, scales[name]) for name in gains})


def _figure(name: str, value: float | Metric) -> Metric:
    if isinstance(value, Metric):
        return value
    remedy = "Give the error that counts as one."
    return Metric(validation.number(f"figure {name}", value, above=0.0, remedy=remedy))


def _check_mapping(name: str, value: Any, example: str) -> None:
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} = {value!r} must be names with values, as in {example}.")
