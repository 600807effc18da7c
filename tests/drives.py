"""Simulated drives as python-control makes them."""

from functools import cache

import control
import numpy as np

from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.single_track import Context, Vehicle, state_space

PAPER = Vehicle()


@cache
def drive(mu_s=0.8, M_delta=120.0, v_x=18.0, *, Ts=0.01, seconds=12.0, bias=0.0, offset=0.0,
          snr_db=30.0, warm_up=3.0, seed=3, order=14, vehicle=PAPER):  # fmt: skip
    """Command, road-wheel angle, yaw rate: read-only (N,) of a drive, from mid-drive on."""
    fine = 0.001
    every, first = round(Ts / fine), round(warm_up / fine)
    N = round((seconds + warm_up) / fine)
    first_bit = np.array([77 if order == 14 else 0], np.uint64)
    command = prbs(N, fine, 0.1, np.radians(1.0), order=order, start=first_bit)[0]
    A, B, C = state_space(vehicle, Context.of(mu_s, M_delta, v_x))
    C = np.stack([C, [0, 0, 0, 0, 0, 1.0]])
    plant = control.ss(A[0], B[0][:, None], C, np.zeros((2, 1)))
    response = control.forced_response(plant.sample(fine, "zoh"), inputs=command)
    yaw_rate, angle = response.outputs[:, first::every]
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(len(yaw_rate)) * yaw_rate.std() * 10 ** (-snr_db / 20)
    found = command[first::every] + bias, angle + bias, yaw_rate + noise + offset
    for array in found:
        array.setflags(write=False)
    return found
