"""Gains over a measured parameter as a C99 table with interpolation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.export.pi_program import TOLERANCES
from tuners.export.programs import REALS, program
from tuners.tuner.schedule import Schedule
from yawrate_env import validation
from yawrate_env.plant.names import split

Array = NDArray[np.float64]

WITHIN, BEYOND, INVALID = range(3)
"""What a lookup returns: interpolated, the nearest end's gains, or nothing."""

_LEFT = -1.0  # what the test holds before a lookup that writes nothing


@dataclass(frozen=True, slots=True, eq=False)
class GainTable:
    """Gains over one parameter, between whose values straight lines are drawn.

    Attributes
    ----------
    parameter : str
        Its label, with the unit in brackets.
    values : NDArray
        (S,) increasing.
    names : tuple of str
        Of the k gains.
    gains : NDArray
        (S, k).
    """

    parameter: str
    values: Array
    names: tuple[str, ...]
    gains: Array

    def __post_init__(self) -> None:
        validation.finite_array("values", self.values, shape=(None,))
        if (np.diff(self.values) <= 0).any():
            raise ValueError(f"values = {self.values.tolist()} must increase. Sort them.")
        missing = self.values[~np.isfinite(self.gains).all(axis=1)]
        if len(missing):
            word, unit = split(self.parameter)
            at = f"{', '.join(f'{value:.3g}' for value in missing)} {unit}".rstrip()
            raise ValueError(
                f"gains are missing at a {word} of {at}. Record there, or leave these values out."
            )

    @classmethod
    def of(cls, schedule: Schedule) -> "GainTable":
        """The table of a schedule."""
        plant = schedule.results[0].plant
        label = plant.label(schedule.parameter)
        return cls(label, schedule.values, tuple(plant.gains), schedule.gains)

    def lookup(self, value: float) -> tuple[int, Array]:
        """Status and gains (k,) for a value; what exported programs must reproduce."""
        if not np.isfinite(value):
            return INVALID, np.full(len(self.names), np.nan)
        gains = np.array([np.interp(value, self.values, column) for column in self.gains.T])
        inside = self.values[0] <= value <= self.values[-1]
        return (WITHIN if inside else BEYOND), gains


def schedule_program(
    table: GainTable, *, real: str = "double", name: str = "yawrate_schedule"
) -> dict[str, str]:
    """Header, source and test program, by file name.

    Parameters
    ----------
    table : GainTable
        Gains over the measured parameter.
    real : {"double", "float"}
        Type of all numbers.
    name : str
        Prefix of the files and of all that they declare.
    """
    validation.one_of("real", real, REALS)
    if real == "float" and (np.diff(table.values.astype(np.float32)) <= 0).any():
        raise ValueError(
            f"values = {table.values.tolist()} are not apart in single precision. Leave some out."
        )
    asked = golden_values(table)
    found = [table.lookup(value) for value in asked]
    word, unit = split(table.parameter)
    values = {
        "parameter": table.parameter,
        "word": word,
        "unit": unit,
        "values": table.values,
        "gains": [split(gain)[0] for gain in table.names],
        "table": table.gains,
        "real": real,
        "asked": asked,
        "statuses": [status for status, _ in found],
        "expected": [np.nan_to_num(gains, nan=_LEFT) for _, gains in found],
        "tolerance": TOLERANCES[real],
    }
    return program("schedule", name, values)


def golden_values(table: GainTable) -> Array:
    """Values (G,) that reach every branch: at and between those of the table, beyond, and none."""
    values = table.values
    width = float(np.ptp(values)) or 1.0
    shares = np.random.default_rng(0).uniform(0.05, 0.95, max(len(values) - 1, 0))
    between = values[:-1] + shares * np.diff(values)
    outside = [values[0] - width, values[-1] + width, np.nan, np.inf, -np.inf]
    return np.concatenate([values, between, outside])
