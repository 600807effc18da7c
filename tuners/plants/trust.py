"""Whether gains can be trusted, judged by the recording beside the plant's own simulator.

The method of `tuners.trust` for any plant: the simulator is fitted to the recording, and
so is a black box.  Gains are trusted where the simulator leaves no more over than the
black box does, the parameters found are ones of the prior, and the figures that they
predict for the gains are on target and certain.  A nonlinear plant's simulator explains
more than the linear black box, which the comparison allows.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.laguerre import Laguerre
from tuners.plants.black_box import unexplained
from tuners.plants.identification import Identified, central, identify, identify_from_several
from tuners.plants.plant import Plant
from tuners.result import Check

Array = NDArray[np.float64]

_DOUBT = 3.0  # standard deviations that a finding must exceed to count
_STEP = 1e-3  # of a range: figures may come from a simulation's samples


@dataclass(frozen=True, slots=True)
class Limits:
    """Largest values that are still trusted.

    Attributes
    ----------
    noise : float
        Residual over simulated output, root mean squares.
    misfit : float
        Output that the input explains and the fitted plant does not, over the output,
        beyond what noise can do.
    outside : float
        Distance of the parameters from the prior, in widths of its ranges, beyond what
        noise can do.
    error, spread : float
        Of the predicted figures, in errors that count as one.
    unsolved : float
        Whether a number is missing or the search did not converge, as 1 or 0.
    """

    noise: float = 0.3
    misfit: float = 0.01
    outside: float = 0.1
    error: float = 0.2
    spread: float = 0.1
    unsolved: float = 0.0


MESSAGES = {
    "noise": "The output hardly follows the input: the sensor is dead, noisy or another's.",
    "misfit": "No plant that the simulator knows answers this input so: check units, signs, "
    "sampling time and what the plant starts from.",
    "outside": "The fitted plant lies outside the prior that the tuner was made for.",
    "error": "With the fitted plant these gains miss what the design rule reaches.",
    "spread": "The recording holds too little information: excite more strongly or for longer.",
    "unsolved": "There are no gains for this plant, or the numerics did not converge.",
}


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """What B recordings say of gains.

    Attributes
    ----------
    gray_box, fit : Identified
        The simulator beside the recordings: the prior's best plant, and the best of all.
    figures, spread : NDArray
        (B, f) figures of the gains with the fitted plants, and their standard deviations.
    findings : dict
        Name of a check to values (B,).
    """

    gray_box: Identified
    fit: Identified
    figures: Array
    spread: Array
    findings: dict[str, Array]

    def trusted(self, limits: Limits) -> NDArray[np.bool_]:
        """Where every finding is within its limit, (B,)."""
        within = [values <= getattr(limits, name) for name, values in self.findings.items()]
        return np.asarray(np.all(within, axis=0))

    def checks(self, index: int, limits: Limits) -> tuple[Check, ...]:
        """The checks of one recording, in words."""
        return tuple(
            Check(name, float(values[index]), getattr(limits, name), MESSAGES[name])
            for name, values in self.findings.items()
        )


def assess(plant: Plant, model: Laguerre, u: Array, y: Array, gains: Array) -> Assessment:
    """Ask recordings (N,), (B, N) about gains (B, k), with a black box for comparison."""
    gray_box = identify_from_several(plant, u, y)
    fit = identify(plant, u, y, gray_box.theta, beyond=True)
    scale = np.array(list(plant.figures.values()))
    tiled = np.tile(gains, (2 * len(plant.prior), 1))
    with np.errstate(all="ignore"):
        figures = plant.judged(fit.theta, gains)
        J = central(plant, fit.theta, lambda theta: plant.judged(theta, tiled), _STEP)
        width = np.subtract(*plant.ranges[::-1])
        covariance = fit.covariance / (width[:, None] * width)
        spread = np.sqrt(np.einsum("bij,bjk,bik->bi", J, covariance, J))
        noise = np.sqrt((fit.residual**2).mean(axis=1) / fit.simulated.var(axis=1))
        findings = {
            "noise": noise,
            "misfit": _misfit(plant, model, u, y, fit),
            "outside": _outside(plant, fit),
            "error": np.abs(plant.errors(fit.theta, gains)).max(axis=1),
            "spread": (spread / scale).max(axis=1),
            "unsolved": 1.0 - (fit.converged & np.isfinite(gains).all(axis=1)),
        }
    return Assessment(gray_box, fit, figures, spread, findings)


def _misfit(plant: Plant, model: Laguerre, u: Array, y: Array, fit: Identified) -> Array:
    """What the black box explains beyond the fitted plant, relative, less what noise can do."""
    freedom = max(model.order - len(plant.prior), 1)
    squares = (fit.residual**2).sum(axis=1)
    excess = squares - unexplained(model, u, y, plant.Ts)
    chance = squares / len(u) * (freedom + _DOUBT * np.sqrt(2 * freedom))
    return np.asarray(np.sqrt(np.maximum(excess - chance, 0) / (fit.simulated**2).sum(axis=1)))


def _outside(plant: Plant, fit: Identified) -> Array:
    """Distance from the prior in widths of its ranges, less three standard deviations."""
    low, high = plant.ranges
    slack = _DOUBT * np.sqrt(np.einsum("bii->bi", fit.covariance))
    beyond = np.maximum(np.maximum(low - fit.theta, fit.theta - high) - slack, 0)
    return np.asarray((beyond / (high - low)).max(axis=1))
