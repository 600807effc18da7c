import numpy as np
import pytest
from scipy.signal import max_len_seq

from yawrate_env.signals.excitation import RANDOM_ORDER, multilevel, multisine, prbs, register


@pytest.mark.parametrize("order", range(2, 21))
def test_register_is_scipys_maximum_length_sequence(order):
    np.testing.assert_array_equal(register(order), max_len_seq(order)[0])


@pytest.mark.parametrize("order", [1, 21, 7.5, "9"])
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


@pytest.mark.parametrize("order", [6, 7, 10])
@pytest.mark.parametrize("levels", [2, 3, 4, 9])
def test_levels_are_evenly_spaced_and_equally_frequent(levels, order):
    period = 2**order - 1
    u = multilevel(period, 1.0, 1.0, 2.0, levels, order=order)[0]
    values, counts = np.unique(u, return_counts=True)
    np.testing.assert_allclose(values, np.linspace(-2.0, 2.0, levels), atol=1e-12)
    assert counts.max() - counts.min() <= 1


@pytest.mark.parametrize("levels", [2, 3, 4, 9])
def test_levels_are_white_until_the_register_has_come_round(levels):
    u = multilevel(1000, 1.0, 1.0, 2.0, levels)[0]
    products = np.fft.irfft(np.abs(np.fft.rfft(u, 2000)) ** 2)[:1000] / (u @ u)
    assert products[0] == pytest.approx(1.0) and np.abs(products[1:]).max() < 4.5 / np.sqrt(1000)


def test_levels_are_held_and_start_where_they_are_told():
    u = multilevel(300, 0.5, 2.0, 1.0, 4)[0].reshape(-1, 4)
    assert (u == u[:, :1]).all()
    shifted = multilevel(300, 0.5, 2.0, 1.0, 4, start=np.array([0, 5], np.uint64))
    np.testing.assert_array_equal(shifted[0].reshape(-1, 4), u)
    np.testing.assert_array_equal(shifted[1].reshape(-1, 4)[:-5], u[5:])


@pytest.mark.parametrize("N", [600, 601])
def test_a_multisine_has_equal_lines_up_to_its_band_and_a_small_crest(N):
    u = multisine(N, 1.0, 20.0, 3.0)[0]
    lines = np.abs(np.fft.rfft(u))
    highest = int(0.44 / 20.0 * N)
    np.testing.assert_allclose(lines[1 : highest + 1], lines[1], rtol=1e-9)
    assert lines[0] < 1e-9 and lines[highest + 1 :].max() < 1e-9
    np.testing.assert_allclose(np.abs(u).max(), 3.0)
    assert np.abs(u).max() / np.sqrt(np.mean(u**2)) < 1.9  # 5 for sines in phase
    late = multisine(N, 1.0, 20.0, 3.0, start=np.array([7], np.uint64))[0]
    np.testing.assert_allclose(late, np.roll(u, -7))


@pytest.mark.parametrize("call, name", [
    (lambda: multilevel(100, 1.0, 1.0, 1.0, 1), "levels"),
    (lambda: multilevel(100, 1.0, 1.0, 1.0, 9, order=3), "levels"),
    (lambda: multisine(100, 1.0, 60.0, 1.0), "bit_time"),
])  # fmt: skip
def test_inputs_that_cannot_be_made_are_refused_by_name(call, name):
    with pytest.raises(ValueError, match=name):
        call()
