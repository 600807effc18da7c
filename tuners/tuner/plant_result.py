"""What `PlantTuner.tune` answers: gains, what the recording says of them, and whether to trust."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.tuner.result import Check, Interval
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PlantFit:
    """The plant that explains a recording best, and what it leaves over.

    Attributes
    ----------
    parameters : dict
        Its parameters, those that are measured as given.
    deviations : dict
        Standard deviations of those that were found.
    u, measured, simulated : NDArray
        (N,) input, measured and simulated output; the simulated one has the offset and the
        response to the start in it.
    Ts : float
        Sampling time of these [s].
    offset : float
        Constant part of the output that the input does not explain.
    from_rest : bool
        Whether offset and start were found negligible, or taken to be, and left out.
    snr_db : float
        Mean square of the simulated output over that of the residual [dB].
    """

    parameters: dict[str, float]
    deviations: dict[str, float]
    u: Array
    measured: Array
    simulated: Array
    Ts: float
    offset: float
    from_rest: bool
    snr_db: float

    @classmethod
    def of(cls, plant: Plant, found: Assessment) -> "PlantFit":
        """The first recording's."""
        fit, model, names = found.fit, found.model, tuple(plant.prior)
        simulated, residual = fit.simulated[0], fit.residual[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            snr_db = float(10 * np.log10(simulated.var() / np.mean(residual**2)))
            deviations = plant.width * np.sqrt(np.diag(fit.covariance[0]))
        found_names = (names[i] for i in plant.unknown)
        return cls(
            parameters=dict(zip(names, map(float, fit.theta[0]), strict=True)),
            deviations=dict(zip(found_names, map(float, deviations), strict=True)),
            u=model.u[0],
            measured=simulated + residual,
            simulated=simulated,
            Ts=model.Ts,
            offset=float(model.offset[0]),
            from_rest=not model.unknown[0],
            snr_db=snr_db,
        )

    @property
    def residual(self) -> Array:
        """Measured minus simulated output (N,)."""
        return self.measured - self.simulated


@dataclass(frozen=True, slots=True, eq=False)
class PlantResult:
    """Gains for one recording.

    Attributes
    ----------
    gains : dict
        By name; ``nan`` where the tuner finds none.
    metrics : dict
        What the recording says that these gains give, with 90 % intervals.
    trusted : bool
        Whether every check passed.
    reasons, notes : tuple of str
        Why not; and what differs from the experiment that the tuner was trained on.
    fallback : dict
        Gains for every plant of the prior: what to use instead of those not trusted.
    checks : tuple of Check
        What was looked at.
    fit : PlantFit
        The plant that explains the recording best, beside it.
    plant : Plant
        What the tuner was trained for.
    """

    gains: dict[str, float]
    metrics: dict[str, Interval]
    trusted: bool
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    fallback: dict[str, float]
    checks: tuple[Check, ...] = field(repr=False)
    fit: PlantFit = field(repr=False)
    plant: Plant = field(repr=False)

    @property
    def parameters(self) -> dict[str, float]:
        """Of the plant that explains the recording best."""
        return self.fit.parameters

    @property
    def simulated(self) -> Array:
        """(N,) that plant's output."""
        return self.fit.simulated
