"""The experiment for a wanted interval, against recordings that are simulated and tuned."""

import re

import numpy as np
import pytest
from command import WRONG, call, refused
from families import FAMILIES, SHORT
from first_order import described
from first_order import plant as lag

from tuners.trust.bound import cramer_rao
from tuners.trust.forecast import forecast
from tuners.trust.intervals import GAUSSIAN
from tuners.trust.proposal import OutOfReachError, check_wanted, propose, room
from tuners.tuner.recording import Recording
from tuners.tuner.rivals import BlackBoxRule
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.vehicle_file import example as paper
from yawrate_env.vehicle.yaw_rate import yaw_rate

COUNT = 64
WANTED = [("vehicle", 0.2), ("vehicle", 1.0), ("motor", 0.3), ("motor", 1.5)]


def proposed(plant, wanted, way="both", **noise):
    found = forecast(plant, **noise)
    return found, propose(found, wanted, room(found, 0.3, 200_000), way)


def claimed(plant, u, seed=0):
    """Half widths (B,) of test plants' intervals; noise is that of the experiment itself."""
    theta = recorded(plant, "test", seed, COUNT).theta
    sigma = plant.sigma(plant.respond(theta))
    noise = np.random.default_rng(seed).normal(size=(COUNT, len(u)))
    y = plant.respond(theta, u) + sigma[:, None] * noise
    results = Tuner(plant, BlackBoxRule()).results(Recording(u[None], y, plant.Ts, theta))
    ends = [result.intervals[plant.counted[0]] for result in results]
    return np.array([(end.high - end.low) / 2 for end in ends])


@pytest.mark.parametrize("name, wanted", WANTED)
@pytest.mark.parametrize("way", ["both", "amplitude"])
def test_recordings_of_the_proposed_experiment_claim_what_was_wanted(name, wanted, way):
    plant = FAMILIES[name]
    found, proposal = proposed(plant, wanted, way)
    half = claimed(plant, found.input(proposal.amplitude, proposal.samples))
    assert np.quantile(half, 0.9) == pytest.approx(wanted, rel=0.2)
    assert np.median(half) == pytest.approx(proposal.median, rel=0.2)
    assert proposal.most == pytest.approx(wanted, rel=0.021)


def test_the_width_falls_with_amplitude_and_root_of_the_length():
    """Exactly so where the noise is white and all else is the plant's."""
    found = forecast(lag)
    N, once = len(lag.u), forecast(lag).half_widths(1.0, len(lag.u))
    np.testing.assert_allclose(found.half_widths(4.0, N), once / 4, rtol=1e-6)
    np.testing.assert_allclose(found.half_widths(1.0, 16 * N), once / 4, rtol=0.05)
    bound = GAUSSIAN * cramer_rao(lag, found.theta)[:, 0]
    np.testing.assert_allclose(once, bound, rtol=1e-6)
    assert not found.alone and forecast(FAMILIES["vehicle"]).alone


def test_the_noise_is_the_experiments_or_given():
    vehicle = FAMILIES["vehicle"]
    own, same, given = forecast(vehicle), forecast(vehicle, snr=30.0), forecast(vehicle, noise=0.1)
    np.testing.assert_allclose(same.sigma, own.sigma)
    assert (given.sigma == 0.1).all()


def test_an_input_is_repeated_or_goes_on_and_begins_as_todays():
    vehicle = FAMILIES["vehicle"]
    twice = forecast(vehicle).input(2.0, 2 * len(vehicle.u))
    np.testing.assert_array_equal(twice, 2 * np.tile(vehicle.u, 2))
    random = yaw_rate(Task(experiment=Experiment(Ts=0.01, N=500, register="random")))
    u = forecast(random, seed=3).input(1.0, 1200)
    (first,) = random.inputs(np.random.default_rng(3).integers(0, 2**64, 1, np.uint64))
    np.testing.assert_array_equal(u[:500], first)
    assert not np.array_equal(u[500:1000], first) and len(u) == 1200


def test_limits_of_the_actuator_end_in_a_longer_experiment():
    plant = described(command_limits=(-2.0, 2.0))
    found = forecast(plant)
    wanted = float(np.quantile(found.half_widths(1.0, 500), 0.9)) / 8
    free, limited = (proposed(each, wanted)[1] for each in (lag, plant))
    assert free.amplitude > 2.5 and limited.amplitude == pytest.approx(2.0)
    assert limited.samples > 1.8 * free.samples
    assert limited.most == pytest.approx(wanted, rel=0.05)
    alone = proposed(plant, wanted, "amplitude")[1]
    assert (alone.amplitude, alone.samples) == (2.0, 500) and alone.most > 3 * wanted


def test_without_noise_nothing_is_forecast():
    with pytest.raises(OutOfReachError, match="noise = 0 must be above 0.*Give"):
        check_wanted(forecast(described(noise=0.0)), 0.1)
    check_wanted(forecast(described(noise=0.0), noise=0.1), 0.1)


@pytest.fixture
def car(tmp_path):
    text = paper().replace("N = 10_000", "N = 1_000").replace("Ts = 0.001", "Ts = 0.01")
    (tmp_path / "car.toml").write_text(text)
    return tmp_path / "car.toml"


def test_the_command_writes_the_proposed_input_and_says_both(car, tmp_path):
    vehicle, out = yaw_rate(Task(experiment=SHORT)), tmp_path / "prbs.csv"
    _, said, _ = call("excite", "--vehicle", car, "--wanted", 0.2, "-o", out)
    _, u = np.loadtxt(out, delimiter=",", skiprows=1).T
    assert np.quantile(claimed(vehicle, u), 0.9) == pytest.approx(0.2, rel=0.2)
    first, *_ = said.splitlines()
    assert f"{len(u) / 100:.6g} s of steering, ±{np.degrees(u.max()):.3g} deg" in first
    rows = {line.split()[0]: line for line in said.splitlines() if line.startswith("  ")}
    assert list(rows) == ["change", "today", "both", "length", "amplitude"]
    assert "median" in rows["change"] and "9 of 10" in rows["change"]
    assert [name for name, row in rows.items() if row.endswith("written")] == ["both"]
    assert "that a recording alone supports" in said and "rad/s" in said


def test_other_plants_have_the_bound(tmp_path):
    (tmp_path / "lag.toml").write_text('[plant]\nentry = "first_order:plant"\n')
    given = ("--vehicle", tmp_path / "lag.toml", "--wanted", 0.002, "--change", "length")
    _, said, _ = call("excite", *given, "-o", tmp_path / "u.csv")
    assert "relative error of kp by the Cramér-Rao bound" in said
    t, u = np.loadtxt(tmp_path / "u.csv", delimiter=",", skiprows=1).T
    assert u.max() == 1.0 and t[-1] > 20.0
    theta = recorded(lag, "test", 0, COUNT).theta
    half = GAUSSIAN * cramer_rao(lag, theta, u)[:, 0]
    assert np.quantile(half, 0.9) == pytest.approx(0.002, rel=0.2)


@pytest.mark.parametrize("given, words", [
    (["--wanted", 0], "--wanted.*not above 0"),
    (["--wanted", "nan"], "--wanted.*finite"),
    (["--wanted", 7], "--wanted = 7 must be at most 5 deg.*Ask for less"),
    (["--wanted", 1e-5, "--change", "amplitude"], "--wanted = 1e-05 must be at least .* deg.*Ask"),
    (["--wanted", 0.2, "--change", "time"], "--change"),
    (["--wanted", 0.2, "--noise", -1], "--noise.*not above 0"),
    (["--wanted", 0.2, "--noise", 0.1, "--snr", 30], "--noise and --snr"),
    (["--noise", 0.1], "--noise says how to reach --wanted"),
    (["--change", "length"], "--change says how"),
])  # fmt: skip
def test_what_is_not_proposed(given, words, car, tmp_path):
    line = refused(WRONG, "excite", "--vehicle", car, *given, "-o", tmp_path / "prbs.csv")
    assert re.search(words, line), line
    assert not (tmp_path / "prbs.csv").exists()
