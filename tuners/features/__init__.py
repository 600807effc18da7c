"""First stage: a few features of each recording.

Each module is one kind: prediction-error models, or least squares on an orthonormal basis.
Features depend on input, output and sampling time; plants and learners do not belong here.
"""

import json
from dataclasses import asdict, is_dataclass
from typing import Any, ClassVar, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from tuners.features.armax import Armax
from tuners.features.integrated import Integrated
from tuners.features.laguerre import Laguerre
from tuners.features.principal import PrincipalResponse
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from yawrate_env import validation
from yawrate_env.plant import entry

Array = NDArray[np.float64]


class Features(Protocol):
    """A first stage: a frozen dataclass of its settings that maps recordings to features."""

    any_experiment: ClassVar[bool]
    """Whether features depend neither on the input nor on the sampling time."""

    @property
    def width(self) -> int:
        """Number of features."""

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, n) of inputs (1 or B, N) and outputs (B, N), and where they are usable."""


FEATURES: dict[str, Any] = {
    "armax": Armax,
    "laguerre": Laguerre,
    "integrated": Integrated,
    "regularised": Regularised,
    "response": FrequencyResponse,
    "principal": PrincipalResponse,
}
"""First stages by the name that files and commands know."""

BY_NAME = "laguerre", "armax", "response"
"""Those that need no settings: what commands and agents choose from."""


def with_measured(
    stage: Features, u: Array, y: Array, Ts: float, measured: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Features of recordings followed by those of the measured parameters, (B, n + m).

    Parameters
    ----------
    u : (1, N) or (B, N) float64
        Inputs.
    y : (B, N) float64
        Measured outputs.
    Ts : float
        Sampling time [s].
    measured : (B, m) float64
        Features of measured parameters.

    Returns
    -------
    (B, n + m) float64
    (B,) bool
        Where the first stage succeeded.
    """
    _check_channels(stage, u)
    values, usable = stage(u, y, Ts)
    return np.concatenate([values, measured], axis=1), usable


def features_named(name: str, **settings: Any) -> Features:
    """A first stage by name, or by ``module:attribute`` of its class.

    ``ValueError`` for unknown names and settings.
    """
    kind = entry.attribute(name) if ":" in name else None
    if kind is None:
        kind = FEATURES[validation.one_of("features", name, tuple(FEATURES))]
    try:
        found: Features = kind(**settings)
    except TypeError as error:
        raise ValueError(f"features {name!r}: {error}.") from None
    return found


def check_features(stage: Any) -> None:
    """``ValueError`` unless `stage` is a first stage that a file can name."""
    if type(stage) in FEATURES.values():
        return
    remedy = (
        "Give one of " + ", ".join(kind.__name__ for kind in FEATURES.values()) + ", or a "
        "dataclass of your own that takes (u, y, Ts) (docs/plants.md)."
    )
    if not is_dataclass(stage) or isinstance(stage, type) or not callable(stage):
        raise ValueError(f"features = {stage!r} is no first stage. {remedy}")
    if not isinstance(getattr(stage, "any_experiment", None), bool):
        raise ValueError(
            f"features = {stage!r} does not say whether it depends on the experiment. Give its "
            "class any_experiment: ClassVar[bool] = False."
        )
    try:
        json.dumps(settings_of(cast(Features, stage)))
    except TypeError as error:
        raise ValueError(f"features = {stage!r}: {error}. Its settings must be plain.") from None


def rehearse(stage: Features, u: Array, y: Array, Ts: float) -> int:
    """How many features a first stage gives; ``ValueError`` where it does not work.

    Parameters
    ----------
    u : (1, N) float64
        The experiment's input.
    y : (B, N) float64
        Outputs.
    """
    _check_channels(stage, u)
    try:
        with np.errstate(all="ignore"):
            values, usable = stage(u, y, Ts)
    except Exception as error:
        why = " ".join(str(error).split()).removesuffix(".")
        raise ValueError(
            f"features = {stage!r} fails on the experiment: {type(error).__name__}: {why}."
        ) from error
    if np.ndim(values) != 2 or len(values) != len(y) or np.shape(usable) != (len(y),):
        raise ValueError(
            f"features = {stage!r} gives shapes {np.shape(values)} and {np.shape(usable)} for "
            f"{len(y)} recordings. Give features (B, n), and where they are usable (B,)."
        )
    return int(np.shape(values)[1])


def _check_channels(stage: Features, u: Array) -> None:
    """``ValueError`` where a stage of one input and output, its ``one_pair``, meets several."""
    if u.ndim == 3 and getattr(stage, "one_pair", False):
        raise ValueError(
            f"features = {type(stage).__name__} are of one input and one output, and this plant "
            "has channels. Take Laguerre, or a first stage of your own."
        )


def known_name(stage: Any) -> str:
    """Name of one of `FEATURES`; empty for others."""
    return {kind: name for name, kind in FEATURES.items()}.get(type(stage), "")


def settings_of(stage: Features) -> dict[str, Any]:
    """Name and settings: what `features_named` takes, as plain JSON values."""
    name = known_name(stage) or entry.of(type(stage), "features")
    return {"name": name, **asdict(stage)}  # type: ignore[call-overload]
