"""A bank of filters: what is known of cars whose data may be wrong, for B cars.

Every hypothesis has friction and load unknown, which move (`tuners.recalibration.belief`), and at
most some of the other coordinates of `yawrate_env.vehicle.drive_slopes`; the first has none, and is
the car as its data say.  A window is read once, at the mean over all hypotheses, and each of them
takes its own coordinates' part of the information.  Weights follow the predictive likelihood of the
windows (Bayes' rule over models: Bar-Shalom, Li and Kirubarajan, 2001, sec. 11.6):

    log w_h += log p_h(window),   p_h = (1 - jump) p_stay + jump p_moved

The noise is unknown under every hypothesis: its scale is the prediction errors' energy, and the
disturbance's size and time constant and the share of the gyro's noise that is coloured are
coordinates of all.  With wrong noise, a loop's feedback would look like another vehicle.  Where the
noise is of a kind that these cannot represent, the car counts as its data say.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tuners.recalibration.belief import Belief, Motion, weighed
from tuners.recalibration.hypotheses import SPREAD, Knowledge, suspected
from yawrate_env.batch import replaced, take
from yawrate_env.loop.loops import Loops
from yawrate_env.vehicle.drive_estimate import COORDINATES, encode
from yawrate_env.vehicle.drive_slopes import AT, LATEST, NOISE, PARAMETERS, Past, Reader, Slopes
from yawrate_env.vehicle.drives import Drives

Array = NDArray[np.float64]

_NOISE_SPREAD = 0.7, 0.7, 0.7  # of logarithms, and of the colour
_NOISE_WALK = 0.03, 0.03, 0.03
_DRIFT = 0.03  # of what is wrong, between windows, in its standard deviations
_SWITCH = 1e-4  # share of the weights that begins anew with every window
_NEAR = 3.0  # deviations that a step may lead, or another one follows
_FADES = 0.95  # of the scale's windows, between windows
_MOST = 3.0
_FLOOR = 0.1  # of the scale
_FIRST = 0.2  # windows that the claimed scale counts
_BEYOND = 0.2  # that friction and mass may lie outside the prior, in logarithms
_QUIETEST = -3.0, -3.0, 0.0
_LOUDEST = 3.0, 3.0, 30.0
_FARTHEST = 3.5  # standard deviations of what is wrong: beyond them something else is
_DISBELIEF = 20.0  # logarithm of what such a hypothesis loses with every window
_STRONGEST, _APART = 1.5, 2.0  # logarithms of the disturbance's size and time constant
_COLOURED, _SCALES = 4.0, (0.1, 10.0)  # of the gyro's noise, in the claimed variance
_DOUBTED = 0.05  # share of the car as its data say, at which they look wrong
_KNOWN = 1e-3
SHARED = np.array([AT["friction"], AT["mass"], *NOISE])
"""Coordinates that are unknown under every hypothesis."""
_OWN = len(SHARED)
_NOTHING = len(PARAMETERS)  # a coordinate that nothing depends on


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """Hypotheses about cars that drive as `drives` say.

    Attributes
    ----------
    drives : Drives
        Prior, walk and jumps of friction; the design rule.
    reader : Reader
        Of the windows.
    free : NDArray
        (H, k) coordinates that a hypothesis frees beside friction and mass.
    prior : NDArray
        (H,) logarithms of the weights at the start.
    """

    drives: Drives
    reader: Reader
    free: NDArray[np.intp]
    prior: Array

    @classmethod
    def of(cls, drives: Drives, suspects: Mapping[tuple[str, ...], float] | None = None) -> Self:
        """The car as its data say, and one hypothesis for each group of suspects.

        Parameters
        ----------
        suspects : mapping, optional
            Probability that these are wrong together, by their names in `SPREAD`; `suspected()`
            if omitted.
        """
        groups = suspected() if suspects is None else suspects
        free = np.full((1 + len(groups), max(map(len, groups), default=0)), _NOTHING)
        for row, names in zip(free[1:], groups, strict=True):
            row[: len(names)] = [AT[name] for name in names]
        shares = np.array([1 - sum(groups.values()), *groups.values()])
        estimator = drives.estimator
        reader = Reader(estimator.vehicle, estimator.noise, estimator.Ts, drives.target.crossover)
        return cls(drives, reader, free, np.log(shares))

    def unknown(self, count: int) -> Knowledge:
        """What is known where nothing has been seen: the prior."""
        prior = self.drives.estimator.prior
        return self._begun(np.tile(prior.mean, (count, 1)), np.tile(prior.variance, (count, 1)))

    def known(self, theta: Array) -> Knowledge:
        """What is known of cars just calibrated, whose friction and load are (B, 2 or 3)."""
        mean = encode(theta, self.drives.vehicle)
        return self._begun(mean, np.full(mean.shape, _KNOWN**2))

    def loaded(self, known: Knowledge) -> Knowledge:
        """What is known before another drive: the load no more, and all else as it was."""
        prior, at = self.drives.estimator.prior, AT["mass"]
        mean, covariance = known.mean.copy(), known.covariance.copy()
        mean[..., at] = prior.mean[at]
        covariance[..., at, :], covariance[..., :, at] = 0.0, 0.0
        covariance[..., at, at] = prior.variance[at]
        return replace(known, mean=mean, covariance=covariance)

    def followed(
        self,
        known: Knowledge,
        u: Array,
        y: Array,
        v_x: Array,
        gap: float | None = None,
        steps: int = 2,
    ) -> Knowledge:
        """What is known after one more window.

        Parameters
        ----------
        u, y : (B, N) float64
            Command [rad] and measured yaw rate [rad/s].
        v_x : (B,) float64
            Speed [m/s].
        gap : float, optional
            Time since the window before [s]; a window's length if omitted.
        steps : int
            Gauss-Newton steps at most; one is enough where it leads less than three deviations far.
        """
        found, far = self._step(known, u, y, v_x, known, gap)
        for _ in range(steps - 1):
            rows = np.flatnonzero(far > _NEAR)
            if not len(rows):
                break
            some = take(known, rows)
            again, length = self._step(some, u[rows], y[rows], v_x[rows], take(found, rows), gap)
            found, far[rows] = replaced(found, rows, again), length
        return found

    def point(self, known: Knowledge) -> Array:
        """Coordinates (B, P), the means over all hypotheses."""
        shares = np.exp(known.weight)
        z = np.zeros((len(known), _NOTHING + 1))
        z[:, SHARED] = (shares[..., None] * known.mean[..., :_OWN]).sum(axis=1)
        for j in range(self.free.shape[1]):
            z += (shares * known.mean[..., _OWN + j]) @ np.eye(_NOTHING + 1)[self.free[:, j]]
        z[:, AT["late"]] = np.clip(z[:, AT["late"]], 0.0, LATEST)
        return z[:, :_NOTHING]

    def foreign(self, known: Knowledge) -> NDArray[np.bool_]:
        """Whether (B,) the noise is of a kind that the bank cannot represent."""
        z, scale = self.point(known), known.energy / known.windows
        size, time, colour = z[:, NOISE].T
        beyond = (size > _STRONGEST) | ((np.abs(time) > _APART) & (size > -_STRONGEST))
        return np.asarray(
            beyond | (colour > _COLOURED) | (scale < _SCALES[0]) | (scale > _SCALES[1])
        )

    def friction_and_mass(self, known: Knowledge) -> tuple[Array, Array]:
        """Means and standard deviations (B, 2) of their logarithms over all hypotheses."""
        share, own = np.exp(known.weight)[..., None], known.mean[..., :COORDINATES]
        mean = (share * own).sum(axis=1)
        variance = np.diagonal(known.covariance, axis1=2, axis2=3)[..., :COORDINATES]
        return mean, np.sqrt((share * (variance + (own - mean[:, None]) ** 2)).sum(axis=1))

    def wrong(self, known: Knowledge) -> dict[str, float]:
        """What is wrong with the first car's data, and its coordinate, where 95 % speak for it."""
        share = np.exp(known.weight[0])
        if share[0] > _DOUBTED:
            return {}
        likely = 1 + int(share[1:].argmax())
        own = known.mean[0, likely, _OWN:]
        return {PARAMETERS[at]: float(value) for at, value in
                zip(self.free[likely], own, strict=True) if at < _NOTHING}  # fmt: skip

    def misfit(self, before: Knowledge, after: Knowledge) -> float:
        """Energy of the first car's last window over what its noise explained before."""
        energy = after.energy[0] - _FADES * before.energy[0]
        return float(energy * before.windows[0] / before.energy[0])

    def drawn(self, known: Knowledge, count: int, rng: np.random.Generator) -> Array:
        """Coordinates (count, P) of what the first car may be."""
        chosen = rng.choice(len(self.free), count, p=np.exp(_normal(known.weight[:1])[0]))
        z = np.zeros((count, _NOTHING + 1))
        for h in np.unique(chosen):
            rows = np.flatnonzero(chosen == h)
            own = rng.multivariate_normal(known.mean[0, h], known.covariance[0, h], len(rows))
            z[rows[:, None], self.index[h]] = own
        return z[:, :_NOTHING]

    def gains(self, known: Knowledge, v_x: Array) -> Array:
        """Gains (B, 2) of the design rule at these means; ``nan`` where it has none."""
        target = self.drives.target
        plants = self.reader.plants(self.point(known), v_x, target.Ts)
        design = Loops.of(plants, target).design()
        return np.stack([design.kp, design.Ti], axis=1)

    @property
    def index(self) -> NDArray[np.intp]:
        """Coordinates (H, q) of the hypotheses."""
        shared = np.tile(SHARED, (len(self.free), 1))
        return np.concatenate([shared, self.free], axis=1)

    @property
    def _variance(self) -> Array:
        """Prior variances (H, k) of what the hypotheses free."""
        spread = np.ones(_NOTHING + 1)
        for name, value in SPREAD.items():
            spread[AT[name]] = value
        return np.asarray(spread[self.free] ** 2)

    def _begun(self, mean: Array, variance: Array) -> Knowledge:
        (count, _), (H, k) = mean.shape, self.free.shape
        means = np.zeros((count, H, _OWN + k))
        means[..., :COORDINATES] = mean[:, None]
        diagonal = np.empty_like(means)
        diagonal[..., COORDINATES:_OWN] = np.square(_NOISE_SPREAD)
        diagonal[..., :COORDINATES], diagonal[..., _OWN:] = variance[:, None], self._variance
        covariance = diagonal[..., None] * np.eye(_OWN + k)
        first = np.full(count, _FIRST)
        return Knowledge(means, covariance, np.tile(self.prior, (count, 1)), np.zeros(count),
                         first, first, first, Past.rest(count, self.reader.Ts),
                         np.zeros((count, _NOTHING + 1), np.complex128))  # fmt: skip

    def _step(
        self, known: Knowledge, u: Array, y: Array, v_x: Array, near: Knowledge, gap: float | None
    ) -> tuple[Knowledge, Array]:
        """One Gauss-Newton step from the point of `near`, and its length (B,) in deviations."""
        z = self.point(near)
        told = self.reader(u, y, v_x, known.past, z)
        energy = _FADES * known.energy + _least(told) / u.shape[1]
        windows = _FADES * known.windows + 1
        own = energy / windows
        slow = _FADES * known.slow + np.minimum(told.slow, _MOST * own)
        scale = np.maximum(own, _FLOOR) * np.maximum(1.0, known.slow / known.energy)
        F = np.pad(told.information, ((0, 0), (0, 1), (0, 1))) / scale[:, None, None]
        i = np.pad(told.pull, ((0, 0), (0, 1))) / scale[:, None]
        i[:, :_NOTHING] += (F[:, :_NOTHING, :_NOTHING] * z[:, None]).sum(axis=2)
        belief, evidence = self._weighed(known, F, i, gap)
        count, H = evidence.shape
        far = np.abs(belief.mean[:, _OWN:].reshape(count, H, -1)) > _FARTHEST * np.sqrt(
            self._variance
        )
        evidence = np.where(far.any(axis=2), evidence - _DISBELIEF, evidence)
        evidence[self.foreign(known), 1:] -= _DISBELIEF
        weight = _normal(_anew(known.weight, self.prior) + evidence)
        share = np.exp(weight)
        found = replace(
            known,
            mean=belief.mean.reshape(known.mean.shape),
            covariance=belief.covariance.reshape(known.covariance.shape),
            weight=weight,
            jumped=(share * belief.jumped.reshape(count, H)).sum(axis=1),
            energy=energy,
            slow=slow,
            windows=windows,
            past=self.reader.after(known.past, u, told),
            response=told.response,
        )
        step = self.point(found) - z
        length = (told.information * step[:, None]).sum(axis=2)
        return found, np.sqrt(np.maximum((length * step).sum(axis=1) / scale, 0.0))

    def _weighed(
        self, known: Knowledge, F: Array, i: Array, gap: float | None
    ) -> tuple[Belief, Array]:
        """Beliefs (B H) after a window, and the hypotheses' evidence (B, H)."""
        prior, conditions = self.drives.estimator.prior, self.drives.conditions
        if gap is not None:
            conditions = replace(conditions, window=max(gap, conditions.Ts))
        (count, H, q), index = known.mean.shape, self.index
        mean = known.mean.reshape(-1, q)
        walk = np.zeros_like(mean)
        walk[:, 0] = (conditions.walk_rms[0] / np.exp(mean[:, 0])) ** 2
        walk[:, COORDINATES:_OWN] = np.square(_NOISE_WALK)
        walk[:, _OWN:] = np.tile(_DRIFT**2 * self._variance, (count, 1))
        belief = Belief(mean, known.covariance.reshape(-1, q, q), np.zeros(len(mean)))
        motion = Motion(walk, conditions.jump_probability, 0, prior.mean[0], prior.variance[0])
        own = F[:, index[:, :, None], index[:, None]].reshape(-1, q, q)
        live = np.tile((index < _NOTHING).sum(axis=1), count)
        found, evidence = weighed(belief, motion, own, i[:, index].reshape(-1, q), live)
        low, high = prior.low - _BEYOND, prior.high + _BEYOND
        found.mean[:, :COORDINATES] = np.clip(found.mean[:, :COORDINATES], low, high)
        noise = found.mean[:, COORDINATES:_OWN]
        found.mean[:, COORDINATES:_OWN] = np.clip(noise, _QUIETEST, _LOUDEST)
        return found, evidence.reshape(count, H)


def _least(told: Slopes) -> Array:
    """Energy (B,) of the prediction errors where friction, mass and noise fit the window."""
    F, pull = told.information[:, SHARED[:, None], SHARED], told.pull[:, SHARED]
    loose = F + 1e-9 * np.trace(F, axis1=1, axis2=2)[:, None, None] * np.eye(_OWN)
    step = np.linalg.solve(loose + np.eye(_OWN), pull[..., None])[..., 0]
    less = ((F * step[:, None]).sum(axis=2) - 2 * pull) * step
    return np.asarray(told.energy + less.sum(axis=1))


def _anew(weight: Array, prior: Array) -> Array:
    """Weights of which a small share begins anew: a car may change under way."""
    return np.asarray(np.logaddexp(weight + np.log1p(-_SWITCH), prior + np.log(_SWITCH)))


def _normal(weight: Array) -> Array:
    """Logarithms of weights (B, H) that sum to one."""
    return np.asarray(weight - np.logaddexp.reduce(weight, axis=1)[:, None])
