"""Ready plants of process control against SciPy, and SIMC against Skogestad's examples."""

import numpy as np
import pytest
from scipy.signal import lsim

from yawrate_env import plants
from yawrate_env.loop.simc import half_rule, simc
from yawrate_env.plant import LogRange
from yawrate_env.plant.entry import find, from_toml
from yawrate_env.signals.excitation import multisine, prbs

EIGHTHS = 8
SYSTEMS = {
    "fopdt": ([1.3, 14.0, 5.375], ([1.3], [14.0, 1.0])),
    "sopdt": ([0.7, 21.0, 4.0, 8.625], ([0.7], [84.0, 25.0, 1.0])),
    "integrator": ([0.05, 3.25], ([0.05], [1.0, 0.0])),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_fractional_dead_time_is_scipys(name):
    """Eight steps a sample, of which the dead time is a whole number."""
    theta, system = SYSTEMS[name]
    plant = getattr(plants, name)()
    u = plant.u.repeat(EIGHTHS)
    late = round(theta[-1] * EIGHTHS)
    delayed = np.concatenate([np.zeros(late), u[:-late]])
    expected = lsim(system, delayed, np.arange(len(u)) / EIGHTHS, interp=False)[1][::EIGHTHS]
    found = plant.respond(np.array([theta]))[0]
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_every_row_of_a_batch_has_its_own_dead_time_and_input():
    plant = plants.fopdt()
    theta = np.array([[1.0, 20.0, 0.0], [2.0, 15.0, 7.5], [0.5, 30.0, 700.0]])
    u = np.random.default_rng(0).standard_normal((3, 600))
    whole = plant.respond(theta, u)
    for i in range(3):
        np.testing.assert_array_equal(plant.respond(theta[i : i + 1], u[i : i + 1])[0], whole[i])
    assert (whole[2] == 0).all()  # later than the recording is long


def test_simc_gives_skogestads_settings():
    """Table 4 of his paper, "tight": E1 1/((s+1)(0.2s+1)), and K e^{-s}/s of section 4.3."""
    lag, late = half_rule(np.array([1.0]), np.array([0.2]), np.zeros(1))
    np.testing.assert_allclose(simc(np.ones(1), lag, late), [[5.5, 0.8]], rtol=1e-12)
    found = simc(np.array([2.0]), np.array([np.inf]), np.ones(1))
    np.testing.assert_allclose(found, [[0.25, 8.0]], rtol=1e-12)
    slower = simc(np.ones(1), np.array([3.0]), np.ones(1), tau_c=2.0)
    np.testing.assert_allclose(slower, [[1.0, 3.0]], rtol=1e-12)


def test_the_margins_of_a_tight_loop_are_the_rules_own():
    """L = exp(-Ls)/(2Ls): phase margin 90 deg - 1/2 rad, gain margin pi, but for the hold."""
    plant = plants.fopdt(L=(3.0, 10.0), experiment={"Ts": 0.05, "N": 2000})
    theta = np.array([[1.5, 20.0, 4.0], [0.7, 15.0, 2.0]])
    values, stable = plant.evaluation(theta, plant.oracle(theta))
    assert stable.all()
    np.testing.assert_allclose(values[:, 0], 90 - np.degrees(0.5), atol=0.1)
    np.testing.assert_allclose(values[:, 1], 20 * np.log10(np.pi), atol=0.1)
    np.testing.assert_allclose(values[:, 2], 0.5 / (2 * np.pi * theta[:, 2]), rtol=0.015)


def test_a_file_of_ranges_is_enough(tmp_path):
    path = tmp_path / "heater.toml"
    path.write_text(
        '[plant]\nentry = "yawrate_env.plants:fopdt"\n[plant.arguments]\nK = {log = [0.1, 10]}\n'
        "T = [60, 300]\nL = 8.4\ntau_c = 20\n[plant.arguments.experiment]\nTs = 2\nnoise = 0.1\n"
        'signals = ["heater [%]", "temperature [degC]"]\n'
    )
    plant = from_toml(path)
    assert plant.prior["K"] == LogRange(0.1, 10.0) and plant.prior["L"] == (8.4, 8.4)
    assert (plant.Ts, plant.noise, plant.signals[1]) == (2.0, 0.1, "temperature [degC]")
    again = find(plant.entry, arguments=plant.arguments)
    theta = np.array([[1.0, 100.0, 8.4]])
    np.testing.assert_array_equal(again.oracle(theta), plant.oracle(theta))
    np.testing.assert_allclose(plant.oracle(theta), [[100 / 29.4, 100.0]])
    assert plant.closed_loop(theta[0], plant.oracle(theta)[0]).open is not None


def test_experiments_have_the_input_that_is_asked_for():
    four = plants.fopdt(experiment={"levels": 4, "amplitude": 3.0})
    np.testing.assert_allclose(np.unique(four.u), [-3.0, -1.0, 1.0, 3.0])
    assert find(four.entry, arguments=four.arguments).u.tolist() == four.u.tolist()
    sines = plants.fopdt(experiment={"kind": "multisine"}).u
    np.testing.assert_array_equal(sines, multisine(600, 1.0, 20.0, 1.0)[0])
    longer = plants.sopdt(experiment={"order": 9}).u
    np.testing.assert_array_equal(longer, prbs(600, 1.0, 20.0, 1.0, order=9)[0])


@pytest.mark.parametrize("arguments, name", [
    ({"tau_c": 0.0}, "tau_c"),
    ({"experiment": {"Ts": 0.0}}, "Ts"),
    ({"experiment": {"Tz": 1.0}}, "experiment's setting = 'Tz'"),
    ({"experiment": 3}, "experiment"),
    ({"experiment": {"kind": "noise"}}, "kind"),
    ({"experiment": {"levels": 1}}, "levels"),
    ({"experiment": {"levels": 3, "kind": "multisine"}}, "levels"),
    ({"experiment": {"order": 21}}, "order"),
    ({"K": (2.0, 1.0)}, "K"),
])  # fmt: skip
def test_bad_arguments_are_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        plants.fopdt(**arguments)
