"""A tuning result as one JSON object."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tuners.cli.text import RUNGS, forms_in, forms_of, gain_units
from tuners.export.forms import controller_of
from tuners.export.gains import plant_settings
from tuners.logs import Log
from tuners.tuner.pooling.share import Share
from tuners.tuner.result import Result
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant


def as_json(result: Result, log: Log, tuner: str, logs: Sequence[Log] = ()) -> dict[str, Any]:
    """Everything about a result as plain JSON values; ``null`` where there is no number.

    Gains and metrics also stand by name beside the other keys, as measured parameters do in
    ``log`` and estimated ones in ``fit``.

    Parameters
    ----------
    logs : sequence of Log
        All of them, where there are several; ``log`` is then ``null``.
    """
    plant, forms = result.plant, forms_of(result)
    gains = bare(result.gains)
    metrics = bare({name: asdict(interval) for name, interval in result.intervals.items()})
    exact = bare({name: asdict(interval) for name, interval in result.exact_intervals.items()})
    settings, known = plant_settings(plant), controller_of(plant)
    keys = {
        "trusted": result.trusted,
        "verdict": result.verdict.value,
        "answered_by": RUNGS[result.rung],
        "left": result.left,
        "reasons": result.reasons,
        "notes": result.notes,
        **metrics,
        "status": result.status.name.lower(),
        "converged": result.converged,
        "fallback": bare(result.fallback),
        "checks": [
            asdict(check) | {"passed": check.passed, "verdict": check.verdict.value}
            for check in result.checks
        ],
        "forms": None if forms is None else asdict(forms),
        "controller": None if not known else {"name": known, "forms": forms_in(result)},
        "target": settings["target"],
        "tuner": tuner,
        "log": None if logs else log_of(log, plant),
        "logs": [
            log_of(one, plant) | share_of(share, plant)
            for one, share in zip(logs, result.logs, strict=True)
        ],
        "validation": _validation(result),
        "fit": _fit(result),
        "gains": gains,
        "metrics": metrics,
        "metrics_if_plant_exact": exact,
        "parameters": bare(result.fit.parameters),
        "deviations": bare(result.fit.deviations),
        "units": units_of(plant),
        "plant": {"entry": plant.entry, **settings},
    }
    answer: dict[str, Any] = plain({**gains, **keys})
    return answer


def log_of(log: Log, plant: Plant) -> dict[str, Any]:
    """A log's stretch, measured parameters and excitation."""
    return {
        "file": log.source,
        "start": log.t0,
        "samples": log.u.shape[-1],
        "Ts": log.Ts,
        **bare({plant.label(name): float(v.mean()) for name, v in log.measured.items()}),
        "excitation": asdict(log.excitation),
    }


def share_of(share: Share, plant: Plant) -> dict[str, Any]:
    """How one of several logs stands to the others."""
    return {
        "share": share.share,
        "agrees": share.agrees,
        "chi_square": share.chi_square,
        "freedom": share.freedom,
        "chance": share.chance,
        "difference": bare(share.shift),
        "parameters": bare(share.parameters),
        "causes": list(share.causes),
    }


def _validation(result: Result) -> dict[str, Any] | None:
    """A further log held against the answer."""
    held = result.validation
    if held is None:
        return None
    plant, against = result.plant, held.against
    measured = {plant.label(name): value for name, value in against.measured.items()}
    others = share_of(against, plant)
    del others["share"]
    return {
        "file": held.name,
        **bare(measured),
        **others,
        "fit_percent": held.fit,
        "attainable_percent": held.attainable,
        "metrics": bare({name: asdict(interval) for name, interval in held.intervals.items()}),
        "within_intervals": held.within,
        "agrees": held.agrees,
        "contradicts": held.contradicts,
    }


def _fit(result: Result) -> dict[str, Any]:
    fit = result.fit
    return {
        **bare({name: fit.parameters[name] for name in fit.deviations}),
        "offset": fit.offset,
        "initial": fit.initial,
        "from_rest": fit.from_rest,
        "snr_db": fit.snr_db,
    }


def units_of(plant: Plant) -> dict[str, str]:
    """Units by name; empty for numbers and where they are not known."""
    parameters = {name: split(plant.label(name))[1] for name in plant.prior}
    metrics = {name: split(name)[1] for name in plant.counted}
    return bare(gain_units(plant) | metrics | parameters)


def bare(values: Mapping[str, Any]) -> dict[str, Any]:
    """By names without their units."""
    return {split(name)[0]: value for name, value in values.items()}


def plain(value: Any) -> Any:
    """Tuples as lists, NumPy's numbers as Python's, ``null`` for those that are not finite."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
