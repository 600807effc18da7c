r"""Plants of process control: lags and integrators behind a dead time, with a PI by SIMC.

===============  ====================================  =========================
plant            G(s)                                  unknown
===============  ====================================  =========================
``fopdt``        K e^{-L s} / (T s + 1)                K, T, L
``sopdt``        K e^{-L s} / ((T1 s + 1)(T2 s + 1))   K, T1, T2, L
``integrator``   K e^{-L s} / s                        K, L
===============  ====================================  =========================

The dead time may be unknown and need not be whole samples; the input is held between samples.
The margins are those of the sampled loop, whose controller runs at the experiment's sampling
time.  A number in place of a range is a parameter that is known.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop.dead_time import zoh_late
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.simc import half_rule, simc
from yawrate_env.loop.target import Target
from yawrate_env.plant.distributions import plain, spread
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.pi_loop import GAINS, PILoop
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import ClosedLoop
from yawrate_env.signals.excitation import prbs

Array = NDArray[np.float64]
Matrices = Callable[[Array], tuple[Array, Array, Array]]
Design = Callable[[Array], Array]

METRICS = {
    "phase_margin [deg]": Metric(10.0),
    "gain_margin [dB]": Metric(4.0),  # 10 % of the gain needs no care, 20 % is no miss
    "crossover [Hz]": Metric(np.inf),
}


@dataclass(frozen=True, slots=True)
class Experiment:
    """A pseudo-random binary test of a process.

    Attributes
    ----------
    Ts, N : float, int
        Sampling time [s], also of the controller, and number of samples.
    amplitude : float
        Half the difference of the input's two levels.
    bit_time : float
        How long a level is held at least [s].
    noise : float
        Standard deviation of the measurement noise, in the output's unit.
    signals : tuple of str
        Names of input and output, with units in brackets.
    """

    Ts: float = 1.0
    N: int = 600
    amplitude: float = 1.0
    bit_time: float = 20.0
    noise: float = 0.05
    signals: tuple[str, str] = ("u", "y")

    def __post_init__(self) -> None:
        for name in ("Ts", "amplitude", "bit_time"):
            validation.number(name, getattr(self, name), above=0.0, remedy="Give a positive one.")
        object.__setattr__(self, "N", validation.count("N", self.N, remedy="Record some samples."))
        object.__setattr__(self, "signals", tuple(self.signals))

    @classmethod
    def of(cls, given: "Experiment | Mapping[str, Any]") -> "Experiment":
        """The experiment, from a record or, as files have it, a mapping."""
        if not isinstance(given, Mapping):
            return validation.instance("experiment", given, cls, remedy="Give an Experiment.")
        for name in given:
            validation.one_of("experiment's setting", name, cls.__slots__)
        return cls(**given)


Given = Experiment | Mapping[str, Any]


def fopdt(
    K: Any = (0.5, 2.0),
    T: Any = (10.0, 40.0),
    L: Any = (3.0, 20.0),
    tau_c: float | None = None,
    experiment: Given = Experiment(),
) -> Plant:
    """First order plus dead time, ``K e^{-L s}/(T s + 1)``.

    Parameters
    ----------
    K : number, pair or prior
        Steady gain, output over input.
    T, L : number, pair or prior
        Lag and dead time [s].
    tau_c : float, optional
        Wanted time constant of the closed loop [s]; each plant's dead time if omitted.
    experiment : Experiment or dict
        Of which recordings are made.
    """

    def design(theta: Array, hold: float) -> Array:
        gain, lag, late = theta.T
        return simc(gain, lag, late + hold, tau_c)

    return _process("fopdt", {"K": K, "T": T, "L": L}, _lag, design, tau_c, experiment)


def sopdt(
    K: Any = (0.5, 2.0),
    T1: Any = (10.0, 40.0),
    T2: Any = (2.0, 10.0),
    L: Any = (3.0, 15.0),
    tau_c: float | None = None,
    experiment: Given = Experiment(),
) -> Plant:
    """Second order plus dead time, ``K e^{-L s}/((T1 s + 1)(T2 s + 1))``.

    Lags T1, T2 [s], and K, L [s], `tau_c` and `experiment` as for `fopdt`.
    """

    def design(theta: Array, hold: float) -> Array:
        gain, one, other, late = theta.T
        return simc(gain, *half_rule(one, other, late + hold), tau_c)

    prior = {"K": K, "T1": T1, "T2": T2, "L": L}
    return _process("sopdt", prior, _two_lags, design, tau_c, experiment)


def integrator(
    K: Any = (0.02, 0.1),
    L: Any = (2.0, 10.0),
    tau_c: float | None = None,
    experiment: Given = Experiment(),
) -> Plant:
    """Integrator plus dead time, ``K e^{-L s}/s``, K in output over input and second [1/s].

    L [s], `tau_c` and `experiment` are as for `fopdt`.
    """

    def design(theta: Array, hold: float) -> Array:
        gain, late = theta.T
        return simc(gain, np.full_like(gain, np.inf), late + hold, tau_c)

    return _process("integrator", {"K": K, "L": L}, _integrator, design, tau_c, experiment, True)


def _process(
    name: str,
    given: dict[str, Any],
    matrices: Matrices,
    design: Callable[[Array, float], Array],
    tau_c: float | None,
    experiment: Given,
    integrating: bool = False,
) -> Plant:
    """A plant behind a dead time, its last parameter."""
    if tau_c is not None:
        validation.number("tau_c", tau_c, above=0.0, remedy="Give it in seconds.")
    prior = {of: spread(of, value) for of, value in given.items()}
    made = Experiment.of(experiment)
    loop = _Loop(_Late(matrices), made.Ts, made.signals, design)
    arguments = {of: plain(value) for of, value in prior.items()} | {"experiment": asdict(made)}
    return Plant(
        prior=prior,
        simulate=loop.simulate,
        design=loop.design,
        evaluate=loop.evaluate,
        loop=loop.around,
        gains=GAINS,
        metrics=METRICS,
        u=prbs(made.N, made.Ts, made.bit_time, made.amplitude)[0],
        Ts=made.Ts,
        noise=made.noise,
        linear=True,
        integrating=integrating,
        signals=made.signals,
        entry=f"yawrate_env.plants:{name}",
        arguments=arguments if tau_c is None else {**arguments, "tau_c": tau_c},
    )


@dataclass(frozen=True, slots=True)
class _Late:
    """Plants behind the dead time that is the last of their parameters, discretised."""

    matrices: Matrices

    def __call__(self, theta: Array, Ts: float) -> DiscretePlant:
        return zoh_late(*self.matrices(theta), Ts, theta[:, -1])


@dataclass(frozen=True, slots=True)
class _Loop:
    """Simulator, rule and metrics of a PI loop around sampled plants."""

    discrete: _Late
    Ts: float
    signals: tuple[str, str]
    rule: Callable[[Array, float], Array]

    def simulate(self, theta: Array, u: Array, rng: Any) -> Array:
        """Noise-free outputs (B, N) from rest."""
        return self._at(0.1 / self.Ts).simulate(theta, u, rng)

    def design(self, theta: Array) -> Array:
        """(kp, Ti) (B, 2); the controller's hold is half a sample of dead time."""
        return self.rule(theta, self.Ts / 2)

    def evaluate(self, theta: Array, gains: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Metrics (B, 3), and whether loops are stable (B,)."""
        found = self._at(0.1 / self.Ts).loops(theta).evaluate(*gains.T)
        of = found.margins
        return np.stack([of.phase_margin, of.gain_margin, of.crossover], axis=1), found.stable

    def around(self, theta: Array, gains: Array) -> ClosedLoop:
        """The loop of gains (2,) around one plant (p,), for reports to draw."""
        (metrics,), _ = self.evaluate(theta[None], gains[None])
        crossover = metrics[2] if np.isfinite(metrics[2]) else 0.1 / self.Ts
        return self._at(min(float(crossover), 0.45 / self.Ts)).around(theta, gains)

    def _at(self, crossover: float) -> PILoop:
        return PILoop(self.discrete, self.Ts, Target(crossover=crossover, Ts=self.Ts), self.signals)


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
