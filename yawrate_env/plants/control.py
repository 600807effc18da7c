"""The loop that is wanted around a ready plant: controller, rule and metrics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

from yawrate_env import validation
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.target import Target
from yawrate_env.plant.control_loop import MARGINS
from yawrate_env.plant.rules import LOOP_SHAPING

METRICS = ("phase_margin [deg]", "gain_margin [dB]", "crossover [Hz]")
"""Of which the crossover is reported and does not count."""


@dataclass(frozen=True, slots=True)
class Control:
    """The loop that is wanted.

    Attributes
    ----------
    controller, rule : str
        By their names in `yawrate_env.loop.controllers` and `yawrate_env.plant.rules`.
    tau_c : float, optional
        Wanted time constant of the closed loop, for SIMC and lambda [s]; each plant's dead time if
        omitted.
    target : Target or dict, optional
        What loop shaping aims at: ``{"phase_margin": 60, "crossover": 0.01}`` [deg, Hz].
    Ms : float
        Largest sensitivity, for the rule ``ms``.
    N : float
        Derivative time over filter time.
    metrics : tuple of str, or dict
        What is evaluated, of `yawrate_env.loop.metrics`; a dict gives the errors that count as one.
    """

    controller: str = "PI"
    rule: str = "simc"
    tau_c: float | None = None
    target: Mapping[str, Any] | None = None
    Ms: float = 1.4
    N: float = 10.0
    metrics: Sequence[Any] | Mapping[str, float] = ()

    def __post_init__(self) -> None:
        validation.one_of("controller", self.controller, tuple(CONTROLLERS))
        if isinstance(self.metrics, str):
            raise ValueError(
                f"metrics = {self.metrics!r} is one name. Give a list, as in [{self.metrics!r}]."
            )

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """From keyword arguments of a plant."""
        known = tuple(each.name for each in fields(cls))
        for name in given:
            validation.one_of("argument", name, ("experiment", *known))
        return cls(**given)

    @property
    def changes(self) -> dict[str, Any]:
        """Settings that are not the usual ones, as plain JSON values."""
        given = ((each.name, getattr(self, each.name), each.default) for each in fields(self))
        changed = {name: value for name, value, usual in given if value != usual}
        if "metrics" in changed:  # as pairs: files may sort a table
            changed["metrics"] = list(map(list, self.scales.items())) or list(self.metrics)
        return changed

    @property
    def scales(self) -> dict[str, float]:
        """Errors that count as one, where they are given."""
        if isinstance(self.metrics, Mapping):
            return dict(self.metrics)
        return dict(pair for pair in self.metrics if not isinstance(pair, str))

    def aimed(self, Ts: float) -> Target:
        """The target, at the controller's sampling time."""
        given = self.target or {}
        lacks = [name for name in ("phase_margin", "crossover") if name not in given]
        if lacks and (given or self.rule == LOOP_SHAPING):
            raise ValueError(
                f"target has no {' and no '.join(lacks)}. Give both, as in "
                "target = {phase_margin = 60, crossover = 0.01} [deg, Hz]."
            )
        return Target(**{"crossover": 0.1 / Ts, "Ts": Ts, **given})

    @property
    def counted(self) -> tuple[str, ...]:
        """Names of the metrics."""
        usual = MARGINS if self.rule == LOOP_SHAPING else METRICS
        return tuple(self.scales or self.metrics) or usual
