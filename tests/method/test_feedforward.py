"""The network and its training by Levenberg and Marquardt's method."""

import dataclasses

import numpy as np
import pytest
import torch

from tuners.learners.feedforward import FeedForward, FeedForwardSettings
from tuners.learners.levenberg_marquardt import nguyen_widrow, normal_equations

torch.set_num_threads(1)


def unpacked(weights, shape):
    n, h, o = shape
    W1, b1, W2, b2 = torch.split(weights, [h * n, h, o * h, o])
    return W1.reshape(h, n), b1, W2.reshape(o, h), b2


def forward(weights, shape, x):
    W1, b1, W2, b2 = unpacked(weights, shape)
    return torch.nn.functional.linear(torch.tanh(torch.nn.functional.linear(x, W1, b1)), W2, b2)


def toy(count, seed):
    """Two smooth functions of three inputs of very different sizes."""
    X = np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    T = np.stack([np.sin(2 * X[:, 0]) * X[:, 1], 50 + np.exp(X[:, 2]) * X[:, 0]], axis=1)
    return X * [1.0, 1e-3, 1e3], T


def trained(X, T, X_val, T_val, random_state=0, progress=None, **settings):
    return FeedForwardSettings(**settings).fit([(X, T)], [(X_val, T_val)], random_state, progress)


@pytest.mark.parametrize("shape", [(3, 4, 2), (1, 1, 1), (6, 10, 2)])
def test_normal_equations_against_automatic_differentiation(shape):
    n, h, o = shape
    generator = torch.Generator().manual_seed(0)
    x, t, weights = (
        torch.randn(size, generator=generator, dtype=torch.float64)
        for size in ((20, n), (20, o), (h * n + h + o * h + o,))
    )

    def error(w):
        return (forward(w, shape, x) - t).ravel()

    J, e = torch.autograd.functional.jacobian(error, weights), error(weights)
    loss, Je, JJ = normal_equations(weights, shape, x, t)
    torch.testing.assert_close(loss, (e**2).mean())
    torch.testing.assert_close(Je, J.T @ e / (20 * o), rtol=1e-11, atol=1e-13)
    torch.testing.assert_close(JJ, J.T @ J / (20 * o), rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("n, neurons, outputs", [(6, 10, 2), (1, 5, 1), (3, 1, 2)])
def test_nguyen_widrow_spreads_the_hidden_units(n, neurons, outputs):
    shape = (n, neurons, outputs)
    weights = nguyen_widrow(*shape, np.random.default_rng(0))
    W1, b1, W2, b2 = (layer.numpy() for layer in unpacked(torch.from_numpy(weights), shape))
    magnitude = 0.7 * neurons ** (1 / n)
    np.testing.assert_allclose(np.linalg.norm(W1, axis=1), magnitude, rtol=1e-12)
    # A unit's centre lies on its own direction, at even distances from one end to the other.
    even = magnitude * np.linspace(-1, 1, neurons)
    np.testing.assert_allclose(b1 * np.sign(W1[:, 0]), even, rtol=1e-12)
    assert abs(W2).max() <= neurons**-0.5 and len(np.unique(W2)) == W2.size
    np.testing.assert_array_equal(b2, 0)


def test_fits_a_smooth_function_where_a_line_cannot():
    X, T, X_val, T_val, X_test, T_test = (a for seed in range(3) for a in toy(400, seed))
    net = trained(X, T, X_val, T_val, epochs=100)
    line = np.linalg.lstsq(np.pad(X, ((0, 0), (0, 1)), constant_values=1), T)[0]
    by_line = np.pad(X_test, ((0, 0), (0, 1)), constant_values=1) @ line
    error = [np.sqrt(np.mean((found - T_test) ** 2, axis=0)) for found in (net(X_test), by_line)]
    assert (error[0] < 0.02 * error[1]).all()


def noisy_toy(count, seed):
    X, T = toy(count, seed)
    return X, T + 0.3 * np.random.default_rng(seed + 10).standard_normal(T.shape)


def test_early_stopping_keeps_the_best_validation_weights():
    data = (*noisy_toy(60, 0), *noisy_toy(60, 1))  # 62 weights for 120 noisy numbers
    epochs = []
    found = trained(*data, progress=lambda done, of: epochs.append((done, of)))
    *epochs, end = epochs
    last = len(epochs)
    assert end == (last, last)  # it goes no further
    assert epochs == [(k, 1000) for k in range(1, last + 1)] and 5 < last < 1000

    def stopped_at(k):
        return trained(*data, epochs=k)

    def validation_error(net):
        # Mean over both outputs in the scale that training sees.
        return np.mean(((net(data[2]) - data[3]) / net.outputs.half) ** 2)

    for name, weights in stopped_at(last - 5).arrays().items():
        np.testing.assert_array_equal(found.arrays()[name], weights)
    assert validation_error(found) < validation_error(stopped_at(last - 6))
    history = [validation_error(stopped_at(k)) for k in range(last)]
    assert (np.diff(history) <= 0).all()  # best so far


def test_a_recovery_starts_the_count_of_rises_anew():
    data = (*noisy_toy(60, 0), *noisy_toy(60, 1))
    recoveries = 0
    for random_state in range(4):
        epochs = []
        trained(*data, random_state, lambda done, of, e=epochs: e.append(done), max_fail=2)
        best = epochs[-1] - 2
        nets = [trained(*data, random_state, epochs=k) for k in range(best + 1)]
        history = [np.mean(((net(data[2]) - data[3]) / net.outputs.half) ** 2) for net in nets]
        assert history[best] < history[best - 1]
        recoveries += (np.diff(history) == 0).any()
    assert recoveries  # the case that the test is about occurred


def test_every_step_lowers_the_training_error():
    X, T = toy(100, 0)
    nets = [trained(X, T, X, T, epochs=k, neurons=4) for k in range(12)]
    errors = [np.mean(((net(X) - T) / net.outputs.half) ** 2) for net in nets]
    assert (np.diff(errors) < 0).all()


def test_training_ends_where_nothing_is_left_to_gain():
    X, _ = toy(50, 0)
    T = np.ones((50, 2))  # scaled to zero: no output weights at all fit exactly
    epochs = []
    net = trained(X, T, X, T, progress=lambda done, of: epochs.append(done))
    assert epochs[-1] < 100
    np.testing.assert_allclose(net(X), T, atol=1e-6)


def test_the_random_state_decides_everything():
    data = (*toy(50, 0), *toy(50, 1))
    one, same, other = (trained(*data, random_state=seed, epochs=10) for seed in (3, 3, 4))
    for name, weights in one.arrays().items():
        np.testing.assert_array_equal(same.arrays()[name], weights)
    assert not np.allclose(other.W1, one.W1)


def test_units_do_not_matter():
    # Powers of two change no rounding, so the whole training repeats.
    X, T, X_val, T_val = (*toy(50, 0), *toy(50, 1))
    plain = trained(X, T, X_val, T_val, epochs=10)
    scaled = trained(8 * X, 4 * T, 8 * X_val, 4 * T_val, epochs=10)
    np.testing.assert_array_equal(scaled(8 * X), 4 * plain(X))


def test_constant_columns_do_no_harm():
    constant = 7.0
    X, T, X_val, T_val = (*toy(300, 0), *toy(300, 1))
    X, X_val = (np.insert(a, 1, constant, axis=1) for a in (X, X_val))
    T, T_val = (np.insert(a, 1, constant, axis=1) for a in (T, T_val))
    net = trained(X, T, X_val, T_val, epochs=60)
    # Within 2 % of the ranges, as without them.
    assert abs(net(X_val) - T_val).max() < 0.02 * np.ptp(T, axis=0).max()
    np.testing.assert_allclose(net(X_val)[:, 1], constant, atol=1e-4)


def test_arrays_that_do_not_go_together_are_refused():
    arrays = trained(*toy(50, 0), *toy(50, 1), epochs=1).arrays()
    for name in ("W1", "W2", "inputs.half", "outputs.middle"):
        with pytest.raises(ValueError, match=f"{name} has shape"):
            FeedForward.from_arrays(arrays | {name: arrays[name][:-1]})
        with pytest.raises(ValueError, match=f"{name} has nan"):
            FeedForward.from_arrays(arrays | {name: arrays[name] * np.nan})


def test_defaults_are_the_papers():
    expected = {"neurons": 10, "epochs": 1000, "mu": 0.001}
    expected |= {"mu_decrease": 0.1, "mu_increase": 10.0, "max_fail": 5}
    assert dataclasses.asdict(FeedForwardSettings()) == expected


@pytest.mark.parametrize(
    "wrong", [{"neurons": 0}, {"neurons": 1.5}, {"epochs": -1}, {"mu": -1.0}, {"mu_increase": 1.0}]
)
def test_settings_that_train_nothing_or_never_end_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=name):
        FeedForwardSettings(**wrong)
