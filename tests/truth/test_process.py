"""Ready plants of process control against SciPy, and SIMC against Skogestad's examples."""

import numpy as np
import pytest
from scipy.signal import lsim

import tuners
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
    "thermal": ([2.0, 0.0125, 0.01, 7.0, 4.375], ([0.01], np.polymul([2.0, 0.0125], [7.0, 1.0]))),
    "dc_motor": (  # K/((L s + R)(J s + b) + K^2), with L = R Te, and a dead time of 2.5 samples
        [2e-4, 1e-3, 0.05, 0.8, 2e-3, 0.0125],
        ([0.05], np.polyadd(np.polymul([1.6e-3, 0.8], [2e-4, 1e-3]), [0.0025])),
    ),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_fractional_dead_time_is_scipys(name):
    """Eight steps a sample, of which the dead time is a whole number."""
    theta, system = SYSTEMS[name]
    plant = getattr(plants, name)()
    step, u = plant.Ts / EIGHTHS, plant.u.repeat(EIGHTHS)
    late = round(theta[-1] / step)
    delayed = np.concatenate([np.zeros(late), u[:-late]])
    expected = lsim(system, delayed, np.arange(len(u)) * step, interp=False)[1][::EIGHTHS]
    found = plant.respond(np.array([theta]))[0]
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", SYSTEMS)
def test_rules_for_processes_know_gain_and_lags(name):
    """The steady gain, or slope, and the poles are those of the matrices."""
    theta = np.array([SYSTEMS[name][0]])
    plant = getattr(plants, name)(rule="lambda", tau_c=20.0)
    loop = plant.simulate.__self__
    process, discrete = loop.process(theta), loop.discrete(theta, loop.Ts)
    lags = np.array([process.lag[0], process.second_lag[0]])
    poles = np.exp(-loop.Ts / lags[lags > 0])
    found = np.sort(np.linalg.eigvals(discrete.A[0]))
    np.testing.assert_allclose(found, np.sort(poles), rtol=1e-9)
    assert process.dead_time[0] == theta[0, -1] + loop.Ts / 2
    if np.isfinite(process.lag[0]):
        stationary = np.linalg.solve(np.eye(len(poles)) - discrete.A[0], discrete.B[0])
        steady = discrete.C @ stationary + discrete.D[0]
        np.testing.assert_allclose(steady, process.gain, rtol=1e-9)


def test_a_motor_that_swings_has_two_lags_of_its_natural_frequency():
    """As much inductance as inertia: poles of the characteristic polynomial are complex."""
    J, b, K, R, Te = 1e-4, 1e-3, 0.05, 1.0, 0.1
    poles = np.roots([J * R * Te, R * (J + b * Te), b * R + K**2])
    assert (poles.imag != 0).all()
    loop = plants.dc_motor().simulate.__self__
    process = loop.process(np.array([[J, b, K, R, Te, 0.0]]))
    np.testing.assert_allclose([process.lag[0], process.second_lag[0]], 1 / abs(poles[0]))


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
    plant = plants.fopdt(L=(3.0, 10.0), experiment={"Ts": 0.05, "N": 2000, "bit_time": 5.0})
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
    motor = plants.dc_motor(experiment={"noise": 2.0})  # the others are a motor's own
    assert (motor.noise, motor.Ts, motor.u.max()) == (2.0, 5e-3, 6.0)
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
    ({"experiment": {"signals": "uy"}}, "signals"),
    ({"experiment": {"signals": ["u", 2]}}, "signal = 2"),
    ({"experiment": {"bit_time": 1e4}}, "bit_time"),
    ({"controller": 3}, "controller"),
    ({"metrics": "Ms"}, "metrics"),
    ({"K": (2.0, 1.0)}, "K"),
    ({"K": (-1.0, 2.0)}, "lowest K"),
    ({"T": {"normal": [10.0, 10.0]}}, "lowest T"),
    ({"L": (-1.0, 2.0)}, "lowest L"),
    ({"L": 601.0}, "highest L"),
])  # fmt: skip
def test_bad_arguments_are_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        plants.fopdt(**arguments)


@pytest.mark.parametrize("waited", [0, 120])
def test_a_process_that_was_at_work_before_is_found_as_from_rest(waited):
    """Input and output are counted from another zero; the log may begin before the test."""
    plant = plants.thermal()
    u = np.concatenate([np.zeros(waited), plant.u])
    noise = 0.1 * np.random.default_rng(0).standard_normal(len(u))
    y = plant.answers(np.array([[2.5, 0.012, 0.01, 12.0, 4.4]]), u[None])[0] + noise
    tuner = tuners.load("gb", plant)
    rested, worked = tuner.tune(u, y), tuner.tune(u + 50.0, y + 300.0)
    assert rested.verdict == worked.verdict == "usable"
    assert worked.gains == pytest.approx(rested.gains, rel=0.01)
    assert worked.fit.offset == pytest.approx(300.0, abs=0.1)
