import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawrate_env import validation

ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True)


@given(ANY_FLOAT, st.floats(-10, 10), st.floats(-10, 10))
def test_number_returns_what_lies_in_its_bounds_and_nothing_else(value, low, high):
    if low < value <= high:
        assert validation.number("x", value, above=low, at_most=high) == value
    else:
        with pytest.raises(ValueError, match=f"^x = .*above {low:g}, at most {high:g}"):
            validation.number("x", value, above=low, at_most=high)


@given(ANY_FLOAT)
def test_number_without_bounds_is_finite(value):
    if np.isfinite(value):
        assert validation.number("x", value) == value
    else:
        with pytest.raises(ValueError, match="^x = .* must be finite"):
            validation.number("x", value)


def test_numbers_and_counts_take_numpy_scalars_and_refuse_the_rest():
    for value in (1, 1.5, np.float32(1.5), np.int64(3)):
        assert type(validation.number("x", value)) is float
    for value in (3, 3.0, np.int32(3)):
        assert type(validation.count("n", value)) is int and validation.count("n", value) == 3
    for value in (True, None, "1", 1j, [1.0], np.array([1.0])):
        with pytest.raises(ValueError, match="^x = .* is not a number"):
            validation.number("x", value)
    for value in (0, 2.5, -1, np.nan, "3"):
        with pytest.raises(ValueError, match="^n = "):
            validation.count("n", value)
    with pytest.raises(ValueError, match=r"^x = 3 must be finite, at most 2\. Lower it\.$"):
        validation.number("x", 3, at_most=2, remedy="Lower it.")


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_interval_orders(low, high):
    if low <= high:
        assert validation.interval("r", [low, high]) == (low, high)
    else:
        with pytest.raises(ValueError, match="^r = .* low above high. Swap"):
            validation.interval("r", [low, high])


def test_one_of_names_the_choices():
    assert validation.one_of("c", "a", ("a", "b")) == "a"
    with pytest.raises(ValueError, match="^c = 'd' is unknown. Choose one of a, b"):
        validation.one_of("c", "d", ("a", "b"))


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([[1.0, np.nan]], "has nan at flat index 1; every value must be finite"),
        ([[1.0, -np.inf]], "has -inf at flat index 1"),
        ([1.0, 2.0], r"has shape \(2,\), not \(any, 2\)"),
        ([[1.0, 2.0, 3.0]], r"has shape \(1, 3\), not \(any, 2\)"),
        ("abc", "is not an array of numbers"),
        ([[1], [2, 3]], "is not an array of numbers"),
        (np.ma.masked_equal([[1.0, 2.0, 1.0]], 1.0), "has 2 masked samples. Fill or cut them"),
        (np.array([1j, 2.0]), "is not an array of numbers but of complex128"),
        (["1", "2"], "is not an array of numbers but of <U1"),
        ([True, False], "is not an array of numbers but of bool"),
        (np.array(["1", 2.0], dtype=object), "is not an array of numbers but of object"),
        (np.array(["2026-01-01"], dtype="M8[D]"), "is not an array of numbers but of datetime64"),
    ],
)
def test_nothing_is_dropped_or_invented_on_the_way_to_floats(value, message):
    with pytest.raises(ValueError, match=f"^x {message}"):
        validation.finite_array("x", value, shape=(None, 2))


def test_finite_array_converts_to_float64():
    for value in ([[1, 2]], np.ma.array([[1, 2]])):
        array = validation.finite_array("x", value, shape=(None, 2))
        assert array.dtype == np.float64 and array.tolist() == [[1, 2]]
