"""Settings of a loop's metrics: their scale in the reward, and the limits of trust."""

from dataclasses import dataclass
from numbers import Real

import numpy as np

from yawrate_env import validation

_SHARES = {"error": 0.2, "spread": 0.1, "widest": 1.0}  # of the scale, by default


@dataclass(frozen=True, slots=True)
class Metric:
    """Settings of one metric, all in its own unit.

    Attributes
    ----------
    scale : float
        The error that counts as one in the reward; ``inf`` for a metric that is only reported.
    error : float
        Largest predicted distance from the target that needs no care, a fifth of the scale if
        omitted; twice as much is a miss.
    spread : float
        Largest standard deviation of the prediction that needs no care: a larger one hides a
        miss.  A tenth of the scale if omitted.
    widest : float
        Half width of the 90 % interval beyond which gains are refused; the scale if omitted.
    """

    scale: float
    error: float = np.nan
    spread: float = np.nan
    widest: float = np.nan

    def __post_init__(self) -> None:
        remedy = "Give the error that counts."
        if self.scale == np.inf:
            scale = self.scale
        else:
            scale = validation.number("scale", self.scale, above=0.0, remedy=remedy)
        for name, share in _SHARES.items():
            value = getattr(self, name)
            if isinstance(value, Real) and np.isnan(float(value)):
                object.__setattr__(self, name, share * scale)
            else:
                validation.number(name, value, above=0.0, remedy=remedy)

    @property
    def counts(self) -> bool:
        """Whether it counts in the reward."""
        return bool(np.isfinite(self.scale))
