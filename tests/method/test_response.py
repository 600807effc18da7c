"""Features that are a recording's frequency response."""

import numpy as np
from recordings import recorded, vehicles

from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from yawrate_env.loop.simulation import simulate
from yawrate_env.loop.transfer_function import TransferFunction
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.task import Task


def test_laguerre_functions_by_their_impulse_response():
    model, Ts = Laguerre(5, 12.0), 0.001
    impulse = np.zeros((1, 6000))
    impulse[0, 0] = 1.0
    g = model.regressors(impulse, Ts)[0]
    omega = np.array([0.5, 3.0, 40.0])
    direct = g @ np.exp(-1j * np.outer(np.arange(6000), omega * Ts))
    np.testing.assert_allclose(model.frequency_response(omega, Ts), direct, atol=1e-9)


def test_features_are_the_plants_log_magnitude_and_phase():
    recording = recorded(6)
    cars = plants(Task().vehicle, vehicles(recording), 0.001)
    clean = simulate(cars, recording.u)
    stage = FrequencyResponse(order=20, pole=12.0)
    features, usable = stage(recording.u, clean, 0.001)
    omega = 2 * np.pi * np.geomspace(stage.low, stage.high, stage.points)
    G = TransferFunction.of(cars)(omega)
    assert usable.all() and features.shape == (6, 12)
    # Twenty functions leave out less than -70 dB of these vehicles.
    np.testing.assert_allclose(features[:, :6], np.log(np.abs(G)), atol=2e-3)
    np.testing.assert_allclose(features[:, 6:], np.unwrap(np.angle(G), axis=1), atol=2e-3)


def test_a_silent_command_has_no_usable_features():
    features, usable = FrequencyResponse()(np.zeros((1, 1000)), np.ones((2, 1000)), 0.001)
    assert not usable.any() and features.shape == (2, 12)
