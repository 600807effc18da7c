import numpy as np
import pytest
from systems import contexts

from yawrate_env.vehicle.single_track import (
    CONTEXT,
    Context,
    Vehicle,
    state_space,
    state_space_sensitivity,
    total_mass,
)


def equations(vehicle, mu_s, M_delta, v_x, x, u):
    """Right-hand sides of eqs. (6) to (9) as printed, but with alpha_r in the rear tyre's."""
    beta, r, alpha_f, alpha_r, z, delta_f = x
    M_veh = vehicle.M_0 + M_delta
    C_f, C_r = vehicle.C_f * mu_s, vehicle.C_r * mu_s
    alpha_f_kin = -delta_f + beta + vehicle.l_f / v_x * r
    alpha_r_kin = beta - vehicle.l_r / v_x * r
    return np.array(
        [
            -r - C_f * alpha_f / (M_veh * v_x) - C_r * alpha_r / (M_veh * v_x),
            -vehicle.l_f * C_f * alpha_f / vehicle.J_z + vehicle.l_r * C_r * alpha_r / vehicle.J_z,
            -v_x / vehicle.l_rel_f * (alpha_f - alpha_f_kin),
            -v_x / vehicle.l_rel_r * (alpha_r - alpha_r_kin),
            -(vehicle.omega_n**2) * delta_f + vehicle.omega_n**2 * u,
            z - 2 * vehicle.xi * vehicle.omega_n * delta_f,
        ]
    )


def test_default_vehicle_is_table_II():
    v = Vehicle()
    assert (v.M_0, v.J_z, v.l_f, v.l_r) == (1895, 2400, 1.18, 1.53)
    assert (v.C_f, v.C_r, v.l_rel_f, v.l_rel_r) == (124.9e3, 166e3, 0.4, 0.8)
    assert (v.omega_n, v.xi) == (2 * np.pi * 5, 0.9)


def test_matrices_are_the_equations_on_the_basis_vectors():
    vehicle = Vehicle(M_0=1500, J_z=2000, l_f=1.1, l_r=1.4, C_f=9e4, C_r=1.1e5, l_rel_f=0.3)
    context = contexts(20, seed=0)
    A, B, C = state_space(vehicle, context)
    for b, at in enumerate(zip(context.mu_s, context.M_delta, context.v_x, strict=True)):
        columns = [equations(vehicle, *at, x, 0.0) for x in np.eye(6)]
        np.testing.assert_allclose(A[b], np.transpose(columns), rtol=1e-14)
        np.testing.assert_allclose(B[b], equations(vehicle, *at, np.zeros(6), 1.0), rtol=1e-14)
    np.testing.assert_array_equal(C, [0, 1, 0, 0, 0, 0])


def test_steady_state_yaw_gain_follows_the_understeer_gradient():
    # Rajamani, Vehicle Dynamics and Control, section 3.3, with axle stiffnesses:
    # delta = L/R + K_V a_y with K_V = M l_r/(C_f L) - M l_f/(C_r L) and R = v/r.
    vehicle, context = Vehicle(), contexts(50, seed=1)
    A, B, C = state_space(vehicle, context)
    gain = -np.linalg.solve(A, B[..., None])[..., 0] @ C
    L, M = vehicle.l_f + vehicle.l_r, vehicle.M_0 + context.M_delta
    K_V = M / L * (vehicle.l_r / vehicle.C_f - vehicle.l_f / vehicle.C_r) / context.mu_s
    np.testing.assert_allclose(gain, context.v_x / (L + K_V * context.v_x**2), rtol=1e-12)


def test_sensitivities_are_central_differences():
    vehicle, context = Vehicle(), contexts(10, seed=2)
    dA = state_space_sensitivity(vehicle, context)
    for p, (name, step) in enumerate((("mu_s", 1e-4), ("M_delta", 0.5))):
        up, down = (
            state_space(
                vehicle,
                Context.of(**{n: getattr(context, n) + (n == name) * h for n in CONTEXT}),
            )[0]
            for h in (step, -step)
        )
        # A is linear in mu_s and in 1/M_veh: truncation (0.5/1895)^2 = 7e-8, rounding 1e-11.
        np.testing.assert_allclose(dA[:, p], (up - down) / (2 * step), rtol=1e-6, atol=1e-9)


def test_total_mass_adds_the_load_and_refuses_to_vanish():
    assert total_mass(Vehicle(), Context.of(1.0, [0.0, 300.0], 20.0)).tolist() == [1895, 2195]
    with pytest.raises(ValueError, match="total mass .* = -105 .*above 0"):
        total_mass(Vehicle(), Context.of(1.0, [0.0, -2000.0], 20.0))


def test_context_broadcasts_and_copies():
    mu_s = np.array([0.5, 0.6])
    context = Context.of(mu_s, 100, 20.0)
    mu_s[:] = 0
    assert context.mu_s.tolist() == [0.5, 0.6]
    assert context.M_delta.tolist() == [100, 100] and len(context) == 2


@pytest.mark.parametrize("name", Vehicle.__slots__)
def test_vehicle_refuses_unphysical_parameters(name):
    zero = () if name in ("l_rel_f", "l_rel_r", "dead_time", "sensor_lag") else (0.0,)
    for value in (*zero, -1.0, np.nan, np.inf, "1"):
        with pytest.raises(ValueError, match=f"vehicle {name} = "):
            Vehicle(**{name: value})


@pytest.mark.parametrize(
    ("context", "message"),
    [
        ((0.0, 0.0, 20.0), "mu_s = 0 "),
        ((0.5, 0.0, [20.0, -3.0]), "v_x = -3 "),
        ((0.5, np.nan, 20.0), "M_delta has nan"),
        ((np.ones((2, 2)), 0.0, 20.0), r"mu_s has shape \(2, 2\)"),
    ],
)
def test_context_refuses_unphysical_values(context, message):
    with pytest.raises(ValueError, match=message):
        Context.of(*context)
