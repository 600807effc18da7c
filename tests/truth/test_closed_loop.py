import control
import numpy as np
import pytest
from systems import CASES, control_controller, control_plants, random_loops

from yawrate_env.loop.closed_loop import stable, time_response
from yawrate_env.loop.design import design

IDS = [f"{form}-delay{delay}" for form, delay in CASES]


@pytest.fixture(params=CASES, ids=IDS)
def loops(request):
    return random_loops(*request.param)


def test_stability_agrees_with_python_control(loops):
    ours = stable(loops.plant, loops.kp, loops.Ti, loops.target)
    theirs = [
        (np.abs(control.feedback(L, 1).poles()) < 1).all()  # negative feedback
        for L in loops.control_loops
    ]
    np.testing.assert_array_equal(ours, theirs)
    assert 20 < ours.sum() < 180


@pytest.mark.parametrize(("form", "delay"), CASES, ids=IDS)
def test_time_response_agrees_with_python_control(form, delay):
    loops, N = random_loops(form, delay), 400
    gains = design(loops.transfer_function, loops.target)
    usable = np.isfinite(gains.kp)
    kp, Ti = np.where(usable, gains.kp, 0.05), np.where(usable, gains.Ti, 1.0)
    reference = np.random.default_rng(0).standard_normal(N)
    y, u = time_response(loops.plant, kp, Ti, loops.target, reference)
    assert y.shape == u.shape == (200, N)
    for b in range(0, 200, 20):
        theirs = python_control_response(loops, b, kp[b], Ti[b], reference)
        for ours, expected in zip((y[b], u[b]), theirs, strict=True):
            scale = np.abs(expected).max()
            np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9 * scale)


def python_control_response(loops, b, kp, Ti, reference):
    """Yaw rate and command (before the delay) of a loop closed by python-control."""
    lag = control.ss(control.tf([1], [1] + [0] * loops.target.delay_samples, loops.target.Ts))
    G, C = control_plants()[b] * lag, control_controller(kp, Ti, loops.target)
    y = control.forced_response(control.feedback(G * C, 1), inputs=reference)
    u = control.forced_response(control.feedback(C, G), inputs=reference)
    return y.y[0], u.y[0]


def test_disturbances_respond_as_in_python_control(loops):
    delay, Ts = loops.target.delay_samples, loops.target.Ts
    gains = design(loops.transfer_function, loops.target)
    d = np.random.default_rng(4).standard_normal(150)
    y, _ = time_response(loops.plant, gains.kp, gains.Ti, loops.target, 0 * d, d)
    lag = control.ss(control.tf([1], [1] + [0] * delay, Ts))
    for b in np.flatnonzero(np.isfinite(gains.kp))[:10]:
        C = control_controller(gains.kp[b], gains.Ti[b], loops.target) * lag
        expected = control.forced_response(control.feedback(control_plants()[b], C), inputs=d)
        scale = np.abs(expected.outputs).max()
        np.testing.assert_allclose(y[b], expected.outputs, rtol=0, atol=1e-9 * scale)
