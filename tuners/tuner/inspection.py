"""Inspection of recordings: models of them, and whether they are usable."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.trust.basis import functions_for, left_over
from tuners.trust.black_box import BlackBox, black_box
from tuners.trust.feedback import opened, projected_on
from tuners.trust.findings import Findings
from tuners.trust.fit import fit
from tuners.trust.response import Response
from tuners.trust.verdict import Finding
from tuners.tuner.look import Look
from tuners.tuner.method import Gains, Method, Rung
from tuners.tuner.recording import Recording
from tuners.tuner.sampling import check_sampling
from yawrate_env import validation
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_STILL = 1e-9  # of the experiment's largest input or output: smaller variations are none
_CLOSER = 0.8  # times the residual, which chance does not make another level of the input


class Inspection:
    """Inspects recordings of one plant for a method.

    Parameters
    ----------
    plant : Plant
        The plant.
    method : Method
        Finds gains of its own.
    """

    def __init__(self, plant: Plant, method: Method) -> None:
        self.plant, self.method = plant, method

    @property
    def alone(self) -> bool:
        """Whether only recordings are asked, and not what the plant's simulator makes of them."""
        return self.method.rungs == (Rung.BLACK_BOX,)

    def gains(self, recording: Recording) -> Gains:
        """The method's gains for every episode; none without excitation, where it needs that."""
        held = recording.resampled(recording.Ts)
        return self._excited(held, self.method.gains(self.plant, held))

    def look(self, recording: Recording, start: str = "auto") -> Look:
        """Models of every episode, and the method's own gains."""
        plant, method = self.plant, self.method
        remedy = "Make one with Recording.of(plant, u, y, Ts)."
        validation.instance("recording", recording, Recording, remedy=remedy)
        validation.count("number of episodes", len(recording), remedy="Give one or more.")
        check_sampling(plant, recording)
        theta = recording.parameters(plant, needed=not self.alone)
        if recording.reference is not None and start == "auto":
            start = "unknown"  # what went before is in the loop; coloured noise hides it from tests
        used = self._opened(recording, theta, start)
        model = black_box(plant, self.black_box, used.u, used.y, start, used.oversampled)
        if start == "auto" and recording.reference is None:
            used, model = self._in_balance(used, model)
        own = self.gains(replace(used, y=plant.unstacked(model.y)))
        still = self._still(used) if method.needs_excitation else np.zeros(len(used), np.bool_)
        fitted = fit(plant, model, used.y, theta)
        target = plant.loop_target
        response = None if target is None else Response.of(model, target)
        return Look(recording, used, theta, model, own, still, fitted, response)

    def response(self, recording: Recording, start: str = "auto") -> Response:
        """What recordings alone show of the plant around the target's crossover.

        ``ValueError`` where the plant's target is no phase margin and crossover of a PI.
        """
        plant, target = self.plant, self.plant.loop_target
        if target is None:
            raise ValueError("plant.parametrisation: this plant's target is no loop of a PI.")
        used = self._opened(recording, recording.parameters(plant, needed=False), start)
        return Response.of(
            black_box(plant, self.black_box, used.u, used.y, start, used.oversampled), target
        )

    def looped(self, recording: Recording) -> dict[str, Finding]:
        """Whether inputs follow outputs, as in a loop that nobody named."""
        given = recording.u, recording.y, recording.Ts, recording.reference
        return Findings(self.plant, None).of_feedback(self.black_box, *given)

    def known(self, theta: Array) -> NDArray[np.bool_]:
        """Which recordings (B,) have measured parameters that the tuner was made for."""
        plant, within = self.plant, np.ones(len(theta), dtype=np.bool_)
        low, high = plant.limits if self.method.any_measured else plant.ranges
        for name, slack in plant.measured.items():
            (i,) = plant.indices((name,))
            within &= (theta[:, i] >= low[i] - slack) & (theta[:, i] <= high[i] + slack)
        return np.asarray(within)

    @cached_property
    def black_box(self) -> Laguerre:
        """Laguerre basis of the reference model."""
        return functions_for(self.plant.emulated())

    @cached_property
    def unexplained(self) -> float:
        """Share of the outputs that the reference model cannot explain, of a nonlinear plant."""
        return 0.0 if self.plant.linear else left_over(self.plant.emulated(), self.black_box)

    def _in_balance(self, used: Recording, model: BlackBox) -> tuple[Recording, BlackBox]:
        """Inputs about the level at which a process was at work before, and models of them.

        Where an input never passes zero, and rest there does not explain the start of a linear
        plant's recording, the input's first value and its middle are tried for that level.  It is
        taken where then at most a constant is needed beside the response, and that alone did not
        do.  Plants with a target of margin and crossover settle soon: free responses do there.
        """
        plant, given = self.plant, used.u
        slow = plant.linear and not plant.integrating and plant.loop_target is None
        if not slow or plant.rows > 2:
            return used, model
        u = np.broadcast_to(given, (len(used), *given.shape[1:])).copy()
        least = np.where(model.extra > 1, np.inf, _CLOSER * model.residual)
        flat = given.reshape(len(given), -1)
        passes = (flat.min(axis=1) <= 0) & (flat.max(axis=1) >= 0)
        least[(model.extra == 0) | passes] = 0.0
        middle = (given.max(axis=-1, keepdims=True) + given.min(axis=-1, keepdims=True)) / 2
        for level in (given[..., :1], middle):
            about = np.broadcast_to(given - level, u.shape)
            rows = np.flatnonzero(least > 0)
            if not len(rows):
                continue
            y, oversampled = used.y[rows], used.oversampled
            found = black_box(plant, self.black_box, about[rows], y, "auto", oversampled)
            taken = (found.extra <= 1) & (found.residual < least[rows])
            rows = rows[taken]
            u[rows], least[rows] = about[rows], found.residual[taken]
        if (u == given).all():
            return used, model
        used = replace(used, u=u)
        return used, black_box(plant, self.black_box, u, used.y, "auto", used.oversampled)

    def _opened(self, recording: Recording, theta: Array, start: str) -> Recording:
        """Recordings at the plant's sampling time, those in a loop as if there were none."""
        plant, used = self.plant, recording.resampled(self.plant.Ts)
        if recording.reference is None:
            return used
        if not plant.linear:
            raise ValueError(
                "reference: the responses of this plant do not add up, and no part of its input "
                "can stand for the whole. Describe the loop as the experiment, with in_loop=True."
            )
        inputs = np.broadcast_to(recording.u, recording.y.shape)
        explained = projected_on(recording.reference, inputs, recording.Ts, self.black_box)
        u = replace(recording, u=explained).resampled(plant.Ts).u
        y = opened(plant, self.black_box, u, used.u, used.y, theta, start, used.oversampled)
        return replace(used, u=u, y=y, reference=None)

    def _excited(self, recording: Recording, found: Gains) -> Gains:
        """Discard gains from recordings without excitation, for methods that need it."""
        return found.without(self._still(recording)) if self.method.needs_excitation else found

    def _still(self, recording: Recording) -> NDArray[np.bool_]:
        """Which recordings (B,) have a constant input or output, of several any.

        A constant input is a step from rest if the experiment holds one as long.
        """
        input, output, held = self._scales
        step = recording.y.shape[-1] * recording.Ts <= held * (1 + 1e-9)
        u = np.abs(recording.u).max(axis=-1) if step else np.ptp(recording.u, axis=-1)
        still = u <= _STILL * input, np.ptp(recording.y, axis=-1) <= _STILL * output
        one, other = (s if s.ndim == 1 else s.any(axis=1) for s in still)
        return np.asarray(one | other)

    @cached_property
    def _scales(self) -> tuple[Array, Array, float]:
        """Largest inputs and outputs of the experiment, and how long it holds an input [s]."""
        u = self.plant.u
        held = (np.flatnonzero(np.diff(row, prepend=np.nan, append=np.nan))
                for row in np.atleast_2d(u))  # fmt: skip
        longest = max(np.diff(turns).max(initial=1) for turns in held) * self.plant.Ts
        y = self.plant.emulated().respond(self.plant.middle)[0]
        return np.abs(u).max(axis=-1), np.ptp(y, axis=-1), longest
