"""What a plant may have besides: measured parameters, inputs of its own, starts in mid-drive."""

import gymnasium
import numpy as np
import pytest
from first_order import SIGMA, TAU, TS, U, by_one, described, design, slopes

import yawrate_env  # noqa: F401, registers
from tuners import plants
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.trust.black_box import suited_to_any_input
from tuners.trust.bound import cramer_rao
from tuners.trust.identification import identify
from tuners.tuner.plant_evaluation import GRAY_BOX, TUNER, compare
from tuners.tuner.stages import Recipe
from yawrate_env.plant import episodes as data
from yawrate_env.plant.episodes import recorded
from yawrate_env.signals.excitation import RANDOM_ORDER, prbs

LONG = prbs(3000, TS, 0.5, 1.0)[0]
QUICK = Recipe(Laguerre(8, 2.0), FeedForwardSettings(neurons=6, epochs=60), noise_draws=2)


def simulate(theta, u, rng):
    """K/(T s + 1) with an input (N,) for all, or (B, N)."""
    (K, T), rows = theta.T, np.broadcast_to(u, (len(theta), u.shape[-1]))
    a, y = np.exp(-TS / T), np.zeros(rows.shape)
    for k in range(rows.shape[1] - 1):
        y[:, k + 1] = a * y[:, k] + K * (1 - a) * rows[:, k]
    return y


def registers(words):
    """A random register for each word."""
    return prbs(500, TS, 0.5, 1.0, order=RANDOM_ORDER, start=words)


def patient(**changes):
    """The same plant in an experiment of a minute."""
    crossover = 1 / (2 * np.pi * TAU)
    return described(simulate=simulate, u=LONG, crossover=crossover, **changes)


@pytest.fixture(scope="module")
def warm():
    """A tuner for a plant whose lag is measured."""
    return plants.train(described(measured={"T": 0.05}), QUICK, count=300, calibration=256)


@pytest.fixture(scope="module")
def various():
    """A tuner for a plant that is asked something else every time."""
    plant = described(simulate=simulate, excite=registers)
    learner = FeedForwardSettings(neurons=12, epochs=300, max_fail=20)
    recipe = Recipe(suited_to_any_input(plant, 24), learner, noise_draws=6)
    return plants.train(plant, recipe, count=800, calibration=256)


@pytest.fixture(scope="module")
def linear():
    """A tuner that may meet its plant in mid-drive."""
    return plants.train(patient(linear=True), QUICK, count=300, calibration=0)


def test_what_is_measured_is_not_searched_for(warm):
    plant = warm.plant
    block = recorded(plant, "test", 0, 40)
    start = block.theta.copy()
    start[:, 0] = 1.0
    found = identify(plant, block.u, block.y, start)
    np.testing.assert_array_equal(found.theta[:, 1], block.theta[:, 1])
    by_K = [slopes(theta)[0] for theta in block.theta]
    least = SIGMA / np.sqrt([d @ d for d in by_K]) / block.theta[:, 0]
    np.testing.assert_allclose(cramer_rao(plant, block.theta)[:, 0], least, rtol=1e-4)
    assert np.abs((found.theta[:, 0] / block.theta[:, 0] - 1) / least).max() < 4


def test_what_is_measured_makes_the_tuner_surer(warm):
    found = compare(warm, 256, 0)
    kp, Ti = np.sqrt((found.bound**2).mean(axis=0))
    assert Ti == 0.0 and kp < 0.6 * np.sqrt((cramer_rao(described(), THETA)[:, 0] ** 2).mean())
    assert found.rms(TUNER)[0] < 2 * kp and found.rms(GRAY_BOX)[0] < 1.2 * kp
    assert found.trusted.mean() > 0.95


THETA = recorded(described(), "test", 0, 256).theta


def test_what_is_measured_is_asked_for_and_looked_at(warm):
    block = recorded(warm.plant, "test", 0, 1)
    (K, T), y = block.theta[0], block.y[0]
    result = warm.tune(U, y, measured={"T": T})
    assert result.trusted and result.parameters == pytest.approx({"K": K, "T": T}, rel=0.05)
    assert result.gains["kp"] == pytest.approx(T / (K * TAU), rel=0.05)
    with pytest.raises(ValueError, match=r"T is needed: this tuner covers 0.2 to 1.*measured="):
        warm.tune(U, y)
    with pytest.raises(ValueError, match="measured parameter = 'K' is unknown. Choose one of T"):
        warm.tune(U, y, measured={"K": 1.0})
    beyond = warm.tune(U, y, measured={"T": 1.2})
    assert "T is not within what the tuner was made for: 0.2 to 1." in beyond.reasons


def test_the_environment_shows_what_is_measured(warm):
    env = gymnasium.make("yawrate/Plant-v0", plant=warm.plant)
    obs, _ = env.reset(seed=3, options={"T": 0.5})
    assert obs.shape == (3, 500) and (obs[2] == 0.5).all()
    _, reward, *_ = env.step(warm.predict(obs)[0])
    assert reward > -0.2
    batch = np.stack([obs, obs])
    np.testing.assert_allclose(warm.predict(batch)[0][1], warm.predict(obs)[0], rtol=1e-12)
    with pytest.raises(ValueError, match=r"wanted \(3, 500\)"):
        warm.predict(obs[:2])


def test_inputs_of_their_own_are_the_episodes_own(various):
    plant = various.plant
    whole, again = (recorded(plant, "test", 1, count) for count in (150, 7))
    assert len(np.unique(whole.u, axis=0)) > 140  # a few registers start alike
    np.testing.assert_array_equal(whole.u[:7], again.u)
    np.testing.assert_array_equal(whole.y[:7], again.y)
    noise = whole.y - simulate(whole.theta, whole.u, None)
    assert noise.std() == pytest.approx(SIGMA, rel=0.02)
    single = described(
        simulate=by_one(simulate), design=by_one(design), excite=registers, batched=False
    )
    np.testing.assert_array_equal(recorded(single, "test", 1, 7).y, again.y)


def test_any_input_is_answered(various):
    found = compare(various, 256, 0)
    bound = np.sqrt((found.bound**2).mean(axis=0))
    assert (found.rms(TUNER) < 1.25 * bound).all() and (found.rms(GRAY_BOX) < 1.2 * bound).all()
    assert found.trusted.mean() > 0.95
    block = recorded(various.plant, "test", 0, 1)
    result = various.tune(block.u[0], block.y[0])
    assert result.trusted and result.notes == ()


@pytest.mark.parametrize(
    ("samples", "amplitude", "sigma", "most"),
    [(1000, 1.0, SIGMA, 2), (2500, 1.0, SIGMA, 2), (500, 3.0, SIGMA, 1), (500, 1.0, SIGMA / 10, 1)],
    ids=["longer", "much longer", "stronger", "quieter"],
)
def test_a_recording_that_says_more_is_answered_nearly_as_well(
    various, samples, amplitude, sigma, most
):
    plant, words = various.plant, np.arange(1, 65, dtype=np.uint64)
    theta, rng = data.sample(plant, 64), np.random.default_rng(0)
    right = plant.oracle(theta)

    def error(N, a, s):
        u = a * prbs(N, TS, 0.5, 1.0, order=RANDOM_ORDER, start=words)
        y = simulate(theta, u, None) + s * rng.standard_normal(u.shape)
        return np.median(np.abs(various.gains(u, y) / right - 1), axis=0)

    usual = error(500, 1.0, SIGMA)
    assert (error(samples, amplitude, sigma) < most * usual).all()


def test_a_start_in_mid_drive_is_found_where_responses_add_up(linear):
    block = recorded(linear.plant, "test", 0, 32)
    u, y, right = LONG[150:], block.y[:, 150:] + 0.3, linear.plant.oracle(block.theta)
    gains, found = linear.assess(u, y)
    assert found.model.unknown.all() and found.trusted.mean() > 0.9
    assert np.abs(gains / right - 1).max() < 0.15
    np.testing.assert_allclose(found.model.offset, 0.3, atol=0.02)
    blind = plants.PlantTuner(patient(), linear.stages, linear.black_box, {})
    assert not blind.assess(u, y)[1].trusted.any()
    assert blind.assess(u, y, start="unknown")[1].trusted.mean() > 0.9
    at_rest, found = linear.assess(LONG, block.y)
    assert not found.model.unknown.any() and found.trusted.all()


def test_a_disturbance_around_the_crossover_is_noticed(linear):
    block, t = recorded(linear.plant, "test", 0, 8), TS * np.arange(3000)
    assert {"colour", "response"} <= set(linear.assess(LONG, block.y)[1].findings)
    disturbed = block.y + 0.2 * np.sin(2 * np.pi * linear.plant.crossover * t)
    found = linear.assess(LONG, disturbed)[1]
    colour = found.findings["colour"]
    assert (colour.values > colour.limit).all() and not found.trusted.any()


def test_a_parameter_that_is_a_point_is_known():
    plant = described(prior={"K": (0.5, 2.0), "T": (0.4, 0.4)})
    tuner = plants.train(plant, QUICK, count=100, calibration=0)
    block = recorded(plant, "test", 0, 1)
    result = tuner.tune(U, block.y[0])
    assert result.parameters["T"] == 0.4 and result.trusted
    nothing = described(prior={"K": (1.0, 1.0), "T": (0.4, 0.4)})
    found = plants.PlantTuner(nothing, tuner.stages, tuner.black_box, {}).tune(U, block.y[0] * 0)
    assert found.parameters == {"K": 1.0, "T": 0.4} and not found.trusted


def test_where_no_gains_suit_everyone_there_is_no_fallback(linear):
    def judge(theta, gains):
        off = gains[:, :1] / design(theta)[:, :1] - 1
        return np.where(np.abs(off) < 0.2, off, np.nan)

    stubborn = described(evaluate=judge, metrics={"gain": 1.0})
    tuner = plants.PlantTuner(stubborn, linear.stages, linear.black_box, {})
    assert np.isnan(tuner.fallback).all()


def test_what_may_be_trusted_is_the_plants_to_say(linear):
    strict = described(
        evaluate=lambda theta, gains: gains[:, :1] / design(theta)[:, :1],
        metrics={"gain [1]": plants.Metric(0.3, error=1e-9)},
        target=(1.0,),
    )
    block = recorded(strict, "test", 0, 4)
    found = plants.PlantTuner(strict, linear.stages, linear.black_box, {}).assess(U, block.y)[1]
    assert found.findings["gain_error"].limit == 1e-9 and not found.trusted.any()
    assert found.findings["gain_spread"].limit == pytest.approx(0.03)
    with pytest.raises(ValueError, match="scale = 0"):
        plants.Metric(0.0)
