"""Gains by name, and what is known of their loop."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from tuners.export.digital import SLOWEST, unit
from tuners.export.digital_pi import DigitalPI
from tuners.export.digital_pid import DigitalPID
from tuners.export.digital_state_feedback import DigitalStateFeedback
from tuners.export.forms import controller_of
from tuners.tuner.result import Result
from yawrate_env import validation
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.state_feedback import STATE_FEEDBACK
from yawrate_env.loop.target import Target
from yawrate_env.plant.channels import Names, loops_of
from yawrate_env.plant.pi_loop import GAINS
from yawrate_env.plant.plant import Plant

Limits = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of a controller.

    Attributes
    ----------
    values : dict
        By name; ``nan`` where a tuner found none.
    Ts : float, optional
        The controller's sampling time [s].
    signals : tuple of str
        Names of the plant's input and output, of several the first.
    channels : tuple of tuple of str, optional
        Names of all inputs and outputs, where there are several.
    limits : tuple of float, optional
        Least and largest command, where they are known.
    target : Target, optional
        The loop's target, where there is one.
    controller : str
        Name of the controller, in `yawrate_env.loop.controllers`; empty where it is not known.
    trusted : bool, optional
        Whether the recording supports them, where there was one.
    """

    values: Mapping[str, float]
    Ts: float | None = None
    signals: tuple[str, str] = ("u", "y")
    limits: Limits | None = None
    target: Target | None = None
    trusted: bool | None = None
    controller: str = ""
    channels: tuple[Names, Names] | None = None

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
    def of(cls, source: Any, plant: Plant | None = None) -> Self:
        """From a result, or a pair (kp, Ti) for a plant."""
        if isinstance(source, cls):
            return source
        if isinstance(source, Result):
            return cls.read_plant(source.gains, plant_settings(source.plant), source.trusted)
        if not isinstance(source, tuple | list) or len(source) != len(GAINS):
            raise ValueError(
                f"source: a {type(source).__name__} has no gains. Tune a recording first and "
                "export the result, or give (kp, Ti); a tuner itself goes to target onnx or c."
            )
        values = dict(zip(GAINS, source, strict=True))
        return cls(values) if plant is None else cls.read_plant(values, plant_settings(plant))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """From a file of ``yawrate tune --json``."""
        try:
            content = json.loads(Path(path).read_bytes())
            trusted = validation.flag("trusted", content["trusted"])
            values = {k: np.nan if v is None else v for k, v in content["gains"].items()}
            return cls.read_plant(values, content["plant"], trusted)
        except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
            raise ValueError(
                f"{path} is no answer of `yawrate tune --json` ({type(error).__name__}: {error}). "
                "Tune the log again."
            ) from None

    @classmethod
    def read_plant(
        cls, values: Mapping[str, float], plant: Mapping[str, Any], trusted: bool | None = None
    ) -> Self:
        """Gains for a plant of which `plant_settings` are known."""
        target = None if plant["target"] is None else Target(**plant["target"])
        Ts = sampling_time(plant["Ts"]) if target is None else target.Ts
        input_, output = plant["signals"]
        limits = plant.get("command_limits")
        known = None if limits is None else _pair(limits, input_)
        controller, several = plant.get("controller", ""), plant.get("channels")
        channels = None if several is None else (tuple(several[0]), tuple(several[1]))
        return cls(values, Ts, (input_, output), known, target, trusted, controller, channels)

    @property
    def loops(self) -> dict[str, tuple[str, str]]:
        """Several PI loops by name, to their input and output; empty where there is one loop."""
        return {} if self.channels is None else loops_of(list(self.values), *self.channels)

    @property
    def refusal(self) -> str:
        """Why no controller can be written for them; empty where one can."""
        instead = "no other controller is written. Export the gains to target json, without limits."
        if self.controller in (*CONTROLLERS, STATE_FEEDBACK):
            return ""
        if self.controller:
            return f"controller {self.controller!r} is not known, and {instead}"
        if set(self.values) != set(GAINS):
            return f"gains {', '.join(self.values)} are not a PI's kp and Ti, and {instead}"
        form = "pi" if self.target is None else self.target.controller
        return "" if form == "pi" else f"controller {form!r} is no PI, and {instead}"

    @property
    def is_pi(self) -> bool:
        """Whether they are a PI's, which has a program of its own."""
        return self.controller in ("", "PI")

    def pi(self, Ts: float | None = None, limits: Limits | None = None) -> DigitalPI:
        """The controller; ``ValueError`` where the gains are no PI's or its limits unknown."""
        if not self.is_pi:
            raise ValueError(
                f"controller {self.controller!r} is no PI, and for that this target is. Export "
                "the gains to target c or json."
            )
        chosen, (low, high) = self._settled(Ts, limits)
        kp, Ti = (validation.number(name, self.values[name]) for name in GAINS)
        return DigitalPI(kp, Ti, chosen, low, high, self.signals)

    def pid(self, Ts: float | None = None, limits: Limits | None = None) -> DigitalPID:
        """The controller of the PID's family."""
        chosen, (low, high) = self._settled(Ts, limits)
        for name, value in self.values.items():
            validation.number(name, value, remedy="Export gains that a tuner found.")
        row = np.array([list(self.values.values())])
        of = CONTROLLERS[self.controller].parallel(row, chosen)
        Kp, Ki, Kd, Tf, b, c = (float(v[0]) for v in (of.Kp, of.Ki, of.Kd, of.Tf, of.b, of.c))
        form = self.controller
        return DigitalPID(form, Kp, Ki, Kd, Tf, b, c, chosen, low, high, self.signals)

    def state_feedback(
        self, Ts: float | None = None, limits: Limits | None = None
    ) -> DigitalStateFeedback:
        """The state feedback."""
        chosen, (low, high) = self._settled(Ts, limits)
        *states, kr = self.values
        gains = {name: self.values[name] for name in states}
        return DigitalStateFeedback(gains, self.values[kr], chosen, low, high, self.signals)

    def _settled(self, Ts: float | None, limits: Limits | None) -> tuple[float, Limits]:
        """Sampling time and limits, of a controller that can be written."""
        if self.refusal:
            raise ValueError(self.refusal)
        chosen = self.Ts if Ts is None else Ts
        if chosen is None:
            raise ValueError("Ts of the controller is missing: give it in seconds, Ts= (--Ts).")
        return sampling_time(chosen), self._limits(limits)

    def _limits(self, given: Limits | None) -> Limits:
        """Those given, or else known."""
        command = self.signals[0]
        if given is None and self.limits is None:
            raise ValueError(
                f"limits of {command} are missing: give limits=(low, high) (--limits LOW HIGH), or "
                "export the gains to target json."
            )
        if given is None or self.limits is None:
            return _pair(given or self.limits, command)
        low, high = _pair(given, command)
        if self.limits[0] < 0.0 < self.limits[1] and not low < 0.0 < high:
            raise ValueError(
                f"limits = [{low:g}, {high:g}] must have low below 0 and high above. Give the "
                f"least and the largest command in {unit(command)}."
            )
        return low, high


def plant_settings(plant: Plant) -> dict[str, Any]:
    """What a controller must know of its plant, as plain JSON values."""
    target, known = plant.parametrisation.target, controller_of(plant)
    inputs, outputs = plant.inputs_named, plant.outputs_named
    several = {"channels": [list(inputs), list(outputs)]} if plant.rows > 2 else {}
    return {
        "signals": [inputs[0], outputs[0]],
        **several,
        "Ts": plant.Ts,
        "target": None if target is None else asdict(target),
        "command_limits": plant.command_limits and list(plant.command_limits),
        **({"controller": known} if known else {}),
    }


def sampling_time(value: Any) -> float:
    """A controller's sampling time [s], or ``ValueError``."""
    return validation.number("Ts", value, above=0.0, at_most=SLOWEST, remedy="Give it in seconds.")


def _pair(limits: Any, command: str) -> Limits:
    if np.shape(limits) != (2,):
        raise ValueError(
            f"limits = {limits!r} must be two numbers, (low, high) in {unit(command)}."
        )
    low, high = map(validation.number, ("low", "high"), limits)
    return low, high
