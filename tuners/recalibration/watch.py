"""Watch one car's recordings in time order: its friction and load, and when gains should change.

Recordings are cut into windows; every window is read by prediction errors
(`yawrate_env.vehicle.drive_estimate`), in closed loop or not, and the filter follows
(`tuners.recalibration.follower`).  The noise is estimated from the first recordings, by maximum
likelihood of their prediction errors.  A car has left what is known where later errors are larger
than this noise explains, or where the windows ask for friction or load outside the prior.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from tuners.recalibration.belief import Belief
from tuners.recalibration.follower import Follower
from yawrate_env import validation
from yawrate_env.batch import take
from yawrate_env.plant.pi_loop import CROSSOVER_SCALE, PHASE_SCALE
from yawrate_env.vehicle.drive_estimate import Estimate, Estimator
from yawrate_env.vehicle.drive_information import Noise, Predictor
from yawrate_env.vehicle.drives import Drives

Array = NDArray[np.float64]

GAP = 600.0
"""Time between two recordings, where it is not given [s]."""

_STEPS = 8  # Gauss-Newton
_LEAST = 20  # samples of a window
_FAR = 4.0  # standard deviations outside the prior
_MOVED = 3.0  # standard deviations between recordings
_TIMES = 1.5  # of the noise's energy, which no window of a known car shows
_MARGIN, _CROSSOVER = 0.3 * PHASE_SCALE, 0.6 * CROSSOVER_SCALE  # 3 deg and 0.15 Hz
_DRAWS = 200
_CERTAIN = 0.95  # of them: a share that counts as certain
_TUNING = 40  # windows from which the noise is estimated, at most


@dataclass(frozen=True, slots=True)
class Advice:
    """What one more recording says.

    Attributes
    ----------
    mu_s, M_delta : tuple of float
        Friction and extra mass [kg] with their standard deviations.
    v_x : float
        Speed, the mean of the last window [m/s].
    kp, Ti : float
        Gains of the design rule for the car at this speed.
    phase_margin, crossover : tuple of float
        Of the gains in effect: means and standard deviations [deg], [Hz].
    change : bool
        Whether the gains in effect miss by more than 3 deg or 0.15 Hz with 95 % certainty.
    jumped : bool
        Whether friction jumped, in the recording or since the one before.
    left : str
        Why the car is no longer what is known, empty if it is.
    windows : int
        How many the recording had.
    """

    mu_s: tuple[float, float]
    M_delta: tuple[float, float]
    v_x: float
    kp: float
    Ti: float
    phase_margin: tuple[float, float]
    crossover: tuple[float, float]
    change: bool
    jumped: bool
    left: str
    windows: int


@dataclass(slots=True, eq=False)
class Watch:
    """Follows one car.

    Attributes
    ----------
    drives : Drives
        The car, the prior, and how friction moves; the noise is only where its estimate begins.
    gains : tuple of float, optional
        kp and Ti [s] in effect; those of the first advice if omitted.
    """

    drives: Drives = field(default_factory=Drives.of)
    gains: tuple[float, float] | None = None
    noise: Noise | None = None
    belief: Belief | None = None

    def add(
        self,
        u: Array,
        y: Array,
        Ts: float,
        v_x: Array | float,
        *,
        gap: float = GAP,
        loaded: bool = True,
    ) -> Advice:
        """Take the next recording.

        Parameters
        ----------
        u, y : (N,) float64
            Command [rad] and yaw rate [rad/s].
        Ts : float
            Sampling time [s].
        v_x : float or (N,)
            Speed [m/s].
        gap : float
            Time since the recording before [s].
        loaded : bool
            Whether the load may have changed since.
        """
        windows = _Windows.of(u, y, Ts, v_x, self.drives.conditions.window)
        follower = self._follower(Ts, windows)
        belief = follower.unknown(1) if self.belief is None else self.belief
        if self.belief is not None:
            belief = follower.loaded(belief) if loaded else belief
        estimator, x = follower.drives.estimator, np.zeros((1, 7))
        start, jumped, misfits, outside = belief.mean, False, [], np.zeros(2)
        for k in range(len(windows.v_x)):
            part = slice(k, k + 1)
            found, x = estimator(
                windows.u[part], windows.y[part], windows.v_x[part], x, start, _STEPS
            )
            if k == 0:  # the state at the start is not known: read again from where it led
                found, x = estimator(
                    windows.u[part], windows.y[part], windows.v_x[part], x, start, _STEPS
                )
            before = belief
            belief = follower.followed(before, found, gap if k == 0 else None)
            if k > 0 or self.belief is not None:
                jumped |= _jumped(before, belief) if k == 0 else bool(belief.jumped[0] > 0.5)
            start = estimator.inside(found.mean)
            misfits.append(float(found.misfit[0]) / windows.u.shape[1])
            outside = np.maximum(outside, _outside(estimator, found))
        self.belief = belief
        return self._advice(follower, belief, windows, jumped, _left(misfits, outside))

    def _follower(self, Ts: float, windows: "_Windows") -> Follower:
        """For this sampling time, with the noise of the first recording."""
        base = self.drives
        if self.noise is None:
            self.noise = estimated(replace(base.estimator, Ts=Ts), windows)
        estimator = replace(base.estimator, Ts=Ts, noise=self.noise)
        return Follower.of(replace(base, estimator=estimator))

    def _advice(
        self, follower: Follower, belief: Belief, windows: "_Windows", jumped: bool, left: str
    ) -> Advice:
        v_x = windows.v_x[-1:]
        (gains,) = follower.gains(belief, v_x)
        if self.gains is None:
            self.gains = float(gains[0]), float(gains[1])
        mean, deviation, surely = _margins(follower, belief, v_x, np.array(self.gains))
        (theta,), spread = follower.theta(belief, v_x), np.sqrt(np.diag(belief.covariance[0]))
        mass = theta[1] + follower.drives.vehicle.M_0
        return Advice(
            (float(theta[0]), float(theta[0] * spread[0])),
            (float(theta[1]), float(mass * spread[1])),
            float(v_x[0]),
            float(gains[0]),
            float(gains[1]),
            (float(mean[0]), float(deviation[0])),
            (float(mean[1]), float(deviation[1])),
            surely,
            jumped,
            left,
            len(windows.v_x),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Windows:
    """A recording in windows: u and y (W, N), speeds (W,)."""

    u: Array
    y: Array
    v_x: Array

    @classmethod
    def of(cls, u: Array, y: Array, Ts: float, v_x: Array | float, length: float) -> "_Windows":
        input, output = (
            validation.finite_array(name, values, shape=(None,)) for name, values in
            (("u", u), ("y", y))
        )  # fmt: skip
        validation.number("Ts", Ts, above=0.0, remedy="Give the sampling time in seconds.")
        if len(input) != len(output):
            raise ValueError(
                f"u has {len(input)} samples and y has {len(output)}. Cut them to one length."
            )
        speed = np.broadcast_to(np.asarray(v_x, dtype=np.float64), input.shape)
        validation.number("v_x", float(speed.min()), above=0.0, remedy="Give it in m/s.")
        count = max(round(len(input) * Ts / length), 1)
        N = len(input) // count
        validation.count("samples of a window", N, at_least=_LEAST, remedy="Record for longer.")
        cut = [
            np.ascontiguousarray(a[: count * N].reshape(count, N)) for a in (input, output, speed)
        ]
        return cls(cut[0], cut[1], cut[2].mean(axis=1))


def estimated(estimator: Estimator, windows: _Windows) -> Noise:
    """Noise that makes prediction errors of windows most likely; the time constant is kept."""
    some = take(windows, slice(0, _TUNING))
    N, x = some.u.shape[1], np.zeros((len(some.v_x), 7))
    start = np.tile(estimator.prior.mean, (len(some.v_x), 1))

    def read(noise: Noise, z: Array, steps: int) -> Estimate:
        found, _ = replace(estimator, noise=noise)(some.u, some.y, some.v_x, x, z, steps)
        return found

    noise = estimator.noise
    for _ in range(2):
        z = estimator.inside(read(noise, start, _STEPS).mean)

        def cost(logs: Array, z: Array = z) -> float:
            gyro, disturbance = np.exp(np.clip(logs, -20.0, 2.0))
            tried = Noise(float(gyro), float(disturbance), estimator.noise.time)
            theta = estimator.theta(z, some.v_x)
            predictor = Predictor.of(estimator.vehicle, theta, tried, estimator.Ts)
            gram, _ = predictor.gram(some.u, some.y, x)
            return float((gram[:, 0, 0] + N * np.log(predictor.variance)).sum())

        begin = np.log([noise.gyro, max(noise.disturbance, 1e-8)])
        gyro, disturbance = np.exp(minimize(cost, begin, method="Nelder-Mead",
                                            options={"maxiter": 80, "xatol": 0.02}).x)  # fmt: skip
        noise = Noise(float(gyro), float(disturbance), noise.time)
        start = z
    return noise


def _margins(
    follower: Follower, belief: Belief, v_x: Array, gains: Array
) -> tuple[Array, Array, bool]:
    """Margins of gains (2,) over the belief: means, deviations, and whether they surely miss."""
    drives, rng = follower.drives, np.random.default_rng(0)
    z = rng.multivariate_normal(belief.mean[0], belief.covariance[0], _DRAWS)
    z = drives.estimator.inside(np.concatenate([belief.mean, z]))
    loops = drives.loops(drives.estimator.theta(z, np.repeat(v_x, len(z))))
    found, best = loops.evaluate(*np.tile(gains, (len(z), 1)).T), loops.design()
    reached = loops.evaluate(best.kp, best.Ti)
    metrics, wanted = (
        np.stack([e.margins.phase_margin, e.margins.crossover], axis=1) for e in (found, reached)
    )
    off = np.abs(metrics - wanted) > [_MARGIN, _CROSSOVER]
    missed = ~found.stable | off.any(axis=1) | ~np.isfinite(metrics).all(axis=1)
    spread = np.nanstd(metrics, axis=0)
    return metrics[0], spread, bool(missed[1:].mean() > _CERTAIN)


def _jumped(before: Belief, after: Belief) -> bool:
    """Whether friction is another one, by more than both beliefs doubt."""
    doubt = np.sqrt(before.covariance[0, 0, 0] + after.covariance[0, 0, 0])
    return bool(np.abs(after.mean[0, 0] - before.mean[0, 0]) > _MOVED * doubt)


def _outside(estimator: Estimator, found: Estimate) -> Array:
    """By how many standard deviations a window asks for more than the prior has, (2,)."""
    prior, spread = estimator.prior, np.sqrt(np.diag(found.covariance[0]))
    beyond = np.maximum(prior.low - found.mean[0], found.mean[0] - prior.high)
    return np.asarray(np.maximum(beyond, 0.0) / spread)


def _left(misfits: list[float], outside: Array) -> str:
    """Why a car is no longer what is known; empty if it is."""
    typical = float(np.median(misfits))
    if typical > _TIMES:
        return f"prediction errors have {typical:.1f} times the energy that noise explains"
    names: Mapping[str, float] = dict(zip(("friction", "load"), outside, strict=True))
    for name, far in names.items():
        if far > _FAR:
            return f"{name} lies {far:.0f} standard deviations outside the prior"
    return ""
