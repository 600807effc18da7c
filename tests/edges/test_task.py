import dataclasses

import numpy as np
import pytest

from yawrate_env.loop.target import Target
from yawrate_env.vehicle.single_track import Vehicle
from yawrate_env.vehicle.task import Experiment, Prior, Task


def test_defaults_are_the_papers_and_the_design_notes():
    task = Task()
    assert task.vehicle == Vehicle()
    assert (task.prior.mu_s, task.prior.M_delta) == ((0.3, 1.1), (0, 300))  # eq. (12)
    assert task.prior.v_x == (20, 20)
    experiment = dataclasses.asdict(task.experiment)
    assert experiment.pop("amplitude") == pytest.approx(np.pi / 180)
    assert experiment == dict(Ts=0.001, N=10_000, bit_time=0.1, register="same", snr_db=30)
    assert dataclasses.asdict(task.target) == dict(
        phase_margin=60, crossover=1.5, Ts=0.01, delay_samples=0, controller="pi"
    )
    assert task.target.omega_c == pytest.approx(2 * np.pi * 1.5)


def test_records_are_frozen_hashable_and_of_one_form():
    task = Task()
    with pytest.raises(dataclasses.FrozenInstanceError):
        task.target.crossover = 2.0
    assert hash(task) == hash(Task()) and task == Task()
    for value in (20, 20.0, np.float64(20), [20, 20], (20.0, 20.0)):
        assert Prior(v_x=value).v_x == (20.0, 20.0)
    # Whole numbers may come as floats, as from JSON written by other programs.
    assert type(Experiment(N=500.0).N) is type(Target(delay_samples=1.0).delay_samples) is int


@pytest.mark.parametrize("N, bit_time", [(200, 0.1), (20, 0.01), (6, 0.003)])
def test_two_bits_are_the_shortest_episode(N, bit_time):
    Experiment(N=N, bit_time=bit_time)
    with pytest.raises(ValueError, match=f"N = {N - 1} samples .* two bits"):
        Experiment(N=N - 1, bit_time=bit_time)


@pytest.mark.parametrize(
    ("record", "field", "value"),
    [
        (Experiment, "Ts", 0.0),
        (Experiment, "Ts", np.nan),
        (Experiment, "N", 500.5),
        (Experiment, "N", 10**8),
        (Experiment, "N", "500"),
        (Experiment, "amplitude", 0.0),
        (Experiment, "amplitude", 1.0),  # degrees, by mistake
        (Experiment, "bit_time", 0.0005),
        (Experiment, "snr_db", np.inf),
        (Experiment, "snr_db", -40.0),
        (Experiment, "N", 1e6),
        (Experiment, "register", "prbs"),
        (Target, "phase_margin", 181.0),
        (Target, "crossover", 46.0),
        (Target, "delay_samples", 0.5),
        (Target, "delay_samples", 201),
        (Target, "delay_samples", True),
        (Target, "controller", "PI"),
        (Prior, "mu_s", 0.0),
        (Prior, "mu_s", [-0.1, 1.0]),
        (Prior, "v_x", [20, np.nan]),
        (Prior, "v_x", [30, 20]),
        (Prior, "v_x", 1e-6),
        (Prior, "M_delta", [1, 2, 3]),
        (Prior, "M_delta", "heavy"),
    ],
)
def test_bad_values_are_refused_by_name(record, field, value):
    with pytest.raises(ValueError, match=rf"^{field}\b.*(=|has)"):
        record(**{field: value})


def test_bad_values_that_the_user_knows_by_other_names():
    with pytest.raises(ValueError, match="^Ts_control = 0 must be finite, above 0"):
        Target(Ts=0.0)
    with pytest.raises(ValueError, match="^Ts_control = 1e-09 must be finite, at least 6.6"):
        Target(Ts=1e-9)
    with pytest.raises(ValueError, match=r"M_0 \+ M_delta = -105 must be finite, at least 189.5"):
        Task(prior=Prior(M_delta=(-2000, 0)))
    Task(vehicle=Vehicle(M_0=2500.0), prior=Prior(M_delta=(-2000, 0)))
