"""What a linear twin costs when the vehicle is not linear, at rising amplitude.

Test episodes are driven on the nonlinear vehicle.  Tuners answer them: the
two-stage tuner trained on the linear twin, the same recipe trained on the nonlinear twin
at that amplitude (on the vehicle's own tyres, and on tyres with less grip), and the gray
box, whose model is the linear one.  Their loops are judged twice: by margin and crossover
of the linearisation, as everywhere, and in time on the nonlinear vehicle.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.catalogue import train
from tuners.trust.vehicle_calibration import assessed
from tuners.tuner.evaluation import Evaluation, evaluate
from tuners.tuner.gray_box import GrayBox
from tuners.tuner.tuner import Tuner
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.nonlinear import NonlinearTwin, Tyre
from yawrate_env.vehicle.nonlinear.time_domain import time_domain
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.twin import LinearTwin

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

RECIPE = "ts-ff-lag"
AMPLITUDES = (0.5, 1.0, 2.0, 4.0)
"""Of the recorded command [deg]."""

ASKED = 256
"""Test episodes that tuners are asked whether to trust their answers to."""

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
        Share of the first `ASKED` episodes whose gains are trusted.
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
    """Train, test and judge at every amplitude.

    Parameters
    ----------
    episodes, seed : int
        Test episodes, and the seed of these and of the training ones.
    training : int
        Vehicles that every tuner is trained on; twelve recordings of each.
    """
    linear = train(RECIPE, task_at(1.0, nonlinear=False), episodes=training, seed=seed,
                   progress=progress)  # fmt: skip
    scores = []
    for done, amplitude in enumerate(amplitudes, start=1):
        task = task_at(amplitude)
        # A linear twin's features do not depend on the amplitude: one training serves all.
        tuners: dict[str, Tuner] = {LINEAR: linear, GRAY: GrayBox(task)}
        for name, twin in ((NONLINEAR, task.twin), (MISTAKEN, WRONG)):
            tuners[name] = train(RECIPE, replace(task, twin=twin), episodes=training, seed=seed,
                                 progress=progress)  # fmt: skip
        scores += metric_values(task, amplitude, tuners, episodes, seed)
        progress("testing", done, len(amplitudes))
    return scores


def metric_values(
    task: Task, amplitude: float, tuners: Mapping[str, Tuner], episodes: int, seed: int
) -> list[Score]:
    """Scores of every tuner and of the oracle on the task's test episodes."""
    found = evaluate(tuners, task, CONTEXT_SETS["test"], episodes=episodes, seed=seed, batch=256)
    trusted = {name: _trusted(tuner, task, min(ASKED, episodes), seed)
               for name, tuner in tuners.items()}  # fmt: skip
    scores = []
    for e in [*found, _oracle(task, found[0].context)]:
        in_time = time_domain(task, e.context, e.kp, e.Ti, float(np.radians(YAW_RATE)))
        for low in (False, True):
            part = e.context.mu_s < LOW_FRICTION if low else np.ones(len(e.kp), dtype=np.bool_)
            settling = in_time.settling_time[part]
            asked = trusted[e.tuner][part[:ASKED]] if e.tuner in trusted else None
            scores.append(
                Score(
                    e.tuner,
                    amplitude,
                    low,
                    int(part.sum()),
                    int((~e.stable[part]).sum()),
                    _rms(e.phase_margin[part] - task.target.phase_margin),
                    _rms(e.crossover[part] - task.target.crossover),
                    float(np.median(in_time.overshoot[part])),
                    float(np.median(np.nan_to_num(settling, nan=10.0))),
                    int(np.isnan(settling).sum()),
                    float(np.degrees(_rms(in_time.tracking_error[part]))),
                    None if asked is None else float(asked.mean()),
                )
            )
    return scores


def _trusted(tuner: Tuner, task: Task, episodes: int, seed: int) -> NDArray[np.bool_]:
    """Whether the answers to the task's first test episodes are trusted, (episodes,)."""
    rows = assessed(tuner, "test", episodes, seed, task)
    return np.concatenate([found.trusted for _, found, _ in rows])


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
        "task": asdict(task_at(1.0)),
        "training": training,
        "seed": seed,
        "low_friction": LOW_FRICTION,
        "yaw_rate": YAW_RATE,
    }
    rows = [asdict(s) for s in scores]
    content = {"conditions": conditions, "rows": rows, "speed": list(speed)}
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def to_markdown(scores: Sequence[Score]) -> str:
    """Tables for all test vehicles and for those on low friction."""
    lines = []
    for low in (False, True):
        part = [s for s in scores if s.low_friction == low]
        which = f"mu_s below {LOW_FRICTION:g}" if low else "All test vehicles"
        lines += [
            f"## {which}: {part[0].episodes} episodes",
            "",
            "| command | tuner | phase margin, rms error [°] | crossover, rms error [Hz] "
            "| unstable | overshoot [%] | settling time [s] | unsettled "
            "| lane change, rms error [°/s] | trusted |",
            "|---|---|---|---|---|---|---|---|---|---|",
        ]
        lines += [
            f"| ±{s.amplitude:g}° | {s.tuner} | {s.phase_margin:.3g} | {s.crossover:.3g} "
            f"| {s.unstable} | {s.overshoot:.1f} | {s.settling_time:.2f} | {s.unsettled} "
            f"| {s.tracking_error:.3f} | {'' if s.trusted is None else f'{s.trusted:.1%}'} |"
            for s in part
        ]
        lines.append("")
    lines += [
        "How many times closer to the target the tuner is that was trained on the nonlinear twin:",
        "",
        "| command | vehicles | phase margin | crossover |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| ±{amplitude:g}° | {'low friction' if low else 'all'} | {margin:.1f} | {crossover:.1f} |"
        for amplitude, low, margin, crossover in factors(scores)
    ]
    return "\n".join(lines) + "\n"


def _oracle(task: Task, context: Context) -> Evaluation:
    """The design rule that knows the vehicles, as an evaluation."""
    judge = loops(task, context)
    design = judge.design()
    verdict = judge.evaluate(design.kp, design.Ti)
    margins = verdict.margins
    return Evaluation(ORACLE, context, design.kp, design.Ti, margins.phase_margin,
                      margins.crossover, verdict.stable, np.zeros_like(design.kp))  # fmt: skip


def _rms(values: Array) -> float:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
