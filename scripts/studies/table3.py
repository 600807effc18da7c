"""The paper's Table III, ours beside it."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

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

HEADS = (
    "tuner",
    "phase margin [°] mean ± std", "std 95 %", "paper",
    "crossover [Hz] mean ± std", "std 95 %", "paper",
    "rms% kp", "rms% Ti", "unstable", "× bound",
)  # fmt: skip

DECIMALS = {"phase_margin": 3, "crossover": 4}

Row = dict[str, Any]


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
    result["median_seconds"] = float(np.median(e.seconds))
    result["paper"] = PAPER.get(e.tuner)
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
    return json.dumps({"conditions": conditions, "rows": list(rows)}, indent=1) + "\n"


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
