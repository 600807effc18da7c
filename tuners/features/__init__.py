"""The first stages by name, as model files and commands know them."""

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

FirstStage = Armax | Laguerre | Regularised | FrequencyResponse

COMPRESSORS: dict[str, type[FirstStage]] = {
    "armax": Armax,
    "laguerre": Laguerre,
    "regularised": Regularised,
    "response": FrequencyResponse,
}

BY_NAME = "laguerre", "armax", "response"
"""Those that need no settings: what commands and agents choose from."""


class Compressor(Protocol):
    """First stage: episodes to a few features each."""

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, n) and where they are usable."""


def compressor(name: str, **settings: Any) -> FirstStage:
    """A first stage by name, or ``ValueError``."""
    validation.one_of("compressor", name, tuple(COMPRESSORS))
    try:
        return COMPRESSORS[name](**settings)
    except TypeError as error:
        raise ValueError(f"compressor {name!r}: {error}.") from None


def check(stage: Any) -> None:
    """``ValueError`` for what is no first stage."""
    if not isinstance(stage, FirstStage):
        raise ValueError(
            f"compressor = {stage!r} is no first stage. Give an Armax, a Laguerre, a "
            "Regularised or a FrequencyResponse."
        )


def described(stage: FirstStage) -> dict[str, Any]:
    """Name and settings: what `compressor` takes, as plain JSON values."""
    names = {kind: name for name, kind in COMPRESSORS.items()}
    return {"name": names[type(stage)], **asdict(stage)}
