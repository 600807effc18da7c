"""Drives, against loops that python-control closes and against themselves."""

from dataclasses import replace

import control
import numpy as np
import pytest
from systems import CASES, control_controller, control_plants, random_loops

from yawrate_env.loop.closed_loop import time_response
from yawrate_env.loop.design import design
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.discrete import plants
from yawrate_env.vehicle.drive import DriveState, drive
from yawrate_env.vehicle.manoeuvre import lane_change, step, weave
from yawrate_env.vehicle.single_track import Context, Vehicle

IDS = [f"{form}-delay{delay}" for form, delay in CASES]
TARGET = Target(delay_samples=2)
COUNT, N = 21, 300
DEAD = Context.of(np.linspace(0.4, 1, COUNT), 100, 20, dead_time=np.linspace(0, 0.03, COUNT))


def signals(seed, rows=COUNT):
    """Reference, disturbance and noise."""
    return np.random.default_rng(seed).standard_normal((3, rows, N))


def late():
    return plants(Vehicle(), DEAD, TARGET.Ts), np.tile([0.1, 0.2], (COUNT, 1))


@pytest.mark.parametrize(("form", "delay"), CASES, ids=IDS)
def test_reference_disturbance_and_noise_act_as_in_python_control(form, delay):
    loops = random_loops(form, delay)
    found = design(loops.transfer_function, loops.target)
    chosen = np.flatnonzero(np.isfinite(found.kp))[:20]
    gains = np.stack([found.kp, found.Ti], axis=1)[chosen]
    r, d, v = signals(0, len(chosen))
    plant = replace(loops.plant, A=loops.plant.A[chosen], B=loops.plant.B[chosen])
    u, y, _ = drive(plant, gains, loops.target, r, d, v)
    lag = control.ss(control.tf([1], [1] + [0] * delay, loops.target.Ts))
    for row, b in enumerate(chosen):
        G, C = control_plants()[b], control_controller(*gains[row], loops.target)
        by_input = control.feedback(G, C * lag), d[row]  # what acts beside the command
        of_output = control.feedback(1, G * lag * C), v[row]
        outputs = (control.feedback(G * lag * C, 1), r[row]), by_input, of_output
        expected = sum(control.forced_response(T, inputs=x).outputs for T, x in outputs)
        np.testing.assert_allclose(y[row], expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        of_error = control.feedback(C, G * lag), r[row] - v[row]
        of_push = -control.feedback(C * G, lag), d[row]
        commands = (control.forced_response(T, inputs=x).outputs for T, x in (of_error, of_push))
        expected = sum(commands)
        np.testing.assert_allclose(u[row], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_dead_times_are_those_of_the_closed_loop():
    plant, gains = late()
    r, d, _ = signals(1)
    y, u = time_response(plant, *gains.T, TARGET, r[0], d[0])
    ours = drive(plant, gains, TARGET, r[:1], d[:1])
    np.testing.assert_allclose(ours[1], y, rtol=0, atol=1e-11)
    np.testing.assert_allclose(ours[0], u, rtol=0, atol=1e-11)


def test_windows_and_batches_leave_every_bit():
    plant, gains = late()
    parts = signals(2)
    u, y, end = drive(plant, gains, TARGET, *parts)
    state = None
    for part in (slice(0, 17), slice(17, 170), slice(170, N)):
        u_part, y_part, state = drive(
            plant, gains, TARGET, *(s[:, part] for s in parts), state=state
        )
        np.testing.assert_array_equal(u_part, u[:, part])
        np.testing.assert_array_equal(y_part, y[:, part])
    for name in DriveState.__slots__:
        np.testing.assert_array_equal(getattr(state, name), getattr(end, name))
    one = slice(COUNT - 1, COUNT)  # the longest dead time, so that the delay line is as long
    last = replace(plant, **{name: getattr(plant, name)[one] for name in ("A", "B", "D", "delay")})
    u_one, y_one, _ = drive(last, gains[one], TARGET, *(s[one] for s in parts))
    np.testing.assert_array_equal(u_one, u[one])
    np.testing.assert_array_equal(y_one, y[one])


def test_new_gains_do_not_move_the_wheel_by_themselves():
    plant, gains = late()
    held = np.full((1, 3000), 0.05)
    u, y, state = drive(plant, gains, TARGET, held)
    np.testing.assert_allclose(y[:, -1], 0.05, rtol=1e-9)
    after, still, _ = drive(plant, gains * [1.5, 0.8], TARGET, held[:, :200], state=state)
    np.testing.assert_allclose(after, np.tile(u[:, -1:], 200), rtol=1e-9)
    np.testing.assert_allclose(still, 0.05, rtol=1e-9)


def test_what_does_not_fit_together_is_refused():
    plant, gains = late()
    r, _, _ = signals(3)
    for given, name in (
        ({"gains": gains[:3]}, "gains"),
        ({"reference": r[:4]}, "reference"),
        ({"noise": r[:, :-1]}, "noise"),
        ({"disturbance": r[:5]}, "disturbance"),
        ({"target": Target(Ts=0.02)}, "Ts"),
        ({"state": DriveState.rest(plant, Target())}, "state"),
    ):
        with pytest.raises(ValueError, match=name):
            drive(**{"plant": plant, "gains": gains, "target": TARGET, "reference": r} | given)


def test_manoeuvres_end_where_they_began():
    time = 0.01 * np.arange(500)
    lanes = lane_change(time, np.array([0.05, -0.1]), 1.0, np.array([2.0, 3.0]))
    assert lanes.shape == (2, 500)
    np.testing.assert_allclose(lanes.sum(axis=1), 0, atol=1e-12)  # the heading of before
    np.testing.assert_allclose(np.abs(lanes).max(axis=1), [0.05, 0.1], rtol=1e-3)
    bend = step(time, 0.05, 1.0, np.array([0.0, 0.4]), 2.0)
    np.testing.assert_allclose(bend.sum(axis=1) * 0.01, 0.05 * 2.0, rtol=0.01)
    assert (bend[:, :100] == 0).all() and (bend[:, 150:300] == 0.05).all()
    assert (bend[:, 345:] == 0).all()
    slow = weave(time, 0.05, 0.2, 0.0)  # five seconds are one period
    np.testing.assert_allclose(slow, 0.05 * np.sin(0.4 * np.pi * time)[None], atol=1e-15)
