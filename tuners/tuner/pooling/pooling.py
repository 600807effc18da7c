"""One answer from several recordings of one plant.

One plant is fitted to all of them (`joint`), their black boxes are pooled (`coordinates`), and
the ladder and the checks go on as for one recording.  What a check finds in a single recording
counts with its worst one.  Every recording is compared with the others (`agreement`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.checks import Assessment, assess, metric_slopes
from tuners.trust.findings import MISS
from tuners.trust.fit import Fit
from tuners.trust.response import Response
from tuners.trust.verdict import Finding
from tuners.tuner.ladder import Climb, climb
from tuners.tuner.look import Look
from tuners.tuner.method import Gains, Method, Rung
from tuners.tuner.pooling.agreement import Estimates, against_others
from tuners.tuner.pooling.coordinates import Coordinates, carried, pooled
from tuners.tuner.pooling.joint import Joint, fitted_like, joint_fit
from tuners.tuner.pooling.pool import DISAGREE, Pool
from tuners.tuner.recording import Recording
from yawrate_env.loop.design import Status
from yawrate_env.plant.names import OF_METRICS, check_name
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FAR = "extrapolated"
"""Name of the check how far from the recordings the gains are wanted."""

_OF_ALL = ("limited", "unsolved", "undesigned", "outside", "parts")
_FAR = 0.1  # of a measured parameter's range: no farther from the recordings without care
_FAR_OFF = (
    "No recording comes near the operating point that the gains are for: there they rest on the "
    "plant's data. Record there."
)
_DIFFER = "The recordings do not show one plant."


@dataclass(frozen=True, slots=True)
class Pooling:
    """Pools the recordings of one tuner's plant.

    Attributes
    ----------
    plant, method
        The tuner's.
    sampled : callable
        Adds to an assessment of a recording the checks of how that was sampled.
    """

    plant: Plant
    method: Method
    sampled: Callable[[Recording, Assessment], Assessment]

    @property
    def alone(self) -> bool:
        """Whether only recordings are asked, and not what the plant's simulator makes of them."""
        return self.method.rungs == (Rung.BLACK_BOX,)

    def fit(self, looks: Sequence[Look]) -> Joint:
        """One plant fitted to all recordings of a set."""
        parts = [look.model for look in looks], [look.fit for look in looks]
        return joint_fit(self.plant, *parts, [look.used.y for look in looks])

    def pool(self, looks: Sequence[Look], joint: Joint, theta: Array, known: Flags) -> Pool:
        """Pool L recordings of each of B sets.

        Parameters
        ----------
        joint : Joint
            What `fit` gives for them.
        theta : (B, p) float64
            Measured parameters that the gains are for.
        known : (B,) bool
            Whether the tuner was made for these.
        """
        plant = self.plant
        fitted = joint.at(plant, theta)
        together = self.together(looks, theta)
        seen = self.coordinates(looks, joint.fits, fitted)
        responses = responses_of(looks)
        response = None if seen is None else pooled(responses, seen)
        own, rungs = self._own(looks, seen, joint, together)
        climbed = climb(plant, rungs, own, fitted, response, known)
        if not together:
            climbed = climbed.without(climbed.rung == Rung.BLACK_BOX)
        climbed = climbed.without(np.all([look.still for look in looks], axis=0))
        assessment = self._assessed(looks, joint, fitted, response, climbed, theta, together)
        kept = _Kept(self, looks, joint)
        chi_square, chance, apart = against_others(kept.estimates(), kept.without)
        estimates, fits = kept.estimates(), kept.fits
        compared = self.coordinates(looks, fits, _like(fits[0], plant, theta))
        shift = np.stack([
            self.shifted(i, among, estimates, compared, fitted, responses, climbed.gains.values)
            for i, among in enumerate(_others(apart))
        ])  # fmt: skip
        shares = joint.shares
        if seen is not None and (climbed.rung >= Rung.BLACK_BOX).all():
            shares = seen.shares
        error = plant.metric_setting("error")
        differs = np.where(apart, np.nan_to_num(np.abs(shift) / error, nan=np.inf).max(axis=2), 0)
        further = {
            DISAGREE: Finding(differs.max(axis=0), 1.0, MISS, _DIFFER),
            FAR: Finding(self.far(looks, theta), _FAR, np.inf, _FAR_OFF),
        }
        return Pool(
            climbed, assessment.followed_by(further), joint, theta, shares,
            chi_square, chance, estimates.freedom, apart, shift,
        )  # fmt: skip

    def far(self, looks: Sequence[Look], theta: Array) -> Array:
        """Distance (B,) of measured parameters from the recordings', in widths of their ranges."""
        plant, most = self.plant, np.zeros(len(theta))
        low, high = plant.ranges
        for i in plant.indices(plant.measured_names):
            taken = np.stack([look.theta[:, i] for look in looks])
            beyond = np.maximum(taken.min(axis=0) - theta[:, i], theta[:, i] - taken.max(axis=0))
            most = np.maximum(most, beyond / (high[i] - low[i]))
        return most

    def together(self, looks: Sequence[Look], theta: Array) -> bool:
        """Whether all recordings were taken at the operating point that gains are for."""
        plant = self.plant
        return all(
            bool((np.abs(look.theta[:, i] - theta[:, i]) <= plant.measured[name]).all())
            for name in plant.measured
            for (i,) in [plant.indices((name,))]
            for look in looks
        )

    def estimates(self, looks: Sequence[Look], fits: Sequence[Fit]) -> Estimates:
        """What is compared: deviations from fitted plants, or the recordings' own plants."""
        plant = self.plant
        if plant.loop_target is None:
            return Estimates.of_fits([look.fit for look in looks], plant.unknown, plant.width)
        models = [look.model for look in looks]
        return Estimates.of_responses(models, list(fits), responses_of(looks))

    def shifted(
        self,
        i: int,
        among: Flags,
        found: Estimates,
        seen: Coordinates | None,
        fitted: Fit,
        responses: Sequence[Response],
        gains: Array,
    ) -> Array:
        """Metrics (B, f) of gains with recording `i`'s plant, less those `among` others (L, B)."""
        if seen is not None:
            others = replace(seen, precision=seen.precision * among[..., None, None])
            here = carried(responses[i], seen, i).metrics(gains)
            with np.errstate(invalid="ignore"):
                return np.asarray(here - pooled(responses, others).metrics(gains))
        held = (found.information * among[..., None, None]).sum(axis=0)
        right = (found.right * among[..., None]).sum(axis=0)
        pairs = (found.information[i], found.right[i]), (held, right)
        own, others = ((np.linalg.pinv(G) @ b[..., None])[..., 0] for G, b in pairs)
        J = metric_slopes(self.plant, fitted, gains)
        return np.asarray((J @ (own - others)[..., None])[..., 0])

    def coordinates(
        self, looks: Sequence[Look], fits: Sequence[Fit], fitted: Fit
    ) -> Coordinates | None:
        """What recordings ask of the controller, beyond the fitted plant where they differ."""
        if self.plant.loop_target is None:
            return None
        here = np.zeros((len(fitted.theta), 2))
        references = np.zeros((len(looks), *here.shape))
        if not self.together(looks, fitted.theta):
            here = self.reference(fitted)
            references = np.stack([self.reference(each) for each in fits])
        return Coordinates.of(responses_of(looks), references, here)

    def reference(self, fitted: Fit) -> Array:
        """Log magnitude and phase (B, 2) of the design rule's controller for fitted plants."""
        return self.plant.parametrisation.encode(self.plant.oracle(fitted.theta))

    def _own(
        self, looks: Sequence[Look], seen: Coordinates | None, joint: Joint, together: bool
    ) -> tuple[Gains, tuple[Rung, ...]]:
        """The method's own gains, and the rungs that may answer.

        A learner's gains for each recording have a common error that pooling leaves, and only
        confirm the fitted plant; a method that answers alone gives the mean of its coordinates.
        """
        rungs, first = self.method.rungs, looks[0].own
        if Rung.FITTED_PLANT not in rungs and not together:
            raise ValueError(
                f"The {self.method.kind} tuner answers for one operating point, and these "
                "recordings have others. Tune them one by one, or use a tuner that fits the plant."
            )
        if rungs != (Rung.METHOD,):
            nothing = first.without(np.ones(len(first.values), dtype=np.bool_))
            return nothing, tuple(rung for rung in rungs if rung is not Rung.METHOD)
        weights = joint.shares if seen is None else seen.shares
        encode, decode = self.plant.parametrisation.encode, self.plant.parametrisation.decode
        coordinates = np.stack([encode(look.own.values) for look in looks])
        values = decode((weights[..., None] * coordinates).sum(axis=0))
        reached = np.all([look.own.status == Status.OK for look in looks], axis=0)
        converged = np.all([look.own.converged for look in looks], axis=0)
        return Gains.of(values, reached, converged), rungs

    def _assessed(
        self,
        looks: Sequence[Look],
        joint: Joint,
        fitted: Fit,
        response: Response | None,
        climbed: Climb,
        theta: Array,
        together: bool,
    ) -> Assessment:
        """Checks of the gains with all recordings; of each one, the worst."""
        plant, method = self.plant, self.method
        how = {"anywhere": method.any_measured, "alone": self.alone}
        y = np.concatenate([look.used.y for look in looks], axis=-1)
        model = in_a_row(plant, [look.model for look in looks])
        found = assess(plant, model, fitted, response, y, climbed.judged, theta, **how)
        each = []
        for look, fit in zip(looks, joint.fits, strict=True):
            gains = climbed.gains.values if together else plant.oracle(fit.theta)
            judged, y = replace(climbed.judged, values=gains), look.used.y
            checked = assess(plant, look.model, fit, look.response, y, judged, look.theta, **how)
            each.append(self.sampled(look.given, checked).findings)
        own = {*_OF_ALL, *(check_name(m, what) for m in plant.counted for what in OF_METRICS)}
        names = [look.name for look in looks]
        findings = {
            name: finding if name in own else _worst([e[name] for e in each if name in e], names)
            for name, finding in (each[0] | found.findings).items()
        }
        return replace(found, findings=findings)


@dataclass(slots=True)
class _Kept:
    """Recordings of one set, and the plant fitted to those that agree."""

    pooling: Pooling
    looks: Sequence[Look]
    joint: Joint
    fits: Sequence[Fit] = ()

    def __post_init__(self) -> None:
        self.fits = self.joint.fits

    def estimates(self) -> Estimates:
        """What is compared, beyond that plant."""
        return self.pooling.estimates(self.looks, self.fits)

    def without(self, apart: Flags) -> Estimates:
        """The same with the plant fitted again; for several sets at once it stays."""
        if apart.shape[1] == 1:
            plant = self.pooling.plant
            some = [look for look, away in zip(self.looks, apart[:, 0], strict=True) if not away]
            joint = self.pooling.fit(some)
            self.fits = [
                fitted_like(plant, joint, look.model, look.fit, look.used.y) for look in self.looks
            ]
        return self.estimates()


def _like(fitted: Fit, plant: Plant, theta: Array) -> Fit:
    """A fitted plant with other measured parameters (B, p)."""
    shared = theta.copy()
    shared[:, plant.unknown] = fitted.theta[:, plant.unknown]
    return replace(fitted, theta=shared)


def _others(apart: Flags) -> Flags:
    """For each recording the others (L, L, B) that agree; all others, where none does."""
    eye = np.eye(len(apart), dtype=np.bool_)[:, :, None]
    agreeing = ~apart & ~eye
    return agreeing | (~agreeing.any(axis=1, keepdims=True) & ~eye)


def _worst(findings: Sequence[Finding], names: Sequence[str]) -> Finding:
    """The largest value of each set; the message names the first set's recording."""
    values = np.stack([np.where(np.isnan(f.values), np.inf, f.values) for f in findings])
    worst = int(values[:, 0].argmax())
    name, found = names[worst], findings[worst]
    message = f"{name}: {found.message}" if name else found.message
    return replace(found, values=values.max(axis=0), message=message)


def in_a_row(plant: Plant, models: Sequence[BlackBox]) -> BlackBox:
    """One record of several black boxes: signals in a row, sums of information and residual."""
    whole = _joined(models, plant.in_a_row)
    rows = [model.rows for model in models if model.rows is not None]
    together = partial(np.concatenate, axis=1)
    return replace(whole, rows=_joined(rows, together)) if rows else whole


def _joined(models: Sequence[BlackBox], together: Callable[[list[Array]], Array]) -> BlackBox:
    """One model of the recordings of several, with their outputs put together by `together`."""
    first, count = models[0], max(len(model.u) for model in models)
    u = [np.broadcast_to(model.u, (count, *model.u.shape[1:])) for model in models]
    lengths = np.array([model.y.shape[1] for model in models], dtype=np.float64)
    offset = (lengths / lengths.sum()) @ np.stack([model.offset for model in models])
    return replace(
        first,
        u=np.concatenate(u, axis=-1),
        y=together([model.y for model in models]),
        oversampled=max(model.oversampled for model in models),
        extra=np.max([model.extra for model in models], axis=0),
        free=together([model.free for model in models]),
        offset=offset,
        information=np.sum([model.information for model in models], axis=0),
        residual=np.sum([model.residual for model in models], axis=0),
    )


def responses_of(looks: Sequence[Look]) -> list[Response]:
    """What the recordings show themselves, where the plant's metrics are a loop's."""
    return [look.response for look in looks if look.response is not None]
