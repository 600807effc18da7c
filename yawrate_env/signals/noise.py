"""White Gaussian noise, one stream an episode.

``xoshiro256++`` (Blackman and Vigna, 2021), ``LANES`` generators side by side, seeded
from the episode's key by SplitMix64 as its authors advise, and the transform of Box
and Muller (1958) with polynomials in place of library calls, so that all of it
vectorises: about half the time of NumPy's scalar ziggurat on one core.  A stream
depends on its key alone, never on batch size or threads.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel, subkernel

KEY_WORDS = 4

_PAIR = 2 * LANES
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1, _MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S12, _S17, _S19, _S23, _S27, _S30, _S31, _S41, _S45, _S52, _S63 = (
    np.uint64(s) for s in (12, 17, 19, 23, 27, 30, 31, 41, 45, 52, 63)
)
_ONE_BITS = np.uint64(0x3FF0000000000000)  # 1.0
_ROOT_2_BITS = np.uint64(0x3FE6A09E667F3BCD)  # sqrt(1/2)
_TWO_52_BITS = np.uint64(0x4330000000000000)  # 2^52: or-ing a small integer in adds it
_TWO_52_BIASED = 4503599627370496.0 + 1023.0
_LN_2 = 0.6931471805599453
_TWO_PI = 6.283185307179586


def standard_normal(keys: NDArray[np.uint64], N: int) -> NDArray[np.float64]:
    """`N` standard normal numbers for each of (E, 4) keys, (E, N) float64."""
    out = np.empty((len(keys), N))
    add_white_noise(np.zeros((len(keys), N)), np.ones(len(keys)), keys, out)
    return out


@subkernel
def _seeded(key: NDArray[np.uint64], state: NDArray[np.uint64]) -> None:
    """Fill the (4, LANES) generator states from the four words of a key.

    A word is chained to the one before: the generator's third word reaches its output
    only after two steps, and keys that differed there alone would begin alike.
    """
    for word in range(KEY_WORDS):
        z = key[word]
        for lane in range(LANES):
            z += _GOLDEN
            x = z ^ state[word - 1, lane] if word > 0 else z
            x = (x ^ (x >> _S30)) * _MIX_1
            x = (x ^ (x >> _S27)) * _MIX_2
            state[word, lane] = x ^ (x >> _S31)


@subkernel
def _fill(state: NDArray[np.uint64], out: NDArray[np.float64]) -> None:
    """Fill (pairs, 2, LANES) with standard normal numbers, advancing the states."""
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    for k in range(len(out)):
        pair = out[k]
        for lane in range(LANES):
            a, b, c, d = s0[lane], s1[lane], s2[lane], s3[lane]
            first = a + d
            first = ((first << _S23) | (first >> _S41)) + a
            t = b << _S17
            c ^= a
            d ^= b
            b ^= c
            a ^= d
            c ^= t
            d = (d << _S45) | (d >> _S19)
            second = a + d
            second = ((second << _S23) | (second >> _S41)) + a
            t = b << _S17
            c ^= a
            d ^= b
            b ^= c
            a ^= d
            c ^= t
            d = (d << _S45) | (d >> _S19)
            s0[lane], s1[lane], s2[lane], s3[lane] = a, b, c, d

            # log of a uniform number in (0, 1]: exponent and mantissa m in [sqrt(1/2), sqrt(2)),
            # log m = 2 artanh((m - 1)/(m + 1)).
            uniform = 2.0 - np.uint64((first >> _S12) | _ONE_BITS).view(np.float64)
            bits = np.float64(uniform).view(np.uint64)
            exponent = (bits - _ROOT_2_BITS + _ONE_BITS) >> _S52
            m = np.uint64(bits - ((exponent << _S52) - _ONE_BITS)).view(np.float64)
            e = np.uint64(exponent | _TWO_52_BITS).view(np.float64) - _TWO_52_BIASED
            z = (m - 1.0) / (m + 1.0)
            zz = z * z
            p = 1.0 / 15.0
            p = p * zz + 1.0 / 13.0
            p = p * zz + 1.0 / 11.0
            p = p * zz + 1.0 / 9.0
            p = p * zz + 1.0 / 7.0
            p = p * zz + 1.0 / 5.0
            p = p * zz + 1.0 / 3.0
            p = p * zz + 1.0
            radius = np.sqrt(-2.0 * (e * _LN_2 + 2.0 * z * p))

            # An angle in [-pi/2, pi/2) and a random sign of its cosine cover the circle.
            angle = (np.uint64((second >> _S12) | _ONE_BITS).view(np.float64) - 1.5) * (
                0.5 * _TWO_PI
            )
            w = angle * angle
            p = -7.647163731819816e-13
            p = p * w + 1.6059043836821613e-10
            p = p * w - 2.505210838544172e-8
            p = p * w + 2.7557319223985893e-6
            p = p * w - 1.984126984126984e-4
            p = p * w + 8.333333333333333e-3
            p = p * w - 1.6666666666666666e-1
            sine = angle + angle * w * p
            p = 4.779477332387385e-14
            p = p * w - 1.1470745597729725e-11
            p = p * w + 2.08767569878681e-9
            p = p * w - 2.755731922398589e-7
            p = p * w + 2.48015873015873e-5
            p = p * w - 1.388888888888889e-3
            p = p * w + 4.1666666666666664e-2
            p = p * w - 0.5
            cosine = 1.0 + w * p
            cosine = np.uint64(np.float64(cosine).view(np.uint64) ^ (second << _S63)).view(
                np.float64
            )
            pair[0, lane] = radius * cosine
            pair[1, lane] = radius * sine


def add_white_noise(
    signal: NDArray[np.float64],
    sigma: NDArray[np.float64],
    keys: NDArray[np.uint64],
    out: NDArray[np.floating],
) -> None:
    """``out = signal + sigma * noise``, row by row.

    Parameters
    ----------
    signal : (E, N) float64
    sigma : (E,) float64
        Standard deviation of each row's noise.
    keys : (E, 4) uint64
        Each row's stream.
    out : (E, N) float32 or float64
        Written; may be a view with strides.
    """
    state = np.empty((KEY_WORDS, LANES), dtype=np.uint64)
    noise = np.empty((-(-signal.shape[1] // _PAIR), 2, LANES))
    _add(signal, sigma, keys, state, noise, noise.reshape(-1), out)


@kernel
def _add(
    signal: NDArray[np.float64],
    sigma: NDArray[np.float64],
    keys: NDArray[np.uint64],
    state: NDArray[np.uint64],
    noise: NDArray[np.float64],
    flat: NDArray[np.float64],
    out: NDArray[np.floating],
) -> None:
    """`add_white_noise` with its workspace; `flat` is `noise`, unrolled."""
    for row in range(len(signal)):
        _seeded(keys[row], state)
        _fill(state, noise)
        for k in range(signal.shape[1]):
            out[row, k] = signal[row, k] + sigma[row] * flat[k]
