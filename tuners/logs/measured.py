"""Measured parameters of a recording: from columns, given values, or the plant's prior."""

from collections.abc import Mapping

import numpy as np

from tuners.logs.table import Array, LogError, MissingParameterError
from tuners.tuner.recording import UNSTEADY, variation
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant


def parameters(
    plant: Plant, columns: Mapping[str, Array], values: Mapping[str, float], count: int
) -> tuple[dict[str, Array], list[str]]:
    """Every measured parameter (count,), and notes.

    Parameters
    ----------
    columns, values : dict
        Parameters that the file has, (count,) each, and that the user gave.
    """
    found, notes = {}, []
    for name in plant.measured:
        if name in columns:
            found[name] = columns[name]
            _check(plant, name, columns[name])
        elif name in values:
            found[name] = np.full(count, values[name])
        else:
            found[name] = np.full(count, _only(plant, name))
            notes.append(f"No {split(plant.label(name))[0]} in the log: taken as the tuner's.")
    return found, notes


def _only(plant: Plant, name: str) -> float:
    """The value of a parameter that the prior leaves no choice about."""
    low, high = plant.prior[name]
    words, unit = split(plant.label(name))
    if low != high:
        said = words if words.isidentifier() else name
        covered = f"{low:g} to {high:g} {unit}".rstrip()
        raise MissingParameterError(
            f"No column looks like {words}, and this tuner covers {covered}. Give its value or its "
            f"column, as in --measured {said}={high:g}."
        )
    return low


def _check(plant: Plant, name: str, values: Array) -> None:
    """Refuse what no mean describes, and what the plant does not allow."""
    low, _ = plant.prior[name]
    words, unit = split(plant.label(name))
    mean = float(values.mean())
    varies, whole = variation(plant, name, values)
    runs = f"from {values.min():.3g} to {values.max():.3g} {unit}".rstrip()
    least, most = (float(end[plant.indices([name])[0]]) for end in plant.limits)
    if not min(least, low) <= mean <= most:
        raise LogError(
            f"{words} runs {runs}; it must lie between {least:g} and {most:g}. Give its unit, or "
            "choose a stretch with --from and --to."
        )
    if varies > UNSTEADY:
        raise LogError(
            f"{words} varies {runs}, more than {UNSTEADY:.0%} of {whole}. "
            "Choose a steadier stretch with --from and --to."
        )
