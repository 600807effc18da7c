"""Ready plants as users meet them: default training, recordings of SciPy's, answers of `tune`.

The recordings are made without the plant's own simulator: `scipy.signal.lsim` in steps of a
twentieth of a sample, of which dead times are whole numbers.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lsim

import tuners
from studies.markdown import table
from studies.schedule_page import finite
from tuners.trust.bound import cramer_rao
from tuners.trust.intervals import Interval
from tuners.tuner.recording import Recording
from yawrate_env.files import write_text
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

STEPS = 20

PAGE = """\
# Ready plants through `tune`

Made by `python scripts/compare_process.py`. Default training; errors are root mean squares of the
metrics' distances from what the rule reaches that knows the plant, over the Cramér–Rao bound's.
The recordings are SciPy's (`lsim` in steps of a twentieth of a sample), not the plant's own.

{table}"""


@dataclass(frozen=True, slots=True)
class Found:
    """One plant's figures, of its counted metrics in their order.

    Attributes
    ----------
    plant, controller, rule : str
    recordings, seed : int
    metrics : tuple of str
    errors, bound : tuple of float
        Root mean squares.
    trusted, usable : float
        Shares of answers that are usable, with care or without, and without.
    exact, headline : tuple of float
        Shares of answers whose 90 % intervals hold: those that assume an exact model, and others.
    unstable : int
    seconds : float
        Of the training, where that was timed.
    """

    plant: str
    controller: str
    rule: str
    recordings: int
    seed: int
    metrics: tuple[str, ...]
    errors: tuple[float, ...]
    bound: tuple[float, ...]
    trusted: float
    usable: float
    exact: tuple[float, ...]
    headline: tuple[float, ...]
    unstable: int
    answered: dict[str, int]
    seconds: float


def transfer(plant: str, theta: Array) -> tuple[list[float], list[float]]:
    """Numerator and denominator of a plant without its dead time."""
    K, *lags = theta[:-1]
    if plant == "integrator":
        return [K], [1.0, 0.0]
    denominator = np.ones(1)
    for lag in lags:
        denominator = np.polymul(denominator, [lag, 1.0])
    return [K], denominator.tolist()


def recordings(plant: Plant, name: str, count: int, seed: int) -> tuple[Array, Array]:
    """Plants (B, p) drawn uniformly from the prior, dead times of whole steps, and outputs."""
    rng = np.random.default_rng([seed, 815])
    low, high = (np.array(ends) for ends in plant.ranges)
    theta = rng.uniform(low, high, (count, len(low)))
    step = plant.Ts / STEPS
    theta[:, -1] = np.round(theta[:, -1] / step) * step
    u, y = plant.u.repeat(STEPS), np.empty((count, len(plant.u)))
    for b, row in enumerate(theta):
        late = round(row[-1] / step)
        delayed = np.concatenate([np.zeros(late), u])[: len(u)]
        fine = lsim(transfer(name, row), delayed, step * np.arange(len(u)), interp=False)[1]
        y[b] = fine[::STEPS]
    return theta, y + float(plant.noise) * rng.standard_normal(y.shape)  # type: ignore[arg-type]


def study(
    tuner: tuners.Tuner, name: str, rule: str, count: int, seed: int, seconds: float = np.nan
) -> Found:
    """Tune every recording, and count."""
    plant = tuner.plant
    theta, y = recordings(plant, name, count, seed)
    results = tuner.results(Recording(plant.u[None], y, plant.Ts, theta))
    gains = np.array([list(result.gains.values()) for result in results])
    counted = list(plant.counted)
    reached = plant.metric_values(theta, gains)
    errors = reached - plant.metric_values(theta, plant.oracle(theta))
    bound = cramer_rao(plant, theta)

    def held(of: str) -> tuple[float, ...]:
        return tuple(
            float(np.mean([_within(getattr(r, of)[m], v[i]) for r, v in
                           zip(results, reached, strict=True)]))
            for i, m in enumerate(counted)
        )  # fmt: skip

    def root(values: Array) -> tuple[float, ...]:
        return tuple(np.sqrt(np.nanmean(values**2, axis=0)).tolist())

    rungs, numbers = np.unique([r.rung.name.lower() for r in results], return_counts=True)
    return Found(
        name, plant.controller, rule, count, seed, tuple(counted), root(errors), root(bound),
        float(np.mean([r.trusted for r in results])),
        float(np.mean([r.verdict.value == "usable" for r in results])),
        held("exact_intervals"), held("intervals"), int(np.isnan(errors).any(axis=1).sum()),
        dict(zip(rungs.tolist(), numbers.tolist(), strict=True)), seconds,
    )  # fmt: skip


def _within(interval: Interval, value: float) -> bool:
    return interval.low <= value <= interval.high


def write(found: Found, folder: Path) -> str:
    """Put a plant's figures into ``processes.json`` and ``processes.md``; returns the table."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "processes.json"
    rows = json.loads(path.read_text()) if path.exists() else {}
    rows[f"{found.plant} {found.controller} {found.rule}"] = finite(asdict(found))
    write_text(path, json.dumps(rows, indent=1, allow_nan=False) + "\n")
    write_text(folder / "processes.md", page(rows))
    return tabulated([asdict(found)])


def page(rows: dict[str, Any]) -> str:
    """The page of the stored figures."""
    return PAGE.format(table=tabulated(rows.values()))


HEADS = (
    "plant", "controller", "rule", "recordings", "metrics", "error / bound",
    "usable, with care or without", "without", "90 % intervals hold, exact", "headline", "unstable",
)  # fmt: skip


def tabulated(rows: Any) -> str:
    """Plants' figures as a table."""
    return table(HEADS, [_row(row) for row in rows])


def _row(row: dict[str, Any]) -> tuple[object, ...]:
    ratios = [f"{e / b:.2f}" for e, b in zip(row["errors"], row["bound"], strict=True)]
    names = [name.partition(" [")[0].replace("_", " ") for name in row["metrics"]]
    shares = [" / ".join(f"{100 * s:.1f}" for s in row[of]) + " %" for of in ("exact", "headline")]
    return (
        f"`{row['plant']}`", row["controller"], row["rule"], row["recordings"], " / ".join(names),
        " / ".join(ratios), f"{100 * row['trusted']:.1f} %", f"{100 * row['usable']:.1f} %",
        *shares, row["unstable"],
    )  # fmt: skip
