"""What the paper leaves open, and which settings would explain its Table III.

The recipe is the paper's as printed: ARMAX(2,2,2,1), gains as targets, its learners, 1500 vehicles.
What it does not say is varied one setting at a time around our defaults, and at random: where the
gray box, whose spread costs little to find, comes nearest to the paper's, learners are trained too,
and around the nearest of all one setting is varied at a time again.  The gray box's spread is the
Cramer-Rao bound, on which ours sits, with what else it estimates projected out of the slopes.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.draws import draw
from studies.metrics import rms
from tuners import RECIPES, Recipe, train
from tuners.features.armax import Armax
from tuners.trust.bound import metric_slopes, spread
from tuners.trust.identification import covariance_of, output_slopes
from tuners.tuner.evaluation import evaluate
from tuners.tuner.examples import examples
from yawrate_env.files import write_text
from yawrate_env.loop.target import Target
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Row = dict[str, Any]
Progress = Callable[[str, int, int], None]

PAPER = {"gb": (0.2385, 0.0037), "ts-ff": (0.1714, 0.0032), "ts-gbm": (0.69, 0.0143)}
"""Standard deviations of phase margin [deg] and crossover [Hz] in the paper's Table III."""

NOTHING, OFFSET, STATE, DEAD_TIME = "nothing", "offset", "offset, state", "offset, state, dead time"

_BLOCK = 25
_STATES, _APART = 6, 20  # of the vehicle; samples between shifts of its impulse response


@dataclass(frozen=True, slots=True)
class Setting:
    """What the paper does not say, or says twice.

    Attributes
    ----------
    v_x : float
        Speed [m/s].
    bit_time : float
        Of the excitation [s].
    amplitude : float
        Of the excitation [deg].
    order : int
        Of its shift register.
    Ts : float
        Sampling time of the recording, of 10 s [s]: noise on 10,000 or on 1000 samples.
    Ts_armax, Ts_control : float
        Sampling times of the ARMAX model, and of controller and margins [s].
    delay : int
        Samples of dead time in the loop.
    estimated : str
        What the gray box estimates besides friction and mass.
    """

    v_x: float = 20.0
    bit_time: float = 0.1
    amplitude: float = 1.0
    order: int = 7
    Ts: float = 0.001
    Ts_armax: float = 0.001
    Ts_control: float = 0.01
    delay: int = 0
    estimated: str = NOTHING

    @property
    def possible(self) -> "Setting":
        """The nearest one whose bits and model are not faster than the recording."""
        return replace(
            self, bit_time=max(self.bit_time, self.Ts), Ts_armax=max(self.Ts_armax, self.Ts)
        )

    @property
    def plant(self) -> Plant:
        """Its vehicles and experiment."""
        experiment = Experiment(
            Ts=self.Ts, N=round(10 / self.Ts), bit_time=self.bit_time,
            amplitude=float(np.radians(self.amplitude)),
        )  # fmt: skip
        target = Target(Ts=self.Ts_control, delay_samples=self.delay)
        speed = Prior(v_x=(self.v_x, self.v_x))
        u = prbs(experiment.N, self.Ts, self.bit_time, experiment.amplitude, order=self.order)
        return replace(yaw_rate(Task(prior=speed, experiment=experiment, target=target)), u=u[0])


LEVELS: dict[str, tuple[Any, ...]] = {
    "Ts_armax": (0.001, 0.01, 0.04),
    "Ts": (0.001, 0.01),
    "estimated": (NOTHING, OFFSET, STATE, DEAD_TIME),
    "Ts_control": (0.001, 0.01),
    "v_x": (10.0, 15.0, 20.0, 30.0, 40.0),
    "bit_time": (0.001, 0.01, 0.1, 0.5),
    "delay": (0, 1, 2),
    "order": (7, 14),
    "amplitude": (1.0, 5.0),
}


def one_at_a_time(base: Setting) -> list[Setting]:
    """Every level of every setting, the others as in the base, with which it begins."""
    found = [base]
    for name, levels in LEVELS.items():
        found += [replace(base, **{name: level}).possible for level in levels]
    return list(dict.fromkeys(found))


def at_random(count: int, seed: int) -> list[Setting]:
    """Levels of all settings at random; the amplitude, which changes nothing, stays."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        chosen = {k: v[rng.integers(len(v))] for k, v in LEVELS.items() if k != "amplitude"}
        found.append(Setting(**chosen).possible)
    return found


def study(
    settings: Iterable[Setting], path: Path, vehicles: int, episodes: int, seed: int,
    progress: Progress | None = None,
) -> list[Row]:  # fmt: skip
    """Rows of the settings and of those in `path`, to which they are written one by one."""
    sizes = {"vehicles": vehicles, "episodes": episodes, "seed": seed}
    stored: dict[str, Any] = {"sizes": sizes, "rows": []}
    if path.exists():
        stored = json.loads(path.read_text())
    if stored["sizes"] != sizes:
        raise ValueError(
            f"{path} has results of {stored['sizes']}, not of {sizes}. Move it away, or give the "
            "same numbers."
        )
    settings = list(settings)
    known = {Setting(**row["setting"]): row for row in stored["rows"]}
    for done, setting in enumerate(settings, start=1):
        if setting not in known:
            same = [s for s in known if replace(s, estimated=setting.estimated) == setting]
            learned = known[same[0]] if same else None
            known[setting] = row_of(setting, vehicles, episodes, seed, learned)
            stored["rows"] = list(known.values())
            write_text(path, json.dumps(stored, indent=1) + "\n")
        if progress is not None:
            progress("settings", done, len(settings))
    return list(known.values())


def row_of(
    setting: Setting, vehicles: int, episodes: int, seed: int, same: Row | None = None
) -> Row:
    """Standard deviations of the three methods.

    Parameters
    ----------
    same : dict, optional
        Row of a setting that differs in what the gray box estimates alone: learners are its.
    """
    plant, found = setting.plant, {}
    found["gb"] = rms(gray_box(plant, setting, episodes, seed))
    if same is not None:
        gray = {"gb": [float(f"{v:.4g}") for v in found["gb"]]}
        return {**same, "setting": asdict(setting), "spreads": {**same["spreads"], **gray}}
    data = examples(plant, vehicles, seed, Armax(setting.Ts_armax))
    lost = 1 - float(data.usable.mean())
    for name in ("ts-ff", "ts-gbm"):
        recipe = Recipe(Armax(setting.Ts_armax), RECIPES[name].learner, "gains")
        tuner = train(recipe, plant, seed=seed, calibration=0, data=data)
        (made,) = evaluate({name: tuner}, plant, "test", episodes=episodes, seed=seed, batch=256)
        reached = plant.designs(made.theta)[1] & made.stable
        found[name] = made.metrics[reached & np.isfinite(made.metrics).all(axis=1)].std(axis=0)
    spreads = {name: [float(f"{v:.4g}") for v in values] for name, values in found.items()}
    return {"setting": asdict(setting), "spreads": spreads, "without": round(lost, 4)}


def nearest_gray_boxes(
    tried: int, count: int, episodes: int, seed: int, progress: Progress | None = None
) -> list[Setting]:
    """Of random settings those whose gray box, which costs little, comes nearest to the paper's."""
    settings = list(dict.fromkeys(at_random(tried, seed)))
    found = []
    for done, each in enumerate(settings, start=1):
        spreads = {"gb": rms(gray_box(each.plant, each, episodes, seed))}
        found.append((distance({"spreads": spreads}, ("gb",)), each))
        if progress is not None:
            progress("gray boxes", done, len(settings))
    return [each for _, each in sorted(found, key=lambda pair: pair[0])[:count]]


def distance(row: Row, names: Sequence[str] = tuple(PAPER)) -> float:
    """Root mean square factor between the paper's figures and ours, 1 if all agree."""
    logs = [np.log(np.array(row["spreads"][name]) / PAPER[name]) for name in names]
    return float(np.exp(rms(np.concatenate(logs))))


def nearest(rows: Sequence[Row], names: Sequence[str] = tuple(PAPER)) -> list[Row]:
    """Rows in the order of their distance."""
    return sorted(rows, key=lambda row: distance(row, names))


def changed(row: Row) -> str:
    """What a row's setting has that our defaults have not."""
    base = asdict(Setting())
    found = [f"{k} {v}" for k, v in row["setting"].items() if v != base[k]]
    return ", ".join(found) or "our defaults"


def varied(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Names of settings, and rows in which no other is changed."""
    base = asdict(Setting())
    for name in (field.name for field in fields(Setting)):
        alone = [
            row for row in rows
            if all(v == base[k] or k == name for k, v in row["setting"].items())
        ]  # fmt: skip
        levels = LEVELS[name]
        yield name, sorted(alone, key=lambda row: levels.index(row["setting"][name]))


def gray_box(plant: Plant, setting: Setting, episodes: int, seed: int) -> Array:
    """Least standard deviations (E, 2) of a gray box that estimates more than two parameters."""
    found = []
    for first in range(0, episodes, _BLOCK):
        drawn = draw(plant, "test", seed, first, min(_BLOCK, episodes - first))
        theta = drawn.theta[plant.designs(drawn.theta)[1]]
        if not len(theta):
            continue
        slopes = _without(plant, setting, theta, output_slopes(plant, theta, drawn.u))
        sigma = plant.sigma(plant.respond(theta, drawn.u))
        found.append(spread(metric_slopes(plant, theta), covariance_of(slopes, sigma)))
    return np.concatenate(found)


def _without(plant: Plant, setting: Setting, theta: Array, slopes: Array) -> Array:
    """Slopes (B, 2, N) less what offset, initial state and dead time explain of them."""
    signals = nuisance(plant, setting, theta)
    if not len(signals[0]):
        return slopes
    Q = np.linalg.qr(signals.swapaxes(1, 2))[0]
    return np.asarray(slopes - (slopes @ Q) @ Q.swapaxes(1, 2))


def nuisance(plant: Plant, setting: Setting, theta: Array) -> Array:
    """Slopes (B, m, N) of the output to what the gray box estimates besides the vehicle.

    The free responses of a vehicle are the sums of its impulse response's later parts.
    """
    N, parts = len(plant.u), []
    if setting.estimated != NOTHING:
        parts.append(np.ones((len(theta), 1, N)))
    if "state" in setting.estimated:
        apart = max(round(_APART * 0.001 / plant.Ts), 1)
        impulse = np.zeros((1, N + _STATES * apart))
        impulse[0, 0] = 1.0
        response = plant.respond(theta, impulse)
        shifts = [response[:, j : j + N] for j in apart * np.arange(1, _STATES + 1)]
        parts.append(np.stack(shifts, axis=1))
    if "dead time" in setting.estimated:
        y = plant.respond(theta)
        parts.append(np.diff(y, axis=1, prepend=0.0)[:, None])
    return np.concatenate(parts, axis=1) if parts else np.empty((len(theta), 0, N))
