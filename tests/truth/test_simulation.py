import control
import numpy as np
import pytest
from systems import contexts

from yawrate_env.batch import take
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.simulation import simulate
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import Vehicle, state_space


@pytest.mark.parametrize("Ts", [0.001, 0.01])
@pytest.mark.parametrize("xi", [0.9, 1.0])  # 1: the actuator is critically damped
def test_response_agrees_with_python_control(Ts, xi):
    vehicle, context, N = Vehicle(xi=xi), contexts(15, seed=0), 1000
    u = np.random.default_rng(0).standard_normal((15, N))
    y = simulate(plants(vehicle, context, Ts), u)
    A, B, C = state_space(vehicle, context)
    for b in range(15):
        system = control.ss(A[b], B[b][:, None], C[None], 0)
        expected = control.forced_response(control.sample_system(system, Ts, "zoh"), inputs=u[b])
        np.testing.assert_allclose(y[b], expected.y[0], rtol=0, atol=1e-9 * np.abs(y[b]).max())


def test_a_shared_input_is_the_same_as_one_copy_each():
    plant, u = plants(Vehicle(), contexts(20, seed=1), 0.001), np.sin(np.arange(300) / 20)
    together = simulate(plant, u)
    np.testing.assert_array_equal(together, simulate(plant, u[None]))
    np.testing.assert_array_equal(together, simulate(plant, np.tile(u, (20, 1))))


def test_initial_state_decays_by_powers_of_the_matrix():
    plant = plants(Vehicle(), contexts(3, seed=2), 0.01)
    x0 = np.random.default_rng(2).standard_normal((3, 6))
    y = simulate(plant, np.zeros(40), x0)
    for b in range(3):
        power = np.linalg.matrix_power(plant.A[b], 39)
        np.testing.assert_allclose(y[b, 0], x0[b, 1], rtol=0)
        np.testing.assert_allclose(y[b, -1], plant.C @ power @ x0[b], rtol=0, atol=1e-13)


@pytest.mark.parametrize("order", [1, 2, 7])
def test_any_order_is_compiled(order):
    rng = np.random.default_rng(order)
    A = rng.uniform(-0.5, 0.5, (1, order, order)) / order
    plant = DiscretePlant(A, rng.standard_normal((1, order)), rng.standard_normal(order), 1.0)
    impulse = np.eye(1, 12)[0]
    powers = [np.linalg.matrix_power(A[0], k) @ plant.B[0] for k in range(11)]
    expected = np.concatenate([[0.0], np.array(powers) @ plant.C])
    np.testing.assert_allclose(simulate(plant, impulse)[0], expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("B", [1, 3, 17])
def test_one_vehicle_does_not_depend_on_the_batch(B):
    context, rng = contexts(40, seed=5), np.random.default_rng(5)
    u, x0 = rng.standard_normal((40, 400)), rng.standard_normal((40, 6))
    together = simulate(plants(Vehicle(), context, 0.001), u, x0)
    for i in range(0, 40, B):
        part = slice(i, i + B)
        alone = simulate(plants(Vehicle(), take(context, part), 0.001), u[part], x0[part])
        np.testing.assert_array_equal(alone, together[part])


def test_inputs_must_fit_the_plants():
    with pytest.raises(ValueError, match="u has 3 rows for 17 plants"):
        simulate(plants(Vehicle(), contexts(17, seed=6), 0.01), np.zeros((3, 10)))
