"""The calls that docs/matlab.md shows give what MATLAB's would."""

import re

import control
import numpy as np
import pytest
from recordings import ROOT

from tuners.features.armax import FitStatus, armax
from tuners.pidtune import pidtune
from yawrate_env.loop.controller import coefficients
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.single_track import Context, Vehicle, state_space

Z = np.exp(1j * np.linspace(0.01, 3.1, 50))


@pytest.fixture(scope="module")
def page():
    """The names that the page's code leaves."""
    text = (ROOT / "docs" / "matlab.md").read_text("utf-8")
    code = "".join(re.findall(r"```python\n(.*?)```", text, re.S))
    names = {}
    exec(compile(code.replace("examples/", f"{ROOT}/examples/"), "matlab.md", "exec"), names)
    return names


def test_armax_recovers_a_model_of_its_own_structure(page):
    fit, G, H = page["fit"], page["G"], page["H"]
    assert fit.status[0] == FitStatus.CONVERGED and fit.cost[0] == pytest.approx(1e-4, rel=0.1)
    # Ten standard deviations: 0.01/sqrt(4000) for B, 1/sqrt(4000) for C.
    np.testing.assert_allclose(G.den[0][0], [1, -1.5, 0.7], atol=2e-3)
    np.testing.assert_allclose(G.num[0][0], [0.4, 0.2], atol=2e-3)
    np.testing.assert_allclose(H.num[0][0], [1, -0.5, 0.2], atol=0.16)


def test_greyest_finds_the_vehicle_of_the_example(page):
    fit = page["found"].fit
    assert fit.parameters["mu_s"] == pytest.approx(0.8, rel=0.05)
    assert fit.parameters["v_x"] == 18.0
    A, B, C = state_space(Vehicle(), Context.of(**fit.parameters))
    sampled, model = page["sampled"], page["model"]
    np.testing.assert_array_equal(model.A, A[0])
    np.testing.assert_array_equal(model.C[0], C)
    assert sampled.dt == 0.01


def test_from_a_recording_to_a_controller(page):
    C, info = pidtune(page["sampled"], "PI", wc=2 * np.pi * 1.5, pm=60.0)
    assert info.Stable and info.PhaseMargin == pytest.approx(60.0, abs=1e-6)
    n1, n0, _ = coefficients(np.array([info.Kp]), np.array([info.Ti]), Target(Ts=0.01))
    np.testing.assert_allclose(C(Z), n1 + n0 * 0.01 / (Z - 1), rtol=1e-9)


def test_the_digital_pi_is_python_controls_tustin_of_a_pi(page):
    C = page["controller"]
    expected = control.sample_system(control.tf([0.3 * 0.2, 0.3], [0.2, 0]), 0.01, "tustin")
    np.testing.assert_allclose(C(Z), expected(Z), rtol=1e-9)
    assert isinstance(C, control.TransferFunction) and C.dt == 0.01


def test_a_dead_output_has_no_model():
    u = np.random.default_rng(0).standard_normal((1, 200))
    assert armax(u, np.zeros((1, 200)), 0.1).status[0] == FitStatus.DEGENERATE
