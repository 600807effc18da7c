"""The two worked examples: their physics in closed form."""

import sys

import control
import numpy as np
import pytest
from recordings import ROOT

from yawrate_env.plant.entry import find

FOLDER = ROOT / "examples" / "plants"
THETA = np.array([[0.35, 0.45, 9.0], [0.45, 0.32, 11.0]])


@pytest.fixture(scope="module")
def tanks():
    plant = find("two_tanks:plant", FOLDER)
    return plant, sys.modules["two_tanks"]


def test_the_tanks_settle_where_torricelli_says(tanks):
    plant, _ = tanks
    level = plant.respond(THETA, np.full(2000, 5.0))[:, -1]
    a2, pump = THETA[:, 1], THETA[:, 2]
    np.testing.assert_allclose(level, (5.0 * pump / a2) ** 2 / (2 * 981.0), rtol=1e-9)


def test_tanks_at_work_go_on_from_the_levels_that_they_begin_with(tanks):
    plant, module = tanks
    first, later = np.full(200, 6.0), plant.u
    h = np.zeros((2, 2))
    for i, (a1, a2, pump) in enumerate(THETA):
        for volts in first:
            h[i] = module.step(*h[i], pump * volts, a1, a2)
    whole = plant.respond(THETA, np.concatenate([first, later]))
    work = module.plant_at_work.respond(np.concatenate([THETA, h], axis=1), later)
    np.testing.assert_allclose(work, whole[:, 200:], rtol=1e-12)


def test_the_tanks_keep_their_water(tanks):
    """What has run in is in the tanks or has run out, to the accuracy of the steps."""
    _, module = tanks
    h, out, a2 = (5.0, 3.0), 0.0, 0.45
    for _ in range(50):
        flow = a2 * np.sqrt(2 * 981.0 * h[1])
        h = module.step(*h, 60.0, 0.35, a2)
        out += (flow + a2 * np.sqrt(2 * 981.0 * h[1])) / 2 * module.TS
    assert 30.0 * 8.0 + 50 * 60.0 * module.TS == pytest.approx(30.0 * sum(h) + out, rel=1e-3)


def test_the_tanks_gains_are_simcs_for_the_linearised_process(tanks):
    """Lags and gain by differences of the rates, at the level where the loop works."""
    plant, module = tanks
    for (a1, a2, pump), (kp, Ti) in zip(THETA, plant.oracle(THETA), strict=True):
        h = np.array([10.0 * (a2 / a1) ** 2, 10.0])
        q = a2 * np.sqrt(2 * 981.0 * 10.0)
        assert module.rates(*h, q, a1, a2) == pytest.approx((0.0, 0.0), abs=1e-12)
        above, below = (
            np.array([module.rates(*(h + s * e), q, a1, a2) for e in np.eye(2)])
            for s in (1e-6, -1e-6)
        )
        A = (above - below).T / 2e-6
        gain = -np.array([0, 1]) @ np.linalg.solve(A, [pump / 30.0, 0.0])
        T2, T1 = np.sort(-1 / np.linalg.eigvals(A).real)
        lag, delay = T1 + T2 / 2, T2 / 2
        assert kp == pytest.approx(lag / (gain * (20.0 + delay)), rel=1e-6)
        assert Ti == pytest.approx(min(lag, 4 * (20.0 + delay)), rel=1e-6)


def test_the_tanks_are_evaluated_by_the_step_that_is_drawn(tanks):
    plant, _ = tanks
    gains = plant.oracle(THETA)
    metrics = plant.metric_values(THETA, gains)
    # Without overshoot the integrated error is the integrator's change times Ti/kp.
    q = THETA[:, 1] * np.sqrt(2 * 981.0) * (np.sqrt(12.0) - np.sqrt(10.0))
    expected = q / THETA[:, 2] * gains[:, 1] / gains[:, 0]
    np.testing.assert_allclose(metrics[:, 1], expected, rtol=0.05)
    for theta, gain, (rise, area) in zip(THETA, gains, metrics, strict=True):
        level, pump = plant.closed_loop(theta, gain).responses
        e = level.setpoint - level.value
        assert e[0] == 2.0 and pump.label == plant.signals[0] and 20 < rise < 80
        k = np.flatnonzero(e < 0.2)[0]
        passed = np.interp(-0.2, -e[k - 1 : k + 1], level.time[k - 1 : k + 1])
        assert (passed, plant.Ts * np.abs(e).sum()) == pytest.approx((rise, area), rel=1e-12)


def test_the_motor_is_python_controls():
    plant = find("dc_motor:plant", FOLDER)
    J, b = 3e-4, 2e-3
    s = control.tf("s")
    motor = 0.05 / ((1.0 + 2e-3 * s) * (J * s + b) + 0.05**2)
    expected = control.forced_response(motor.sample(plant.Ts), U=plant.u).outputs
    found = plant.respond(np.array([[J, b]]))[0]
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_the_twenty_lines_of_the_guide_run(tmp_path):
    text = (ROOT / "docs" / "plants.md").read_text()
    code = text.partition("```python\n")[2].partition("```")[0]
    assert sum(bool(line.strip()) for line in code.splitlines()[1:]) <= 20
    (tmp_path / "my_plant.py").write_text(code)
    plant = find("my_plant:plant", tmp_path)
    np.testing.assert_allclose(plant.oracle(np.array([[2.0, 0.6]])), [[1.0, 0.6]])
