import control
import numpy as np
import pytest
from recordings import recorded
from imports import modules_after

from tuners.export.control_models import pi_controller, vehicle_model
from tuners.pidtune.matlab import armax, greyest, pidtune
from yawrate_env.batch import take
from yawrate_env.loop.controller import coefficients
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.single_track import Context, Vehicle, state_space


def test_the_pi_is_python_controls_tustin_of_a_pi():
    kp, Ti, Ts = 0.3, 0.2, 0.01
    C = pi_controller(kp, Ti, Ts)
    expected = control.sample_system(control.tf([kp * Ti, kp], [Ti, 0]), Ts, "tustin")
    z = np.exp(1j * np.linspace(0.01, 3.1, 50))
    np.testing.assert_allclose(C(z), expected(z), rtol=1e-9)
    n1, n0, _ = coefficients(np.array([kp]), np.array([Ti]), Target(Ts=Ts))
    np.testing.assert_allclose(C(z), n1 + n0 * Ts / (z - 1), rtol=1e-12)
    assert isinstance(C, control.TransferFunction) and C.dt == Ts


def test_the_vehicle_is_the_simulators():
    A, B, C = state_space(Vehicle(), Context.of(0.7, 150.0, 25.0))
    model = vehicle_model(0.7, 150.0, 25.0)
    np.testing.assert_array_equal(model.A, A[0])
    np.testing.assert_array_equal(model.B[:, 0], B[0])
    np.testing.assert_array_equal(model.C[0], C)
    sampled = vehicle_model(0.7, 150.0, 25.0, Ts=0.01)
    expected = control.sample_system(control.ss(model.A, model.B, model.C, model.D), 0.01, "zoh")
    np.testing.assert_allclose(sampled.A, expected.A, atol=1e-12)
    assert (sampled.dt, sampled.input_labels, sampled.output_labels) == (
        0.01,
        ["delta_f_cmd"],
        ["r"],
    )


def test_armax_recovers_a_model_of_its_own_structure():
    rng = np.random.default_rng(1)
    u, e = np.sign(rng.standard_normal(4000)), 0.01 * rng.standard_normal(4000)
    G, H = (
        control.tf([0.4, 0.2], [1, -1.5, 0.7], 0.1),
        control.tf([1, -0.5, 0.2], [1, -1.5, 0.7], 0.1),
    )
    y = sum(control.forced_response(s, inputs=x).outputs for s, x in ((G, u), (H, e)))
    model = armax(u, y, 0.1)
    assert model.converged and model.cost == pytest.approx(1e-4, rel=0.1)
    # Ten standard deviations: 0.01/sqrt(4000) for B, 1/sqrt(4000) for C.
    np.testing.assert_allclose(model.G.den[0][0], G.den[0][0], atol=2e-3)
    np.testing.assert_allclose(model.G.num[0][0], G.num[0][0], atol=2e-3)
    np.testing.assert_allclose(model.H.num[0][0], H.num[0][0], atol=0.16)


def test_greyest_finds_the_vehicle_and_returns_it():
    recording = recorded(1)
    found = greyest(recording.u[0], recording.y[0], recording.Ts, v_x=20.0)
    truth = take(recording.context, slice(0, 1))
    assert found.converged
    assert found.mu_s == pytest.approx(truth.mu_s[0], rel=0.01)
    assert found.M_delta == pytest.approx(truth.M_delta[0], abs=20.0)
    expected = vehicle_model(found.mu_s, found.M_delta, 20.0)
    np.testing.assert_array_equal(found.model.A, expected.A)


def test_from_a_recording_to_a_controller():
    recording = recorded(1)
    found = greyest(recording.u[0], recording.y[0], recording.Ts)
    plant = vehicle_model(found.mu_s, found.M_delta, found.v_x, Ts=0.01)
    C, info = pidtune(plant, "pi", 2 * np.pi * 1.5, PhaseMargin=60.0)
    assert info.Stable and info.PhaseMargin == pytest.approx(60.0, abs=1e-6)
    z = np.exp(1j * np.linspace(0.01, 3.1, 50))
    np.testing.assert_allclose(C(z), pi_controller(info.Kp, info.Ti, 0.01)(z), rtol=1e-9)


def test_misuse_is_refused():
    u = np.ones(100)
    with pytest.raises(ValueError, match=r"\(3, 2, 2, 1\) is not fitted"):
        armax(u, u, 0.1, (3, 2, 2, 1))
    with pytest.raises(ValueError, match="orders = 5 is not fitted"):
        armax(u, u, 0.1, 5)
    with pytest.raises(ValueError, match="v_x = 2000 must be .* at most 1000"):
        greyest(u, u, 0.01, v_x=2e3)
    for speed in (None, np.full(2, 20.0), "fast"):
        with pytest.raises(ValueError, match="v_x = .* is not a number. Give one in"):
            greyest(u, u, 0.01, v_x=speed)
    with pytest.raises(ValueError, match="at least 60"):
        armax(u[:20], u[:20], 0.1)
    with pytest.raises(ValueError, match="Ti = -1"):
        pi_controller(0.3, -1.0, 0.01)
    with pytest.raises(ValueError, match="v_x"):
        greyest(u, u, 0.01, v_x=-3.0)
    with pytest.raises(ValueError, match="Ts = 0"):
        vehicle_model(0.7, 150.0, 20.0, Ts=0.0)


def test_a_dead_output_has_no_vehicle():
    recording = recorded(1)
    found = greyest(recording.u[0], np.zeros(recording.y.shape[1]), recording.Ts)
    assert not found.converged


def test_control_is_imported_where_it_is_used():
    assert "control" not in modules_after("import tuners.pidtune.matlab, tuners.pidtune")
