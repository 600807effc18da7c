import numpy as np
import pytest
from scipy.signal import max_len_seq

from yawrate_env.signals.excitation import RANDOM_ORDER, prbs, register


@pytest.mark.parametrize("order", range(3, 17))
def test_register_is_scipys_maximum_length_sequence(order):
    np.testing.assert_array_equal(register(order), max_len_seq(order)[0])


@pytest.mark.parametrize("order", [2, 17, 7.5, "9"])
def test_a_register_that_is_not_there_is_refused_by_name(order):
    with pytest.raises(ValueError, match="order = "):
        prbs(100, 0.01, 0.1, 1.0, order=order)


def test_the_default_episode_is_the_first_100_of_127_bits():
    u = prbs(10_000, 0.001, 0.1, 0.0175)
    assert u.shape == (1, 10_000)
    expected = 0.0175 * (2.0 * max_len_seq(7)[0][:100] - 1)
    np.testing.assert_array_equal(u[0], np.repeat(expected, 100))


@pytest.mark.parametrize("hold", [1, 3, 7, 33])
def test_rounding_never_shifts_a_bit(hold):
    # k Ts/bit_time falls just short of a whole number for many of these products.
    u = prbs(100_000, 0.003, hold * 0.003, 1.0)[0]
    bits = 2.0 * np.resize(max_len_seq(7)[0], -(-100_000 // hold)) - 1
    np.testing.assert_array_equal(u, np.repeat(bits, hold)[:100_000])


def test_bit_time_need_not_be_a_multiple_of_the_sampling_time():
    u = prbs(1000, 0.01, 0.025, 1.0)[0]
    bits = 2.0 * max_len_seq(7)[0] - 1
    np.testing.assert_array_equal(u[:10], bits[[0, 0, 0, 1, 1, 2, 2, 2, 3, 3]])


def test_random_starts_are_shifts_of_the_order_14_register():
    start = np.array([0, 5, 16_382, 16_383, 2**64 - 1], dtype=np.uint64)
    u = prbs(2000, 0.01, 0.02, 1.0, order=RANDOM_ORDER, start=start)
    signal = 2.0 * max_len_seq(14)[0] - 1
    for row, first in zip(u, [0, 5, 16_382, 0, (2**64 - 1) % 16_383], strict=True):
        np.testing.assert_array_equal(row[::2], np.roll(signal, -first)[:1000])


def test_the_register_cannot_be_overwritten():
    with pytest.raises(ValueError, match="read-only"):
        register(7)[0] = 1
