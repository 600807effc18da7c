"""What an experiment cannot tell, and errors too small to be true, by construction."""

import re

import numpy as np
import pytest
from command import FEW, TRUSTED, call
from first_order import SIGMA, described, plant, simulate
from first_order import design as pole_cancelling

import tuners
from tuners.cli.train import accuracy, leaks
from tuners.trust.bound import bounds, cramer_rao
from tuners.trust.distinction import distinction, information
from tuners.tuner.comparison import TUNER, compare
from tuners.tuner.training import assessed
from yawrate_env.plant.episodes import sample
from yawrate_env.vehicle.vehicle_file import example as paper


def product(theta):
    """Gain and time constant of plants with two gains in a row, and what else they have."""
    return np.stack([theta[:, 0] * theta[:, 1], theta[:, 2]], axis=1)


def in_a_row(**changes):
    """K1 K2 / (T s + 1): only the product shows."""
    settings = {
        "prior": {"K1": (0.9, 1.0), "K2": (0.5, 2.0), "T": (0.2, 1.0)},
        "simulate": lambda theta, u, rng: simulate(product(theta), u, rng),
        "design": lambda theta: pole_cancelling(product(theta)),
        "labels": {"K1": "amplifier gain", "K2": "valve gain [l/s/%]"},
        "entry": "",
    }
    return described(**(settings | changes))


def with_another(effect, **changes):
    """The lag with a third parameter c, which adds ``effect(theta)`` to its output."""

    def respond(theta, u, rng):
        return simulate(theta[:, :2], u, rng) + effect(theta)[:, None]

    return described(
        prior={"K": (0.5, 2.0), "T": (0.2, 1.0), "c": (0.0, 1.0)},
        simulate=respond,
        design=lambda theta: pole_cancelling(theta[:, :2]),
        labels={"c": "leak [l/s]"},
        **changes,
    )


def test_gains_in_a_row_cannot_be_told_apart_whatever_their_ranges():
    together = "amplifier gain and valve gain cannot be told apart by this experiment: only their"
    assert distinction(in_a_row()).sentences() == (f"{together} combination is found.",)
    wide = in_a_row(prior={"K1": (0.1, 9.0), "K2": (1.9, 2.0), "T": (0.2, 1.0)})
    assert distinction(wide).sentences() == (f"{together} combination is found.",)
    exact = in_a_row(noise=0.0)
    assert distinction(exact).sentences() == (f"{together} combination is found.",)


def test_a_parameter_that_never_matters_does_not_show():
    (said,) = distinction(with_another(lambda theta: 0 * theta[:, 2])).sentences()
    assert said.startswith("leak does not show in this experiment")
    small = 0.5 * SIGMA * np.sqrt(12 / 500)  # half of what the prior's own width is worth
    (said,) = distinction(with_another(lambda theta: small * theta[:, 2])).sentences()
    assert said.startswith("leak does not show")
    assert not distinction(with_another(lambda theta: 4 * small * theta[:, 2])).sentences()


def test_a_parameter_may_show_in_some_plants_only():
    some = with_another(lambda theta: theta[:, 2] * (theta[:, 1] > 0.6))
    found = distinction(some)
    (said,) = found.sentences()
    share = (sample(some, 64)[:, 1] > 0.6).mean()
    assert said == f"leak shows in some plants only: in {share:.0%} of the prior's."


def test_what_can_be_found_is_not_spoken_of():
    assert distinction(plant).sentences() == ()
    lone = described(prior={"K": 1.0, "T": 0.5})
    assert distinction(lone).sentences() == () and distinction(lone).mixed.shape == (0, 0)


def test_the_information_is_that_of_the_bound():
    theta = sample(plant, 5)
    F = information(plant, theta)
    J = np.linalg.inv(F)
    assert np.allclose(np.sqrt(J[:, 1, 1]) * 0.8 / theta[:, 1], cramer_rao(plant, theta)[:, 1],
                       rtol=1e-3)  # fmt: skip


def test_the_prior_adds_its_own_information():
    """Much noise leaves the prior's deviation, width/sqrt(12); little noise the bound."""
    theta = sample(plant, 5)
    least, informed = bounds(described(noise=1e-4), theta)
    np.testing.assert_allclose(informed, least, rtol=1e-3)
    np.testing.assert_allclose(least, cramer_rao(described(noise=1e-4), theta))
    least, informed = bounds(described(noise=1e4), theta)
    np.testing.assert_allclose(informed[:, 1], 0.8 / np.sqrt(12) / theta[:, 1], rtol=1e-3)
    assert (least > 10 * informed).all()


def forgotten(theta, u, keys, out, written):
    """Recordings without the noise that the plant is said to have."""
    y = simulate(theta, u, None)
    if out is not None:
        out[...] = y
    return y


@pytest.mark.parametrize("noise, record, warned", [
    (0.2, forgotten, True), (0.2, None, False), (30.0, None, False),
])  # fmt: skip
def test_an_error_that_the_noise_does_not_allow_is_warned_of(noise, record, warned):
    noisy = described(noise=noise, record=record)
    tuner = tuners.train(FEW, noisy, episodes=300)
    found = compare(tuner, 128, 0)
    said = leaks(noisy, found)
    assert bool(said) == warned
    for line in said:
        assert re.match(
            r"Warning: relative error of \w+ [\d.e-]+ rms is far below the [\d.e-]", line
        )
    rms, bound = found.rms(TUNER), np.sqrt((found.bound**2).mean(axis=0))
    if noise > 1:  # the prior says more than the recording: below the bound, and right so
        assert rms[1] < 0.7 * bound[1]


def test_few_episodes_warn_of_nothing():
    noisy = described(noise=0.2, record=forgotten)
    assert not leaks(noisy, compare(tuners.train(FEW, noisy, episodes=300), 60, 0))


def test_the_shares_that_are_printed_are_those_of_the_verdicts(monkeypatch):
    monkeypatch.setattr("tuners.cli.train.VALIDATION", 128)
    noisy = described(noise=0.35, metrics={"kp": 0.4, "Ti": 0.4})
    tuner = tuners.train(FEW, noisy, episodes=300)
    verdicts = np.concatenate([found.verdicts for _, found, _ in assessed(tuner, "test", 128, 0)])
    usable, careful = (f"{(verdicts == value).mean():.0%}" for value in (0, 1))
    said = accuracy(tuner, 0)
    assert f"{usable} will be usable, {careful} usable with care" in said
    assert 0.05 < (verdicts == 2).mean() < 0.95 and "larger scales" in said


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr("tuners.cli.train.CALIBRATION", 64)
    monkeypatch.setattr("tuners.cli.train.VALIDATION", 60)


def test_the_command_says_it_before_it_trains(tmp_path, quick):
    text = paper().replace("N = 10_000", "N = 1_000").replace("Ts = 0.001", "Ts = 0.01")
    open_too = "C_f = [100e3, 150e3]\nC_r = [130e3, 200e3]"
    text = text.replace("# C_f = [100e3, 150e3]", open_too)
    (tmp_path / "car.toml").write_text(text)
    given = ("--vehicle", tmp_path / "car.toml", "-o", tmp_path / "car.tuner", "--episodes", 200)
    code, out, _ = call("train", *given)
    first, second = out.splitlines()[:2]
    together = (
        "friction, front stiffness and rear stiffness cannot be told apart by this experiment"
    )
    assert code == TRUSTED and first.startswith(together)
    assert re.search(r"phase margin [\d.e-]+ deg rms \(bound [\d.e-]+ with the prior\)", second)
    assert re.search(r"of these recordings \d+% will be usable, \d+% usable with care", second)


TWO_GAINS = """
from first_order import described, design, simulate


def product(t):
    return t[:, :2] * t[:, 2:] ** [1, 0]


plant = described(
    prior={"K": (0.5, 2.0), "T": (0.2, 1.0), "K2": (0.9, 1.1)},
    simulate=lambda t, u, rng: simulate(product(t), u, rng),
    design=lambda t: design(product(t)),
    entry="two_gains:plant",
)
"""


def test_where_only_the_simulator_judges_it_says_so_and_trains(tmp_path, quick):
    (tmp_path / "two_gains.py").write_text(TWO_GAINS)
    (tmp_path / "my.toml").write_text('[plant]\nentry = "two_gains:plant"\n')
    given = ("--vehicle", tmp_path / "my.toml", "-o", tmp_path / "my.tuner", "--episodes", 60)
    code, out, err = call("train", *given)
    assert code == 0 and out.startswith("K and K2 cannot be told apart by this experiment")
    assert "with the prior" in out and (tmp_path / "my.tuner").exists()
