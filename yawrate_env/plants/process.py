r"""Plants of process control: lags and integrators behind a dead time, in a control loop.

===============  ====================================  =========================
plant            G(s)                                  unknown
===============  ====================================  =========================
``fopdt``        K e^{-L s} / (T s + 1)                K, T, L
``sopdt``        K e^{-L s} / ((T1 s + 1)(T2 s + 1))   K, T1, T2, L
``integrator``   K e^{-L s} / s                        K, L
===============  ====================================  =========================

The dead time may be unknown and need not be whole samples; the input is held between samples.
No fitted dead time is shorter than the prior's shortest, since gains grow as it shrinks.
The margins are those of the sampled loop, whose controller runs at the experiment's sampling
time.  A number in place of a range is a parameter that is known.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop.dead_time import zoh_late
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.process_rules import Process
from yawrate_env.loop.target import Target
from yawrate_env.plant.control_loop import MARGINS, ControlLoop
from yawrate_env.plant.distributions import plain, spread
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.rules import LOOP_SHAPING
from yawrate_env.signals.excitation import (
    RANDOM_ORDER,
    SAME_ORDER,
    multilevel,
    multisine,
    prbs,
)

Array = NDArray[np.float64]
Matrices = Callable[[Array], tuple[Array, Array, Array]]

_DEAD_TIME = "L"

METRICS = ("phase_margin [deg]", "gain_margin [dB]", "crossover [Hz]")
"""Of which the crossover is reported and does not count."""

KINDS = "prbs", "multisine"


@dataclass(frozen=True, slots=True)
class Experiment:
    """A test of a process.

    Attributes
    ----------
    Ts, N : float, int
        Sampling time [s], also of the controller, and number of samples.
    kind : {"prbs", "multisine"}
        Levels that are held, or a sum of sines (`yawrate_env.signals.excitation`).
    amplitude : float
        Largest absolute input: half the difference of two levels.
    bit_time : float
        How long a level is held at least [s]; sines have frequencies up to ``0.44/bit_time``.
    levels : int
        Of a ``prbs``; two show no saturation and no characteristic of the actuator.
    order : int, optional
        Length of the shift register of a ``prbs``, 2 to 20; 7 for two levels and 14 for more if
        omitted.
    noise : float
        Standard deviation of the measurement noise, in the output's unit.
    signals : tuple of str
        Names of input and output, with units in brackets.
    """

    Ts: float = 1.0
    N: int = 600
    amplitude: float = 1.0
    bit_time: float = 20.0
    kind: str = "prbs"
    levels: int = 2
    order: int | None = None
    noise: float = 0.05
    signals: tuple[str, str] = ("u", "y")

    def __post_init__(self) -> None:
        for name in ("Ts", "amplitude", "bit_time"):
            validation.number(name, getattr(self, name), above=0.0, remedy="Give a positive one.")
        object.__setattr__(self, "N", validation.count("N", self.N, remedy="Record some samples."))
        validation.one_of("kind", self.kind, KINDS)
        validation.count("levels", self.levels, at_least=2, remedy="Two are the fewest.")
        if self.kind == "multisine" and self.levels != 2:
            raise ValueError(f"levels = {self.levels}: a multisine has none. Leave one out.")
        object.__setattr__(self, "signals", tuple(self.signals))

    @classmethod
    def of(cls, given: "Experiment | Mapping[str, Any]") -> "Experiment":
        """The experiment, from a record or, as files have it, a mapping."""
        if not isinstance(given, Mapping):
            return validation.instance("experiment", given, cls, remedy="Give an Experiment.")
        for name in given:
            validation.one_of("experiment's setting", name, cls.__slots__)
        return cls(**given)

    def input(self) -> Array:
        """What is applied, (N,)."""
        timing = self.N, self.Ts, self.bit_time, self.amplitude
        if self.kind == "multisine":
            u = multisine(*timing)
        elif self.levels > 2:
            u = multilevel(*timing, self.levels, order=self.order or RANDOM_ORDER)
        else:
            u = prbs(*timing, order=self.order or SAME_ORDER)
        return np.asarray(u[0])


Given = Experiment | Mapping[str, Any]


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


def fopdt(
    K: Any = (0.5, 2.0),
    T: Any = (10.0, 40.0),
    L: Any = (3.0, 20.0),
    experiment: Given = Experiment(),
    **control: Any,
) -> Plant:
    """First order plus dead time, ``K e^{-L s}/(T s + 1)``.

    Parameters
    ----------
    K : number, pair or prior
        Steady gain, output over input.
    T, L : number, pair or prior
        Lag and dead time [s].
    experiment : Experiment or dict
        Of which recordings are made.
    control
        Attributes of `Control`: ``controller="PID", rule="amigo"``.
    """
    prior = {"K": K, "T": T, "L": L}
    return _process("fopdt", prior, _lag, experiment, Control.of(control))


def sopdt(
    K: Any = (0.5, 2.0),
    T1: Any = (10.0, 40.0),
    T2: Any = (2.0, 10.0),
    L: Any = (3.0, 15.0),
    experiment: Given = Experiment(),
    **control: Any,
) -> Plant:
    """Second order plus dead time, ``K e^{-L s}/((T1 s + 1)(T2 s + 1))``.

    Lags T1, T2 [s]; K, L [s], `experiment` and `control` as for `fopdt`.
    """
    prior = {"K": K, "T1": T1, "T2": T2, "L": L}
    return _process("sopdt", prior, _two_lags, experiment, Control.of(control))


def integrator(
    K: Any = (0.02, 0.1),
    L: Any = (2.0, 10.0),
    experiment: Given = Experiment(),
    **control: Any,
) -> Plant:
    """Integrator plus dead time, ``K e^{-L s}/s``, K in output over input and second [1/s].

    L [s], `experiment` and `control` are as for `fopdt`.
    """
    prior = {"K": K, "L": L}
    return _process("integrator", prior, _integrator, experiment, Control.of(control), True)


def _process(
    name: str,
    given: dict[str, Any],
    matrices: Matrices,
    experiment: Given,
    control: Control,
    integrating: bool = False,
) -> Plant:
    """A plant behind a dead time, its last parameter."""
    if integrating and control.rule == "ms":
        raise ValueError("rule = 'ms' is for plants that are stable alone. Choose another.")
    prior = {of: spread(of, value) for of, value in given.items()}
    made = Experiment.of(experiment)
    loop = ControlLoop(
        _Late(matrices),
        made.Ts,
        control.aimed(made.Ts),
        made.signals,
        control.controller,
        control.rule,
        control.counted,
        _As(made.Ts / 2),
        control.tau_c,
        control.Ms,
        control.N,
    )
    scales = control.scales
    metrics: dict[str, Any] = {**loop.settings, **scales}
    if not scales and control.rule != LOOP_SHAPING and "crossover [Hz]" in metrics:
        metrics["crossover [Hz]"] = Metric(np.inf)
    settings: dict[str, Any] = {}
    if loop.parametrisation.target is not None:  # the recording can judge alone
        aim = loop.target
        settings = {"crossover": aim.crossover, "target": (aim.phase_margin, aim.crossover)}
        settings = settings if control.counted == MARGINS else {}
    shortest, longest = prior[_DEAD_TIME]
    if 0 < shortest < longest:  # gains grow as it shrinks: what noise takes away is not asked for
        settings["search_limits"] = {_DEAD_TIME: (shortest, longest + (longest - shortest) / 2)}
    arguments = {of: plain(value) for of, value in prior.items()}
    return loop.plant(
        prior=prior,
        metrics=metrics,
        u=made.input(),
        noise=made.noise,
        labels=_labels(prior, made.signals, integrating),
        integrating=integrating,
        entry=f"yawrate_env.plants:{name}",
        arguments={**arguments, "experiment": asdict(made), **control.changes},
        **settings,
    )


def _labels(names: Iterable[str], signals: tuple[str, str], integrating: bool) -> dict[str, str]:
    """Parameters' names with their units: a gain's is the output's over the input's."""
    input, output = (split(signal)[1] for signal in signals)
    gain = f"{output}/{input}" if input and output else ""
    if gain and integrating:
        gain = f"{output}/({input} s)"
    units = {name: gain if name == "K" else "s" for name in names}
    return {name: f"{name} [{unit}]" for name, unit in units.items() if unit}


@dataclass(frozen=True, slots=True)
class _Late:
    """Plants behind the dead time that is the last of their parameters, discretised."""

    matrices: Matrices

    def __call__(self, theta: Array, Ts: float) -> DiscretePlant:
        return zoh_late(*self.matrices(theta), Ts, theta[:, -1])


@dataclass(frozen=True, slots=True)
class _As:
    """Parameters (B, p) as processes; the controller's hold is half a sample of dead time [s]."""

    hold: float

    def __call__(self, theta: Array) -> Process:
        gain, *lags, dead_time = theta.T
        none = np.zeros_like(gain)
        lag, second = [*lags, none][:2] if lags else (np.full_like(gain, np.inf), none)
        return Process(gain, lag, second, dead_time + self.hold)


def _lag(theta: Array) -> tuple[Array, Array, Array]:
    K, T = theta.T[:2]
    return -1 / T[:, None, None], (K / T)[:, None], np.ones(1)


def _two_lags(theta: Array) -> tuple[Array, Array, Array]:
    K, T1, T2 = theta.T[:3]
    A, B = np.zeros((len(theta), 2, 2)), np.zeros((len(theta), 2))
    A[:, 0, 0], A[:, 0, 1], A[:, 1, 1], B[:, 1] = -1 / T1, 1 / T1, -1 / T2, K / T2
    return A, B, np.array([1.0, 0.0])


def _integrator(theta: Array) -> tuple[Array, Array, Array]:
    return np.zeros((len(theta), 1, 1)), theta[:, :1], np.ones(1)
