"""Watch one car's recordings in time order: its friction and load, and when gains should change.

Recordings are cut into windows; a bank of filters follows them, in closed loop or not
(`tuners.recalibration.bank`).  The noise is estimated from the first recording, by maximum
likelihood of its prediction errors, and followed from then on.  A car has left what is known where
later errors are larger than its noise explains, where numbers of its data look wrong, or where it
asks for friction or load outside the prior.  Gains suit wrong data that the bank recognises.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from tuners.recalibration.bank import Bank
from tuners.recalibration.doubt import LIMITS, ORDER, doubt
from tuners.recalibration.hypotheses import Knowledge
from tuners.trust.verdict import Verdict
from yawrate_env import validation
from yawrate_env.batch import take
from yawrate_env.loop.loops import Loops
from yawrate_env.vehicle.drive_estimate import Estimate, Estimator
from yawrate_env.vehicle.drive_information import Noise, Predictor
from yawrate_env.vehicle.drive_slopes import Past
from yawrate_env.vehicle.drives import Drives
from yawrate_env.vehicle.suspects import WORDS

Array = NDArray[np.float64]

GAP = 600.0
"""Time between two recordings, where it is not given [s]."""

_STEPS = 8  # Gauss-Newton
_LEAST = 20  # samples of a window
_FAR = 4.0  # standard deviations outside the prior
_MOVED = 3.0  # standard deviations between recordings
_TIMES = 1.5  # of the noise's energy, which no window of a known car shows
_DRAWS = 200
_CERTAIN = 0.95  # of them: a share that counts as certain
_TUNING = 40  # windows from which the noise is estimated, at most
_SENTENCES = {
    "late": "commands act {:.0f} ms late",
    "offset": "the gyro is off by {:.2g} deg/s",
    "speed": "the speed is {:+.0%} off",
    "load": "the mass is {:+.0%} off",
    "gain": "the gyro's gain is {:+.0%} off",
    **{name: words + " is {:+.0%} off" for name, words in WORDS.items()},
}
_UNITS = {"late": 1e3, "offset": np.degrees(1.0)}  # of what is no logarithm


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
    half_widths : tuple of float
        Half widths of 90 % intervals of the phase margin [deg] and crossover [Hz] that these gains
        reach, around those of the design rule, if the vehicle's data are right or wrong in a way
        that the bank has as a hypothesis.
    verdict : Verdict
        What may be done with these gains (`tuners.recalibration.doubt`).
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
    half_widths: tuple[float, float]
    verdict: Verdict
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
    suspects : mapping, optional
        What may be wrong with the data, with probabilities (`Bank.of`); empty where they are exact.
    noise : Noise, optional
        Of the car; estimated from its first recording if omitted.
    known : Knowledge, optional
        What is known of the car.
    """

    drives: Drives = field(default_factory=Drives.of)
    gains: tuple[float, float] | None = None
    suspects: Mapping[tuple[str, ...], float] | None = None
    noise: Noise | None = None
    known: Knowledge | None = None

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
        bank = self._bank(Ts, windows)
        first = self.known is None
        known = bank.unknown(1) if self.known is None else self.known
        if self.known is not None:
            known = bank.loaded(known) if loaded else known
        known = replace(known, past=Past.rest(1, Ts))
        jumped, misfits = False, []
        for k in range(len(windows.v_x)):
            part = slice(k, k + 1)
            since, before = gap if k == 0 else None, known
            window = windows.u[part], windows.y[part], windows.v_x[part]
            known = bank.followed(before, *window, since, _STEPS)
            if k == 0:  # the state at the start is not known: read again from where it led
                settled = replace(before.past, x=known.past.x)
                known = bank.followed(replace(before, past=settled), *window, since, _STEPS)
            if k > 0 or not first:
                jumped |= _jumped(bank, before, known) if k == 0 else bool(known.jumped[0] > 0.5)
                misfits.append(bank.misfit(before, known))
        self.known = known
        return self._advice(bank, known, windows, jumped, _left(bank, known, misfits, first))

    def _bank(self, Ts: float, windows: "_Windows") -> Bank:
        """For this sampling time, with the noise of the first recording."""
        base = self.drives
        if self.noise is None:
            self.noise = estimated(replace(base.estimator, Ts=Ts), windows)
        estimator = replace(base.estimator, Ts=Ts, noise=self.noise)
        return Bank.of(replace(base, estimator=estimator), self.suspects)

    def _advice(
        self, bank: Bank, known: Knowledge, windows: "_Windows", jumped: bool, left: str
    ) -> Advice:
        v_x = windows.v_x[-1:]
        gains = bank.gains(known, v_x)[0]
        found = doubt(bank, known, gains[None])
        if self.gains is None:
            self.gains = float(gains[0]), float(gains[1])
        mean, deviation, surely = _margins(bank, known, v_x, np.array(self.gains))
        (log,), (spread,) = bank.friction_and_mass(known)
        mu_s, mass = np.exp(log)
        return Advice(
            (float(mu_s), float(mu_s * spread[0])),
            (float(mass - bank.drives.vehicle.M_0), float(mass * spread[1])),
            float(v_x[0]),
            float(gains[0]),
            float(gains[1]),
            (float(found.half[0, 0]), float(found.half[0, 1])),
            ORDER[found.verdict[0]],
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


def _margins(bank: Bank, known: Knowledge, v_x: Array, gains: Array) -> tuple[Array, Array, bool]:
    """Margins of gains (2,) over what is known: means, deviations, and whether they surely miss."""
    drawn = bank.drawn(known, _DRAWS, np.random.default_rng(0))
    z, target = np.concatenate([bank.point(known), drawn]), bank.drives.target
    loops = Loops.of(bank.reader.plants(z, np.repeat(v_x, len(z)), target.Ts), target)
    found, best = loops.evaluate(*np.tile(gains, (len(z), 1)).T), loops.design()
    reached = loops.evaluate(best.kp, best.Ti)
    metrics, wanted = (
        np.stack([e.margins.phase_margin, e.margins.crossover], axis=1) for e in (found, reached)
    )
    off = np.abs(metrics - wanted) > LIMITS
    missed = ~found.stable | off.any(axis=1) | ~np.isfinite(metrics).all(axis=1)
    spread = np.nanstd(metrics, axis=0)
    return metrics[0], spread, bool(missed[1:].mean() > _CERTAIN)


def _jumped(bank: Bank, before: Knowledge, after: Knowledge) -> bool:
    """Whether friction is another one, by more than is doubted before and after."""
    (was,), (spread,) = bank.friction_and_mass(before)
    (now,), (rest,) = bank.friction_and_mass(after)
    return bool(np.abs(now[0] - was[0]) > _MOVED * np.hypot(spread[0], rest[0]))


def _left(bank: Bank, known: Knowledge, misfits: list[float], first: bool) -> str:
    """Why a car is no longer what is known; empty if it is."""
    typical = 1.0 if first else float(np.median(misfits))
    if typical > _TIMES:
        return f"prediction errors have {typical:.1f} times the energy that noise explains"
    if bank.foreign(known)[0]:
        return "its noise is of another kind than the vehicle file's"
    wrong = bank.wrong(known)
    if wrong:
        said = (_SENTENCES[name].format(value * _UNITS[name] if name in _UNITS else np.expm1(value))
                for name, value in wrong.items())  # fmt: skip
        return "the vehicle's data look wrong: " + ", ".join(said)
    prior = bank.drives.estimator.prior
    (mean,), (spread,) = bank.friction_and_mass(known)
    far = np.maximum(prior.low - mean, mean - prior.high) / spread
    for name, off in zip(("friction", "load"), far, strict=True):
        if off > _FAR:
            return f"{name} lies {off:.0f} standard deviations outside the prior"
    return ""
