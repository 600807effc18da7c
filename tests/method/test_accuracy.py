"""The accuracy that the shipped tuners promise, on the paper's number of test episodes."""

import pytest

import tuners
from tuners.tuner.evaluation import evaluate
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

# Standard deviation of phase_margin [deg] and crossover [Hz], and how far the mean of the
# phase margin may lie from 60 deg; that of the crossover lies within 0.005 Hz of 1.5.
PROMISED = {
    "gb": (0.012, 0.0005, 0.05),
    "ts-ff": (0.12, 0.003, 0.05),
    "ts-gbm": (0.69, 0.020, 0.1),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PROMISED)
def test_promised_accuracy_on_the_test_set(name):
    plant = yaw_rate(Task())
    (found,) = evaluate(
        {name: tuners.load(name)}, plant, "test", episodes=1500, seed=0, batch=256
    )  # fmt: skip
    phase_margin, crossover, mean = PROMISED[name]
    (margin_std, crossover_std), off = found.metrics.std(axis=0), found.metrics.mean(axis=0)
    assert found.stable.all()
    assert margin_std <= phase_margin and crossover_std <= crossover
    assert abs(off[0] - 60) <= mean and abs(off[1] - 1.5) <= 0.005
