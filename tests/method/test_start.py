"""Starts in mid-drive and offsets: found where they are, not found where they are not."""

import numpy as np
import pytest
from recordings import recorded

from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import black_box, free_responses
from tuners.tuner.recording import Recording
from yawrate_env.loop.simulation import simulate
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import BLACK_BOX, yaw_rate

REST = recorded(8)


def modelled(recording, start):
    plant = yaw_rate(Task())
    return black_box(plant, BLACK_BOX, recording.u, recording.y, start, recording.oversampled)


def middle(recording, first, offset):
    return Recording(
        recording.u[:, first:], recording.y[:, first:] + offset, recording.Ts, recording.v_x
    )


def test_free_responses_are_orthonormal_and_hold_the_decays_and_a_constant():
    Z, constant = free_responses(BLACK_BOX, 5000, 0.001)
    np.testing.assert_allclose(Z @ Z.T, np.eye(BLACK_BOX.order + 1), atol=1e-10)
    decay = np.exp(-BLACK_BOX.pole * 0.001 * np.arange(5000))
    for signal in (decay, np.arange(5000) * decay, np.ones(5000)):
        np.testing.assert_allclose(Z.T @ (Z @ signal), signal, atol=1e-8 * np.abs(signal).max())
    # A constant's coefficient on the last signal times `constant` is the constant itself.
    assert (Z @ np.full(5000, 0.3))[-1] * constant == pytest.approx(0.3, rel=1e-9)


def test_episodes_from_rest_are_left_alone():
    model = modelled(REST, "auto")
    assert not model.unknown.any()
    np.testing.assert_array_equal(model.y, REST.y)
    assert (model.offset == 0).all() and (model.free == 0).all()


@pytest.mark.parametrize("register", ["same", "random"])
def test_a_start_in_mid_drive_is_found_and_taken_out(register):
    task = Task(experiment=Experiment(register=register))
    whole = recorded(6, task.experiment)
    cut = middle(whole, 3000, 0.02)
    model = modelled(cut, "auto")
    assert model.unknown.all()
    np.testing.assert_allclose(model.offset, 0.02, atol=5e-4)
    # What is left is the response from rest to the commands of the rest of the episode.
    clean = simulate(plants(task.vehicle, whole.context, 0.001), cut.u)
    noise = np.sqrt(model.residual / cut.y.shape[1])
    error = np.sqrt(((model.y - clean) ** 2).mean(axis=1))
    np.testing.assert_allclose(error, noise, rtol=0.15)


def test_offsets_of_the_command_end_up_in_the_constant():
    biased = Recording(REST.u + 0.005, REST.y, REST.Ts, REST.v_x)
    model = modelled(biased, "auto")
    gain = simulate(plants(Task().vehicle, REST.context, 0.001), np.ones(10_000))[:, -1]
    np.testing.assert_allclose(model.offset, -0.005 * gain, rtol=0.05)


def test_features_do_not_notice_what_was_taken_out():
    stage = Laguerre(8, 12.0)
    plain, _ = stage(REST.u, REST.y, 0.001)
    biased = modelled(Recording(REST.u, REST.y + 0.05, 0.001, REST.v_x), "unknown")
    found, _ = stage(biased.u, biased.y, 0.001)
    assert np.abs(found - plain).max() < 0.02 * np.abs(plain).max()


def test_both_ways_to_the_normal_equations_give_one_answer():
    own = Recording(np.repeat(REST.u, 8, axis=0), REST.y, REST.Ts, REST.v_x)
    for start in ("rest", "unknown"):
        one, other = modelled(REST, start), modelled(own, start)
        np.testing.assert_allclose(one.coefficients, other.coefficients, rtol=1e-5, atol=1e-8)
        np.testing.assert_allclose(one.residual, other.residual, rtol=1e-8)


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match="start = 'moving' is unknown. Choose one of auto, rest"):
        modelled(REST, "moving")
    with pytest.raises(ValueError, match="150 samples are too few, at least 200"):
        modelled(middle(REST, 9850, 0.0), "auto")


def test_resampling_keeps_commands_and_follows_the_yaw_rate():
    whole = recorded(4)
    clean = simulate(plants(Task().vehicle, whole.context, 0.001), whole.u)
    coarse = Recording(whole.u[:, ::10], clean[:, ::10], 0.01, whole.v_x)
    fine = coarse.resampled(0.001)
    assert fine.Ts == 0.001 and fine.oversampled == pytest.approx(10) and fine.y.shape == (4, 9991)
    np.testing.assert_array_equal(fine.u, whole.u[:, :9991])
    error = np.sqrt(((fine.y - clean[:, :9991]) ** 2).mean()) / np.sqrt((clean**2).mean())
    assert error < 2e-4
    assert coarse.resampled(0.01) is coarse
