from dataclasses import dataclass

import numpy as np
from systems import contexts

from yawrate_env.batch import concatenate, replaced, take


@dataclass(frozen=True)
class Outer:
    inner: object
    values: np.ndarray
    name: str


def outer(count, seed=0):
    return Outer(contexts(count, seed), np.arange(count), "outer")


def test_records_are_taken_apart_joined_and_replaced_through_every_level():
    old, new = outer(4), outer(2, seed=1)
    parts = take(old, np.array([3])), take(old, slice(0, 3))
    again = concatenate(parts)
    mixed = replaced(old, np.array([2, 0]), new)
    for record, rows in ((again, [3, 0, 1, 2]), (old, [0, 1, 2, 3])):
        assert record.values.tolist() == rows and record.name == "outer"
        np.testing.assert_array_equal(record.inner.mu_s, contexts(4, 0).mu_s[rows])
    assert mixed.values.tolist() == [1, 1, 0, 3] and type(mixed.inner) is type(old.inner)
    expected = old.inner.mu_s.copy()
    expected[[2, 0]] = new.inner.mu_s
    np.testing.assert_array_equal(mixed.inner.mu_s, expected)
