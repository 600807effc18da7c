"""The paper's experiment from end to end: Table III and figures 4 to 8."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from studies import plots
from studies.bounds import bound_on, posterior_on
from studies.draws import draw, recorded
from studies.metrics import rms
from studies.players import CLIMBER, LADDER, Ladder
from studies.table3 import bound_row, page, row, times_json, to_csv, to_json
from tuners import RECIPES, Recipe, load, train
from tuners.catalogue import UNTRAINED
from tuners.features.armax import Armax, armax, simulated
from tuners.tuner.evaluation import Evaluation, Policy, evaluate
from tuners.tuner.examples import Examples, examples
from yawrate_env.files import write_text
from yawrate_env.loop import closed_loop
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.manoeuvre import double_lane_change
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

SHOWN = ("gb", "ts-ff", "ts-gbm")
"""The three methods of the paper's figures."""

PRINTED = {
    f"{name}-{text}": Recipe(Armax(Ts), RECIPES[name].learner, "gains")
    for name in ("ts-ff", "ts-gbm")
    for text, Ts in (("1khz", 0.001), ("100hz", 0.01))
}
"""The paper's own recipe as printed: gains as targets, ARMAX at either of its sampling times."""

TIMED = (*SHOWN, "bb", LADDER)
"""Those whose answers are timed in figure 7."""

ORDER = (
    "gb", *PRINTED, "ts-ff", "ts-gbm", "ts-ff-gains", "ts-gbm-gains", LADDER, "bb", "vrft", "frit",
    "nominal", "oracle",
)  # fmt: skip
"""Of the rows."""

_BATCH = 256  # episodes at a time of those whose answers are not timed

FIGURE_8 = (0.60, 44.14)
"""mu_s and M_delta [kg] of the paper's figure 8."""

Progress = Callable[[str, int, int], None]


def reproduce(
    episodes: int, seed: int, results: Path, figures: Path, times: Path, progress: Progress
) -> str:
    """Run it all and return the page of the table as Markdown.

    What another run or another processor would give otherwise, times and figure 7, goes to the
    folder `times`.  Tuners are trained afresh, on the ``train`` episodes of `seed`, and tested
    on as many episodes of ``test``.
    """
    task = Task()
    plant = yaw_rate(task)
    results.mkdir(parents=True, exist_ok=True)
    figures.mkdir(parents=True, exist_ok=True)
    times.mkdir(parents=True, exist_ok=True)
    tuners = trained(plant, episodes, seed, progress)
    found = [
        e
        for some, batch in ((printed(plant, episodes, seed, progress), _BATCH), (tuners, 1))
        for e in evaluate(
            some,
            plant,
            "test",
            episodes=episodes,
            seed=seed,
            batch=batch,
            progress=lambda done, of: progress("testing", done, of),
        )
    ]
    found = [e for name in ORDER for e in found if e.tuner == name]
    target = task.target.phase_margin, task.target.crossover
    bound = bound_on(plant, "test", seed, episodes)
    posterior = posterior_on(plant, "test", seed, episodes)
    rows = [
        *map(row, found),
        bound_row(bound, target),
        bound_row(posterior, target, "posterior spread"),
    ]  # fmt: skip
    write_text(results / "episodes.csv", to_csv(found))
    conditions = {"task": asdict(task), "episodes": episodes, "seed": seed}
    stored = to_json(rows, conditions)
    write_text(results / "table3.json", stored)
    table = page(json.loads(stored)["rows"])
    write_text(results / "table3.md", table)
    write_text(times / "times.json", times_json(found))
    draw_figures(task, found, tuners, rms(bound), seed, figures, times, progress)
    return table


def printed(plant: Plant, episodes: int, seed: int, progress: Progress) -> dict[str, Policy]:
    """The paper's recipe to the letter, trained on the episodes that the others are trained on."""
    data: dict[float, Examples] = {}
    tuners: dict[str, Policy] = {}
    for name, recipe in PRINTED.items():
        assert isinstance(recipe.features, Armax)
        Ts = recipe.features.Ts
        if Ts not in data:
            data[Ts] = examples(plant, episodes, seed, recipe.features)
        tuners[name] = train(
            recipe, plant, episodes=episodes, seed=seed, calibration=0, progress=progress,
            data=data[Ts],
        )  # fmt: skip
    return tuners


def trained(plant: Plant, episodes: int, seed: int, progress: Progress) -> dict[str, Policy]:
    """Every tuner, those of the paper trained on one common data set, and the package's ladder."""
    data = examples(
        plant,
        episodes,
        seed,
        Armax(),
        progress=lambda done, of: progress("simulating", done, of),
    )
    tuners: dict[str, Policy] = {name: load(name, plant) for name in UNTRAINED}
    for name, recipe in RECIPES.items():
        if recipe.features == Armax():
            tuners[name] = train(
                name, plant, episodes=episodes, seed=seed, calibration=0, progress=progress,
                data=data,
            )  # fmt: skip
    tuners[LADDER] = Ladder(load(CLIMBER))
    return tuners


def draw_figures(
    task: Task,
    evaluations: Sequence[Evaluation],
    tuners: Mapping[str, Policy],
    spread: NDArray[np.float64],
    seed: int,
    folder: Path,
    times: Path,
    progress: Progress,
) -> None:
    """Write fig4.png to fig8.png, and margins.png with the bound's (2,) spread as a star.

    Figure 7, the times of answers, goes to the folder `times`.
    """
    found = {e.tuner: e for e in evaluations}
    shown = {name: found[name] for name in SHOWN}
    percent = {name: row(e)["rms_percent"] for name, e in shown.items()}

    def regression(column: int, name: str, symbol: str) -> Figure:
        return plots.regression(
            found["oracle"].gains[:, column],
            {tuner: e.gains[:, column] for tuner, e in shown.items()},
            symbol,
            "s",
            {tuner: of[name] for tuner, of in percent.items()},
        )

    pictures: dict[str, Callable[[], Figure]] = {
        "fig4": lambda: _identification(yaw_rate(task), seed),
        "fig5": lambda: regression(0, "kp", "$k_p$"),
        "fig6": lambda: regression(1, "Ti", "$T_i$"),
        "fig7": lambda: plots.times({name: found[name].seconds for name in TIMED}),
        "margins": lambda: plots.margin_scatter(
            {name: (e.metrics[:, 0], e.metrics[:, 1]) for name, e in shown.items()},
            (task.target.phase_margin, task.target.crossover),
            (float(spread[0]), float(spread[1])),
            [name for name in found if name not in shown],
        ),
        "fig8": lambda: _tracking(task, {name: tuners[name] for name in SHOWN}),
    }
    for done, (name, picture) in enumerate(pictures.items(), start=1):
        plots.save(picture(), (times if name == "fig7" else folder) / f"{name}.png")
        progress("drawing", done, len(pictures))


def _identification(plant: Plant, seed: int) -> Figure:
    """Fig. 4: one test episode, noise-free, noisy, and the ARMAX model's own response."""
    drawn, stage = draw(plant, "test", seed, 0, 1), Armax()
    u, y = drawn.u, recorded(plant, drawn).y
    slow_u, slow_y = stage.averaged(u, plant.Ts), stage.averaged(y, plant.Ts)
    model = simulated(armax(slow_u, slow_y, stage.Ts).theta, slow_u)
    time = plant.Ts * np.arange(y.shape[1], dtype=np.float64)
    middle = stage.Ts * (np.arange(slow_y.shape[1], dtype=np.float64) + 0.5)
    clean = plant.respond(drawn.theta, u)[0]
    return plots.identification(time, clean, y[0], middle, model[0], u[0])


def _tracking(task: Task, tuners: Mapping[str, Policy]) -> Figure:
    """Fig. 8: the same vehicle and manoeuvre for every method."""
    plant = yaw_rate(task)
    theta = np.array([[*FIGURE_8, min(task.prior.v_x)]])
    recording = recorded(plant, replace(draw(plant, "test", 0, 0, 1), theta=theta))
    truth = loops(task, context_of(theta)).plant
    time, reference = double_lane_change(task.target.Ts)
    rates, commands = {}, {}
    for name, tuner in tuners.items():
        kp, Ti = tuner.act(recording).T
        rate, command = closed_loop.time_response(truth, kp, Ti, task.target, reference)
        rates[name], commands[name] = rate[0], command[0]
    return plots.tracking(time, reference, rates, commands)
