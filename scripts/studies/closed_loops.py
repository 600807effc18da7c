"""Drives under an old controller, and what tuners make of them.

Vehicles of any friction, load and speed are driven by a PI that is badly tuned, sluggish or with
5° to 20° of phase margin, through steps, lane changes or a slow weave.  Gyro noise and a
disturbance at the steering act inside the loop; controller and logger run at 100 Hz, the vehicle
is exact between their samples.  The recording begins in mid-drive.

Each drive is tuned in three ways: with its reference, with the gains of the controller that drove,
and with neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.faulty import claimed_speed, scaled
from studies.trusting import MISS
from tuners import Tuner
from tuners.trust.feedback import rebuilt
from tuners.trust.verdict import Verdict
from tuners.tuner.recording import Recording
from tuners.tuner.result import Result
from yawrate_env.loop.design import Status
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.loops import Loops
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.discrete import plants
from yawrate_env.vehicle.drive import drive
from yawrate_env.vehicle.manoeuvre import weave
from yawrate_env.vehicle.single_track import Context, Vehicle

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rng = np.random.Generator

MANOEUVRES = "steps", "lane changes", "slow weave"
WAYS = "reference", "old gains", "neither"

FIRST = "first"
_CHANGES: dict[str, dict[str, Any]] = {
    "assumed": {},
    "short": {"seconds": 10.0},
    "wrong": {"wrong": 0.2},
    "slow": {"fastest": 0.15},
    "forward": {"forward": True},
}
CONDITIONS = {
    "assumed": "Vehicles as the tuner assumes",
    "short": "Recordings of 10 s",
    "wrong": "Every constant of the vehicle off by up to 20 %",
    "slow": "An actuator that moves by 0.15 rad/s at most",
    "forward": "A driver who adds half of the steering that the reference needs",
}
"""Conditions, in words."""

WARM = 3.0
"""Driven before the recording begins [s]."""

_SNR = 30.0  # dB
_MOST_DISTURBED = float(np.radians(0.1))  # rad, root mean square
_PACE = 0.3, 5.0  # Hz: bandwidth of the disturbance
_SPEED = 10.0, 33.0
_DEGREE = float(np.radians(1.0))
_WRONG = ("J_z", "l_f", "l_r", "C_f", "C_r", "l_rel_f", "l_rel_r", "omega_n", "xi", "M_0")
_TRIES = 300


@dataclass(frozen=True, slots=True, eq=False)
class Drives:
    """B recorded drives.

    Attributes
    ----------
    manoeuvre : tuple of str
        Of each.
    loops : Loops
        Around the true vehicles.
    gains : NDArray
        (B, 2) of the controllers that drove.
    reference, u, y : NDArray
        (B, N) as logged.
    disturbed : NDArray
        (B,) disturbance, root mean square [rad].
    v_x : NDArray
        (B,) speeds [m/s].
    """

    manoeuvre: tuple[str, ...]
    loops: Loops
    gains: Array
    reference: Array
    u: Array
    y: Array
    disturbed: Array
    v_x: Array

    def __len__(self) -> int:
        return len(self.y)

    def recording(self, way: str) -> Recording:
        """What a tuner gets that knows the reference, the old gains, or neither."""
        Ts = self.loops.target.Ts
        given = Recording(self.u, self.y, Ts, claimed_speed(self.v_x))
        if way == "neither":
            return given
        reference = self.reference
        if way == "old gains":
            rows = zip(self.u, self.y, self.gains, strict=True)
            target = self.loops.target
            reference = np.stack([rebuilt(u, y, Ts, (g[0], g[1]), target) for u, y, g in rows])
        return replace(given, reference=reference)

    def good(self, gains: Array) -> Flags:
        """Where gains (B, 2) come as near the target as `MISS` allows, or as the rule does."""
        found, rule = self.loops.evaluate(*gains.T), self.loops.design()
        best = self.loops.evaluate(rule.kp, rule.Ti).margins
        target, reachable = self.loops.target, rule.status == Status.OK
        aim = np.where(reachable, target.phase_margin, best.phase_margin)
        near = np.abs(found.margins.phase_margin - aim) <= MISS[0]
        aim = np.where(reachable, target.crossover, best.crossover)
        near &= np.abs(found.margins.crossover - aim) <= MISS[1]
        return np.asarray(near & found.stable)


@dataclass(frozen=True, slots=True)
class Row:
    """What became of the drives of one manoeuvre in one way."""

    condition: str
    way: str
    manoeuvre: str
    drives: int
    within: int
    usable: int
    with_care: int
    bad_and_trusted: int
    flagged: int


def driven(
    count: int,
    seed: int,
    *,
    seconds: float = 20.0,
    wrong: float = 0.0,
    fastest: float = np.inf,
    forward: bool = False,
) -> Drives:
    """Drives, of which each third follows one kind of reference.

    Parameters
    ----------
    seconds : float
        Recorded.
    wrong : float
        Share by which each of the vehicle's data is off from what tuners assume, either way.
    fastest : float
        Steering rate of the actuator at most [rad/s].
    forward : bool
        Whether a driver adds half of the steering that the reference needs in steady state.
    """
    target, made = Target(), []
    for i in range(count):
        rng = np.random.default_rng((seed, i))
        context, loops, gains = _controlled(rng, target, wrong, sluggish=bool(i // 3 % 2))
        N = round((WARM + seconds) / target.Ts)
        reference = _reference(MANOEUVRES[i % 3], rng, N, target.Ts)
        level = rng.uniform(0.0, _MOST_DISTURBED)
        pushed = level * _coloured(rng, N, target.Ts, float(np.exp(rng.uniform(*np.log(_PACE)))))
        made.append((context, loops.plant, gains, reference, level, pushed, rng.standard_normal(N)))
    contexts, vehicles, old, references, levels, pushes, noises = zip(*made, strict=True)
    plant = replace(
        vehicles[0],
        A=np.concatenate([v.A for v in vehicles]),
        B=np.concatenate([v.B for v in vehicles]),
    )
    gain, reference = np.stack(old), np.stack(references)
    added = reference / _steady(plant)[:, None] / 2 if forward else np.zeros_like(reference)
    _, clean, _ = drive(plant, gain, target, reference, added)
    sigma = np.sqrt((clean**2).mean(axis=1, keepdims=True)) * 10 ** (-_SNR / 20)
    push, noise = np.stack(pushes), sigma * np.stack(noises)
    if np.isfinite(fastest):
        u, y = _rate_limited(plant, gain, target, reference, push, noise, fastest * target.Ts)
    else:
        u, y, _ = drive(plant, gain, target, reference, added + push, noise)
    kept = slice(round(WARM / target.Ts), None)
    kinds = tuple(MANOEUVRES[i % 3] for i in range(count))
    speeds = np.array([float(np.ravel(c.v_x)[0]) for c in contexts])
    return Drives(
        kinds, Loops.of(plant, target), gain, reference[:, kept], (u + added)[:, kept],
        y[:, kept], np.array(levels), speeds,
    )  # fmt: skip


def study(tuner: Tuner, *, drives: int, others: int, seed: int) -> list[Row]:
    """Rows of every condition; of the first forty drives once more on their own."""
    rows = []
    for name, changes in _CHANGES.items():
        if count := drives if not changes else others:
            made = driven(count, seed, **changes)
            for way in WAYS:
                results = tuner.results(made.recording(way))
                if not changes:
                    rows += _rows(FIRST, way, made, results, min(count, 40))
                rows += _rows(name, way, made, results, count)
    return rows


def _rows(
    condition: str, way: str, drives: Drives, results: Sequence[Result], count: int
) -> list[Row]:
    """Of the first `count` drives, by manoeuvre."""
    gains = np.array([list(result.gains.values()) for result in results])
    good = drives.good(gains)
    usable, with_care, refused = (
        np.array([r.verdict is v for r in results])
        for v in (Verdict.USABLE, Verdict.USABLE_WITH_CARE, Verdict.REFUSE)
    )
    flagged = np.array([_flagged(result) for result in results])
    found, first = (
        (good, usable, with_care, ~refused & ~good, flagged),
        np.arange(len(good)) < count,
    )
    rows = []
    for kind in MANOEUVRES:
        of = first & np.array([m == kind for m in drives.manoeuvre])
        counts = (int((of & flags).sum()) for flags in found)
        rows.append(Row(condition, way, kind, int(of.sum()), *counts))
    return rows


def _flagged(result: Result) -> bool:
    names = "feedback", "reference"
    return any(check.name in names and not check.passed for check in result.checks)


def _controlled(
    rng: Rng, target: Target, wrong: float, sluggish: bool
) -> tuple[Context, Loops, Array]:
    """A vehicle, its loops, and bad gains (2,)."""
    vehicle = Vehicle()
    for _ in range(_TRIES):
        mu_s, M_delta = rng.uniform(0.3, 1.1), rng.uniform(0.0, 300.0)
        context = Context.of(mu_s, M_delta, rng.uniform(*_SPEED))
        for name in _WRONG if wrong else ():
            context = scaled(vehicle, context, name, np.array([1 + rng.uniform(-wrong, wrong)]))
        plant = plants(vehicle, context, target.Ts)
        margin = rng.uniform(60.0, 90.0) if sluggish else rng.uniform(5.0, 20.0)
        pace = rng.uniform(0.4, 0.8) if sluggish else rng.uniform(1.2, 2.6)
        old = Loops.of(plant, replace(target, phase_margin=margin, crossover=pace))
        found = old.design()
        if found.status[0] == Status.OK and old.evaluate(found.kp, found.Ti).stable[0]:
            return context, Loops.of(plant, target), np.array([found.kp[0], found.Ti[0]])
    raise ValueError("no vehicle has such gains. Ask for another speed.")


def _reference(kind: str, rng: Rng, N: int, Ts: float) -> Array:
    """A yaw-rate reference (N,) [rad/s]."""
    time, reference, k = Ts * np.arange(N, dtype=np.float64), np.zeros(N), 0
    if kind == "slow weave":
        size, phase = rng.uniform(3.0, 6.0) * _DEGREE, rng.uniform(0.0, 2 * np.pi)
        found: Array = weave(time, size, rng.uniform(0.15, 0.35), phase)[0]
        return found
    while k < N:
        if kind == "steps":
            reference[k:] = rng.uniform(-6.0, 6.0) * _DEGREE
            k += round(rng.uniform(0.8, 2.5) / Ts)
        else:
            length = round(rng.uniform(1.5, 3.0) / Ts)
            size = rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 7.0) * _DEGREE
            period = size * np.sin(2 * np.pi * np.arange(length) / length)
            reference[k : k + length] = period[: N - k]
            k += length + round(rng.uniform(0.5, 2.0) / Ts)
    return reference


def _coloured(rng: Rng, N: int, Ts: float, pace: float) -> Array:
    """Noise (N,) of variance one and a bandwidth of `pace` [Hz]."""
    pole, white = np.exp(-2 * np.pi * pace * Ts), rng.standard_normal(N)
    white[1:] *= np.sqrt(1 - pole**2)
    for k in range(1, N):
        white[k] += pole * white[k - 1]
    return white


def _steady(plant: DiscretePlant) -> Array:
    """Steady gains (B,)."""
    states = np.linalg.solve(np.eye(plant.A.shape[1]) - plant.A, plant.B[..., None])[..., 0]
    return np.asarray(states @ plant.C)


def _rate_limited(
    plant: DiscretePlant, gains: Array, target: Target, reference: Array, push: Array,
    noise: Array, step: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Commands and yaw rates (B, N) where the actuator moves by `step` a sample at most."""
    kp, Ti = gains.T
    n1, n0 = kp * (1 + target.Ts / (2 * Ti)), kp / Ti
    x, w, at = np.zeros(plant.B.shape), np.zeros(len(kp)), np.zeros(len(kp))
    u, y = np.empty(reference.shape), np.empty(reference.shape)
    for k in range(reference.shape[1]):
        y[:, k] = x @ plant.C + noise[:, k]
        error = reference[:, k] - y[:, k]
        u[:, k] = n1 * error + n0 * w
        w += target.Ts * error
        at += np.clip(u[:, k] - at, -step, step)
        x = np.einsum("bij,bj->bi", plant.A, x) + plant.B * (at + push[:, k])[:, None]
    return u, y
