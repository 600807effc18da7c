"""The speed of every stage beside its rivals and limits, and what each tuner costs (fig. 7)."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from benchmarks import rivals, throughput
from benchmarks.stopwatch import Contender, Times, race
from studies.draws import draw
from studies.draws import recorded as recorded_draw
from tuners import RECIPES, load, train
from tuners.features.armax import armax
from tuners.features.laguerre import Laguerre
from tuners.trust.identification import identify
from tuners.tuner.examples import examples
from tuners.tuner.recording import Recording
from yawrate_env.batch import take
from yawrate_env.compiled import LANES
from yawrate_env.loop.simulation import simulate
from yawrate_env.plant.episodes import BLOCK
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import Context, context_of
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Progress = Callable[[str, int, int], None]

TUNERS = ("ts-ff-lag", "ts-gbm-lag", "ts-ff", "ts-gbm", "gb")
BASIS = Laguerre(order=8, pole=12.0)
_SLOW = 3  # rounds of those that take seconds an episode
ONE = slice(0, 1)

BATCHES = 64, 256
"""Sizes of the batch environment, beside the one that is asked for."""

ANSWERS = {
    "Gains, one episode alone": "same",
    "Gains, episodes with one input": "same",
    "Gains, episodes with an input each": "random",
}
"""How tuners are asked, and the register of the episodes."""


def stages(batch: int, rounds: int, progress: Progress) -> dict[str, Times]:
    """Time an episode takes in every stage, ours first, then alternatives and limits."""
    contenders: dict[str, Callable[[int], dict[str, Contender]]] = {
        "Noise-free simulation": simulations,
        "ARMAX fit at 1 kHz": armax_fits,
        "Gray box": gray_boxes,
        "Laguerre fit": laguerre_fits,
        **{title: partial(answers, title) for title in ANSWERS},
    }

    def reported(title: str) -> Callable[[int, int], None]:
        return lambda done, of: progress(title, done, of)

    found = {
        title: throughput.measure(count, rounds, reported(title))
        for count in sorted({*BATCHES, batch})
        for title in [f"Environment, {count}"]
    }
    for title, entrants in contenders.items():
        found[title] = race(entrants(batch), rounds, reported(title))
    return found


def simulations(batch: int) -> dict[str, Contender]:
    """Noise-free responses; the product has the recursion's three multiply-adds a state."""
    context, recording = recorded(batch, "same")
    u, y = recording.u, np.empty_like(recording.y)
    many = plants(Task().vehicle, context, recording.Ts)
    one = plants(Task().vehicle, take(context, ONE), recording.Ts)
    square = np.ones((round((18 * y.size) ** (1 / 3)),) * 2)
    found = {
        f"ours, {batch} side by side": Contender(lambda: len(simulate(many, u))),
        "ours, one alone": Contender(lambda: len(simulate(one, u))),
    }
    found |= _one_each(rivals.simulations(Task(), context, u[0]))
    found["limit: one matrix product of the same size"] = _of(batch, lambda: square @ square)
    found["limit: copying the responses"] = _of(batch, lambda: np.copyto(y, recording.y))
    return found


def armax_fits(batch: int) -> dict[str, Contender]:
    """ARMAX(2, 2, 2, 1) models."""
    _, recording = recorded(batch, "same")
    u, y, Ts = recording.u, recording.y, recording.Ts
    return {
        f"ours, {batch} side by side": _of(batch, lambda: armax(u, y, Ts)),
        "ours, one alone": _of(1, lambda: armax(u, y[ONE], Ts)),
        **_one_each(rivals.armax_fits(u[0], y[0]), _SLOW),
    }


def gray_boxes(batch: int) -> dict[str, Contender]:
    """Friction and mass of a vehicle."""
    plant, (_, recording) = yaw_rate(Task()), recorded(batch, "same")
    alone = recording.part(ONE)

    def ours(part: Recording) -> Contender:
        return _of(len(part), lambda: identify(plant, part.u, part.y))

    rival = rivals.gray_box(Task(), recording)
    return {
        f"ours, {batch} side by side": ours(recording),
        "ours, one alone": ours(alone),
        **_one_each({"scipy least_squares around python-control": rival}, _SLOW),
    }


def laguerre_fits(batch: int) -> dict[str, Contender]:
    """Coefficients on Laguerre functions; the product is all that one input leaves to do."""
    (_, same), (_, own) = recorded(batch, "same"), recorded(batch, "random")
    phi = BASIS.regressors(same.u, same.Ts)[0]
    return {
        f"ours, {batch} with one input": _of(batch, lambda: BASIS(same.u, same.y, same.Ts)),
        f"ours, {batch} with an input each": _of(batch, lambda: BASIS(own.u, own.y, own.Ts)),
        "ours, one alone": _of(1, lambda: BASIS(same.u, same.y[ONE], same.Ts)),
        **_one_each({"scipy lfilter and numpy lstsq": rivals.laguerre(BASIS, own)}),
        "limit: the one matrix product, all cores": _of(batch, lambda: phi @ same.y.T),
        "limit: reading the outputs": _of(batch, lambda: same.y.sum()),
    }


def answers(how: str, batch: int) -> dict[str, Contender]:
    """From raw arrays to gains by every tuner, in one of the ways of `ANSWERS`."""
    _, recording = recorded(batch, ANSWERS[how])
    part = recording.part(ONE) if how == next(iter(ANSWERS)) else recording
    acts = {name: load(name).act for name in TUNERS}
    return {name: _of(len(part), partial(act, part)) for name, act in acts.items()}


def recorded(batch: int, register: str) -> tuple[Context, Recording]:
    """Vehicles and episodes of the test set."""
    plant = yaw_rate(Task(experiment=Experiment(register=register)))
    drawn = draw(plant, "test", 0, 0, batch)
    return context_of(drawn.theta), recorded_draw(plant, drawn)


def growth(sizes: Sequence[int]) -> dict[str, list[dict[str, float]]]:
    """Seconds that Laguerre features and targets take, by `sizes` of data sets and by samples.

    Memory is the process's largest so far: measure in a fresh one.  The ``first`` data set of its
    length takes memory that the process never had, and is beside the median of the next three.
    """
    found: dict[str, list[dict[str, float]]] = {"episodes": [], "samples": []}
    _dataset(LANES, Experiment())  # loads the kernels
    for size in sizes:
        found["episodes"].append({"size": size, **_dataset(size, Experiment())})
    for N in (1_000, 10_000, 100_000, 200_000):
        count = int(np.clip(4_000_000 // N, BLOCK, 2 * BLOCK))  # blocks are computed whole
        first, *more = (_dataset(count, Experiment(N=N)) for _ in range(4))
        seconds = float(np.median([row["seconds"] for row in more]))
        row = first | {"seconds": seconds, "first": first["seconds"]}
        found["samples"].append({"size": N, **row})
    return found


def decades(largest: int) -> list[int]:
    """Four sizes a factor ten apart, the last being the largest."""
    return [largest // 10**k for k in (3, 2, 1, 0)]


def trainings(episodes: int, progress: Progress) -> dict[str, float]:
    """Seconds from nothing to a trained tuner, simulation included."""
    found = {}
    for name in RECIPES:
        start = time.perf_counter()
        train(name, episodes=episodes, calibration=0, progress=progress)
        found[name] = time.perf_counter() - start
    return found


def first_calls() -> dict[str, dict[str, float]]:
    """Seconds of what a process does first, with compilation (``cold``) and from the cache."""
    found = {}
    for what, (preparation, work) in _FIRST_CALLS.items():
        program = f"{preparation}\nimport time; t = time.perf_counter(); {work}; "
        with tempfile.TemporaryDirectory() as cache:
            cold, cached = (
                float(in_fresh_process(program + "print(time.perf_counter() - t)", cache))
                for _ in range(2)
            )
        found[what] = {"cold": cold, "cached": cached}
    return found


def in_fresh_process(program: str, cache: str | None = None) -> str:
    """What a Python program prints, with the compiled kernels in a folder of its own."""
    inherited = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    if cache is not None:
        inherited["NUMBA_CACHE_DIR"] = cache
    done = subprocess.run(
        [sys.executable, "-c", program], env=inherited, check=True, capture_output=True, text=True
    )
    return done.stdout


def commands(rounds: int) -> Times:
    """Seconds from the shell to the end of commands, beside the import of NumPy."""
    with tempfile.TemporaryDirectory() as folder:
        report = str(Path(folder) / "report.html")
        asked = {
            "python -c 'import numpy'": ["-c", "import numpy"],
            "yawrate --help": [*_COMMAND, "--help"],
            "yawrate tune": [*_COMMAND, "tune", str(_LOG)],
            "yawrate tune --report": [*_COMMAND, "tune", str(_LOG), "--report", report],
        }
        return race(
            {name: _of(1, partial(_call, words)) for name, words in asked.items()},
            rounds,
            lambda done, of: None,
        )


def first_answer() -> float:
    """Seconds of `yawrate tune` where nothing is compiled yet."""
    with tempfile.TemporaryDirectory() as cache:
        start = time.perf_counter()
        _call([*_COMMAND, "tune", str(_LOG)], {"NUMBA_CACHE_DIR": cache})
        return time.perf_counter() - start


def _call(words: Sequence[str], variables: Mapping[str, str] = MappingProxyType({})) -> None:
    inherited = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | dict(variables)
    subprocess.run([sys.executable, *words], env=inherited, check=True, capture_output=True)


_COMMAND = "-m", "tuners.cli"
_LOG = Path(__file__).parents[2] / "examples" / "log.csv"


def growth_in_fresh_process(sizes: Sequence[int]) -> dict[str, list[dict[str, float]]]:
    """`growth`, where nothing else has used memory."""
    measured = f"json.dumps(stages.growth({list(sizes)}))"
    program = f"import json; from benchmarks import stages; print({measured})"
    return dict(json.loads(in_fresh_process(program)))


_ARRAYS = "import numpy as np, tuners; u = np.resize([0.02] * 100 + [-0.02] * 100, 10_000)"
_FIRST_CALLS = {
    "import yawrate_env": ("", "import yawrate_env"),
    "gymnasium.make and reset": (
        "import gymnasium, yawrate_env",
        "gymnasium.make('yawrate/PITuning-v0').reset(seed=0)",
    ),
    **{
        f"load {name} and tune": (_ARRAYS, f"tuners.load('{name}').tune(u, u, 0.001)")
        for name in TUNERS
    },
}


def _dataset(count: int, experiment: Experiment) -> dict[str, float]:
    start, task = time.perf_counter(), Task(experiment=experiment)
    examples(yaw_rate(task), count, 0, BASIS)
    seconds = time.perf_counter() - start
    return {"count": count, "seconds": seconds, "megabytes": _peak_megabytes()}


def _peak_megabytes() -> float:
    """Most memory resident so far; `getrusage` counts the parent before the start as well."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def _of(episodes: int, work: Callable[[], Any]) -> Contender:
    def counted() -> int:
        work()
        return episodes

    return Contender(counted)


def _one_each(
    works: dict[str, Callable[[], Any]], rounds: int | None = None
) -> dict[str, Contender]:
    return {name: Contender(_of(1, work).work, rounds) for name, work in works.items()}
