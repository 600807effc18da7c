"""Records of arrays, or of dicts of arrays, over one batch: part of one, and several in a row."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Record = TypeVar("Record")


def take(record: Record, index: slice | NDArray[Any]) -> Record:
    """The same record for part of the batch; fields that are not arrays stay as they are."""
    return _each([record], lambda values: values[0][index])


def concatenate(records: Sequence[Record]) -> Record:
    """One record of all the batches; fields that are not arrays come from the first."""
    return _each(records, np.concatenate)


def replaced(record: Record, index: NDArray[Any], other: Record) -> Record:
    """Copy of `record` with the items at `index` taken from `other`."""

    def put(values: list[NDArray[Any]]) -> NDArray[Any]:
        result = values[0].copy()
        result[index] = values[1]
        return result

    return _each([record, other], put)


def _each(records: Sequence[Record], combine: Any) -> Record:
    first: Any = records[0]
    combined = []
    for field in fields(first):
        values = [getattr(r, field.name) for r in records]
        if is_dataclass(values[0]):
            combined.append(_each(values, combine))
        elif isinstance(values[0], np.ndarray):
            combined.append(combine(values))
        elif isinstance(values[0], Mapping):
            combined.append({name: combine([v[name] for v in values]) for name in values[0]})
        else:
            combined.append(values[0])
    return type(first)(*combined)  # type: ignore[no-any-return]
