"""Recordings of vehicles at several speeds, and two tuners for them."""

from functools import cache

import numpy as np

import tuners
from studies.draws import draw
from tuners.tuner.recording import Recording
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

VEHICLE = yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0))))


def drive(mu_s, v_x, episode, *, M_delta=120.0, vehicle=None, seconds=10.0, snr_db=30.0):
    """One recording of a vehicle with a random register, which knows its speed alone."""
    experiment = Experiment(register="random", N=round(1000 * seconds), snr_db=snr_db)
    given = {} if vehicle is None else {"vehicle": vehicle}
    made = yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0)), experiment=experiment, **given))
    found = draw(made, "test", 4, episode, 1)
    y = made.measure(np.array([[mu_s, M_delta, v_x]]), found.u, found.keys)
    return Recording(found.u, y, made.Ts, np.array([[np.nan, np.nan, v_x]]))


@cache
def learned():
    return tuners.load("ts-ff-lag-vx")


@cache
def black():
    return tuners.load("bb", VEHICLE)
