"""A tuning result as one JSON object."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tuners.cli.text import RUNGS, forms_of, gain_units
from tuners.export.gains import plant_settings
from tuners.logs import Log
from tuners.tuner.result import Result
from tuners.tuner.shares import Share
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
    gains = _bare(result.gains)
    metrics = _bare({name: asdict(interval) for name, interval in result.intervals.items()})
    exact = _bare({name: asdict(interval) for name, interval in result.exact_intervals.items()})
    settings = plant_settings(plant)
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
        "fallback": _bare(result.fallback),
        "checks": [
            asdict(check) | {"passed": check.passed, "verdict": check.verdict.value}
            for check in result.checks
        ],
        "forms": None if forms is None else asdict(forms),
        "target": settings["target"],
        "tuner": tuner,
        "log": None if logs else _log(log, plant),
        "logs": [
            _log(one, plant) | _share(share, plant)
            for one, share in zip(logs, result.logs, strict=True)
        ],
        "validation": _validation(result),
        "fit": _fit(result),
        "gains": gains,
        "metrics": metrics,
        "metrics_if_plant_exact": exact,
        "parameters": _bare(result.fit.parameters),
        "deviations": _bare(result.fit.deviations),
        "units": _units(plant),
        "plant": {"entry": plant.entry, **settings},
    }
    answer: dict[str, Any] = _plain({**gains, **keys})
    return answer


def _log(log: Log, plant: Plant) -> dict[str, Any]:
    return {
        "file": log.source,
        "start": log.t0,
        "samples": len(log.u),
        "Ts": log.Ts,
        **_bare({plant.label(name): float(v.mean()) for name, v in log.measured.items()}),
        "excitation": asdict(log.excitation),
    }


def _share(share: Share, plant: Plant) -> dict[str, Any]:
    """How one of several logs stands to the others."""
    return {
        "share": share.share,
        "agrees": share.agrees,
        "chi_square": share.chi_square,
        "freedom": share.freedom,
        "chance": share.chance,
        "difference": _bare(share.shift),
        "parameters": _bare(share.parameters),
        "causes": list(share.causes),
    }


def _validation(result: Result) -> dict[str, Any] | None:
    """A further log held against the answer."""
    held = result.validation
    if held is None:
        return None
    plant, against = result.plant, held.against
    measured = {plant.label(name): value for name, value in against.measured.items()}
    others = _share(against, plant)
    del others["share"]
    return {
        "file": held.name,
        **_bare(measured),
        **others,
        "fit_percent": held.fit,
        "attainable_percent": held.attainable,
        "metrics": _bare({name: asdict(interval) for name, interval in held.intervals.items()}),
        "within_intervals": held.within,
        "agrees": held.agrees,
        "contradicts": held.contradicts,
    }


def _fit(result: Result) -> dict[str, Any]:
    fit = result.fit
    return {
        **_bare({name: fit.parameters[name] for name in fit.deviations}),
        "offset": fit.offset,
        "initial": fit.initial,
        "from_rest": fit.from_rest,
        "snr_db": fit.snr_db,
    }


def _units(plant: Plant) -> dict[str, str]:
    """Units by name; empty for numbers and where they are not known."""
    parameters = {name: split(plant.label(name))[1] for name in plant.prior}
    metrics = {name: split(name)[1] for name in plant.counted}
    return _bare(gain_units(plant) | metrics | parameters)


def _bare(values: Mapping[str, Any]) -> dict[str, Any]:
    """By names without their units."""
    return {split(name)[0]: value for name, value in values.items()}


def _plain(value: Any) -> Any:
    """Tuples as lists, NumPy's numbers as Python's, ``null`` for those that are not finite."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
