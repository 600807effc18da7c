"""What a figure's error is worth, and how much of it is trusted."""

from dataclasses import dataclass
from numbers import Real

import numpy as np

from yawrate_env import validation

_ERROR, _SPREAD = 0.2, 0.1  # of the scale: what is trusted if nothing else is said


@dataclass(frozen=True, slots=True)
class Figure:
    """How one of the figures counts by which gains are judged, all in its own unit.

    Attributes
    ----------
    scale : float
        The error that counts as one in the reward.
    error : float
        Largest predicted distance from what the design rule reaches that is still trusted;
        a fifth of the scale if not given.
    spread : float
        Largest standard deviation of the prediction that is; a tenth if not given.
    """

    scale: float
    error: float = np.nan
    spread: float = np.nan

    def __post_init__(self) -> None:
        remedy = "Give the error that counts."
        scale = validation.number("scale", self.scale, above=0.0, remedy=remedy)
        for name, share in (("error", _ERROR), ("spread", _SPREAD)):
            value = getattr(self, name)
            if isinstance(value, Real) and np.isnan(float(value)):
                object.__setattr__(self, name, share * scale)
            else:
                validation.number(name, value, above=0.0, remedy=remedy)
