r"""Ready plants in a control loop: lags, integrators, motors and heaters behind a dead time.

===============  ====================================  =========================
plant            G(s)                                  unknown
===============  ====================================  =========================
``fopdt``        K e^{-L s} / (T s + 1)                K, T, L
``sopdt``        K e^{-L s} / ((T1 s + 1)(T2 s + 1))   K, T1, T2, L
``integrator``   K e^{-L s} / s                        K, L
``dc_motor``     K e^{-L s} / (R (Te s + 1)            J, b
                 (J s + b) + K^2)
``thermal``      P e^{-L s} / ((C s + h)(tau s + 1))   C, h, tau, L
===============  ====================================  =========================

The dead time may be unknown and need not be whole samples; the input is held between samples.
No fitted dead time is shorter than the prior's shortest, since gains grow as it shrinks.
The margins are those of the sampled loop, whose controller runs at the experiment's sampling
time.  A number in place of a range is a parameter that is known.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop.process_rules import Process
from yawrate_env.plant.control_loop import MARGINS, ControlLoop
from yawrate_env.plant.distributions import spread
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.rules import LOOP_SHAPING
from yawrate_env.plants.control import Control
from yawrate_env.plants.experiment import USUAL, Experiment, Given
from yawrate_env.plants.models import HEATER, INTEGRATOR, LAG, MOTOR, TWO_LAGS, ProcessModel

Array = NDArray[np.float64]

_DEAD_TIME = "L"
_MAY_BE_NONE = _DEAD_TIME, "b"
_REVERSED = (
    "Of a plant that falls where its input rises give the gain's size, tune with --flip-output, "
    "and reverse the sign of the gains."
)

_MOTOR_TARGET = {"phase_margin": 60.0, "crossover": 8.0}
_MOTOR_UNITS = {"J": "kg m2", "b": "N m s/rad", "K": "N m/A", "R": "ohm"}
_HEATER_UNITS = {"C": "J/K", "h": "W/K", "P": ""}  # power for one unit of the input

_TEST = Experiment()
_MOTOR_TEST = Experiment(
    Ts=5e-3,
    N=1200,
    amplitude=6.0,
    bit_time=0.05,
    noise=1.0,
    signals=("voltage [V]", "speed [rad/s]"),
)
_HEATER_TEST = Experiment(
    N=1200, amplitude=40.0, bit_time=20.0, noise=0.1, signals=("heater [%]", "temperature [degC]")
)


def fopdt(
    K: Any = (0.5, 2.0),
    T: Any = (10.0, 40.0),
    L: Any = (3.0, 20.0),
    experiment: Given = USUAL,
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
        Of which recordings are made; a dict changes settings of the usual one.
    control
        Attributes of `Control`: ``controller="PID", rule="amigo"``.
    """
    prior = {"K": K, "T": T, "L": L}
    return _process("fopdt", prior, LAG, _TEST.changed(experiment), Control.of(control))


def sopdt(
    K: Any = (0.5, 2.0),
    T1: Any = (10.0, 40.0),
    T2: Any = (2.0, 10.0),
    L: Any = (3.0, 15.0),
    experiment: Given = USUAL,
    **control: Any,
) -> Plant:
    """Second order plus dead time, ``K e^{-L s}/((T1 s + 1)(T2 s + 1))``.

    Lags T1, T2 [s]; K, L [s], `experiment` and `control` as for `fopdt`.
    """
    prior = {"K": K, "T1": T1, "T2": T2, "L": L}
    return _process("sopdt", prior, TWO_LAGS, _TEST.changed(experiment), Control.of(control))


def integrator(
    K: Any = (0.02, 0.1),
    L: Any = (2.0, 10.0),
    experiment: Given = USUAL,
    **control: Any,
) -> Plant:
    """Integrator plus dead time, ``K e^{-L s}/s``, K in output over input and second [1/s].

    L [s], `experiment` and `control` are as for `fopdt`.
    """
    prior = {"K": K, "L": L}
    return _process(
        "integrator", prior, INTEGRATOR, _TEST.changed(experiment), Control.of(control), True
    )


def dc_motor(
    J: Any = (1e-4, 6e-4),
    b: Any = (5e-4, 4e-3),
    K: Any = 0.05,
    R: Any = 1.0,
    Te: Any = 2e-3,
    L: Any = 0.0,
    experiment: Given = USUAL,
    **control: Any,
) -> Plant:
    """Direct-current motor from voltage [V] to speed [rad/s], ``R Te`` being its inductance.

    Parameters
    ----------
    J, b : number, pair or prior
        Inertia [kg m2] and viscous friction [N m s/rad] of motor and load.
    K : number, pair or prior
        Torque constant [N m/A], also that of the back electromotive force [V s/rad].
    R, Te : number, pair or prior
        Resistance [ohm] and electrical time constant [s] of the winding.
    L : number, pair or prior
        Dead time of drive and sensor [s].
    experiment : Experiment or dict
        Of which recordings are made; a dict changes settings of the usual one.
    control
        Attributes of `Control`; a PI by loop shaping for 60 deg at 8 Hz if omitted.
    """
    prior = {"J": J, "b": b, "K": K, "R": R, "Te": Te, "L": L}
    usual = {"rule": LOOP_SHAPING, "target": _MOTOR_TARGET}
    made, wanted = _MOTOR_TEST.changed(experiment), Control.of({**usual, **control})
    return _process("dc_motor", prior, MOTOR, made, wanted, units=_MOTOR_UNITS)


def thermal(
    C: Any = (1.0, 4.0),
    h: Any = (0.008, 0.02),
    P: Any = 0.01,
    tau: Any = (2.0, 30.0),
    L: Any = (1.0, 10.0),
    experiment: Given = USUAL,
    **control: Any,
) -> Plant:
    """Heated body that loses heat to its surroundings, from heater [%] to measured temperature.

    Parameters
    ----------
    C : number, pair or prior
        Heat capacity [J/K].
    h : number, pair or prior
        Heat lost for each degree above the surroundings [W/K].
    P : number, pair or prior
        The heater's power for one unit of its input [W/%].  Gains follow from ratios of P, C and h,
        so one of them has to be known, or a guess.
    tau, L : number, pair or prior
        Lag of the sensor and dead time [s].
    experiment : Experiment or dict
        Of which recordings are made; a dict changes settings of the usual one.
    control
        Attributes of `Control`; a PI by SIMC with ``tau_c=20`` if omitted.
    """
    prior = {"C": C, "h": h, "P": P, "tau": tau, "L": L}
    usual = {"tau_c": 20.0}
    made, wanted = _HEATER_TEST.changed(experiment), Control.of({**usual, **control})
    return _process("thermal", prior, HEATER, made, wanted, units=_HEATER_UNITS)


def _process(
    name: str,
    given: dict[str, Any],
    model: ProcessModel,
    experiment: Experiment,
    control: Control,
    integrating: bool = False,
    units: Mapping[str, str] = USUAL,
) -> Plant:
    """A plant behind a dead time, its last parameter."""
    if integrating and control.rule == "ms":
        raise ValueError("rule = 'ms' is for plants that are stable alone. Choose another.")
    prior = {of: spread(of, value) for of, value in given.items()}
    _check_ranges(prior, experiment)
    loop = ControlLoop(
        model.discrete,
        experiment.Ts,
        control.aimed(experiment.Ts),
        experiment.signals,
        control.controller,
        control.rule,
        control.counted,
        _As(model, experiment.Ts / 2),
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
    arguments = {of: value.plain for of, value in prior.items()}
    return loop.plant(
        prior=prior,
        metrics=metrics,
        u=experiment.input(),
        noise=experiment.noise,
        labels=_labels(prior, experiment.signals, integrating, units),
        integrating=integrating,
        entry=f"yawrate_env.plants:{name}",
        arguments={**arguments, "experiment": asdict(experiment), **control.changes},
        **settings,
    )


def _check_ranges(prior: Mapping[str, Iterable[float]], experiment: Experiment) -> None:
    """``ValueError`` where parameters may be negative, or the output later than the recording."""
    for name, (low, high) in prior.items():
        remedy = _REVERSED if name == "K" else "Give a range of positive values."
        least = {"at_least": 0.0} if name in _MAY_BE_NONE else {"above": 0.0}
        validation.number(f"lowest {name}", low, **least, remedy=remedy)
        if name == _DEAD_TIME:
            lasts = experiment.N * experiment.Ts
            remedy = "Give it in seconds, or record for longer: N samples, every Ts."
            validation.number(f"highest {name}", high, at_most=lasts, remedy=remedy)


def _labels(
    names: Iterable[str], signals: tuple[str, str], integrating: bool, units: Mapping[str, str]
) -> dict[str, str]:
    """Parameters' names with their units: a gain's is the output's over the input's."""
    input, output = (split(signal)[1] for signal in signals)
    gain = f"{output}/{input}" if input and output else ""
    if gain and integrating:
        gain = f"{output}/({input} s)"
    usual = {name: gain if name == "K" else "s" for name in names}
    return {name: f"{name} [{unit}]" for name, unit in {**usual, **units}.items() if unit}


@dataclass(frozen=True, slots=True)
class _As:
    """Parameters (B, p) as processes; the controller's hold is half a sample of dead time [s]."""

    model: ProcessModel
    hold: float

    def __call__(self, theta: Array) -> Process:
        return self.model.process(theta, self.hold)
