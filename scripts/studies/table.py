"""The paper's Table III, ours beside it."""

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from studies.metrics import bootstrap_interval, rms, rms_percent
from tuners.tuner.evaluation import Evaluation
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.task import Task

PAPER = {
    "gb": {"phase_margin": (59.98, 0.2385), "crossover": (1.50, 0.0037)},
    "ts-ff": {"phase_margin": (59.99, 0.1714), "crossover": (1.50, 0.0032)},
    "ts-gbm": {"phase_margin": (60.01, 0.69), "crossover": (1.50, 0.0143)},
}
"""Mean and standard deviation printed in Table III."""

Row = dict[str, Any]


def row(e: Evaluation, task: Task) -> Row:
    """Mean, spread, 95 % intervals, rms% of eq. (14) and the paper's figures for one tuner."""
    oracle = loops(task, e.context).design()
    result: Row = {"tuner": e.tuner, "episodes": len(e.kp), "unstable": int((~e.stable).sum())}
    for name in ("phase_margin", "crossover"):
        values = getattr(e, name)
        values = values[np.isfinite(values)]
        result[name] = {
            "mean": float(values.mean()),
            "mean_interval": bootstrap_interval(values, np.mean),
            "std": float(values.std()),
            "std_interval": bootstrap_interval(values, np.std),
            "rmse": float(np.sqrt(np.mean((values - getattr(task.target, name)) ** 2))),
        }
    result["rms_percent"] = {
        "kp": rms_percent(oracle.kp, e.kp),
        "Ti": rms_percent(oracle.Ti, e.Ti),
    }
    result["median_seconds"] = float(np.median(e.seconds))
    result["paper"] = PAPER.get(e.tuner)
    return result


def bound_row(
    spread: Sequence[Sequence[float]] | Any, task: Task, name: str = "Cramér–Rao bound"
) -> Row:
    """A bound as a row: root mean square over the vehicles of (B, 2) spreads."""
    least = rms(np.asarray(spread))
    return {
        "tuner": name,
        "episodes": len(spread),
        "phase_margin": {"mean": task.target.phase_margin, "std": float(least[0])},
        "crossover": {"mean": task.target.crossover, "std": float(least[1])},
    }


def to_json(rows: Sequence[Row], conditions: dict[str, Any]) -> str:
    """Rows and the conditions they hold for."""
    return json.dumps({"conditions": conditions, "rows": list(rows)}, indent=1) + "\n"


def to_markdown(rows: Sequence[Row]) -> str:
    """The table as people read it: ours, the paper's beside it, errors over the bound's."""
    lines = [
        "| tuner | phase margin [°] mean ± std | std 95 % | paper | crossover [Hz] mean ± std "
        "| std 95 % | paper | rms% kp | rms% Ti | unstable | × bound |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    bound = next((r for r in rows if "unstable" not in r), None)
    lines += [_line(r, bound) for r in rows]
    return "\n".join(lines) + "\n"


def _line(r: Row, bound: Row | None) -> str:
    paper = r.get("paper") or {}
    cells = [f"`{r['tuner']}`" if "unstable" in r else f"*{r['tuner']}*"]
    for name, places in (("phase_margin", 3), ("crossover", 4)):
        m = r[name]
        cells.append(f"{m['mean']:.{places}f} ± {short(m['std'])}")
        interval = m.get("std_interval")
        cells.append("–".join(map(short, interval)) if interval else "")
        cells.append("{:g} ± {:g}".format(*paper[name]) if paper else "")
    percent = r.get("rms_percent", {})
    cells += [short(percent[k]) if k in percent else "" for k in ("kp", "Ti")]
    cells.append(str(r.get("unstable", "")))
    ratios = [
        r[name].get("rmse", r[name]["std"]) / bound[name]["std"]
        for name in ("phase_margin", "crossover")
        if bound is not None and bound[name]["std"] > 0
    ]
    cells.append(" / ".join("0" if ratio < 1e-6 else f"{ratio:.3g}" for ratio in ratios))
    return "| " + " | ".join(cells) + " |"


def short(value: float) -> str:
    """Three significant digits without an exponent."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    if value < 1e-7:
        return f"{value:.0e}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(value)))}f}"
