"""Priors over any of the vehicle's parameters: the same numbers as with constants, and refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest

import tuners
from tuners import LogRange, Normal
from yawrate_env.batch import concatenate, take
from yawrate_env.plant.episodes import recorded, sample
from yawrate_env.plant.fingerprint import fingerprint
from yawrate_env.vehicle.nonlinear import NonlinearTwin
from yawrate_env.vehicle.nonlinear.time_domain import time_response
from yawrate_env.vehicle.single_track import OTHERS, Context, Vehicle, context_of, theta_of
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import LABELS, yaw_rate

SHORT = Experiment(N=1000)
OTHER = {
    "J_z": 2600.0, "l_f": 1.3, "l_r": 1.4, "C_f": 1.1e5, "C_r": 1.5e5, "l_rel_f": 0.3,
    "l_rel_r": 0.0, "omega_n": 25.0, "xi": 0.7, "dead_time": 0.0137, "sensor_lag": 0.01,
}  # fmt: skip
DELAYS = ("dead_time", "sensor_lag")


def opened(*names, twin=None, experiment=SHORT):
    """A task whose vehicles have ranges around some of the other values."""
    ends = {name: (0.9 * OTHER[name], 1.1 * OTHER[name]) for name in names}
    task = Task(prior=Prior(**ends), experiment=experiment)
    return task if twin is None else replace(task, twin=twin)


def compared(names, twin=None):
    """Three vehicles: parameters with columns, and the same as constants."""
    task = opened(*names, twin=twin)
    fixed = replace(task, prior=Prior(), vehicle=Vehicle(**{name: OTHER[name] for name in names}))
    theta = sample(yaw_rate(fixed, check=False), 3)
    values = [OTHER[name] for name in OTHERS if name in names]
    wide = np.column_stack([theta, np.tile(values, (3, 1))])
    return yaw_rate(task, check=False), wide, yaw_rate(fixed, check=False), theta


@pytest.mark.parametrize("names", [*((name,) for name in OTHERS), OTHERS])
def test_a_column_is_the_same_as_the_vehicles_constant(names):
    plant, wide, fixed, theta = compared(names)
    assert tuple(plant.prior) == ("mu_s", "M_delta", "v_x", *names)
    scale = np.abs(fixed.respond(theta)).max()
    np.testing.assert_allclose(plant.respond(wide), fixed.respond(theta), atol=1e-12 * scale)
    np.testing.assert_allclose(plant.oracle(wide), fixed.oracle(theta), rtol=1e-10)
    gains = fixed.oracle(theta)
    metrics = (each.evaluation(t, gains)[0] for each, t in ((plant, wide), (fixed, theta)))
    np.testing.assert_allclose(*metrics, rtol=1e-9)


def test_stiffnesses_are_the_same_bit_for_bit():
    plant, wide, fixed, theta = compared(("C_f", "C_r"))
    np.testing.assert_array_equal(plant.respond(wide), fixed.respond(theta))
    np.testing.assert_array_equal(plant.oracle(wide), fixed.oracle(theta))


@pytest.mark.parametrize("names", [("C_f",), tuple(name for name in OTHERS if name not in DELAYS)])
def test_so_it_is_on_saturating_tyres(names):
    names = tuple(name for name in names if name != "l_rel_r")  # too stiff without relaxation
    plant, wide, fixed, theta = compared(names, NonlinearTwin())
    scale = np.abs(fixed.respond(theta)).max()
    np.testing.assert_allclose(plant.respond(wide), fixed.respond(theta), atol=1e-11 * scale)
    kp, Ti, step = np.full(3, 0.15), np.full(3, 0.1), np.full(50, 0.05)
    one, other = (
        time_response(task, context_of(t, task.prior.others), kp, Ti, step)[0]
        for task, t in ((opened(*names, twin=NonlinearTwin()), wide),
                        (Task.of(fixed.arguments), theta))
    )  # fmt: skip
    np.testing.assert_allclose(one, other, atol=1e-11)


@pytest.mark.parametrize("name", DELAYS)
def test_the_nonlinear_twin_refuses_delays(name):
    message = rf"\A{name} must be 0 .*nonlinear twin.* linear twin\.\Z"
    with pytest.raises(ValueError, match=message):
        opened(name, twin=NonlinearTwin())
    with pytest.raises(ValueError, match=message):
        Task(vehicle=Vehicle(**{name: 0.01}), twin=NonlinearTwin())


def test_without_further_parameters_nothing_changes():
    task, plant = Task(), yaw_rate(Task())
    assert task.settings() == json.loads(json.dumps(task.settings()), object_hook=as_ranges)
    assert set(task.settings()["vehicle"]) == set(Vehicle.__slots__) - set(DELAYS)
    assert set(task.settings()["prior"]) == {"mu_s", "M_delta", "v_x"}
    assert plant.prior == {"mu_s": (0.3, 1.1), "M_delta": (0.0, 300.0), "v_x": (20.0, 20.0)}
    assert plant.sensitivity is not None and plant.action_bounds is not None


def as_ranges(part):
    """JSON's lists as the pairs that settings have."""
    return {name: tuple(v) if isinstance(v, list) else v for name, v in part.items()}


@pytest.mark.parametrize(
    "prior",
    [
        Prior(C_f=(1e5, 1.5e5), dead_time=(0, 0.04)),
        Prior(C_r=LogRange(1e5, 2e5), mu_s=LogRange(0.3, 1.1)),
        Prior(J_z=Normal(2400, 100), v_x=Normal(20, 1), xi=0.8),
        Prior(l_rel_f=(0.0, 0.5), sensor_lag=0.02),
    ],
)
def test_settings_are_read_again(prior):
    task = Task(Vehicle(dead_time=0.005), prior, SHORT)
    again = Task.of(json.loads(json.dumps(task.settings())))
    assert again == task and hash(again) == hash(task)
    assert Task.of(task.settings()) == task
    assert again.settings() == task.settings()


def test_priors_of_other_distributions_are_other_tasks():
    uniform, logarithmic = (Task(prior=Prior(C_f=p)) for p in ((1e5, 2e5), LogRange(1e5, 2e5)))
    assert uniform != logarithmic and yaw_rate(uniform) is not yaw_rate(logarithmic)
    assert fingerprint(yaw_rate(uniform)) != fingerprint(yaw_rate(logarithmic))


def test_columns_stand_in_a_fixed_order_whatever_order_they_are_given_in():
    prior = Prior(sensor_lag=(0, 0.01), C_f=(1e5, 1.5e5), J_z=2500.0)
    plant = yaw_rate(Task(prior=prior, experiment=SHORT))
    assert tuple(plant.prior) == ("mu_s", "M_delta", "v_x", "J_z", "C_f", "sensor_lag")
    assert plant.known.tolist() == [2, 3]  # v_x and J_z are points
    assert {plant.label(name) for name in plant.prior} == {LABELS[name] for name in plant.prior}
    assert tuple(LABELS) == ("mu_s", "M_delta", "v_x", *OTHERS)


def test_contexts_are_taken_apart_and_joined_with_all_columns():
    theta = sample(yaw_rate(opened(*OTHERS), check=False), 5)
    context = context_of(theta, OTHERS)
    np.testing.assert_array_equal(theta_of(context), theta)
    parts = [take(context, slice(0, 2)), take(context, slice(2, 5))]
    np.testing.assert_array_equal(theta_of(concatenate(parts)), theta)
    turned = Context.of(0.5, 0.0, 20.0, dead_time=0.01, J_z=[2400.0, 2500.0])
    np.testing.assert_array_equal(theta_of(turned)[:, 3:], [[2400, 0.01], [2500, 0.01]])


def test_searches_stay_where_vehicles_are_physical():
    prior = Prior(C_f=(2e4, 2e5), dead_time=(0.0, 0.4), l_rel_r=(0, 1), xi=(0.3, 2.0))
    plant = yaw_rate(Task(prior=prior, experiment=SHORT), check=False)
    assert plant.sensitivity is None
    limits = plant.search_limits
    assert limits["C_f"] == (1e4, 2.9e5) and limits["dead_time"] == (0, 0.5)
    assert limits["l_rel_r"] == (0, 1.5) and limits["xi"][0] == 0.15


def test_the_gray_box_finds_stiffness_and_dead_time():
    task = Task(
        prior=Prior(M_delta=100.0, C_f=(1e5, 1.5e5), dead_time=(0.0, 0.03)),
        experiment=Experiment(Ts=0.002, N=3000, snr_db=60.0),
    )
    plant = yaw_rate(task)
    episode, gray = recorded(plant, "test", 0, 2), tuners.load("gb", plant)
    for theta, y in zip(episode.theta, episode.y, strict=True):
        found = gray.tune(u=episode.u[0], y=y, Ts=0.002, v_x=20.0)
        fitted = np.array([found.fit.parameters[name] for name in plant.prior])
        np.testing.assert_allclose(fitted[[0, 3]], theta[[0, 3]], rtol=0.02)
        assert fitted[4] == pytest.approx(theta[4], abs=2e-4)
        assert found.trusted
        assert found.exact_intervals["phase_margin [deg]"].value == pytest.approx(60, abs=1e-6)


@pytest.mark.parametrize(
    "factors",
    [
        {"mu_s": 1.1, "M_delta": 1.1, "J_z": 1.1},
        {"mu_s": 1.1, "C_f": 1 / 1.1, "C_r": 1 / 1.1},
    ],
)
def test_parameters_that_no_recording_tells_apart_are_no_failure(factors):
    names = [name for name in factors if name in OTHERS]
    plant = yaw_rate(opened(*names, experiment=Experiment(Ts=0.002, N=3000)))
    known = {"M_delta": Vehicle().M_0}  # the total mass is scaled
    theta, other = plant.middle, plant.middle
    for name, factor in factors.items():
        (i,) = plant.indices((name,))
        other[:, i] = factor * (other[:, i] + known.get(name, 0.0)) - known.get(name, 0.0)
    np.testing.assert_allclose(plant.respond(other), plant.respond(theta), atol=1e-12)
    episode = recorded(plant, "test", 0, 1)
    found = tuners.load("gb", plant).tune(u=plant.u, y=episode.y[0], Ts=0.002)
    assert found.trusted
    actual = plant.metric_values(episode.theta, np.array([[found.kp, found.Ti]]))[0]
    np.testing.assert_allclose(actual, plant.target, atol=3 * plant.metric_setting("spread").min())
    spread = np.array(list(found.fit.deviations.values()))  # alone, they are as unknown as before
    shares = spread / plant.width / np.sqrt(1 / 12)
    assert (shares < 1 + 1e-9).all() and shares.max() > 0.5


def test_the_actuator_in_front_is_known_only_where_it_is_the_same_for_all():
    assert yaw_rate(opened("omega_n")).actuator is None
    late = yaw_rate(Task(vehicle=Vehicle(dead_time=0.01), experiment=SHORT))
    ramp = 0.001 * np.maximum(np.arange(500) - 100, 0)
    np.testing.assert_allclose(
        late.actuator(ramp, 0.001)[10:], yaw_rate(Task()).actuator(ramp, 0.001)[:-10], atol=1e-12
    )


@pytest.mark.parametrize(
    "name, value, message",
    [
        ("C_f", (1.0, 2.0), "C_f = 1 must be .* at least 124.9, at most 1.249e.08. Use SI units"),
        ("C_f", Normal(1e5, 1e5), "C_f = -200000 must be .* at least 124.9"),
        ("C_f", "soft", "C_f = 'soft' must be a number or a pair"),
        ("J_z", (3000, 2000), "J_z = .* low above high. Swap"),
        ("dead_time", (0.0, 0.6), "dead_time = 0.6 must be .* at most 0.5. Use SI units"),
        ("dead_time", -0.1, "dead_time = -0.1 must be .* at least 0"),
        ("sensor_lag", (0, 2), "sensor_lag = 2 must be .* at most 1"),
        ("mu_s", LogRange(0.1, 200), "mu_s = 200 must be .* at most 100"),
        ("l_rel_f", LogRange(0.1, 1e3), "l_rel_f = 1000 must be .* at most 400"),
    ],
)
def test_priors_that_are_not_physical_are_refused_in_one_line(name, value, message):
    with pytest.raises(ValueError, match=rf"\A{message}[^\n]*\Z"):
        Prior(**{name: value})


def test_vehicles_that_are_not_physical_are_refused():
    with pytest.raises(ValueError, match="dead_time = 0.7 .* at most 0.5"):
        Context.of(0.5, 0.0, 20.0, dead_time=[0.1, 0.7])
    with pytest.raises(ValueError, match="'M_0' is unknown. Choose one of J_z"):
        Context.of(0.5, 0.0, 20.0, M_0=1000.0)
    assert Vehicle(l_rel_f=0).l_rel_f == 1e-4
