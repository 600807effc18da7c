"""Whether tuners know when not to be trusted.

Four questions, each on episodes that no training and no calibration saw: faulty and
foreign recordings (`studies.faults`), usual ones, usable ones of an unusual experiment,
and whether intervals of 90 % hold nine times in ten.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies import faults
from studies.draws import task_of
from studies.faulty import Faulty, claimed_speed, of_prior
from studies.markdown import table
from tuners import Tuner
from tuners.trust.bound import cramer_rao
from tuners.tuner.recording import Recording
from tuners.tuner.training import assessed
from yawrate_env.loop.simulation import simulate
from yawrate_env.signals.excitation import RANDOM_ORDER, prbs
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

MISS = (3.0, 0.15)
"""Gains miss where the true phase_margin [deg] or crossover [Hz] is off by more."""

_BATCH = 100


@dataclass(frozen=True, slots=True)
class Count:
    """What became of the recordings of one kind.

    Attributes
    ----------
    kind : str
        Which.
    recordings, misses, unstable : int
        All; those whose gains miss, unstable loops among them; unstable loops.
    trusted, trusted_misses : int
        Those that are usable without care, and that should not have been.
    real : bool
        Whether there is a vehicle behind them.
    """

    kind: str
    recordings: int
    misses: int
    unstable: int
    trusted: int
    trusted_misses: int
    real: bool = True


@dataclass(frozen=True, slots=True)
class Coverage:
    """How often the intervals hold, for some vehicles.

    Attributes
    ----------
    vehicles : str
        Which.
    episodes : int
        How many.
    phase_margin, crossover : float
        Share of episodes whose true value lies inside.
    width : tuple of float
        Mean full width [deg], [Hz].
    bound : tuple of float
        Width that the Cramer-Rao bound and a normal error would give.
    """

    vehicles: str
    episodes: int
    phase_margin: float
    crossover: float
    width: tuple[float, float]
    bound: tuple[float, float]


def faulty(tuner: Tuner, count: int, seed: int, progress: Progress | None = None) -> list[Count]:
    """Every kind of `studies.faults.KINDS`, `count` recordings each."""
    rows, task = [], task_of(tuner.plant)
    for number, (name, kind) in enumerate(faults.KINDS.items()):
        made = kind(task, np.random.default_rng((seed, number)), count)
        good, stable, trusted = [], [], []
        for i in range(0, count, _BATCH):
            part = slice(i, min(i + _BATCH, count))
            gains, found = tuner.assess(made.part(part).recording)
            trusted.append(found.verdicts == 0)
            g, s = _evaluated(task, made.part(part), gains.values)
            good.append(g)
            stable.append(s)
        rows.append(_count(name, *map(np.concatenate, (good, stable, trusted)), real=made.real))
        if progress is not None:
            progress("faulty recordings", number + 1, len(faults.KINDS))
    return rows


def usual(tuner: Tuner, episodes: int, seed: int, progress: Progress | None = None) -> Count:
    """Episodes of the ``test`` set."""
    plant, good, trusted, done = tuner.plant, [], [], 0
    for block, found, actual in assessed(tuner, "test", episodes, seed):
        done += len(block)
        good.append(_good(task_of(plant), actual))
        trusted.append(found.verdicts == 0)
        if progress is not None:
            progress("usual episodes", done, episodes)
    ok = np.concatenate(good)
    return _count("usual episodes", ok, ok, np.concatenate(trusted))


def unusual(tuner: Tuner, count: int, seed: int, progress: Progress | None = None) -> list[Count]:
    """Experiments that no training saw, `count` recordings of each kind."""
    rows, task = [], task_of(tuner.plant)
    for number, (name, experiment) in enumerate(UNUSUAL.items()):
        rng = np.random.default_rng((seed, number))
        good, stable, trusted = [], [], []
        for done in range(count):
            context = of_prior(task, rng, 1)
            recording = experiment(task, context, rng)
            gains, found = tuner.assess(recording)
            g, s = _evaluated(task, Faulty(recording, context), gains.values)
            good.append(g)
            stable.append(s)
            trusted.append(found.verdicts == 0)
            if progress is not None:
                progress(name, done + 1, count)
        rows.append(_count(name, *map(np.concatenate, (good, stable, trusted))))
    return rows


def coverage(
    tuner: Tuner, episodes: int, seed: int, progress: Progress | None = None
) -> list[Coverage]:
    """Intervals on ``test`` episodes: all of them, and each third of friction."""
    plant, done = tuner.plant, 0
    inside, width, bound, friction = [], [], [], []
    for block, found, actual in assessed(tuner, "test", episodes, seed):
        half = np.array(tuner.calibration) * found.spread
        inside.append(np.abs(actual - found.metrics) <= half)
        width.append(2 * half)
        bound.append(2 * 1.6449 * cramer_rao(plant, block.theta, block.u))
        friction.append(block.theta[:, 0])
        done += len(block)
        if progress is not None:
            progress("coverage", done, episodes)
    columns = [np.concatenate(x) for x in (inside, width, bound)]
    mu_s = np.concatenate(friction)
    low, high = plant.prior["mu_s"]
    edges = np.linspace(low, high, 4)
    groups = {"all": np.ones(len(mu_s), dtype=bool)}
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        groups[f"friction {low:.2f} to {high:.2f}"] = (mu_s >= low) & (mu_s <= high)
    rows = []
    for name, chosen in groups.items():
        held, wide, least = (values[chosen].mean(axis=0).tolist() for values in columns)
        count = int(chosen.sum())
        rows.append(
            Coverage(name, count, held[0], held[1], (wide[0], wide[1]), (least[0], least[1]))
        )
    return rows


def recorded(
    task: Task,
    context: Context,
    rng: np.random.Generator,
    *,
    bit_time: float = 0.1,
    snr_db: float = 30.0,
    seconds: float = 10.0,
    skipped: float = 0.0,
    bias: float = 0.0,
) -> Recording:
    """One vehicle under a random register.

    Parameters
    ----------
    bit_time, seconds : float
        Time that bits are held, and length of the recording [s].
    skipped : float
        Driven before the recording starts [s].
    bias : float
        Offset of the yaw rate, in parts of its root mean square, and of the command, in
        parts of its amplitude.
    """
    Ts, amplitude = task.experiment.Ts, task.experiment.amplitude
    N, first = round((seconds + skipped) / Ts), round(skipped / Ts)
    start = rng.integers(0, 2**63, 1, dtype=np.uint64)
    u = prbs(N, Ts, bit_time, amplitude, order=RANDOM_ORDER, start=start)
    clean = simulate(plants(task.vehicle, context, Ts), u)[:, first:]
    rms = np.sqrt((clean**2).mean())
    y = clean + rms * (10 ** (-snr_db / 20) * rng.standard_normal(clean.shape) + bias)
    shifted = np.ascontiguousarray(u[:, first:] + bias * amplitude)
    return Recording(shifted, y, Ts, claimed_speed(context.v_x))


Experiment = Callable[[Task, Context, np.random.Generator], Recording]

UNUSUAL: dict[str, Experiment] = {
    "another register and bit time (0.05 to 0.3 s)": lambda task, context, rng: recorded(
        task, context, rng, bit_time=rng.uniform(0.05, 0.3)
    ),
    "20 to 40 dB": lambda task, context, rng: recorded(
        task, context, rng, snr_db=rng.uniform(20, 40)
    ),
    "5 to 20 s": lambda task, context, rng: recorded(
        task, context, rng, seconds=rng.uniform(5, 20)
    ),
    "a start in mid-drive, offsets": lambda task, context, rng: recorded(
        task, context, rng, skipped=rng.uniform(1, 5), bias=rng.uniform(-0.5, 0.5)
    ),
    "all of these": lambda task, context, rng: recorded(
        task, context, rng, bit_time=rng.uniform(0.05, 0.3), snr_db=rng.uniform(20, 40),
        seconds=rng.uniform(5, 20), skipped=rng.uniform(1, 5), bias=rng.uniform(-0.5, 0.5),
    ),
}  # fmt: skip
"""Experiments unlike any that a tuner was trained on, which it should handle."""


def to_markdown(results: dict[str, Any]) -> str:
    """The study's tables."""
    parts = []
    for name, found in results.items():
        trusted = _trusted_table([found["usual"], *found["unusual"]])
        tables = _counts_table(found["faulty"]), trusted, _coverage_table(found["coverage"])
        parts += [f"## `{name}`\n", *tables]
    return "\n".join(parts)


def run(
    tuners: dict[str, Tuner], *, faults_each: int, episodes: int, unusual_each: int,
    covered: int, seed: int, progress: Progress | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Answers to the four questions for every tuner, as plain values."""
    return {
        name: {
            "faulty": [asdict(row) for row in faulty(tuner, faults_each, seed, progress)],
            "usual": asdict(usual(tuner, episodes, seed, progress)),
            "unusual": [asdict(row) for row in unusual(tuner, unusual_each, seed, progress)],
            "coverage": [asdict(row) for row in coverage(tuner, covered, seed + 1, progress)],
            "calibration": list(tuner.calibration),
        }
        for name, tuner in tuners.items()
    }


def _good(task: Task, margins: Array) -> NDArray[np.bool_]:
    target = np.array([task.target.phase_margin, task.target.crossover])
    return np.asarray((np.abs(margins - target) <= MISS).all(axis=1))


def _evaluated(
    task: Task, made: Faulty, gains: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether gains (B, 2) are good for the true vehicles, and whether the loops are stable."""
    margins, stable = made.reached(task, gains)
    return _good(task, margins) & stable, stable


def _count(
    kind: str,
    good: NDArray[np.bool_],
    stable: NDArray[np.bool_],
    trusted: NDArray[np.bool_],
    *,
    real: bool = True,
) -> Count:
    return Count(
        kind, len(good), int((~good).sum()), int((~stable).sum()),
        int(trusted.sum()), int((trusted & ~good).sum()), real,
    )  # fmt: skip


def _counts_table(rows: Sequence[dict[str, Any]]) -> str:
    columns = ("recordings", "misses", "unstable", "trusted", "trusted_misses")
    pooled = {key: sum(row[key] for row in rows) for key in columns}
    return table(
        ("faulty or foreign", "recordings", "gains miss", "unstable", "usable",
         "usable, missing"),
        [
            (row["kind"] + ("" if row["real"] else " (no vehicle behind it)"),
             *(row[c] for c in columns))
            for row in [*rows, {"kind": "**together**", "real": True, **pooled}]
        ],
    )  # fmt: skip


def _trusted_table(rows: Sequence[dict[str, Any]]) -> str:
    def share(row: dict[str, Any]) -> float:
        good = row["recordings"] - row["misses"]
        return float((row["trusted"] - row["trusted_misses"]) / max(good, 1))

    return table(
        ("not faulty", "recordings", "gains miss", "usable of the good", "usable and missing"),
        [
            (row["kind"], row["recordings"], row["misses"], f"{share(row):.1%}",
             row["trusted_misses"])
            for row in rows
        ],
    )  # fmt: skip


def _coverage_table(rows: Sequence[dict[str, Any]]) -> str:
    cells = []
    for row in rows:
        (w, f), (bw, bf) = row["width"], row["bound"]
        inside = f"{row['phase_margin']:.1%}", f"{row['crossover']:.1%}"
        widths = f"{w:.4f} ({bw:.4f})", f"{f:.5f} ({bf:.5f})"
        cells.append((row["vehicles"], row["episodes"], *inside, *widths))
    return table(
        ("intervals of 90 %", "episodes", "phase margin inside", "crossover inside",
         "mean width [°] (bound's)", "mean width [Hz] (bound's)"),
        cells,
    )  # fmt: skip
