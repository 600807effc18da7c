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


@pytest.mark.parametrize("value", [1, 1.5, np.float32(1.5), np.int64(3)])
def test_number_takes_numpy_scalars(value):
    assert type(validation.number("x", value)) is float


@pytest.mark.parametrize("value", [True, None, "1", 1j, [1.0], np.array([1.0])])
def test_number_refuses_other_types(value):
    with pytest.raises(ValueError, match="^x = .* is not a number"):
        validation.number("x", value)


def test_messages_end_with_the_remedy():
    with pytest.raises(ValueError, match=r"^x = 3 must be finite, at most 2\. Lower it\.$"):
        validation.number("x", 3, at_most=2, remedy="Lower it.")


@pytest.mark.parametrize("value", [3, 3.0, np.int32(3)])
def test_count_is_an_int(value):
    assert validation.count("n", value) == 3 and type(validation.count("n", value)) is int


@pytest.mark.parametrize("value", [0, 2.5, -1, np.nan, "3"])
def test_count_refuses_fractions_and_too_few(value):
    with pytest.raises(ValueError, match="^n = "):
        validation.count("n", value)


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
        ([[1.0, np.nan]], "^x has nan at flat index 1; every value must be finite"),
        ([[1.0, -np.inf]], "^x has -inf at flat index 1"),
        ([1.0, 2.0], r"^x has shape \(2,\), not \(any, 2\)"),
        ([[1.0, 2.0, 3.0]], r"^x has shape \(1, 3\), not \(any, 2\)"),
        ("abc", "^x is not an array of numbers"),
        ([[1], [2, 3]], "^x is not an array of numbers"),
    ],
)
def test_finite_array_says_what_is_wrong(value, message):
    with pytest.raises(ValueError, match=message):
        validation.finite_array("x", value, shape=(None, 2))


def test_finite_array_converts_to_float64():
    array = validation.finite_array("x", [[1, 2]], shape=(None, 2))
    assert array.dtype == np.float64 and array.tolist() == [[1, 2]]


@pytest.mark.parametrize(
    "value, message",
    [
        (np.ma.masked_equal([1.0, 2.0, 1.0], 1.0), "x has 2 masked samples. Fill or cut them"),
        (np.array([1j, 2.0]), "not an array of numbers but of complex128"),
        (["1", "2"], "not an array of numbers but of <U1"),
        ([True, False], "not an array of numbers but of bool"),
        (np.array(["1", 2.0], dtype=object), "not an array of numbers but of object"),
        (np.array(["2026-01-01"], dtype="M8[D]"), "not an array of numbers but of datetime64"),
    ],
)
def test_nothing_is_dropped_or_invented_on_the_way_to_floats(value, message):
    with pytest.raises(ValueError, match=message):
        validation.finite_array("x", value, shape=(None,))


def test_a_masked_array_without_masked_values_is_an_array():
    found = validation.finite_array("x", np.ma.array([1, 2]), shape=(2,))
    np.testing.assert_array_equal(found, [1.0, 2.0])
