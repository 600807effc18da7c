"""What studies compare beside tuners by name: a learner without its ladder, and the ladder."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners import Tuner, load
from tuners.trust.checks import Assessment
from tuners.tuner.ladder import Climb
from tuners.tuner.method import Rung
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Stages

LADDER = "ladder"
"""Its name in tables and figures."""

CLIMBER = "ts-ff-lag"
"""The learner that the ladder starts from."""


class Alone(Stages):
    """Both stages, whose gains nothing replaces."""

    rungs = (Rung.METHOD,)


def alone(tuner: Tuner) -> Tuner:
    """The same tuner without its ladder: its method's own gains, checked as they are."""
    method = tuner.method
    if not isinstance(method, Stages):
        return tuner
    own: Any = Alone(method.features, method.learner, method.parametrisation)
    return Tuner(tuner.plant, own, tuner.training, tuner.calibration, tuner.exact_calibration)


class Remembering(Tuner):
    """The same tuner, which climbs once for a recording that it is asked about again."""

    def __init__(self, tuner: Tuner) -> None:
        super().__init__(
            tuner.plant, tuner.method, tuner.training, tuner.calibration, tuner.exact_calibration
        )
        self._asked: tuple[Recording, str] | None = None

    def climb(self, recording: Recording, start: str = "auto") -> tuple[Climb, Assessment]:
        """Gains, whose they are, and their assessment."""
        asked = self._asked
        if asked is None or asked[0] is not recording or asked[1] != start:
            self._last = super().climb(recording, start)
            self._asked = recording, start
        return self._last


def named(name: str) -> Tuner:
    """A tuner as rows of tables have it: a learner alone, or the whole `LADDER`."""
    return load(CLIMBER) if name == LADDER else alone(load(name))


@dataclass(frozen=True, slots=True, eq=False)
class Ladder:
    """A policy that climbs, where `Tuner.act` gives the method's own gains."""

    tuner: Tuner

    @property
    def training(self) -> dict[str, Any]:
        """Of its learner."""
        return self.tuner.training

    def act(self, recording: Recording) -> NDArray[np.float64]:
        """Gains (B, k), with the fallback where there are none."""
        values = self.tuner.assess(recording)[0].values
        found = np.isfinite(values).all(axis=1, keepdims=True)
        return np.where(found, values, self.tuner.fallback)
