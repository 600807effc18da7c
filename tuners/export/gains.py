"""Gains by name, from whatever has them, and what is known of the loop that they are for."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from tuners.export.digital_pi import LIMITS, SIGNALS, SLOWEST, DigitalPI, unit
from tuners.tuner.plant_result import PlantResult
from yawrate_env import validation
from yawrate_env.loop.target import Target
from yawrate_env.plant.pi_loop import GAINS

Limits = tuple[float, float]

OF_VEHICLES = 0.01
"""Sampling time of a vehicle's controller, where nothing else is said [s]."""


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of a controller.

    Attributes
    ----------
    values : dict
        By name; ``nan`` where a tuner found none.
    Ts : float
        The controller's sampling time [s].
    signals : tuple of str
        What input and output of the plant are called.
    limits : tuple of float, optional
        Least and largest command, where they are known.
    target : Target, optional
        The loop that the gains shall give, where there is one.
    trusted : bool, optional
        Whether the recording supports them, where one was asked.
    """

    values: Mapping[str, float]
    Ts: float = OF_VEHICLES
    signals: tuple[str, str] = SIGNALS
    limits: Limits | None = LIMITS
    target: Target | None = None
    trusted: bool | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.values, Mapping) or not self.values:
            raise ValueError(
                f'gains = {self.values!r} must be names with values, as in {{"K": 1}}.'
            )
        for name, value in self.values.items():
            if not (isinstance(value, float) and not np.isfinite(value)):
                validation.number(name, value, remedy="Give nan for none.")
        for name, signal in zip(("input", "output"), self.signals, strict=True):
            validation.text(f"signals' {name}", signal)
        if self.trusted is not None:
            validation.flag("trusted", self.trusted)

    @classmethod
    def of(cls, source: Any) -> Self:
        """From a result, a pair (kp, Ti), or anything with attributes of these names."""
        if isinstance(source, cls):
            return source
        if isinstance(source, PlantResult):
            plant, target = source.plant, source.plant.parametrisation.target
            Ts = plant.Ts if target is None else target.Ts
            return cls(source.gains, Ts, plant.signals, None, target, source.trusted)
        trusted = getattr(source, "trusted", None)
        if all(hasattr(source, name) for name in GAINS):
            source = tuple(getattr(source, name) for name in GAINS)
        if not isinstance(source, tuple | list) or len(source) != 2:
            raise ValueError(
                f"a {type(source).__name__} holds no gains. Tune a recording first and export the "
                "result, or give (kp, Ti); a tuner itself goes to target onnx or c."
            )
        return cls(dict(zip(GAINS, source, strict=True)), trusted=trusted)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """From a file of ``yawrate tune --json``, a vehicle's or a plant's."""
        try:
            content = json.loads(Path(path).read_bytes())
            trusted = validation.flag("trusted", content["trusted"])
            if "gains" not in content:
                loop = Target(**content["target"])
                pair = {name: _number(content[name]) for name in GAINS}
                return cls(pair, loop.Ts, target=loop, trusted=trusted)
            values = {name: _number(value) for name, value in content["gains"].items()}
            plant = content["plant"]
            target = None if plant["target"] is None else Target(**plant["target"])
            Ts = _sampling_time(plant["Ts"]) if target is None else target.Ts
            first, second = plant["signals"]
            return cls(values, Ts, (first, second), None, target, trusted)
        except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
            raise ValueError(
                f"{path} is no answer of `yawrate tune --json` ({type(error).__name__}: {error}). "
                "Tune the log again."
            ) from None

    @property
    def refusal(self) -> str:
        """Why no controller is written for them; empty where one can be."""
        instead = "no other controller is written. Export the gains to target json, without limits."
        if set(self.values) != set(GAINS):
            return f"gains {', '.join(self.values)} are not a PI's kp and Ti, and {instead}"
        form = "pi" if self.target is None else self.target.controller
        return "" if form == "pi" else f"controller {form!r} is no PI, and {instead}"

    def pi(self, Ts: float | None = None, limits: Limits | None = None) -> DigitalPI:
        """The controller, or ``ValueError`` where the gains are no PI's or its limits unknown."""
        if self.refusal:
            raise ValueError(self.refusal)
        values = *(self.values[name] for name in GAINS), self.sampling(Ts), *self._limits(limits)
        names = "kp", "Ti", "Ts", "low", "high"
        kp, Ti, Ts, low, high = map(validation.number, names, values)
        return DigitalPI(kp, Ti, Ts, low, high, self.signals)

    def sampling(self, Ts: float | None) -> float:
        """The controller's sampling time, where another one is not given."""
        return _sampling_time(self.Ts if Ts is None else Ts)

    def _limits(self, given: Limits | None) -> Limits:
        """Those given or known, checked as far as they are a vehicle's."""
        low_high = self.limits if given is None else given
        command = self.signals[0]
        if low_high is None:
            raise ValueError(
                f"a controller needs the limits of {command}: give limits=(low, high) "
                "(--limits LOW HIGH), or export the gains to target json."
            )
        if np.shape(low_high) != (2,):
            raise ValueError(f"limits = {low_high!r} must be two numbers, (low, high) in "
                             f"{unit(command)}.")  # fmt: skip
        low, high = map(validation.number, ("low", "high"), low_high)
        if self.limits is not None and not low < 0.0 < high:
            raise ValueError(
                f"limits = [{low:g}, {high:g}] must have low below 0 and high above. Give the "
                f"least and the largest command in {unit(command)}."
            )
        return low, high


def _number(value: Any) -> Any:
    """JSON's value, or ``nan`` for its null."""
    return np.nan if value is None else value


def _sampling_time(value: Any) -> float:
    return validation.number("Ts", value, above=0.0, at_most=SLOWEST, remedy="Give it in seconds.")
