"""Several recordings of one vehicle: what pooling gains, and whether other cars are called out.

Recordings have a random register each.  A wrong car's friction is 0.2 off, or one of its constants
20 % larger or smaller; the wrong data of a right car are off by up to a share in every constant.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from studies.draws import draw, recorded
from studies.metrics import rms
from tuners import Result, Tuner
from tuners.tuner.recording import Recording
from yawrate_env.vehicle.single_track import Vehicle
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

CONSTANTS = ("J_z", "l_f", "l_r", "C_f", "C_r", "l_rel_f", "l_rel_r", "omega_n", "xi")
LOGS = 4
SPEED, SPEEDS, BETWEEN = 20.0, (12.0, 18.0, 24.0, 30.0), 21.0
"""One for all recordings; one each, and what the gains are then for [m/s]."""

CONDITIONS = ((30.0, 10_000), (20.0, 5_000))
"""SNR [dB] and samples of 1 ms."""

_FRICTION, _SHARE = 0.2, 0.2
_MISS = np.array([3.0, 0.15])
_TARGET = np.array([60.0, 1.5])


@dataclass(frozen=True, slots=True)
class Gain:
    """What pooling gains.

    Attributes
    ----------
    speeds, answered_by : str
        Of the recordings, and which rung.
    sets : int
    one, pooled, ratio : list of float
        Rms errors of phase margin [deg] and crossover [Hz], and how many times smaller.
    """

    speeds: str
    answered_by: str
    sets: int
    one: list[float]
    pooled: list[float]
    ratio: list[float]


@dataclass(frozen=True, slots=True)
class Called:
    """How often a further recording of one kind of car is called out.

    Attributes
    ----------
    kind : str
    snr_db, seconds : float
    sets : int
    disagrees, contradicts : float
        Shares that are called another car, and of these with gains that miss.
    phase_margin, crossover : float
        Rms of what the other car changes [deg], [Hz].
    """

    kind: str
    snr_db: float
    seconds: float
    sets: int
    disagrees: float
    contradicts: float
    phase_margin: float
    crossover: float


@dataclass(frozen=True, slots=True)
class Pooled:
    """Sets of recordings of one kind, pooled.

    Attributes
    ----------
    kind, speeds : str
    sets : int
    usable, care, refused : int
    named : int
        Sets in which the wrong recording, and no other, is named; of right ones, in which none is.
    missed : int
        Trusted answers off by 3 degrees or 0.15 Hz.
    covered : list of float
        Shares of the headline 90 % intervals of trusted answers that hold.
    """

    kind: str
    speeds: str
    sets: int
    usable: int
    care: int
    refused: int
    named: int
    missed: int
    covered: list[float]


@dataclass(frozen=True, slots=True)
class Car:
    """One vehicle: constants, friction and load."""

    vehicle: Vehicle
    mu_s: float
    M_delta: float

    def theta(self, v_x: float) -> Array:
        """(1, 3) parameters at a speed [m/s]."""
        return np.array([[self.mu_s, self.M_delta, v_x]])

    def other(self, name: str, rng: np.random.Generator) -> "Car":
        """Another car in one parameter."""
        sign = rng.choice([-1.0, 1.0])
        if name == "friction":
            within = 0.3 <= self.mu_s + sign * _FRICTION <= 1.1
            return replace(self, mu_s=self.mu_s + (sign if within else -sign) * _FRICTION)
        if name == "mass":
            total = self.vehicle.M_0 + self.M_delta
            return replace(self, M_delta=self.M_delta + sign * _SHARE * total)
        return replace(self, vehicle=_scaled(self.vehicle, {name: 1 + sign * _SHARE}))


def _scaled(vehicle: Vehicle, factors: Mapping[str, float]) -> Vehicle:
    return replace(vehicle, **{n: f * getattr(vehicle, n) for n, f in factors.items()})


class Garage:
    """Draws cars of the prior and drives them; every drive has a noise of its own.

    Parameters
    ----------
    share : float
        By which every constant may differ from the vehicle's data.
    """

    def __init__(self, seed: int, snr_db: float, samples: int, share: float = 0.0) -> None:
        self.rng, self.seed, self.share = np.random.default_rng(seed), seed, share
        self.experiment = Experiment(N=samples, snr_db=snr_db, register="random")
        self.drives = 0

    def car(self) -> Car:
        """A car of the prior, its constants off by up to the share."""
        rng = self.rng
        factors = {name: 1 + self.share * rng.uniform(-1, 1) for name in CONSTANTS}
        vehicle = _scaled(Vehicle(), factors if self.share else {})
        return Car(vehicle, rng.uniform(0.3, 1.1), rng.uniform(0.0, 300.0))

    def drive(self, car: Car, v_x: float) -> Recording:
        """One recording at a speed [m/s], which it knows."""
        task = Task(car.vehicle, Prior(v_x=(10.0, 33.0)), self.experiment)
        plant = yaw_rate.__wrapped__(task, check=False)
        drawn = draw(plant, "test", self.seed, self.drives, 1)
        self.drives += 1
        found = recorded(plant, replace(drawn, theta=car.theta(v_x)))
        known = np.array([[np.nan, np.nan, v_x]])
        return replace(found, known=known)

    def off(self, car: Car, v_x: float, result: Result) -> Array:
        """Phase margin [deg] and crossover [Hz] of a car's loop, less the target's."""
        gains = np.array([list(result.gains.values())])
        plant = yaw_rate.__wrapped__(Task(car.vehicle), check=False)
        if not np.isfinite(gains).all():
            return np.full(2, np.nan)
        return np.asarray(plant.errors(car.theta(v_x), gains)[0])


def gains(
    tuner: Tuner, name: str, speeds: Sequence[float], at: float, sets: int, seed: int
) -> Gain:
    """Errors from one recording, and from all."""
    garage, one, all_ = Garage(seed, *CONDITIONS[0]), [], []
    for _ in range(sets):
        car = garage.car()
        drives = [garage.drive(car, v_x) for v_x in speeds]
        target = {"v_x": at}
        one.append(garage.off(car, at, tuner.pool(drives[:1], target)))
        all_.append(garage.off(car, at, tuner.pool(drives, target)))
    first, pooled = rms(np.array(one)), rms(np.array(all_))
    return Gain(_listed(speeds), name, sets, first.tolist(), pooled.tolist(),
                (first / pooled).tolist())  # fmt: skip


def called(tuner: Tuner, kind: str, snr_db: float, samples: int, sets: int, seed: int) -> Called:
    """How often a further recording is called another car, after one that was tuned from."""
    garage, rows = Garage(seed, snr_db, samples), []
    for _ in range(sets):
        car = garage.car()
        other = car if kind == "right" else car.other(kind, garage.rng)
        tuned, further = garage.drive(car, SPEED), garage.drive(other, SPEED)
        held = tuner.pool([tuned], validate=further).validation
        assert held is not None
        shift = list(held.against.shift.values())
        rows.append([not held.agrees, held.contradicts, *shift])
    found = np.array(rows, dtype=np.float64)
    change = np.sqrt(np.nanmean(found[:, 2:] ** 2, axis=0))
    disagrees, contradicts = found[:, :2].mean(axis=0).tolist()
    seconds = samples * garage.experiment.Ts
    return Called(kind, snr_db, seconds, sets, disagrees, contradicts, *change.tolist())


def pooled(
    tuner: Tuner, kind: str, speeds: Sequence[float], at: float, sets: int, seed: int
) -> Pooled:
    """Verdicts of sets; the last recording of some kinds is another car's."""
    share = 0.05 if kind == "data off by 5 %" else 0.0
    garage, rows, verdicts = Garage(seed, *CONDITIONS[0], share), [], []
    for _ in range(sets):
        car = garage.car()
        last = car.other(kind, garage.rng) if kind in ("friction", *CONSTANTS) else car
        drives = [garage.drive(car if k < len(speeds) - 1 else last, v_x)
                  for k, v_x in enumerate(speeds)]  # fmt: skip
        result = tuner.pool(drives, {"v_x": at})
        apart = [not each.agrees for each in result.logs]
        right = [False] * (len(apart) - 1) + [last is not car]
        off = garage.off(car, at, result)
        ends = result.intervals.values()
        holds = [i.low <= v <= i.high for i, v in zip(ends, off + _TARGET, strict=True)]
        verdicts.append(result.verdict.value)
        missed = bool(not (np.abs(off) <= _MISS).all())
        rows.append([apart == right, result.trusted and missed, result.trusted, *holds])
    found = np.array(rows, dtype=np.bool_)
    trusted = found[found[:, 2]]
    covered = trusted[:, 3:].mean(axis=0).tolist() if len(trusted) else [float("nan")] * 2
    count = verdicts.count
    return Pooled(kind, _listed(speeds), sets, count("usable"), count("usable_with_care"),
                  count("refuse"), int(found[:, 0].sum()), int(found[:, 1].sum()),
                  covered)  # fmt: skip


def _listed(speeds: Sequence[float]) -> str:
    return ", ".join(f"{v:g}" for v in dict.fromkeys(speeds))


KINDS = ("right", "friction", "mass", *CONSTANTS)
"""Of a validation."""

POOLED = ("right", "friction", "C_r", "data off by 5 %")


def study(
    tuner: Tuner, black_box: Tuner, sets: int, seed: int, progress: Progress
) -> tuple[list[Gain], list[Called], list[Pooled]]:
    """All tables."""
    same = (SPEED,) * LOGS
    jobs = [
        (tuner, "fitted plant", same, SPEED),
        (tuner, "fitted plant", SPEEDS, BETWEEN),
        (black_box, "black box", same, SPEED),
    ]
    first = []
    for i, (used, name, speeds, at) in enumerate(jobs):
        progress("pooling", i, len(jobs))
        first.append(gains(used, name, speeds, at, sets, seed))
    progress("pooling", len(jobs), len(jobs))
    pairs = [(kind, *condition) for condition in CONDITIONS for kind in KINDS]
    second = []
    for i, pair in enumerate(pairs):
        progress("validation", i, len(pairs))
        second.append(called(tuner, *pair, sets, seed))
    progress("validation", len(pairs), len(pairs))
    places = [(kind, *where) for kind in POOLED for where in ((same, SPEED), (SPEEDS, SPEEDS[1]))]
    third = []
    for i, place in enumerate(places):
        progress("disagreement", i, len(places))
        third.append(pooled(tuner, *place, max(sets // 8, 1), seed))
    progress("disagreement", len(places), len(places))
    return first, second, third
