"""The interface between a `Tuner` and the method that finds its gains."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.recording import Recording
from yawrate_env.loop.design import Status
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """Gains for B recordings.

    Attributes
    ----------
    values : NDArray
        (B, k) gains; ``nan`` where there are none.
    status : NDArray
        (B,) of `Status`: how far the target can be reached.
    converged : NDArray
        (B,) whether the method's own numerics succeeded.
    """

    values: Array
    status: NDArray[np.int64]
    converged: NDArray[np.bool_]

    @classmethod
    def of(cls, values: Array, reached: NDArray[np.bool_], converged: NDArray[np.bool_]) -> Self:
        """Gains (B, k), and whether they reach the target (B,)."""
        found = np.asarray(np.isfinite(values).all(axis=1))
        status = np.where(reached, int(Status.OK), int(Status.PHASE_LIMITED))
        status = np.where(found, status, int(Status.UNREACHABLE))
        return cls(np.where(found[:, None], values, np.nan), status, converged)

    def replaced(self, rows: NDArray[np.bool_], other: "Gains") -> "Gains":
        """Gains with those of some recordings (B,) taken from others."""
        return Gains(
            np.where(rows[:, None], other.values, self.values),
            np.where(rows, other.status, self.status),
            np.where(rows, other.converged, self.converged),
        )

    def without(self, rows: NDArray[np.bool_]) -> "Gains":
        """Gains with those of some recordings (B,) removed."""
        return Gains(
            np.where(rows[:, None], np.nan, self.values),
            np.where(rows, int(Status.UNREACHABLE), self.status),
            self.converged & ~rows,
        )


class Rung(IntEnum):
    """Whose gains answer a recording (`tuners.tuner.ladder`)."""

    METHOD = 0
    FITTED_PLANT = 1
    BLACK_BOX = 2
    NONE = 3


class Method(Protocol):
    """Finds gains: the two stages, or a reference method."""

    kind: ClassVar[str]
    """Its name in tuner files."""

    needs_excitation: ClassVar[bool]
    """Whether its gains mean nothing where the input or the output is constant."""

    any_measured: ClassVar[bool]
    """Whether measured parameters may have values outside the prior."""

    rungs: ClassVar[tuple[Rung, ...]]
    """Whose gains may answer in place of its own: all for what is learned, none for a rival."""

    @property
    def any_experiment(self) -> bool:
        """Whether the recording may have another input and sampling time than the plant's."""

    def gains(self, plant: Plant, recording: Recording) -> Gains:
        """Gains for every episode."""

    def settings(self) -> dict[str, Any]:
        """Settings to save, as plain JSON values."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Learned arrays to save."""

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> "Method":
        """Rebuild from saved `settings` and `arrays`."""
