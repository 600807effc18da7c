"""The answer of `Tuner.tune`: gains, what the recording says of them, whether to trust them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.trust.intervals import Interval
from tuners.trust.response import Response
from tuners.trust.verdict import Check, Verdict, worst
from tuners.tuner.method import Rung
from tuners.tuner.pooling.share import Share, Validation
from yawrate_env.loop.design import Status
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import ClosedLoop, OpenLoop

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FittedPlant:
    """The plant fitted to a recording, and its residual.

    Attributes
    ----------
    parameters : dict
        Its parameters, measured ones as given.
    deviations : dict
        Standard deviations of the estimated ones.
    u, measured, simulated : NDArray
        (N,) input, measured and simulated output, or (m, N) and (q, N); the simulated one has the
        offset and the response to the initial state in it.
    Ts : float
        Sampling time of these [s].
    offset : float
        Constant part of the output that the input does not explain; of several outputs the largest.
    initial : float
        Root mean square of the response to the initial state.
    from_rest : bool
        Whether offset and initial state were found negligible, or taken to be, and left out.
    snr_db : float
        Variance of the simulated output over the mean square of the residual [dB].
    """

    parameters: dict[str, float]
    deviations: dict[str, float]
    u: Array
    measured: Array
    simulated: Array
    Ts: float
    offset: float
    initial: float
    from_rest: bool
    snr_db: float

    @classmethod
    def of(cls, plant: Plant, found: Assessment, i: int = 0, alone: bool = False) -> "FittedPlant":
        """One recording's; output and residual are the black box's where it is asked alone."""
        fit, model, names = found.fit, found.model, tuple(plant.prior)
        simulated, residual = fit.simulated[i], fit.residual[i]
        if alone and found.response is not None:
            measured = simulated + residual
            simulated = found.response.output[i] + model.free[i]
            residual = measured - simulated
        with np.errstate(divide="ignore", invalid="ignore"):
            snr_db = float(10 * np.log10(simulated.var() / np.mean(residual**2)))
            deviations = plant.width * np.sqrt(np.diag(fit.covariance[i]))
        unknown = (names[i] for i in plant.unknown)
        return cls(
            parameters=dict(zip(names, map(float, fit.theta[i]), strict=True)),
            deviations=dict(zip(unknown, map(float, deviations), strict=True)),
            u=model.u[i % len(model.u)],
            measured=plant.unstacked((simulated + residual)[None])[0],
            simulated=plant.unstacked(simulated[None])[0],
            Ts=model.Ts,
            offset=float(model.offset[i]),
            initial=_initial(plant, found, i),
            from_rest=not model.unknown[i],
            snr_db=snr_db,
        )

    @property
    def residual(self) -> Array:
        """Measured minus simulated output (N,)."""
        return self.measured - self.simulated


def _initial(plant: Plant, found: Assessment, i: int) -> float:
    """Root mean square of the response to the initial state, of several outputs the largest."""
    free, offset = plant.unstacked(found.model.free[[i]])[0], found.model.offset[i]
    if free.ndim == 2:
        offset = free.mean(axis=1, keepdims=True)
    return float(np.sqrt(np.mean((free - offset) ** 2, axis=-1)).max())


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Gains for one recording.

    Gains and metrics are attributes too, by their names without units: ``result.kp``,
    ``result.phase_margin.low``.

    Attributes
    ----------
    gains : dict
        By name; ``nan`` where the tuner finds none.
    intervals : dict
        By the metric's name: its prediction for these gains with the 90 % interval, as far as the
        recording itself tells; ``nan`` where there is none.
    exact_intervals : dict
        The same, narrower, if the plant's data are exact.
    status : Status
        Whether the design target is reached.
    converged : bool
        Whether the tuner's own numerics succeeded.
    verdict : Verdict
        Whether the gains are usable, usable with care, or refused.
    rung : Rung
        Whose gains they are: the method's, the fitted plant's or the black box's.
    left : tuple of str
        Why gains of a higher rung were left: what the recording asks to change.
    reasons, notes : tuple of str
        Why the verdict is no better; and what differs from the experiment that the tuner was
        made for.
    fallback : dict
        Gains that are stable for every plant of the prior: what to use instead of gains that
        are refused; ``nan`` where there are none.
    checks : tuple of Check
        All checks, in the order in which they are reported.
    fit : FittedPlant
        The plant fitted to the recording, and the recording itself; its output and residual are
        the black box's where that answers.
    open_loop : OpenLoop, optional
        The loop of the gains around the recording's own response, where that answers.
    response : Response, optional
        What the recording itself shows of the plant, where metrics are a PI loop's.
    plant : Plant
        What the tuner was made for.
    gain_intervals, exact_gain_intervals : dict
        By the gain's name: the gain with a 90 % interval by the delta method, as far as the
        recording itself tells, and if the plant's data are exact.
    logs : tuple of Share
        What each of several recordings adds, and how far it agrees; empty for a single one.
    validation : Validation, optional
        A further recording held against the answer.
    """

    gains: Mapping[str, float]
    intervals: Mapping[str, Interval]
    exact_intervals: Mapping[str, Interval]
    status: Status
    converged: bool
    verdict: Verdict
    rung: Rung
    left: tuple[str, ...]
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    fallback: Mapping[str, float]
    checks: tuple[Check, ...] = field(repr=False)
    fit: FittedPlant = field(repr=False)
    open_loop: OpenLoop | None = field(repr=False)
    response: Response | None = field(repr=False)
    plant: Plant = field(repr=False)
    gain_intervals: Mapping[str, Interval] = field(default_factory=dict, repr=False)
    exact_gain_intervals: Mapping[str, Interval] = field(default_factory=dict, repr=False)
    logs: tuple[Share, ...] = field(default=(), repr=False)
    validation: Validation | None = field(default=None, repr=False)

    @property
    def trusted(self) -> bool:
        """Whether the gains are usable, with care or without."""
        return self.verdict is not Verdict.REFUSE

    @property
    def loop(self) -> ClosedLoop | None:
        """The loop of the gains around the plant that answers; None where nothing can be drawn."""
        if self.rung >= Rung.BLACK_BOX:
            return None if self.open_loop is None else ClosedLoop(open=self.open_loop)
        theta, gains = (np.array(list(v.values())) for v in (self.fit.parameters, self.gains))
        return self.plant.closed_loop(theta, gains)

    def after(self, before: "Result") -> "Result":
        """The same, no more certain than an earlier answer for the same recording."""
        return replace(
            self,
            verdict=worst([before.verdict, self.verdict]),
            left=(*before.left, *(why for why in self.left if why not in before.left)),
            reasons=(*before.reasons, *(r for r in self.reasons if r not in before.reasons)),
        )

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # copying and pickling ask before there are any gains
            raise AttributeError(name)
        if name in self.gains:
            return self.gains[name]
        for metric, interval in self.intervals.items():
            if name == split(metric)[0]:
                return interval
        raise AttributeError(f"a result has no {name!r}; gains: {', '.join(self.gains)}.")
