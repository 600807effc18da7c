"""The generator bit by bit, then its statistics.

Seeds are fixed, so each statistical test gives the same answer every time; a limit of
z standard errors would fail for a share of seeds that the comment beside it states.
"""

import math

import numpy as np
import pytest
import scipy.stats

from yawrate_env.signals.noise import KEY_WORDS, add_white_noise, standard_normal

LANES = 16
WORD = 2**64 - 1
GOLDEN = 0x9E3779B97F4A7C15


def keys(count, seed=0):
    return np.random.default_rng(seed).integers(0, 2**64, (count, KEY_WORDS), dtype=np.uint64)


@pytest.fixture(scope="module")
def sample():
    """200 streams of 10 000, two million numbers."""
    return standard_normal(keys(200), 10_000)


def splitmix64(state):
    """Vigna's splitmix64.c: the numbers from a state are the mixed multiples of GOLDEN."""
    z = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & WORD
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & WORD
    return z ^ (z >> 31)


def xoshiro256plusplus(s):
    """Blackman and Vigna's xoshiro256plusplus.c."""

    def rotated(x, k):
        return ((x << k) | (x >> (64 - k))) & WORD

    s = list(s)
    while True:
        yield (rotated((s[0] + s[3]) & WORD, 23) + s[0]) & WORD
        t = (s[1] << 17) & WORD
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = rotated(s[3], 45)


def box_muller(first, second):
    """Two normal numbers from two words; the second word's last bit turns the circle's half."""
    radius = math.sqrt(-2 * math.log(1 - (first >> 12) * 2.0**-52))
    angle = math.pi * ((second >> 12) * 2.0**-52 - 0.5)
    return radius * math.cos(angle) * (-1) ** (second & 1), radius * math.sin(angle)


def literal_stream(key, pairs):
    """LANES generators in turn, in plain integers and math functions."""
    lanes = []
    for lane in range(1, LANES + 1):
        state = [0]
        for word in key:
            state.append(splitmix64(((int(word) + lane * GOLDEN) & WORD) ^ state[-1]))
        lanes.append(xoshiro256plusplus(state[1:]))
    blocks = []
    for _ in range(pairs):
        values = [box_muller(next(lane), next(lane)) for lane in lanes]
        blocks.append(np.transpose(values))
    return np.concatenate(blocks, axis=None)


def test_the_transcriptions_give_the_published_outputs():
    # splitmix64 from 1234567 (Rosetta Code), xoshiro256++ from 1, 2, 3, 4 (rand_xoshiro's test).
    numbers = [splitmix64((1234567 + k * GOLDEN) & WORD) for k in (1, 2)]
    assert numbers == [6457827717110365317, 3203168211198807973]
    numbers = xoshiro256plusplus([1, 2, 3, 4])
    assert [next(numbers) for _ in range(4)] == [
        41943041,
        58720359,
        3588806011781223,
        3591011842654386,
    ]


@pytest.mark.parametrize("key", [*keys(5), np.zeros(4, np.uint64), np.full(4, WORD, np.uint64)])
def test_numbers_are_those_of_the_plain_transcription(key):
    literal = literal_stream(key, pairs=100)
    # The polynomials for log, sine and cosine stop at 2e-11.
    np.testing.assert_allclose(standard_normal(key[None], 3200)[0], literal, rtol=0, atol=5e-11)


def test_moments(sample):
    # Standard errors of mean, variance, skewness and kurtosis; 4 of them fail 1 seed in 4000.
    x, n = sample.ravel(), sample.size
    for power, expected, error in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert abs((x**power).mean() - expected) < 4 * math.sqrt(error / n)


def test_distribution(sample):
    assert scipy.stats.kstest(sample.ravel(), "norm").pvalue > 0.01  # 1 seed in 100


@pytest.mark.parametrize("limit", [2.0, 3.0, 4.0, 4.5])
def test_tails(sample, limit):
    for tail in (sample > limit, sample < -limit):
        expected = scipy.stats.norm.sf(limit) * sample.size
        assert abs(tail.sum() - expected) < 4 * math.sqrt(expected)


@pytest.mark.parametrize("of", [lambda x: x, lambda x: (x**2 - 1) / math.sqrt(2)])
def test_no_number_tells_of_a_later_one(sample, of):
    # Lags up to 100 pass the 16 lanes and the 32 numbers of a block; with the squares, the
    # radius shared by two numbers too. The largest of 100 normal z is above 4.5 for 1 in 1400.
    x = of(sample)
    for lag in range(1, 101):
        products = x[:, lag:] * x[:, :-lag]
        assert abs(products.sum()) / math.sqrt(products.size) < 4.5


@pytest.mark.parametrize("word", range(KEY_WORDS))
def test_neighbouring_keys_give_unrelated_streams(word):
    near = np.repeat(keys(1), 64, axis=0)
    near[:, word] += np.arange(64, dtype=np.uint64)
    x = standard_normal(near, 10_000)
    z = np.corrcoef(x)[np.triu_indices(64, k=1)] * math.sqrt(10_000)
    # The largest of 2016 normal z is above 5 for 1 in 900; together they are normal again.
    assert np.abs(z).max() < 5
    assert scipy.stats.kstest(z, "norm").pvalue > 0.01


def test_white_in_frequency(sample):
    power = (np.abs(np.fft.rfft(sample[:, :8192])) ** 2).mean(axis=0)[1:-1] / 8192
    # Means of 200 periodograms of a chi-square with 2 degrees of freedom each.
    error = 1 / math.sqrt(len(sample))
    assert np.abs(power - 1).max() < 6 * error
    assert abs(power.mean() - 1) < 4 * error / math.sqrt(len(power))


@pytest.mark.parametrize("rows, N", [(1, 1), (3, 31), (3, 32), (17, 33), (17, 1000)])
def test_a_stream_depends_neither_on_its_length_nor_on_the_batch(rows, N):
    together = standard_normal(keys(40), 2000)
    part = standard_normal(keys(40)[5 : 5 + rows], N)
    np.testing.assert_array_equal(part, together[5 : 5 + rows, :N])


def test_noise_is_scaled_and_added_row_by_row():
    signal, sigma = np.random.default_rng(1).standard_normal((3, 100)), np.array([0.0, 1.0, 1e-3])
    out = np.empty((3, 100))
    add_white_noise(signal, sigma, keys(3), out)
    expected = signal + sigma[:, None] * standard_normal(keys(3), 100)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(out[0], signal[0])


def test_output_may_be_a_float32_view_with_strides():
    obs = np.zeros((3, 2, 100), dtype=np.float32)
    add_white_noise(np.zeros((3, 100)), np.ones(3), keys(3), obs[:, 1])
    np.testing.assert_array_equal(obs[:, 1], standard_normal(keys(3), 100).astype(np.float32))
    assert not obs[:, 0].any()
