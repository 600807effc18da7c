"""Starts in mid-drive and offsets: found where they are, not found where they are not."""

from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, LINEAR, trained
from families import tested as recordings
from first_order import CROSSOVER, TS, described
from recordings import recorded as drives
from scipy.signal import lfilter

from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import black_box, free_responses
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.episodes import recorded
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import BLACK_BOX, yaw_rate

FUNCTIONS = Laguerre(*BLACK_BOX)
LONG = prbs(3000, TS, 0.5, 1.0)[0]  # a minute


@pytest.fixture(params=LINEAR)
def family(request):
    return request.param


def modelled(family, recording, start):
    plant = FAMILIES[family]
    functions = trained(family).inspection.black_box
    return black_box(plant, functions, recording.u, recording.y, start, recording.oversampled)


def cut(recording, first, offset):
    return replace(recording, u=recording.u[:, first:], y=recording.y[:, first:] + offset)


def test_free_responses_are_orthonormal_and_hold_decays_a_trend_and_a_constant():
    Z, (constant, trend) = free_responses(FUNCTIONS, 5000, 0.001)
    np.testing.assert_allclose(Z @ Z.T, np.eye(FUNCTIONS.order + 2), atol=1e-10)
    decay = np.exp(-FUNCTIONS.pole * 0.001 * np.arange(5000))
    for signal in (decay, np.arange(5000) * decay, np.arange(5000), np.ones(5000)):
        np.testing.assert_allclose(Z.T @ (Z @ signal), signal, atol=1e-8 * np.abs(signal).max())
    # The constant is found beside a decay and a line about the middle, and by the first alone.
    mixed = 0.3 + 0.2 * decay + 0.1 * np.linspace(-1, 1, 5000)
    assert Z @ mixed @ constant == pytest.approx(0.3, rel=1e-9)
    assert Z @ mixed @ trend == pytest.approx(0.1, rel=1e-9)
    assert (Z @ np.full(5000, 0.3))[0] * constant[0] == pytest.approx(0.3, rel=1e-9)


@pytest.mark.parametrize("extra, added", [
    (0, lambda t: 0 * t), (1, lambda t: 0.02 + 0 * t), (2, lambda t: 0.02 + 0.004 * t),
])  # fmt: skip
def test_no_more_is_estimated_than_a_recording_needs(extra, added):
    plant, rest = FAMILIES["vehicle"], recordings("vehicle")
    t = plant.Ts * np.arange(rest.y.shape[1])
    model = modelled("vehicle", replace(rest, y=rest.y + added(t)), "auto")
    assert (model.extra == extra).mean() > 0.9
    np.testing.assert_allclose(model.offset, added(t).mean(), atol=5e-3)


def test_recordings_from_rest_are_left_alone(family):
    rest = recordings(family)
    model = modelled(family, rest, "auto")
    assert model.unknown.mean() < 0.05
    alone = ~model.unknown
    np.testing.assert_array_equal(model.y[alone], rest.y[alone])
    assert (model.offset[alone] == 0).all() and (model.free[alone] == 0).all()


@pytest.mark.parametrize("register", ["same", "random"])
def test_a_start_in_mid_drive_is_found_and_taken_out(register):
    plant = yaw_rate(Task(experiment=Experiment(register=register)))
    block = recorded(plant, "test", 0, 4)
    u, y = block.u[:, 3000:], block.y[:, 3000:] + 0.02
    model = black_box(plant, FUNCTIONS, u, y, "auto")
    assert model.unknown.all()
    np.testing.assert_allclose(model.offset, 0.02, atol=5e-4)
    # What is left is the response from rest to the commands of the rest of the episode.
    clean = plant.respond(block.theta, u)
    noise = np.sqrt(model.residual / y.shape[1])
    error = np.sqrt(((model.y - clean) ** 2).mean(axis=1))
    np.testing.assert_allclose(error, noise, rtol=0.15)


def test_offsets_of_the_input_end_up_in_the_constant():
    plant, rest = FAMILIES["vehicle"], recordings("vehicle")
    biased = replace(rest, u=rest.u + 0.005)
    model = modelled("vehicle", biased, "auto")
    gain = plant.respond(rest.known, np.ones((1, 1000)))[:, -1]
    np.testing.assert_allclose(model.offset, -0.005 * gain, rtol=0.1)


@pytest.mark.parametrize("start", ["rest", "unknown"])
def test_both_ways_to_the_normal_equations_give_one_answer(start):
    rest = recordings("vehicle").part(slice(0, 6))
    own = replace(rest, u=np.repeat(rest.u, len(rest), axis=0))
    one, other = modelled("vehicle", rest, start), modelled("vehicle", own, start)
    np.testing.assert_allclose(one.coefficients, other.coefficients, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(one.residual, other.residual, rtol=1e-8)


def test_bad_input_is_refused():
    rest = recordings("lag")
    with pytest.raises(ValueError, match="start = 'moving'"):
        modelled("lag", rest, "moving")
    with pytest.raises(ValueError, match="samples are too few"):
        modelled("lag", replace(rest, u=rest.u[:, :90], y=rest.y[:, :90]), "auto")


def test_resampling_keeps_inputs_and_follows_the_output():
    plant = yaw_rate(Task())
    rest = drives(4)
    clean = plant.respond(rest.known, rest.u)
    coarse = replace(rest, u=rest.u[:, ::10], y=clean[:, ::10], Ts=10 * rest.Ts)
    fine = coarse.resampled(rest.Ts)
    N = fine.y.shape[1]
    assert fine.Ts == rest.Ts and fine.oversampled == pytest.approx(10 / 0.873) and N == 9991
    np.testing.assert_array_equal(fine.u, rest.u[:, :N])
    error = np.sqrt(((fine.y - clean[:, :N]) ** 2).mean()) / np.sqrt((clean**2).mean())
    assert error < 2e-4
    assert coarse.resampled(10 * rest.Ts) is coarse


def test_tuners_of_linear_plants_find_the_start_and_others_are_told_of_it():
    plant = described(linear=True, crossover=CROSSOVER, u=LONG)
    block, tuner = recorded(plant, "test", 0, 16), Tuner(plant, trained("lag").method)
    moving = Recording(block.u[:, 150:], block.y[:, 150:] + 0.3, TS)
    right = plant.oracle(block.theta)
    gains, found = tuner.assess(moving)
    assert found.model.unknown.all() and found.trusted.mean() > 0.9
    assert np.abs(gains.values / right - 1).max() < 0.15
    np.testing.assert_allclose(found.model.offset, 0.3, atol=0.02)
    blind = Tuner(described(crossover=CROSSOVER, u=LONG), tuner.method)
    assert not blind.assess(moving)[1].trusted.any()
    assert blind.assess(moving, start="unknown")[1].trusted.mean() > 0.9
    found = tuner.assess(Recording(block.u, block.y, TS))[1]
    assert not found.model.unknown.any() and found.trusted.all()


def test_a_start_takes_no_more_than_it_needs():
    plant = yaw_rate(Task(experiment=Experiment(snr_db=14.0, register="random")))
    block = recorded(plant, "test", 0, 32)
    model = black_box(plant, FUNCTIONS, block.u[:, 1000:6000], block.y[:, 1000:6000], "auto")
    assert model.unknown.all() and (model.extra < FUNCTIONS.order).mean() > 0.9


@pytest.mark.parametrize("memory", [0.03, 0.3])
def test_coloured_noise_is_no_trend_and_no_start(memory):
    plant = yaw_rate(Task())
    block = recorded(plant, "test", 0, 24)
    a = np.exp(-plant.Ts / memory)
    white = np.random.default_rng(3).standard_normal((24, block.y.shape[1] + 3000))
    gusts = lfilter([np.sqrt(1 - a * a)], [1, -a], white, axis=1)[:, 3000:]
    noise = 0.05 * block.y.std(axis=1, keepdims=True) * gusts
    rest = black_box(plant, FUNCTIONS, block.u, block.y + noise, "auto")
    assert rest.unknown.mean() < 0.3
    late = np.ascontiguousarray((block.y + noise)[:, 2000:])
    moving = black_box(plant, FUNCTIONS, block.u[:, 2000:], late, "auto")
    assert moving.unknown.mean() > 0.8
