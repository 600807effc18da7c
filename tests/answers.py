"""Answers about simulated drives, made without a tuner."""

import numpy as np
from drives import drive

from tuners.logs import Log
from tuners.logs.excitation import check
from tuners.tuner.result import Check, Interval, TuningResult, TwinFit
from yawrate_env.loop.design import Status
from yawrate_env.loop.simulation import simulate
from yawrate_env.vehicle.episode import loops, plants
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task


def answer(trusted=True, fitted=True, gains=None, source="drive.csv"):
    """An answer for a drive, with a fit that is the truth."""
    task = Task()
    Ts, context = 0.001, Context.of(0.8, 120.0, 18.0)
    u, _, y = drive(Ts=Ts, seconds=10.0, warm_up=0.0)
    v_x = np.full(len(u), 18.0)
    judged = check(u, y, v_x, Ts, task.target.crossover)
    log = Log(source, 12.0, Ts, Ts, u, y, v_x, judged, ("Column u_deg is taken to be in deg.",))
    oracle = loops(task, context).design()
    kp, Ti = gains or (float(oracle.kp[0]), float(oracle.Ti[0]))
    simulated = simulate(plants(task.vehicle, context, Ts), u)[0]
    fit = TwinFit(context, u, y, simulated, Ts, 0.01, 0.002, False, 30.0)
    checks = (
        Check("residual autocorrelation", 0.02 if trusted else 0.31, 0.1, "The residual is not "
              "white: something moves the car that the model does not know."),
        Check("phase margin interval", 0.4, 3.0, "The recording says too little."),
    )  # fmt: skip
    result = TuningResult(
        kp, Ti, Status.OK, True, (), Interval(60.02, 59.81, 60.22), Interval(1.5, 1.492, 1.509),
        trusted, () if trusted else (checks[0].message,), (0.2, 0.31), checks,
        fit if fitted else None,
    )  # fmt: skip
    return result, log, task
