"""Reference tuners: gray box, black box, the oracle and the fixed nominal controller."""

from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tuners.trust.basis import functions_for
from tuners.trust.black_box import black_box
from tuners.trust.fit import search
from tuners.trust.response import Response
from tuners.tuner.method import Gains, Rung
from tuners.tuner.recording import Recording
from yawrate_env.loop.target import Target
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]


class Untrained:
    """A method without anything learned."""

    any_experiment = True
    any_measured: ClassVar[bool] = False
    rungs: ClassVar[tuple[Rung, ...]] = (Rung.METHOD,)

    def settings(self) -> dict[str, Any]:
        """Nothing to save."""
        return {}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Nothing to save."""
        return {}

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """A new one; nothing was saved."""
        return cls()


class GrayBox(Untrained):
    """Identify the plant from the recording, then apply the design rule."""

    kind: ClassVar[str] = "gray-box"
    needs_excitation: ClassVar[bool] = True
    any_measured: ClassVar[bool] = True

    def gains(self, plant: Plant, recording: Recording) -> Gains:
        """Design for the identified plants."""
        start = recording.parameters(plant)
        found = search(plant, recording.u, recording.y, start)
        return Gains.of(*plant.designs(found.theta), found.converged)


class Fitted(GrayBox):
    """The gray box where the recording supports it, else what the recording shows itself."""

    kind: ClassVar[str] = "fitted"
    rungs: ClassVar[tuple[Rung, ...]] = (Rung.FITTED_PLANT, Rung.BLACK_BOX)


class BlackBoxRule(Untrained):
    """Apply the design rule to the response that the recording shows (`tuners.trust.response`).

    It needs no simulator, no data of the plant and no measured parameter: only that the plant is
    linear, and a loop target.
    """

    kind: ClassVar[str] = "black-box"
    needs_excitation: ClassVar[bool] = True
    any_measured: ClassVar[bool] = True
    rungs: ClassVar[tuple[Rung, ...]] = (Rung.BLACK_BOX,)

    def gains(self, plant: Plant, recording: Recording) -> Gains:
        """Design for the recordings' own responses."""
        target = loop_target(plant)
        u, y, functions = recording.u, recording.y, functions_for(plant)
        model = black_box(plant, functions, u, y, "auto", recording.oversampled)
        found = Response.of(model, target)
        return Gains.of(found.gains, found.within_reach, np.ones(len(y), dtype=np.bool_))


def loop_target(plant: Plant) -> Target:
    """The plant's loop target, or ``ValueError`` where there is none."""
    if plant.loop_target is None:
        raise ValueError(
            "The plant has no loop target whose phase margin and crossover count, or is not "
            "linear. Give it parametrisation=loop(target) and linear=True, or use another tuner."
        )
    return plant.loop_target


class Oracle(Untrained):
    """Apply the design rule to the true plant, where the recording shows it."""

    kind: ClassVar[str] = "oracle"
    needs_excitation: ClassVar[bool] = False

    def gains(self, plant: Plant, recording: Recording) -> Gains:
        """Design for the true parameters."""
        known = recording.known
        if known is None or np.isnan(known).any():
            raise ValueError(
                "The oracle must see the plant's true parameters. Give a Recording that knows "
                'them, or use an environment that shows them, with visible="context".'
            )
        return Gains.of(*plant.designs(known), np.ones(len(recording), dtype=np.bool_))


class Nominal(Untrained):
    """Give the fixed gains of the plant in the middle of the prior."""

    kind: ClassVar[str] = "nominal"
    needs_excitation: ClassVar[bool] = False

    def gains(self, plant: Plant, recording: Recording) -> Gains:
        """The same gains for all."""
        one, reached = plant.designs(plant.middle)
        count = len(recording)
        everyone = np.ones(count, dtype=np.bool_)
        return Gains.of(np.repeat(one, count, axis=0), np.repeat(reached, count), everyone)
