"""Priors that are not uniform: what is drawn, the middle, and how they are written."""

import json

import numpy as np
import pytest
from scipy.stats import beta, kstest, lognorm, truncnorm

import tuners
from tuners import LogRange, Normal
from tuners.cli.text import prior_of
from yawrate_env import plants
from yawrate_env.plant.distributions import spread
from yawrate_env.plant.episodes import parameters, recorded, sample
from yawrate_env.plant.fingerprint import changed, fingerprint
from yawrate_env.signals.streams import stream, uniform

COUNT = 4000


def plant(together=None, **prior):
    """A gain K and a time constant, whose step is recorded."""

    def simulate(theta, u, rng):
        t = 0.1 * np.arange(len(u))
        return theta[:, :1] * (1 - np.exp(-t / theta[:, 1:2]))

    return tuners.Plant(
        prior={"K": (1.0, 3.0), "T": (0.5, 2.0)} | prior, simulate=simulate,
        design=lambda theta: 1 / theta[:, :1], gains=("k",), u=np.ones(40), Ts=0.1, noise=0.01,
        extrapolation={"T": (2.0, 3.0)}, together=together,
    )  # fmt: skip


def test_episodes_follow_the_distribution():
    theta = sample(plant(K=LogRange(0.01, 10.0), T=Normal(2.0, 0.5)), COUNT)
    expected = (np.log(theta[:, 0] / 0.01) / np.log(1000), "uniform"), (
        theta[:, 1], truncnorm(-3, 3, loc=2.0, scale=0.5).cdf,
    )  # fmt: skip
    for values, law in expected:
        assert kstest(values, law).pvalue > 1e-3
    assert theta[:, 0].min() >= 0.01 and theta[:, 0].max() <= 10.0
    assert np.abs(theta[:, 1] - 2.0).max() <= 1.5


def test_quantiles_are_monotone_and_end_at_the_ends():
    for prior in (LogRange(0.2, 5.0), Normal(-1.0, 2.0)):
        low, high = prior
        values = prior.at(np.linspace(0, 1, 1001))
        assert (np.diff(values) > 0).all()
        np.testing.assert_allclose(values[[0, 500, 1000]], [low, prior.middle, high], rtol=1e-9)


def test_other_parameters_keep_their_numbers_to_the_bit():
    uniform_one, logarithmic = plant(), plant(T=LogRange(0.5, 2.0))
    one, other = (sample(each, 50) for each in (uniform_one, logarithmic))
    np.testing.assert_array_equal(one[:, 0], other[:, 0])
    unit = uniform(stream(20, 0, 50, 2))
    np.testing.assert_array_equal(one, np.array([1.0, 0.5]) + np.array([2.0, 1.5]) * unit)
    assert (one[:, 1] != other[:, 1]).all()


def test_the_middle_and_the_ends_are_the_distributions():
    other = plant(K=LogRange(1.0, 100.0), T=Normal(1.0, 0.1))
    np.testing.assert_allclose(other.middle, [[10.0, 1.0]], rtol=1e-15)
    np.testing.assert_allclose(other.ranges, [[1.0, 0.7], [100.0, 1.3]], rtol=1e-15)
    assert plant().middle.tolist() == [[2.0, 1.25]]


def test_episodes_outside_the_prior_are_uniform():
    whole = recorded(plant(K=LogRange(1.0, 3.0), T=LogRange(0.5, 2.0)), "extrapolation", 0, 300)
    assert kstest((whole.theta[:, 1] - 2.0), "uniform").pvalue > 1e-3
    assert (np.log(whole.theta[:, 0]) / np.log(3.0) < 0.5).mean() == pytest.approx(0.5, abs=0.1)


def test_ranges_may_be_given():
    other = plant(K=LogRange(1.0, 3.0))
    words = stream(1, 0, 20, 2)
    given = parameters(other, words, (np.array([5.0, 5.0]), np.array([6.0, 6.0])))
    np.testing.assert_array_equal(given, 5.0 + uniform(words))


def test_a_plant_with_another_distribution_is_another_plant():
    then = json.loads(json.dumps(fingerprint(plant())))
    assert changed(plant(), then) == ""
    assert changed(plant(K=LogRange(1.0, 3.0)), then) == "prior"
    normal = Normal(2.0, 1 / 3)
    assert changed(plant(K=normal), fingerprint(plant(K=tuple(normal)))) == "prior"


@pytest.mark.parametrize("prior", [(1.0, 2.0), LogRange(1, 2), Normal(1, 2)])
def test_what_files_hold_is_read_again(prior):
    known = spread("K", prior)
    assert spread("K", json.loads(json.dumps(known.plain))) == prior == known
    assert hash(prior) == hash(spread("K", known.plain))


def test_any_distribution_of_scipy_is_a_prior():
    frozen = lognorm(0.5, scale=2.0)
    described = plant(K=frozen, T={"beta": {"a": 2.0, "b": 3.0, "loc": 0.5, "scale": 1.5}})
    theta = sample(described, COUNT)
    assert kstest(theta[:, 0], frozen.cdf).pvalue > 1e-3
    assert kstest(theta[:, 1], beta(2.0, 3.0, 0.5, 1.5).cdf).pvalue > 1e-3
    low, high = described.prior["K"]
    np.testing.assert_allclose([low, high], frozen.ppf([0.00135, 1 - 0.00135]), rtol=1e-9)
    assert tuple(described.prior["T"]) == (0.5, 2.0)  # no tails to cut off
    assert described.prior["K"].middle == pytest.approx(2.0)
    again = spread("K", json.loads(json.dumps(described.prior["K"].plain)))
    assert again == described.prior["K"]
    other = plant(K=lognorm(0.6, scale=2.0))
    assert changed(other, json.loads(json.dumps(fingerprint(described)))) == "prior"


def along(unit):
    """Time constants that grow with the gain."""
    K = 1 + 2 * unit[:, 0]
    return np.stack([K, 0.5 * K + 0.3 * unit[:, 1]], axis=1)


def test_parameters_may_be_drawn_together():
    described = plant(together=along)
    theta = sample(described, 500)
    assert np.corrcoef(theta.T)[0, 1] > 0.9
    np.testing.assert_array_equal(theta, along(uniform(stream(20, 0, 500, 2))))
    beyond = recorded(described, "extrapolation", 0, 20).theta
    assert (beyond[:, 1] >= 2.0).all()  # ranges of their own are uniform
    assert changed(described, json.loads(json.dumps(fingerprint(plant())))) == "simulate"
    with pytest.raises(ValueError, match="together's answer has K = "):
        sample(plant(together=lambda unit: 5 + unit), 2)
    with pytest.raises(ValueError, match="together's answer has shape"):
        sample(plant(together=lambda unit: unit[:, :1]), 2)


def test_records_are_not_pairs():
    assert LogRange(1, 2) != (1, 2) != Normal(1.5, 1 / 6)
    assert tuple(LogRange(1, 2)) == (1, 2)


@pytest.mark.parametrize(
    "value, message",
    [
        ({"log": [0.0, 1.0]}, "K: LogRange low = 0 .* above 0. .*uniform"),
        ({"log": [2.0, 1.0]}, "K: LogRange .* low above high. Swap"),
        ({"normal": [1.0, 0.0]}, "K: Normal deviation = 0 .* above 0. .* known"),
        ({"normal": [np.nan, 1.0]}, "K: Normal mean = nan"),
        ({"beta": [1.0, 2.0]}, "K = .*beta.* is no prior. Give .*log.*normal"),
        ({"log": [1.0, 2.0, 3.0]}, "K = .* is no prior"),
        ({"log": 3.0}, "K = .* is no prior"),
        ({"lognorm": {"s": -1.0}}, "K: lognorm .*no numbers"),
        ({"lognorm": {"sigma": 1.0}}, "K: lognorm: .*argument"),
        ({"binom": {"n": 5.0, "p": 0.5}}, "K: distribution = 'binom'"),
        ({"log": [1.0, 2.0], "normal": [1.0, 2.0]}, "K = .* is no prior"),
        ({}, "K = .* is no prior"),
        ("wide", "K = 'wide' must be a number or a pair"),
    ],
)
def test_what_is_no_prior_is_refused_in_one_line(value, message):
    with pytest.raises(ValueError, match=rf"\A[^\n]*{message}[^\n]*\Z"):
        plant(K=value)


def test_the_gray_box_finds_them():
    other = plant(K=LogRange(0.5, 8.0), T=Normal(1.0, 0.2))
    gray = tuners.load("gb", other)
    episode = recorded(other, "test", 0, 3)
    for theta, y in zip(episode.theta, episode.y, strict=True):
        found = gray.tune(u=episode.u[0], y=y, Ts=0.1)
        np.testing.assert_allclose(list(found.fit.parameters.values()), theta, rtol=0.1)


def test_reports_have_priors_in_their_units_and_by_name():
    heater = plants.fopdt(
        K={"beta": {"a": 2.0, "b": 3.0, "loc": 0.5, "scale": 2.0}},
        T={"log": [5.0, 50.0]},
        L=4.0,
        experiment={"signals": ["heater [%]", "temperature [degC]"]},
    )
    assert prior_of(heater, "K") == "0.5 to 2.5 degC/%, beta a 2, b 3, loc 0.5, scale 2"
    assert prior_of(heater, "T") == "5 to 50 s, uniform in its logarithm"
    assert prior_of(heater, "L") == "known, 4 s"
    tank = plants.integrator(experiment={"signals": ["pump [%]", "level [mm]"]})
    assert tank.label("K") == "K [mm/(% s)]" and plants.fopdt().label("K") == "K"
    joint = plant(together=lambda unit: np.array([1.0, 0.5]) + unit)
    assert prior_of(joint, "T") == "0.5 to 2, drawn with the others"
