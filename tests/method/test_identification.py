"""The search for a plant's parameters: slopes, minima, limits and data that tell nothing."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, SHORT, VEHICLE
from families import tested as recordings
from first_order import SIGMA, U, described, simulate, slopes
from first_order import plant as lag

from tuners.trust.bound import cramer_rao
from tuners.trust.fit import search
from tuners.trust.identification import identify, output_slopes
from tuners.tuner.recording import Recording
from tuners.tuner.rivals import GrayBox
from yawrate_env.plant.episodes import recorded as episodes_of
from yawrate_env.plant.episodes import sample
from yawrate_env.vehicle.single_track import Context, Vehicle, total_mass
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

CORNERS = np.array(list(itertools.product((0.3, 0.7, 1.1), (0.0, 300.0), (10.0, 20.0, 33.0))))
M_0 = Vehicle().M_0
EXACT = [name for name, plant in FAMILIES.items() if plant.sensitivity is not None]


def start_of(plant, theta):
    return Recording(np.empty((1, 0)), np.empty((len(theta), 0)), plant.Ts, theta).parameters(plant)


def test_output_slopes_are_those_of_the_closed_form():
    theta = sample(lag, 5)
    expected = [slopes(row) * [[1.5], [0.8]] for row in theta]
    np.testing.assert_allclose(output_slopes(lag, theta), expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("family", EXACT)
def test_exact_slopes_are_the_differences_of_the_simulation(family):
    plant = FAMILIES[family]
    block = episodes_of(plant, "test", 0, 5)
    theta = np.roll(block.theta, 1, axis=0)
    gram = plant.sensitivity.gram(theta, block.u, block.y, np.arange(5))
    # From widths of ranges to logarithms of friction and of total mass.
    scale = np.stack([theta[:, 0], theta[:, 1] + M_0], axis=1) / plant.width
    signals = output_slopes(plant, theta) * scale[..., None]
    signals = np.concatenate([(block.y - plant.respond(theta))[:, None], signals], axis=1)
    expected = signals @ signals.swapaxes(1, 2)
    size = np.sqrt(np.einsum("bii,bjj->bij", expected, expected))  # of signals that may be normal
    np.testing.assert_allclose(gram / size, expected / size, atol=1e-6)


def test_the_parameters_of_clean_outputs_are_found(plant, episodes):
    theta = episodes.known[:12]
    found = search(plant, episodes.u, plant.respond(theta, episodes.u), start_of(plant, theta))
    assert found.converged.all()
    error = (found.theta - theta)[:, plant.unknown] / plant.width
    assert np.abs(error).max() < 2e-5


@pytest.mark.parametrize("experiment", [replace(SHORT, register="random"), Experiment(N=2500)])
def test_every_corner_of_the_prior_is_found_from_its_middle(experiment):
    plant = yaw_rate(replace(VEHICLE, experiment=experiment))
    u = plant.inputs(np.arange(len(CORNERS), dtype=np.uint64) * np.uint64(997))
    found = identify(plant, u, plant.respond(CORNERS, u), start_of(plant, CORNERS))
    assert found.converged.all()
    np.testing.assert_allclose(found.theta[:, 0], CORNERS[:, 0], rtol=1e-6)
    np.testing.assert_allclose(found.theta[:, 1] + M_0, CORNERS[:, 1] + M_0, rtol=1e-6)
    assert (found.steps < 20).all()  # Gauss-Newton without residual is quadratic


@pytest.mark.parametrize("family", EXACT)
def test_exact_slopes_and_differences_find_the_same(family):
    plant = FAMILIES[family]
    block = episodes_of(plant, "test", 0, 16)
    start = start_of(plant, block.theta)
    exact = identify(plant, block.u, block.y, start)
    differences = identify(replace(plant, sensitivity=None), block.u, block.y, start)
    assert exact.converged.all() and differences.converged.all()
    # Both stop where a step promises 1e-10 of the cost.
    np.testing.assert_allclose(exact.theta, differences.theta, rtol=1e-3, atol=0.1)
    np.testing.assert_allclose(exact.cost, differences.cost, rtol=1e-7)


def test_vehicles_beyond_the_prior_are_found_where_that_is_allowed():
    plant, theta = FAMILIES["vehicle"], np.array([[1.3, 500.0, 20.0], [0.15, -200.0, 20.0]])
    y = plant.respond(theta)
    found = search(plant, plant.u[None], y, start_of(plant, theta))
    assert found.converged.all()
    np.testing.assert_allclose(found.theta, theta, rtol=1e-5)
    inside = identify(plant, plant.u[None], y)
    low, high = plant.ranges
    assert ((inside.theta >= low - 1e-9) & (inside.theta <= high + 1e-9)).all()


def test_the_cost_is_a_minimum_below_that_of_the_truth(plant, episodes):
    u, y, theta = episodes.u, episodes.y, episodes.known
    found = search(plant, u, y, start_of(plant, theta))

    def cost(at):
        return ((y - plant.respond(at, u)) ** 2).sum(axis=1)

    assert found.converged.all()
    np.testing.assert_allclose(found.cost, cost(found.theta), rtol=1e-9)
    assert (found.cost < cost(theta) * (1 + 1e-12)).all()
    # Least squares takes up one degree of freedom a parameter.
    noise = cost(theta) / y.shape[1]
    taken = (cost(theta) - found.cost) / noise
    assert taken.mean() == pytest.approx(len(plant.unknown), rel=0.5)
    for i, width in zip(plant.unknown, plant.width, strict=True):
        for step in (-0.01 * width, 0.01 * width):
            beside = found.theta.copy()
            beside[:, i] += step
            assert (cost(beside) > found.cost).all()


@pytest.mark.parametrize("family", ["lag", "motor"])
def test_a_recordings_parameters_do_not_depend_on_the_batch(family):
    plant, episodes = FAMILIES[family], recordings(family)
    start = start_of(plant, episodes.known)
    whole = search(plant, episodes.u, episodes.y, start)
    for count in (1, 3):
        part = episodes.part(slice(0, count))
        found = search(plant, part.u, part.y, start[:count])
        error = (found.theta - whole.theta[:count])[:, plant.unknown] / plant.width
        # The motor's simulator is a matrix product, which rounds otherwise in other sizes.
        assert np.abs(error).max() < 1e-6


def test_a_vehicles_parameters_do_not_depend_on_the_batch_at_all():
    plant = yaw_rate(Task(experiment=replace(SHORT, register="random")))
    block = episodes_of(plant, "test", 0, 20)
    whole = identify(plant, block.u, block.y)
    for count in (1, 17):
        part = identify(plant, block.u[:count], block.y[:count])
        for name in ("theta", "cost", "steps"):
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[:count])


N = 1000
PLANT = FAMILIES["vehicle"]
GOOD = episodes_of(PLANT, "test", 0, 1)
HOPELESS = {
    "zero output": (PLANT.u, np.zeros(N)),
    "constant output": (PLANT.u, np.full(N, 0.1)),
    "zero input": (np.zeros(N), GOOD.y[0]),
    "nothing": (np.zeros(N), np.zeros(N)),
    "wrong sign": (PLANT.u, -GOOD.y[0]),
    "degrees": (PLANT.u, np.degrees(GOOD.y[0])),
    "noise": (PLANT.u, np.random.default_rng(0).standard_normal(N)),
}


def test_hopeless_data_are_not_called_converged_and_leave_their_neighbours_alone():
    u = np.array([u for u, _ in HOPELESS.values()] + [PLANT.u])
    y = np.array([y for _, y in HOPELESS.values()] + [GOOD.y[0]])
    start = np.tile(PLANT.middle, (len(y), 1))
    among = search(PLANT, u, y, start)
    assert among.converged.tolist() == [False] * len(HOPELESS) + [True]
    alone = search(PLANT, GOOD.u, GOOD.y, start[:1])
    np.testing.assert_array_equal(among.theta[-1], alone.theta[0])
    gains = GrayBox().gains(PLANT, Recording(u, y, PLANT.Ts))
    assert not gains.converged[:-1].any() and gains.converged[-1]


def test_the_prior_holds_a_search_of_noise_where_simulators_give_nan():
    def fragile(theta, u, rng):
        return np.where(theta[:, 1:] > 0.9, np.nan, simulate(theta, u, rng))

    own = described(simulate=fragile)
    theta = np.array([[1.0, 0.85]])
    found = identify(own, U, simulate(theta, U, None))
    np.testing.assert_allclose(found.theta, theta, rtol=1e-5)


def test_measured_parameters_are_not_searched_for():
    plant = described(measured={"T": 0.05})
    block = episodes_of(plant, "test", 0, 40)
    found = identify(plant, block.u, block.y, start_of(plant, block.theta))
    np.testing.assert_array_equal(found.theta[:, 1], block.theta[:, 1])
    by_K = [slopes(theta)[0] for theta in block.theta]
    least = SIGMA / np.sqrt([d @ d for d in by_K]) / block.theta[:, 0]
    np.testing.assert_allclose(cramer_rao(plant, block.theta)[:, 0], least, rtol=1e-4)
    assert np.abs((found.theta[:, 0] / block.theta[:, 0] - 1) / least).max() < 4


def test_a_wrong_yaw_inertia_biases_the_parameters_and_not_the_gains():
    # mu_s, M_veh and J_z scaled together leave the dynamics as they are.
    theta = np.array([[0.4, 50.0, 20.0], [0.9, 250.0, 20.0]])
    wrong = Vehicle(J_z=1.2 * Vehicle().J_z)
    plant = yaw_rate(replace(VEHICLE, vehicle=wrong))
    y = PLANT.respond(theta)
    found = search(plant, PLANT.u[None], y, start_of(plant, theta))
    np.testing.assert_allclose(found.theta[:, 0], 1.2 * theta[:, 0], rtol=1e-6)
    mass = total_mass(Vehicle(), Context(*theta.T))
    np.testing.assert_allclose(found.theta[:, 1] + M_0, 1.2 * mass, rtol=1e-6)
    gains = GrayBox().gains(plant, Recording(PLANT.u[None], y, PLANT.Ts)).values
    np.testing.assert_allclose(gains[:, 0], PLANT.oracle(theta)[:, 0], rtol=1e-5)
