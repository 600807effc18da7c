import math

import numpy as np
import pytest
import scipy.stats
from scipy.signal import max_len_seq

from yawrate_env.batch import replaced, take
from yawrate_env.loop.simulation import simulate
from yawrate_env.signals.noise import standard_normal
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.episode import WORDS, Draw, excitation, plants, record
from yawrate_env.vehicle.task import Experiment, Prior, Task


def draw(task, count, root=0):
    return Draw.of(stream(root, 0, count, WORDS), task.prior)


def noise_free(task, drawn):
    u = excitation(task.experiment, drawn.start)
    return simulate(plants(task.vehicle, drawn.context, task.experiment.Ts), u)


def test_an_episode_is_seeded_by_its_number():
    words = stream(7, 3, 2, WORDS)
    assert words.shape == (2, WORDS) and words.dtype == np.uint64
    np.testing.assert_array_equal(stream(7, 0, 5, WORDS)[3:], words)
    for row, episode in zip(words, (3, 4), strict=True):
        seed = np.random.SeedSequence(7, spawn_key=(episode,))
        np.testing.assert_array_equal(row, seed.generate_state(WORDS, np.uint64))


def test_context_is_uniform_over_the_prior_and_independent():
    prior = Prior(mu_s=(0.3, 1.1), M_delta=(0.0, 300.0), v_x=(10.0, 33.0))
    words = np.random.default_rng(0).integers(0, 2**64, (50_000, WORDS), dtype=np.uint64)
    context = Draw.of(words, prior).context
    units = []
    for name in ("mu_s", "M_delta", "v_x"):
        low, high = getattr(prior, name)
        values = getattr(context, name)
        assert low <= values.min() and values.max() <= high
        units.append((values - low) / (high - low))
        assert scipy.stats.kstest(units[-1], "uniform").pvalue > 0.01  # 1 seed in 100
    z = np.corrcoef(units)[np.triu_indices(3, k=1)] * math.sqrt(50_000)
    assert np.abs(z).max() < 4  # 1 seed in 5000


def test_the_ends_of_the_words_are_the_ends_of_the_range():
    words = np.array([[0] * WORDS, [2**64 - 1] * WORDS], dtype=np.uint64)
    context = Draw.of(words, Prior(mu_s=(0.3, 1.1), M_delta=5.0, v_x=(20.0, 20.0))).context
    assert context.mu_s[0] == 0.3 and 1.1 - 1e-15 < context.mu_s[1] <= 1.1
    assert context.M_delta.tolist() == [5, 5] and context.v_x.tolist() == [20, 20]


@pytest.mark.parametrize("register", ["same", "random"])
def test_a_recording_is_the_response_and_its_noise(register):
    task = Task(experiment=Experiment(register=register, N=3000))
    drawn = draw(task, 20)
    u, y = record(task, drawn)
    assert u.shape == ((1 if register == "same" else 20), 3000)
    clean = noise_free(task, drawn)
    sigma = np.sqrt((clean**2).mean(axis=1) / 1000)  # 30 dB, mean not removed
    expected = clean + sigma[:, None] * standard_normal(drawn.key, 3000)
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("snr_db", [0.0, 30.0, 60.0])
def test_signal_to_noise_ratio(snr_db):
    task = Task(experiment=Experiment(snr_db=snr_db))
    drawn = draw(task, 100)
    clean = noise_free(task, drawn)
    noise = record(task, drawn)[1] - clean
    ratio = 10 * np.log10((clean**2).mean(axis=1) / (noise**2).mean(axis=1))
    # A variance from N samples is off by sqrt(2/N), in decibels 4.34 times that: 0.061 dB.
    error = 10 / math.log(10) * math.sqrt(2 / 10_000)
    assert np.abs(ratio - snr_db).max() < 4.5 * error  # 1 seed in 1500
    assert abs(ratio.mean() - snr_db) < 4 * error / 10


def test_random_registers_start_where_the_draw_says():
    task = Task(experiment=Experiment(register="random", N=500))
    drawn = draw(task, 10)
    u, _ = record(task, drawn)
    bits = max_len_seq(14)[0]
    for row, start in zip(u, drawn.start, strict=True):
        first = int(start) % len(bits)
        expected = 2.0 * np.roll(bits, -first)[:5] - 1
        np.testing.assert_array_equal(row[::100], np.radians(1.0) * expected)


@pytest.mark.parametrize("N", [200, 8192, 20_001])
@pytest.mark.parametrize("count", [1, 17])
def test_a_recording_does_not_depend_on_the_batch(N, count):
    task = Task(experiment=Experiment(N=N, register="random"))
    drawn = draw(task, 57)
    _, together = record(task, drawn)
    for first in (0, 5, 17):
        part = slice(first, first + count)
        np.testing.assert_array_equal(record(task, take(drawn, part))[1], together[part])


def test_recording_into_a_float32_view():
    task = Task(experiment=Experiment(N=300))
    drawn, obs = draw(task, 5), np.zeros((5, 2, 300), dtype=np.float32)
    _, y = record(task, drawn, out=obs[:, 1])
    assert np.shares_memory(y, obs)
    np.testing.assert_array_equal(y, record(task, drawn)[1].astype(np.float32))


def test_replaced_episodes_and_no_others():
    task = Task(experiment=Experiment(N=300, register="random"))
    old, new = draw(task, 6), draw(task, 2, root=1)
    before = record(task, old)[1]
    mixed = record(task, replaced(old, np.array([1, 4]), new))[1]
    np.testing.assert_array_equal(mixed[[1, 4]], record(task, new)[1])
    np.testing.assert_array_equal(mixed[[0, 2, 3, 5]], before[[0, 2, 3, 5]])
    np.testing.assert_array_equal(record(task, old)[1], before)  # the original is left alone
