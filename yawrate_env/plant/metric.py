"""Settings of a loop's metrics: their scale in the reward, and the limits of trust."""

from dataclasses import dataclass
from numbers import Real

import numpy as np

from yawrate_env import validation

_ERROR, _SPREAD = 0.2, 0.1  # of the scale: trusted by default


@dataclass(frozen=True, slots=True)
class Metric:
    """Settings of one metric, all in its own unit.

    Attributes
    ----------
    scale : float
        The error that counts as one in the reward; ``inf`` for a metric that is only reported.
    error : float
        Largest predicted distance from the target that is still trusted; a fifth of the scale
        if omitted.
    spread : float
        Largest standard deviation of the prediction that is trusted; a tenth if omitted.
    """

    scale: float
    error: float = np.nan
    spread: float = np.nan

    def __post_init__(self) -> None:
        remedy = "Give the error that counts."
        if self.scale == np.inf:
            scale = self.scale
        else:
            scale = validation.number("scale", self.scale, above=0.0, remedy=remedy)
        for name, share in (("error", _ERROR), ("spread", _SPREAD)):
            value = getattr(self, name)
            if isinstance(value, Real) and np.isnan(float(value)):
                object.__setattr__(self, name, share * scale)
            else:
                validation.number(name, value, above=0.0, remedy=remedy)

    @property
    def counts(self) -> bool:
        """Whether it counts in the reward."""
        return bool(np.isfinite(self.scale))
