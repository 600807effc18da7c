"""Random integers to vehicles, commands and noisy recordings."""

import math

import numpy as np
import pytest
import scipy.stats
from scipy.signal import max_len_seq

from yawrate_env.loop.simulation import simulate
from yawrate_env.plant.episodes import Draw, integers_of
from yawrate_env.signals.noise import standard_normal
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

INTEGERS = integers_of(yaw_rate(Task()))
LOW, HIGH = np.zeros((1, INTEGERS), np.uint64), np.full((1, INTEGERS), 2**64 - 1, np.uint64)


def drawn(task, count, root=0):
    return Draw.of(yaw_rate(task), stream(root, 0, count, INTEGERS))


def recorded(task, draw, rows=slice(None), out=None):
    u = draw.u if len(draw.u) == 1 else draw.u[rows]
    return yaw_rate(task).measure(draw.theta[rows], u, draw.keys[rows], out=out)


def noise_free(task, draw):
    return simulate(plants(task.vehicle, context_of(draw.theta), task.experiment.Ts), draw.u)


def test_an_episode_is_seeded_by_its_number():
    integers = stream(7, 3, 2, INTEGERS)
    assert integers.shape == (2, INTEGERS) and integers.dtype == np.uint64
    np.testing.assert_array_equal(stream(7, 0, 5, INTEGERS)[3:], integers)
    for row, episode in zip(integers, (3, 4), strict=True):
        seed = np.random.SeedSequence(7, spawn_key=(episode,))
        np.testing.assert_array_equal(row, seed.generate_state(INTEGERS, np.uint64))


def test_vehicles_are_uniform_over_the_prior_and_independent():
    plant = yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0)), experiment=Experiment(N=200)))
    integers = np.random.default_rng(0).integers(0, 2**64, (50_000, INTEGERS), dtype=np.uint64)
    low, high = plant.ranges
    theta = Draw.of(plant, integers).theta
    units = ((theta - low) / (high - low)).T
    for values in units:
        assert values.min() >= 0 and values.max() <= 1
        assert scipy.stats.kstest(values, "uniform").pvalue > 0.01  # 1 seed in 100
    z = np.corrcoef(units)[np.triu_indices(3, k=1)] * math.sqrt(50_000)
    assert np.abs(z).max() < 4  # 1 seed in 5000


def test_the_ends_of_the_integers_are_the_ends_of_the_range():
    plant = yaw_rate(Task(prior=Prior(M_delta=5.0)))
    mu_s, M_delta, v_x = Draw.of(plant, np.concatenate([LOW, HIGH])).theta.T
    assert mu_s[0] == 0.3 and 1.1 - 1e-15 < mu_s[1] <= 1.1
    assert M_delta.tolist() == [5, 5] and v_x.tolist() == [20, 20]


@pytest.mark.parametrize("register", ["same", "random"])
def test_a_recording_is_the_response_and_its_noise(register):
    task = Task(experiment=Experiment(register=register, N=3000))
    draw = drawn(task, 20)
    assert draw.u.shape == ((1 if register == "same" else 20), 3000)
    clean = noise_free(task, draw)
    sigma = np.sqrt((clean**2).mean(axis=1) / 1000)  # 30 dB, mean not removed
    expected = clean + sigma[:, None] * standard_normal(draw.keys, 3000)
    np.testing.assert_allclose(recorded(task, draw), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("snr_db", [0.0, 30.0, 60.0])
def test_signal_to_noise_ratio(snr_db):
    task = Task(experiment=Experiment(snr_db=snr_db))
    draw = drawn(task, 100)
    clean = noise_free(task, draw)
    noise = recorded(task, draw) - clean
    ratio = 10 * np.log10((clean**2).mean(axis=1) / (noise**2).mean(axis=1))
    # A variance from N samples is off by sqrt(2/N), in decibels 4.34 times that: 0.061 dB.
    error = 10 / math.log(10) * math.sqrt(2 / 10_000)
    assert np.abs(ratio - snr_db).max() < 4.5 * error  # 1 seed in 1500
    assert abs(ratio.mean() - snr_db) < 4 * error / 10


def test_random_registers_start_where_the_integer_says():
    plant = yaw_rate(Task(experiment=Experiment(register="random", N=500)))
    starts = stream(0, 0, 10, 1)[:, 0]
    bits = max_len_seq(14)[0]
    for row, start in zip(plant.inputs(starts), starts, strict=True):
        expected = 2.0 * np.roll(bits, -(int(start) % len(bits)))[:5] - 1
        np.testing.assert_array_equal(row[::100], np.radians(1.0) * expected)


@pytest.mark.parametrize("N", [200, 8192, 20_001])
@pytest.mark.parametrize("count", [1, 17])
def test_a_recording_does_not_depend_on_the_batch(N, count):
    task = Task(experiment=Experiment(N=N, register="random"))
    draw = drawn(task, 57)
    together = recorded(task, draw)
    for first in (0, 5, 17):
        rows = slice(first, first + count)
        np.testing.assert_array_equal(recorded(task, draw, rows), together[rows])


def test_recording_into_a_float32_view():
    task = Task(experiment=Experiment(N=300))
    draw, obs = drawn(task, 5), np.zeros((5, 2, 300), dtype=np.float32)
    y = recorded(task, draw, out=obs[:, 1])
    assert np.shares_memory(y, obs)
    np.testing.assert_array_equal(y, recorded(task, draw).astype(np.float32))
