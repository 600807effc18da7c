"""Checks of a plant's settings that call none of its functions."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from yawrate_env import validation
from yawrate_env.plant.channels import check_channels
from yawrate_env.plant.distributions import Spread, spread
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.names import CHECKS, OF_METRICS, check_name, check_unique, split
from yawrate_env.plant.parametrisation import Parametrisation
from yawrate_env.signals.hold import HOLDS

Check = Callable[[str, Any], Any]

RELATIVE_ERROR = 0.3
"""Scale of a gain's relative error, where the plant has no `evaluate`."""

SHORTEST = 16
"""Samples that an experiment has at least."""

_RELATIVE = "relative_error_of_"


def checked(given: Mapping[str, Any]) -> dict[str, Any]:
    """All settings by name, normalised; ``ValueError`` names the first that is wrong."""
    plant = dict(given)
    for name, check in _SETTINGS.items():
        plant[name] = check(name, plant[name])
    for name, check in _OF_PARAMETERS.items():
        plant[name] = _mapping(name, plant[name], check, tuple(plant["prior"]))
    roles = ("input", "output", *plant["measured"])
    _check_initial(plant)
    if plant["integrating"] and not plant["linear"]:
        raise ValueError("integrating is for plants that are linear. Set linear, or leave it out.")
    if plant["slow"] and plant["record"] is not None:
        raise ValueError("slow: a plant with record simulates quickly. Leave out one of the two.")
    plant["synonyms"] = _mapping("synonyms", plant["synonyms"], _texts, roles)
    plant["metrics"] = _metrics(plant["metrics"], plant["gains"], plant["evaluate"] is not None)
    if plant["crossover"] is not None:
        validation.number("crossover", plant["crossover"], above=0.0, remedy="Give it in Hz.")
    if plant["target"] is not None:
        counted = sum(metric.counts for metric in plant["metrics"].values())
        target = validation.finite_array("target", plant["target"], shape=(counted,))
        plant["target"] = tuple(target.tolist())
    check_channels(plant)
    _check_limits(plant["search_limits"], plant["prior"])
    _check_names(plant)
    _check_messages(plant)
    return plant


def check_experiment(u: Any, Ts: float, crossover: float | None) -> None:
    """``ValueError`` where an experiment is too short or sampled too slowly to learn from."""
    remedy = "Describe a longer experiment."
    validation.count("number of samples of u", u.shape[-1], at_least=SHORTEST, remedy=remedy)
    if crossover is not None:
        remedy = "Give it in Hz, below half the sampling rate."
        validation.number("crossover", crossover, below=0.5 / Ts, remedy=remedy)


def _mapping(name: str, value: Any, check: Check, keys: tuple[str, ...] = ()) -> dict[str, Any]:
    """Values by name; where `keys` are given, the names are among them."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} = {value!r} must be a dict of names and values.")
    for key in value:
        if keys:
            validation.one_of(f"{name}'s parameter", key, keys)
        validation.text(f"a name in {name}", key)
    return {key: check(f"{name} {key}", each) for key, each in value.items()}


def _prior(name: str, value: Any) -> dict[str, Spread]:
    if not value:
        raise ValueError('prior must name at least one parameter, as in {"J": (0.01, 0.03)}.')
    return _mapping(name, value, spread)


def _gains(name: str, value: Any) -> tuple[str, ...]:
    if isinstance(value, str) or not isinstance(value, Sequence) or not value:
        raise ValueError(f'gains = {value!r} must be names, as in ("kp", "Ti").')
    return tuple(validation.text(f"gains[{i}]", name) for i, name in enumerate(value))


def _texts(name: str, value: Any) -> tuple[str, ...]:
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise ValueError(f'{name} = {value!r} must be texts, as in ("steer", "u").')
    return tuple(validation.text(name, each) for each in value)


def _input(name: str, value: Any) -> Any:
    several = np.ndim(value) == 2
    u = validation.finite_array(name, value, shape=(None, None) if several else (None,))
    if not u.any(axis=-1).all():
        raise ValueError("u is zero everywhere. Give an input that excites the plant.")
    return np.array(u)  # the caller may change theirs


def _noise(name: str, value: Any) -> Any:
    remedy = "Give a standard deviation."
    if callable(value):
        return value
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(validation.number(name, each, above=0.0, remedy=remedy) for each in value)
    return validation.number(name, value, at_least=0.0, remedy=remedy)


def _channels(name: str, value: Any) -> Any:
    example = '(("reflux", "steam"), ("top", "bottom"))'
    return None if value is None else _pair(name, value, example, _texts, _texts)


def _pair(name: str, value: Any, example: str, first: Check, second: Check) -> tuple[Any, Any]:
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != 2:
        raise ValueError(f"{name} = {value!r} must be a pair, as in {example}.")
    return first(f"first of {name}", value[0]), second(f"second of {name}", value[1])


def _largest(name: str, value: Any) -> float:
    remedy = "Give the largest plausible value, or inf."
    return np.inf if value == np.inf else validation.number(name, value, above=0.0, remedy=remedy)


def _black_box(name: str, value: Any) -> Any:
    pole = partial(validation.number, above=0.0, remedy="Give it in rad/s.")
    return None if value is None else _pair(name, value, "(20, 12.0)", validation.count, pole)


def _command_limits(name: str, value: Any) -> Any:
    if value is None:
        return None
    low, high = validation.interval(name, value)
    if low == high:
        raise ValueError(
            f"{name} = {value!r} leaves no room: the largest input must be above the least. "
            "Give both, as in (-12.0, 12.0)."
        )
    return low, high


def _metric(name: str, value: Any) -> Metric:
    if isinstance(value, Metric):
        return value
    remedy = "Give the error that counts as one."
    return Metric(validation.number(name, value, above=0.0, remedy=remedy))


def _metrics(given: Any, gains: tuple[str, ...], evaluated: bool) -> dict[str, Metric]:
    """Metrics of `evaluate`; without one, the gains' relative errors, by gain."""
    metrics = _mapping("metrics", given, _metric)
    scales = {n.removeprefix(_RELATIVE): m for n, m in metrics.items() if n.startswith(_RELATIVE)}
    own = {name: metric for name, metric in metrics.items() if not name.startswith(_RELATIVE)}
    if evaluated and not own:
        raise ValueError(
            "evaluate and metrics belong together. Give metrics the names of what evaluate returns "
            'and the errors that count as one, as in {"phase_margin [deg]": 10.0}.'
        )
    if evaluated:
        return own
    for name in own:
        validation.one_of("metrics without evaluate: a gain's name", name, gains)
    scales |= own
    return {f"{_RELATIVE}{n}": scales.get(n, Metric(RELATIVE_ERROR)) for n in gains}


def _check_initial(plant: Mapping[str, Any]) -> None:
    """A recording's initial states are unknown parameters of a nonlinear plant."""
    for name in plant["initial"]:
        validation.one_of("initial's parameter", name, tuple(plant["prior"]))
        if name in plant["measured"]:
            raise ValueError(f"initial {name!r} is measured, too. Leave out one of the two.")
    if plant["initial"] and plant["linear"]:
        raise ValueError(
            f"initial = {plant['initial']!r}: of a linear plant every initial state is estimated "
            "without it. Leave it out, and simulate from rest."
        )


def _check_limits(limits: Mapping[str, Any], prior: Mapping[str, Any]) -> None:
    for name, (low, high) in limits.items():
        least, most = prior[name]
        if low > least or high < most:
            raise ValueError(
                f"search_limits {name} = [{low:g}, {high:g}] must contain the prior's "
                f"[{least:g}, {most:g}]. Widen the limits."
            )


def _check_names(plant: Mapping[str, Any]) -> None:
    """Each name stands for one thing in an info, a result, a log and among the checks."""
    labels = {name: plant["labels"].get(name, name) for name in plant["prior"]}
    metrics = plant["metrics"]
    check_unique({"parameter": labels, "gain": plant["gains"], "metric": metrics})
    check_unique({"parameter's label": labels.values()})
    check_unique({
        "check of every recording": CHECKS,
        "measured parameter": [labels[name] for name in plant["measured"]],
        "metric's check": [check_name(name, of) for name in metrics for of in OF_METRICS],
    })  # fmt: skip


def _check_messages(plant: Mapping[str, Any]) -> None:
    """Each message belongs to a check that recordings of the plant may undergo."""
    counted = [name for name, metric in plant["metrics"].items() if metric.counts]
    measured = [split(plant["labels"].get(name, name))[0] for name in plant["measured"]]
    of_metrics = [check_name(name, of) for name in counted for of in OF_METRICS]
    for name in plant["messages"]:
        validation.one_of("messages' check", name, (*CHECKS, *measured, *of_metrics))


def _display(name: str, value: Any) -> Any:
    """Pairs of a label and a factor, of input and output."""
    factor = partial(validation.number, above=0.0, remedy="Give the factor to the label's unit.")
    labelled = partial(_pair, example='("speed [rpm]", 9.55)', first=validation.text, second=factor)
    example = '(("voltage [mV]", 1e3), ("speed [rpm]", 9.55))'
    return None if value is None else _pair(name, value, example, labelled, labelled)


_OPTIONAL = (
    "evaluate",
    "excite",
    "together",
    "record",
    "action_bounds",
    "loop",
    "speeds",
    "sliders",
    "actuator",
    "remarks",
    "suspects",
)

_SETTINGS: dict[str, Check] = {
    "prior": _prior,
    "simulate": validation.function,
    "design": validation.function,
    **dict.fromkeys(_OPTIONAL, partial(validation.function, optional=True)),
    "gains": _gains,
    "initial": _texts,
    "u": _input,
    "Ts": partial(validation.number, above=0.0, remedy="Give the sampling time in seconds."),
    "noise": _noise,
    "parametrisation": partial(
        validation.instance, kind=Parametrisation,
        remedy="Give LOG, GAINS, loop(target) or Parametrisation(encode, decode).",
    ),
    "linear": validation.flag,
    "integrating": validation.flag,
    "in_loop": validation.flag,
    "batched": validation.flag,
    "slow": validation.flag,
    "input": partial(validation.one_of, choices=HOLDS),
    "plausible": partial(_pair, example="(1.0, 20.0)", first=_largest, second=_largest),
    "controller": partial(validation.instance, kind=str, remedy="Give its name."),
    "channels": _channels,
    "signals": partial(
        _pair, example='("voltage [V]", "speed [rad/s]")', first=validation.text,
        second=validation.text,
    ),
    "entry": partial(
        validation.instance, kind=str, remedy='Give a text, as in "my_plant:plant".'
    ),
    **dict.fromkeys(("messages", "cautions"), partial(_mapping, check=validation.text)),
    **dict.fromkeys(("arguments", "synonyms"), partial(_mapping, check=lambda name, value: value)),
    "black_box": _black_box,
    "command_limits": _command_limits,
    "display": _display,
}  # fmt: skip

_OF_PARAMETERS: dict[str, Check] = {
    "measured": partial(
        validation.number, at_least=0.0, remedy="Give how far outside the prior it may lie."
    ),
    "labels": validation.text,
    "extrapolation": validation.interval,
    "search_limits": validation.interval,
}
