from dataclasses import dataclass

import numpy as np
from systems import contexts

from yawrate_env.batch import concatenate, replaced, take
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.episode import WORDS, Draw
from yawrate_env.vehicle.task import Prior


@dataclass(frozen=True)
class Outer:
    inner: object
    values: np.ndarray
    name: str


def outer(count, seed=0):
    return Outer(contexts(count, seed), np.arange(count), "outer")


def test_take_reaches_nested_records_and_keeps_what_is_no_array():
    part = take(outer(5), np.array([3, 1]))
    assert part.values.tolist() == [3, 1] and part.name == "outer"
    np.testing.assert_array_equal(part.inner.mu_s, contexts(5, 0).mu_s[[3, 1]])
    assert type(part.inner) is type(contexts(5, 0))


def test_concatenate_undoes_taking_apart():
    whole = Draw.of(stream(0, 0, 7, WORDS), Prior())
    again = concatenate([take(whole, slice(0, 3)), take(whole, slice(3, 7))])
    np.testing.assert_array_equal(again.key, whole.key)
    np.testing.assert_array_equal(again.start, whole.start)
    np.testing.assert_array_equal(again.context.M_delta, whole.context.M_delta)


def test_replaced_is_a_copy():
    old, new = outer(4), outer(2, seed=1)
    mixed = replaced(old, np.array([2, 0]), new)
    assert mixed.values.tolist() == [1, 1, 0, 3]
    expected = old.inner.mu_s.copy()
    expected[[2, 0]] = new.inner.mu_s
    np.testing.assert_array_equal(mixed.inner.mu_s, expected)
    assert old.values.tolist() == [0, 1, 2, 3]
