"""What a linear twin costs when the vehicle is not linear, at rising amplitude.

Test episodes are driven on the nonlinear vehicle and given to several tuners: the
two-stage tuner trained on the linear twin, the same recipe trained on the nonlinear twin
at that amplitude (on the vehicle's own tyres, and on tyres with less grip), and the gray
box, whose model is the linear one.  Their loops are evaluated twice: by margin and crossover
of the linearisation, as everywhere, and in time on the nonlinear vehicle.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.markdown import table
from tuners import Tuner, load, train
from tuners.tuner.evaluation import Evaluation, evaluate
from tuners.tuner.training import assessed
from yawrate_env.vehicle.nonlinear import NonlinearTwin, Tyre
from yawrate_env.vehicle.nonlinear.time_domain import time_domain
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.twin import LinearTwin
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

RECIPE = "ts-ff-lag"
AMPLITUDES = (0.5, 1.0, 2.0, 4.0)
"""Of the recorded command [deg]."""

ASKED = 256
"""Test episodes whose gains are also checked for trust."""

LOW_FRICTION = 0.5
YAW_RATE = 5.0
"""Of the step and the double lane change [deg/s]."""

WRONG = NonlinearTwin(tyre=Tyre(friction=0.9 * Tyre().friction))
"""A twin whose tyres hold 10 % less than those of the test vehicles."""

LINEAR, NONLINEAR, MISTAKEN, GRAY, ORACLE = (
    f"{RECIPE}, linear twin",
    f"{RECIPE}, nonlinear twin",
    f"{RECIPE}, nonlinear twin with 10 % less grip",
    "gb, linear model",
    "oracle",
)


@dataclass(frozen=True, slots=True)
class Score:
    """One tuner on the test episodes of one amplitude, all of them or those on low friction.

    Attributes
    ----------
    tuner : str
        And what it assumes or was trained on.
    amplitude : float
        [deg]
    low_friction : bool
        Only vehicles with mu_s below `LOW_FRICTION`.
    episodes, unstable : int
        How many, and how many of them end in an unstable loop.
    phase_margin, crossover : float
        Root mean square error [deg] and [Hz] where defined.
    overshoot : float
        Median [%].
    settling_time : float
        Median [s], counting loops that do not settle within ten seconds as ten.
    unsettled : int
        Loops that are not within 2 % of the step after ten seconds.
    tracking_error : float
        Root mean square over episodes [deg/s].
    trusted : float or None
        Share of the first `ASKED` episodes whose gains are usable without care.
    """

    tuner: str
    amplitude: float
    low_friction: bool
    episodes: int
    unstable: int
    phase_margin: float
    crossover: float
    overshoot: float
    settling_time: float
    unsettled: int
    tracking_error: float
    trusted: float | None = None


def task_at(amplitude: float, nonlinear: bool = True) -> Task:
    """The default task with commands of so many degrees."""
    experiment = Experiment(amplitude=float(np.radians(amplitude)))
    return Task(experiment=experiment, twin=NonlinearTwin() if nonlinear else LinearTwin())


def study(
    episodes: int,
    seed: int,
    progress: Progress,
    *,
    training: int = 600,
    amplitudes: Sequence[float] = AMPLITUDES,
) -> list[Score]:
    """Train, test and evaluate at every amplitude.

    Parameters
    ----------
    episodes, seed : int
        Test episodes, and the seed of these and of the training ones.
    training : int
        Vehicles that every tuner is trained on; twelve recordings of each.
    """

    def trained(task: Task) -> Tuner:
        return train(
            RECIPE, yaw_rate(task), episodes=training, seed=seed, calibration=0, progress=progress
        )  # fmt: skip

    linear = trained(task_at(1.0, nonlinear=False))
    scores = []
    for done, amplitude in enumerate(amplitudes, start=1):
        task = task_at(amplitude)
        # A linear twin's features do not depend on the amplitude: one training serves all.
        tuners = {LINEAR: linear, GRAY: load("gb", yaw_rate(task_at(amplitude, nonlinear=False)))}
        for name, twin in ((NONLINEAR, task.twin), (MISTAKEN, WRONG)):
            tuners[name] = trained(replace(task, twin=twin))
        scores += scored(task, amplitude, tuners, episodes, seed)
        progress("testing", done, len(amplitudes))
    return scores


def scored(
    task: Task, amplitude: float, tuners: Mapping[str, Tuner], episodes: int, seed: int
) -> list[Score]:
    """Scores of every tuner and of the oracle on the task's test episodes."""
    plant, few = yaw_rate(task), min(ASKED, episodes)
    given = {**tuners, ORACLE: load("oracle", plant)}
    found = evaluate(given, plant, "test", episodes=episodes, seed=seed, batch=256)
    trusted = {
        name: np.concatenate(
            [checked.verdicts == 0 for _, checked, _ in assessed(tuner, "test", few, seed, plant)]
        )
        for name, tuner in tuners.items()
    }  # fmt: skip
    return [
        _score(task, amplitude, e, low, trusted.get(e.tuner))
        for e in found
        for low in (False, True)
    ]


def _score(
    task: Task, amplitude: float, e: Evaluation, low: bool, trusted: NDArray[np.bool_] | None
) -> Score:
    """One tuner's, over all test vehicles or those on low friction."""
    part = e.theta[:, 0] < LOW_FRICTION if low else np.ones(len(e.gains), dtype=np.bool_)
    step = float(np.radians(YAW_RATE))
    in_time = time_domain(task, context_of(e.theta[part]), e.gains[part, 0], e.gains[part, 1], step)
    margin, crossover = e.errors[part].T
    settling = in_time.settling_time
    return Score(
        e.tuner,
        amplitude,
        low,
        int(part.sum()),
        int((~e.stable[part]).sum()),
        _rms(margin),
        _rms(crossover),
        float(np.median(in_time.overshoot)),
        float(np.median(np.nan_to_num(settling, nan=10.0))),
        int(np.isnan(settling).sum()),
        float(np.degrees(_rms(in_time.tracking_error))),
        None if trusted is None else float(trusted[part[:ASKED]].mean()),
    )


def factors(scores: Sequence[Score]) -> list[tuple[float, bool, float, float]]:
    """How many times closer the nonlinear twin's tuner is: amplitude, low friction, two ratios.

    The ratios are those of the errors in phase margin and in crossover.
    """
    by = {(s.tuner, s.amplitude, s.low_friction): s for s in scores}
    return [
        (
            amplitude,
            low,
            by[LINEAR, amplitude, low].phase_margin / by[NONLINEAR, amplitude, low].phase_margin,
            by[LINEAR, amplitude, low].crossover / by[NONLINEAR, amplitude, low].crossover,
        )
        for (tuner, amplitude, low) in by
        if tuner == LINEAR
    ]


def to_json(
    scores: Sequence[Score], speed: Sequence[dict[str, Any]], training: int, seed: int
) -> str:
    """Scores, speed and the conditions that they hold for."""
    conditions = {
        "task": task_at(1.0).settings(),
        "training": training,
        "seed": seed,
        "low_friction": LOW_FRICTION,
        "yaw_rate": YAW_RATE,
    }
    rows = [asdict(s) for s in scores]
    content = {"conditions": conditions, "rows": rows, "speed": list(speed)}
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


HEADS = (
    "command", "tuner", "phase margin, rms error [°]", "crossover, rms error [Hz]", "unstable",
    "overshoot [%]", "settling time [s]", "unsettled", "lane change, rms error [°/s]", "trusted",
)  # fmt: skip


def to_markdown(scores: Sequence[Score]) -> str:
    """Tables for all test vehicles and for those on low friction."""
    parts = []
    for low in (False, True):
        part = [s for s in scores if s.low_friction == low]
        which = f"mu_s below {LOW_FRICTION:g}" if low else "All test vehicles"
        parts += [f"## {which}: {part[0].episodes} episodes\n", table(HEADS, map(_cells, part))]
    closer = [
        (f"±{amplitude:g}°", "low friction" if low else "all", f"{margin:.1f}", f"{crossover:.1f}")
        for amplitude, low, margin, crossover in factors(scores)
    ]
    parts += [
        "How many times closer to the target the tuner is that was trained on the nonlinear "
        "twin:\n",
        table(("command", "vehicles", "phase margin", "crossover"), closer),
    ]
    return "\n".join(parts)


def summary(scores: Sequence[Score]) -> str:
    """What docs/nonlinear.md shows: rms errors of the phase margin, and who is closer."""
    tuners = list(dict.fromkeys(s.tuner for s in scores if s.tuner != "oracle"))
    largest = max(s.amplitude for s in scores)
    rows = [
        (f"±{amplitude:g}°{', μ_s < ' + format(LOW_FRICTION, 'g') if low else ''}",
         *(f"{margins[tuner]:#.2g}°" for tuner in tuners))
        for low in (False, True)
        for amplitude in dict.fromkeys(s.amplitude for s in scores)
        if not low or amplitude == largest
        for margins in [{s.tuner: s.phase_margin for s in scores
                         if (s.amplitude, s.low_friction) == (amplitude, low)}]
    ]  # fmt: skip
    return f"{table(('command', *tuners), rows)}\n{_closer(scores, largest)}"


def _closer(scores: Sequence[Score], amplitude: float) -> str:
    """At one amplitude: how the twins' tuners compare, and how many answers are usable."""
    here = {(s.tuner, s.low_friction): s for s in scores if s.amplitude == amplitude}
    (_, _, *every), (_, _, *low) = (f for f in factors(scores) if f[0] == amplitude)
    mistaken = here[LINEAR, False].phase_margin / here[MISTAKEN, False].phase_margin
    usable = [here[name, False].trusted or 0.0 for name in (NONLINEAR, LINEAR)]
    return (
        f"At ±{amplitude:g}° the tuner of the nonlinear twin is {every[0]:.3g} times closer to the "
        f"target phase margin than that of the linear twin, and {every[1]:.3g} times closer to the "
        f"crossover; {low[0]:.3g} and {low[1]:.3g} times where μ_s < {LOW_FRICTION:g}. That of the "
        f"twin with less grip is {mistaken:.2g} times closer to the phase margin. Of {ASKED} "
        f"answers of the nonlinear twin's tuner {usable[0]:.0%} are usable, of the linear twin's "
        f"{usable[1]:.0%}."
    )


def _cells(s: Score) -> tuple[object, ...]:
    return (
        f"±{s.amplitude:g}°", s.tuner, f"{s.phase_margin:.3g}", f"{s.crossover:.3g}", s.unstable,
        f"{s.overshoot:.1f}", f"{s.settling_time:.2f}", s.unsettled, f"{s.tracking_error:.3f}",
        "" if s.trusted is None else f"{s.trusted:.1%}",
    )  # fmt: skip


def _rms(values: Array) -> float:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
