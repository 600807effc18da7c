"""Rules for processes against printed settings and what they promise."""

import numpy as np
import pytest

from yawrate_env import plants
from yawrate_env.loop.process_rules import Process, amigo, imc, simc
from yawrate_env.plant.episodes import sample

ONE, NONE = np.ones(1), np.zeros(1)


def test_amigo_gives_the_books_settings():
    """Astrom and Hagglund's lag-dominated example, L = 0.074, T = 1.03, and the integrator."""
    fast = Process(ONE, np.array([1.03]), NONE, np.array([0.0743]))
    pi, pid = amigo(fast, False, ONE), amigo(fast, True, ONE)
    np.testing.assert_allclose([pi.kp[0], pi.Ti[0]], [4.13, 0.539], rtol=0.011)
    np.testing.assert_allclose([pid.kp[0], pid.Ti[0], pid.Td[0]], [6.44, 0.361, 0.0367], rtol=0.011)
    slope = Process(ONE, np.array([np.inf]), NONE, ONE)
    pi, pid = amigo(slope, False, ONE), amigo(slope, True, ONE)
    np.testing.assert_allclose([pi.kp[0], pi.Ti[0]], [0.35, 13.35])
    np.testing.assert_allclose([pid.kp[0], pid.Ti[0], pid.Td[0]], [0.45, 8.0, 0.5])


def test_simc_cancels_the_second_lag():
    """kp (1 + 1/(Ti s) + Td s) is (T1 s + 1)(T2 s + 1)/(T1 s) times T1/(K (tau_c + L))."""
    found = simc(Process(2 * ONE, 10 * ONE, 4 * ONE, 2 * ONE), True, 3 * ONE)
    assert (found.kp[0], found.Ti[0], found.Td[0]) == pytest.approx((1.4, 14.0, 40 / 14))
    swapped = simc(Process(2 * ONE, 4 * ONE, 10 * ONE, 2 * ONE), True, 3 * ONE)
    assert swapped.kp == pytest.approx(found.kp)
    tight = simc(Process(ONE, 100 * ONE, NONE, ONE), True, ONE)  # Ti 8, lead 1/3
    assert tight.Ti[0] == pytest.approx(8 + 1 / 3) and tight.Td[0] == pytest.approx(8 / 25)


@pytest.mark.parametrize("derives", [False, True])
def test_lambda_leaves_one_lag_of_the_wanted_length(derives):
    """With Pade's approximation of the dead time, of the order that each rule rests on."""
    K, T, L, slow = 1.7, 12.0, 3.0, 5.0
    found = imc(Process(K * ONE, T * ONE, NONE, L * ONE), derives, slow * ONE)
    s = 1j * np.geomspace(1e-3, 1, 30)
    C = found.kp * (1 + 1 / (found.Ti * s) + found.Td * s)
    if derives:
        loop = C * K * (1 - s * L / 2) / ((1 + s * L / 2) * (T * s + 1))
        np.testing.assert_allclose(loop / (1 + loop), (1 - s * L / 2) / (1 + slow * s), rtol=1e-9)
    else:
        loop = C * K * (1 - s * L) / (T * s + 1)
        np.testing.assert_allclose(loop / (1 + loop), (1 - s * L) / (1 + slow * s), rtol=1e-9)


@pytest.mark.parametrize("controller", ["PI", "PIDF"])
def test_the_constrained_rule_reaches_its_sensitivity_and_nothing_integrates_more(controller):
    plant = plants.fopdt(controller=controller, rule="ms", Ms=1.6, metrics=["Ms", "IE"])
    theta = sample(plant, 4)
    gains = plant.oracle(theta)
    (Ms, IE), stable = plant.evaluation(theta, gains)[0].T, plant.evaluation(theta, gains)[1]
    assert stable.all()
    np.testing.assert_allclose(Ms, 1.6, rtol=1e-4)
    Ti = list(plant.gains).index("Ti")
    for factor in (0.8, 1.25):
        other = gains.copy()
        other[:, Ti] *= factor
        if controller == "PIDF":
            other[:, 2:] *= factor
        low, high = np.full(4, 0.1), np.full(4, 3.0)
        for _ in range(40):  # the largest gain with the same sensitivity
            middle = np.sqrt(low * high)
            tried = other * np.column_stack([middle, *np.ones((len(plant.gains) - 1, 4))])
            values, ok = plant.evaluation(theta, tried)
            fine = ok & (values[:, 0] <= 1.6)
            low, high = np.where(fine, middle, low), np.where(fine, high, middle)
        tried = other * np.column_stack([low, *np.ones((len(plant.gains) - 1, 4))])
        assert (plant.evaluation(theta, tried)[0][:, 1] >= IE * (1 - 1e-6)).all()


def test_amigos_loops_have_about_its_sensitivity():
    plant = plants.fopdt(controller="2DOF", rule="amigo", metrics=["Ms"],
                         L=(3.0, 15.0), experiment={"Ts": 0.5, "N": 600})  # fmt: skip
    theta = sample(plant, 20)
    gains = plant.oracle(theta)
    Ms = plant.evaluation(theta, gains)[0][:, 0]
    assert (np.abs(Ms - 1.4) < 0.3).all()
    late = theta[:, 2] + 0.25 > theta[:, 1]
    np.testing.assert_array_equal(gains[:, 4] == 1.0, late)


@pytest.mark.parametrize("rule", ["simc", "lambda", "ms", "loop-shaping"])
def test_faster_loops_have_less_margin(rule):
    target = {"phase_margin": 60, "crossover": 0.012} if rule == "loop-shaping" else None
    plant = plants.sopdt(controller="PIDF", rule=rule, target=target)
    theta = plant.middle
    loops = plant.speeds(theta[0])
    margin = [plant.closed_loop(theta[0], loops[name]).open.marked.delay_margin[0]
              for name in ("slow", "medium", "fast")]  # fmt: skip
    assert margin[0] > margin[1] > margin[2] > 0
    np.testing.assert_allclose(loops["medium"], plant.oracle(theta)[0])
    assert plants.fopdt(rule="amigo").speeds is None


@pytest.mark.parametrize("arguments, name", [
    ({"controller": "PIDD"}, "controller = 'PIDD'"),
    ({"rule": "luck"}, "rule = 'luck'"),
    ({"rule": "lqr"}, "rule = 'lqr' is not for controller 'PI'"),
    ({"controller": "P"}, "rule = 'simc' is not for controller 'P'"),
    ({"rule": "loop-shaping"}, "target"),
    ({"target": {"phase_margin": 60}}, "target.*crossover"),
    ({"tau": 3.0}, "'tau'"),
    ({"rule": "ms", "Ms": 1.0}, "Ms = 1"),
    ({"metrics": ["beauty"]}, "metric = 'beauty'"),
    ({"tau_c": 0.0}, "tau_c"),
    ({"N": 0.0}, "N = 0"),
])  # fmt: skip
def test_wrong_controls_are_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        plants.fopdt(**arguments)


def test_the_constrained_rule_is_not_for_integrators():
    with pytest.raises(ValueError, match="rule = 'ms'"):
        plants.integrator(rule="ms")


@pytest.mark.parametrize("rule", ["simc", "lambda", "amigo", "ms"])
def test_a_computation_delay_is_dead_time(rule):
    aim = {"phase_margin": 60, "crossover": 0.01, "delay_samples": 3}
    late = plants.fopdt(controller="PIDF", rule=rule, target=aim)
    gains = late.oracle(np.array([[1.5, 20.0, 6.0]]))
    alike = plants.fopdt(controller="PIDF", rule=rule).oracle(np.array([[1.5, 20.0, 9.0]]))
    np.testing.assert_allclose(gains, alike, rtol=1e-9)
