"""Verdicts on gains: usable, usable with care, or refused, and the checks that decide."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Verdict(StrEnum):
    """What may be done with gains."""

    USABLE = "usable"
    USABLE_WITH_CARE = "usable_with_care"
    REFUSE = "refuse"


@dataclass(frozen=True, slots=True)
class Check:
    """One of the checks that decide on the verdict.

    Attributes
    ----------
    name : str
        Short, as a table shows it.
    value, limit : float
        The value, and the largest one that passes.
    refusal : float
        The largest value that is usable with care.
    message : str
        Meaning of a failure.
    """

    name: str
    value: float
    limit: float
    refusal: float
    message: str

    @property
    def passed(self) -> bool:
        """Whether the value is within its limit; not-a-number never is."""
        return bool(self.value <= self.limit)

    @property
    def verdict(self) -> Verdict:
        """What the check alone allows."""
        if self.passed:
            return Verdict.USABLE
        return Verdict.USABLE_WITH_CARE if self.value <= self.refusal else Verdict.REFUSE


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """Outcome of one check for B recordings: values (B,), their limits, and a message.

    Attributes
    ----------
    refusal : float
        Beyond it gains are refused, not only usable with care.
    """

    values: Array
    limit: float
    refusal: float
    message: str

    def check(self, name: str, index: int) -> Check:
        """The check of one recording."""
        return Check(name, float(self.values[index]), self.limit, self.refusal, self.message)


def worst(verdicts: "list[Verdict]") -> Verdict:
    """The verdict that the least favourable check allows."""
    order = list(Verdict)
    return max(verdicts, key=order.index, default=Verdict.USABLE)
