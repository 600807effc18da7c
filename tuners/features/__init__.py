"""First stage: an episode to a few numbers.

Each module is one way to do it: prediction-error models, least squares on an orthonormal
basis.  Features know input, output and sampling time; what they are used for does not belong
here.
"""

from dataclasses import asdict
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from yawrate_env import validation

Array = NDArray[np.float64]


class Features(Protocol):
    """First stage: episodes to a few features each; a frozen dataclass of its settings."""

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, n) of inputs (1 or B, N) and outputs (B, N), and where they are usable."""


FEATURES: dict[str, Any] = {
    "armax": Armax,
    "laguerre": Laguerre,
    "regularised": Regularised,
    "response": FrequencyResponse,
}
"""First stages by the name that files and commands know."""

BY_NAME = "laguerre", "armax", "response"
"""Those that need no settings: what commands and agents choose from."""


def features_named(name: str, **settings: Any) -> Features:
    """A first stage by name, or ``ValueError``."""
    validation.one_of("features", name, tuple(FEATURES))
    try:
        found: Features = FEATURES[name](**settings)
    except TypeError as error:
        raise ValueError(f"features {name!r}: {error}.") from None
    return found


def check_features(stage: Any) -> None:
    """``ValueError`` for what is no first stage."""
    remedy = "Give an Armax, a Laguerre, a Regularised or a FrequencyResponse."
    if type(stage) not in FEATURES.values():
        raise ValueError(f"features = {stage!r} is no first stage. {remedy}")


def settings_of(stage: Features) -> dict[str, Any]:
    """Name and settings: what `features_named` takes, as plain JSON values."""
    names = {kind: name for name, kind in FEATURES.items()}
    return {"name": names[type(stage)], **asdict(stage)}  # type: ignore[call-overload]
