import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawrate_env.loop.controller import coefficients, gains, response
from yawrate_env.loop.target import CONTROLLERS, Target

KP = st.floats(1e-3, 10.0)
TI = st.floats(1e-3, 100.0)
SAMPLING_TIMES = [0.001, 0.05]
FORMS = pytest.mark.parametrize("form", CONTROLLERS)


def evaluated(kp, Ti, target, z):
    n1, n0, d0 = coefficients(np.array([kp]), np.array([Ti]), target)
    delta = (z - 1) / target.Ts
    return (n1 * delta + n0) / (delta + d0)


@pytest.mark.parametrize("Ts", SAMPLING_TIMES)
@given(kp=KP, Ti=TI)
def test_printed_form_is_eq_13_to_the_letter(Ts, kp, Ti):
    z = np.exp(1j * np.linspace(0.01, 3.1, 50))
    printed = kp / (1 + 2 * Ti / Ts) * (z + 1) / (z + (Ts - 2 * Ti) / (Ts + 2 * Ti))
    ours = evaluated(kp, Ti, Target(Ts=Ts, controller="printed"), z)
    # z + (Ts - 2Ti)/(Ts + 2Ti) cancels by up to 2Ti/(0.01 Ts) = 1e7 at the lowest frequency.
    np.testing.assert_allclose(ours, printed, rtol=1e-9, atol=1e-12 * kp)


@pytest.mark.parametrize("Ts", SAMPLING_TIMES)
@pytest.mark.parametrize(("kp", "Ti"), [(0.3, 0.2), (0.001, 100.0), (10.0, 0.001)])
def test_both_forms_are_sampled_as_python_control_does(Ts, kp, Ti):
    z = np.exp(1j * np.linspace(0.01, 3.1, 50))
    for form, num, den in (("pi", [kp * Ti, kp], [Ti, 0]), ("printed", [kp], [Ti, 1])):
        sampled = control.sample_system(control.tf(num, den), Ts, "tustin")
        ours = evaluated(kp, Ti, Target(Ts=Ts, controller=form), z)
        # The pole in z, 1 - Ts/Ti = 1 - 1e-5, is rounded to 1e-11 of its distance from 1.
        np.testing.assert_allclose(ours, sampled(z), rtol=1e-8, atol=1e-12 * kp)


@FORMS
@given(kp=KP, Ti=TI)
def test_response_is_the_controllers_at_the_target_crossover(form, kp, Ti):
    target = Target(controller=form)
    log_magnitude, phase = response(np.array([kp]), np.array([Ti]), target)
    C = evaluated(kp, Ti, target, np.exp(1j * target.omega_c * target.Ts))
    np.testing.assert_allclose(np.exp(log_magnitude + 1j * phase), C, rtol=1e-12)
    assert -np.pi / 2 < phase[0] < 0


@FORMS
@given(kp=KP, Ti=TI)
def test_gains_undo_the_response(form, kp, Ti):
    target = Target(controller=form)
    back = gains(*response(np.array([kp]), np.array([Ti]), target), target)
    # The phase comes within 1e-3 rad of 0 or -90 degrees, where tan loses three digits.
    np.testing.assert_allclose(back, [[kp], [Ti]], rtol=1e-12)


def test_the_printed_form_has_no_integrator():
    # Its gain at zero frequency is kp, which is why it cannot be the PI that the text describes.
    n1, n0, d0 = coefficients(np.array([0.3]), np.array([0.2]), Target(controller="printed"))
    assert n0 / d0 == pytest.approx(0.3)
    assert coefficients(np.array([0.3]), np.array([0.2]), Target())[2] == 0
