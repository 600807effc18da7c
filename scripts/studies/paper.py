"""The paper's experiment from end to end: Table III and figures 4 to 8."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from studies import plots
from studies.table import bound_row, row, to_json, to_markdown
from tuners.catalogue import RECIPES, UNTRAINED, train
from tuners.features.armax import Armax, armax, simulated
from tuners.trust.vehicle_bound import cramer_rao, posterior_spread
from tuners.tuner.evaluation import Evaluation, evaluate, write_csv
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.files import write_text
from yawrate_env.loop import closed_loop
from yawrate_env.loop.simulation import simulate
from yawrate_env.plant.episodes import examples
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import Draw, loops, plants, record
from yawrate_env.vehicle.manoeuvre import double_lane_change
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

SHOWN = ("gb", "ts-ff", "ts-gbm")
"""The three methods of the paper's figures."""

FIGURE_8 = (0.60, 44.14)
"""mu_s and M_delta [kg] of the paper's figure 8."""

Progress = Callable[[str, int, int], None]


def reproduce(episodes: int, seed: int, results: Path, figures: Path, progress: Progress) -> str:
    """Run it all and return the table as Markdown.

    Tuners are trained afresh, on the ``train`` episodes of `seed`, and tested on as many
    episodes of ``test``.
    """
    task = Task()
    results.mkdir(parents=True, exist_ok=True)
    figures.mkdir(parents=True, exist_ok=True)
    tuners = trained(task, episodes, seed, progress)
    found = evaluate(
        tuners,
        task,
        CONTEXT_SETS["test"],
        episodes=episodes,
        seed=seed,
        progress=lambda done, of: progress("testing", done, of),
    )
    draw = CONTEXT_SETS["test"].draw(task.prior, seed, 0, episodes)
    rows = [row(e, task) for e in found]
    bound = cramer_rao(task, draw)
    rows.append(bound_row(bound, task))
    rows.append(bound_row(posterior_spread(task, draw), task, "posterior spread"))
    write_csv(results / "episodes.csv", found)
    conditions = {"task": asdict(task), "episodes": episodes, "seed": seed}
    write_text(results / "table3.json", to_json(rows, conditions))
    write_text(results / "table3.md", to_markdown(rows))
    spread = np.sqrt((bound**2).mean(axis=0))
    draw_figures(task, {e.tuner: e for e in found}, tuners, spread, seed, figures, progress)
    return to_markdown(rows)


def trained(task: Task, episodes: int, seed: int, progress: Progress) -> dict[str, Tuner]:
    """Every tuner, those of the paper trained on one common data set."""
    data = examples(
        yaw_rate(task),
        episodes,
        seed,
        Armax(),
        progress=lambda done, of: progress("simulating", done, of),
    )
    tuners: dict[str, Tuner] = {name: cls(task) for name, cls in UNTRAINED.items()}
    for name, recipe in RECIPES.items():
        if recipe.compressor == Armax():
            tuners[name] = train(
                name, task, episodes=episodes, seed=seed, progress=progress, dataset=data
            )
    order = ("gb", "ts-ff", "ts-gbm", "ts-ff-gains", "ts-gbm-gains", "nominal", "oracle")
    return {name: tuners[name] for name in order}


def draw_figures(
    task: Task,
    found: Mapping[str, Evaluation],
    tuners: Mapping[str, Tuner],
    spread: NDArray[np.float64],
    seed: int,
    folder: Path,
    progress: Progress,
) -> None:
    """Write fig4.png to fig8.png, and margins.png with the bound's (2,) spread as a star."""
    shown = {name: found[name] for name in SHOWN}
    oracle = found["oracle"]
    percent = {name: row(e, task)["rms_percent"] for name, e in shown.items()}
    pictures: dict[str, Callable[[], Figure]] = {
        "fig4": lambda: _identification(task, seed),
        "fig5": lambda: plots.regression(
            oracle.kp,
            {name: e.kp for name, e in shown.items()},
            "$k_p$",
            "s",
            {name: p["kp"] for name, p in percent.items()},
        ),
        "fig6": lambda: plots.regression(
            oracle.Ti,
            {name: e.Ti for name, e in shown.items()},
            "$T_i$",
            "s",
            {name: p["Ti"] for name, p in percent.items()},
        ),
        "fig7": lambda: plots.times({name: e.seconds for name, e in shown.items()}),
        "margins": lambda: plots.margin_scatter(
            {name: (e.phase_margin, e.crossover) for name, e in shown.items()},
            (task.target.phase_margin, task.target.crossover),
            (float(spread[0]), float(spread[1])),
        ),
        "fig8": lambda: _tracking(task, {name: tuners[name] for name in SHOWN}),
    }
    for done, (name, picture) in enumerate(pictures.items(), start=1):
        plots.save(picture(), folder / f"{name}.png")
        progress("drawing", done, len(pictures))


def _identification(task: Task, seed: int) -> Figure:
    """Fig. 4: one test episode, noise-free, noisy, and the ARMAX model's own response."""
    draw = CONTEXT_SETS["test"].draw(task.prior, seed, 0, 1)
    u, y = record(task, draw)
    clean = simulate(plants(task.vehicle, draw.context, task.experiment.Ts), u)
    stage = Armax()
    slow_u, slow_y = stage.averaged(u, task.experiment.Ts), stage.averaged(y, task.experiment.Ts)
    model = simulated(armax(slow_u, slow_y, stage.Ts).theta, slow_u)
    time = task.experiment.Ts * np.arange(task.experiment.N, dtype=np.float64)
    middle = stage.Ts * (np.arange(slow_y.shape[1], dtype=np.float64) + 0.5)
    measured = np.asarray(y[0], dtype=np.float64)
    return plots.identification(time, clean[0], measured, middle, model[0], u[0])


def _tracking(task: Task, tuners: Mapping[str, Tuner]) -> Figure:
    """Fig. 8: the same vehicle and manoeuvre for every method."""
    context = Context.of(*FIGURE_8, task.prior.v_x[0])
    judge = loops(task, context)
    drawn = CONTEXT_SETS["test"].draw(task.prior, 0, 0, 1)
    u, y = record(task, Draw(context, drawn.start, drawn.key))
    recording = Recording(u, np.asarray(y), task.experiment.Ts, context.v_x, context)
    time, reference = double_lane_change(task.target.Ts)
    rates, commands = {}, {}
    for name, tuner in tuners.items():
        kp, Ti = tuner.act(recording).T
        rate, command = closed_loop.time_response(judge.plant, kp, Ti, task.target, reference)
        rates[name], commands[name] = rate[0], command[0]
    return plots.tracking(time, reference, rates, commands)
