"""The paper's Table III, ours beside it."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.stopwatch import machine
from studies.markdown import ratios, short, table
from studies.metrics import bootstrap_interval, rms, rms_percent
from tuners.tuner.evaluation import Evaluation
from yawrate_env.plant.names import split

PAPER = {
    "gb": {"phase_margin": (59.98, 0.2385), "crossover": (1.50, 0.0037)},
    "ts-ff": {"phase_margin": (59.99, 0.1714), "crossover": (1.50, 0.0032)},
    "ts-gbm": {"phase_margin": (60.01, 0.69), "crossover": (1.50, 0.0143)},
}
"""Mean and standard deviation printed in Table III."""

COMPARABLE = {"gb": "gb"} | {
    f"{name}-{rate}": name for name in ("ts-ff", "ts-gbm") for rate in ("1khz", "100hz")
}
"""Rows that follow the paper's recipe to the letter, to its own; no others stand beside it."""

DIGITS = {"episodes.csv": 5, "table3.json": 6}
"""Significant digits that are stored: those that another processor gives as well."""

HEADS = (
    "tuner",
    "phase margin [°] mean ± std", "std 95 %", "paper",
    "crossover [Hz] mean ± std", "std 95 %", "paper",
    "rms% kp", "rms% Ti", "unstable", "× bound",
)  # fmt: skip

DECIMALS = {"phase_margin": 3, "crossover": 4}

Row = dict[str, Any]

_ROUNDING = 1e-9  # what is less is another processor's rounding, and 0


def row(e: Evaluation) -> Row:
    """Mean, spread, 95 % intervals, rms% of eq. (14) and the paper's values for one tuner."""
    assert e.plant.target is not None
    oracle = e.plant.oracle(e.theta)
    result: Row = {"tuner": e.tuner, "episodes": len(e.gains), "unstable": int((~e.stable).sum())}
    for name, target, values in zip(e.plant.counted, e.plant.target, e.metrics.T, strict=True):
        values = values[np.isfinite(values)]
        result[split(name)[0]] = {
            "mean": float(values.mean()),
            "mean_interval": bootstrap_interval(values, np.mean),
            "std": float(values.std()),
            "std_interval": bootstrap_interval(values, np.std),
            "rmse": float(np.sqrt(np.mean((values - target) ** 2))),
        }
    result["rms_percent"] = {
        name: rms_percent(oracle[:, j], e.gains[:, j]) for j, name in enumerate(e.plant.gains)
    }
    result["paper"] = PAPER.get(COMPARABLE.get(e.tuner, ""))
    return result


def bound_row(
    spread: NDArray[np.float64], target: Sequence[float], name: str = "Cramér–Rao bound"
) -> Row:
    """A bound as a row: root mean square over the vehicles of (B, 2) spreads."""
    least = rms(np.asarray(spread))
    return {
        "tuner": name,
        "episodes": len(spread),
        **{
            metric: {"mean": mean, "std": float(std)}
            for metric, mean, std in zip(DECIMALS, target, least, strict=True)
        },
    }


def to_json(rows: Sequence[Row], conditions: dict[str, Any]) -> str:
    """Rows and the conditions they hold for."""
    kept = _rounded(list(rows), DIGITS["table3.json"])
    return json.dumps({"conditions": conditions, "rows": kept}, indent=1) + "\n"


def to_csv(evaluations: Sequence[Evaluation]) -> str:
    """One row an episode and tuner: how far each metric is from its target."""
    first, digits = evaluations[0], DIGITS["episodes.csv"]
    parameters, gains = tuple(first.plant.prior), first.plant.gains
    metrics = [f"{split(name)[0]}_error" for name in first.plant.counted]
    lines = [",".join(("tuner", "episode", *parameters, *gains, *metrics, "stable"))]
    for e in evaluations:
        errors = np.round(e.errors, 4)  # below a hundredth of the least tuner's
        values = np.concatenate([e.theta, e.gains, errors + 0.0], axis=1)
        lines += [
            ",".join((e.tuner, str(k), *(f"{v:.{digits}g}" for v in row), str(bool(ok))))
            for k, (row, ok) in enumerate(zip(values, e.stable, strict=True))
        ]
    return "\n".join(lines) + "\n"


def times_json(evaluations: Sequence[Evaluation]) -> str:
    """Median time of an answer [s]; on another machine it is another."""
    seconds = {e.tuner: float(np.median(e.seconds)) for e in evaluations}
    return json.dumps({"machine": machine(), "median_seconds": seconds}, indent=1) + "\n"


def page(rows: Sequence[Row]) -> str:
    """The table, and what it says of the paper."""
    return f"{to_markdown(rows)}\n{said(rows)}\n"


def said(rows: Sequence[Row]) -> str:
    """The paragraph under the table: like for like with the paper."""
    by_name = {r["tuner"]: r for r in rows}

    def spread(name: str) -> str:
        return " / ".join(
            f"{short(by_name[name][q]['std'])}{unit}"
            for q, unit in (("phase_margin", "°"), ("crossover", " Hz"))
        )

    def theirs(name: str) -> str:
        margin, crossover = (PAPER[name][q][1] for q in ("phase_margin", "crossover"))
        return f"{margin:g}° / {crossover:g} Hz"

    def factor(name: str) -> str:
        ratio = by_name[name]["phase_margin"]["std"] / PAPER[COMPARABLE[name]]["phase_margin"][1]
        return f"{ratio:.2g} times" if ratio >= 1 else f"1/{1 / ratio:.2g} of"

    return (
        "Like for like, with ARMAX at 1 kHz or 100 Hz and (kp, Ti) as targets, as printed, our "
        f"networks spread {spread('ts-ff-1khz')} and {spread('ts-ff-100hz')} where the paper's "
        f"has {theirs('ts-ff')}: {factor('ts-ff-1khz')} and {factor('ts-ff-100hz')} its phase "
        f"margin's. Our trees spread {spread('ts-gbm-1khz')} and {spread('ts-gbm-100hz')} where "
        f"its have {theirs('ts-gbm')}: {factor('ts-gbm-1khz')} and {factor('ts-gbm-100hz')}. Our "
        f"gray box has {factor('gb')} its spread. Averages at 25 Hz before the ARMAX fit and "
        f"loop coordinates as targets make `ts-ff` ({spread('ts-ff')}) and `ts-gbm` "
        f"({spread('ts-gbm')}) of these rows; they are not the paper's recipe, and its figures "
        "stand beside no row but those that are."
    )


def to_markdown(rows: Sequence[Row]) -> str:
    """The table as people read it: ours, the paper's beside it, errors over the bound's."""
    bound = next((r for r in rows if "unstable" not in r), None)
    return table(HEADS, [_cells(r, bound) for r in rows])


def _cells(r: Row, bound: Row | None) -> list[str]:
    paper, percent = r.get("paper") or {}, r.get("rms_percent", {})
    cells = [f"`{r['tuner']}`" if "unstable" in r else f"*{r['tuner']}*"]
    for name, places in DECIMALS.items():
        interval = r[name].get("std_interval")
        cells += [
            f"{r[name]['mean']:.{places}f} ± {short(r[name]['std'])}",
            "–".join(map(short, interval)) if interval else "",
            "{:g} ± {:g}".format(*paper[name]) if paper else "",
        ]
    cells += [short(percent[k]) if k in percent else "" for k in ("kp", "Ti")]
    found = [
        r[name].get("rmse", r[name]["std"]) / bound[name]["std"]
        for name in DECIMALS
        if bound is not None and bound[name]["std"] > 0
    ]
    return [*cells, str(r.get("unstable", "")), ratios(found)]


def _rounded(value: Any, digits: int) -> Any:
    """Floats in nested lists and dictionaries with so many significant digits."""
    if isinstance(value, dict):
        return {name: _rounded(each, digits) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each, digits) for each in value]
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") if abs(value) > _ROUNDING else 0.0
    return value
