"""Predicted metrics, intervals, fallback and the checks that decide on trust."""

from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, LINEAR, SHORT, SLOW, VEHICLE, one, reference, trained
from families import tested as recordings
from first_order import described, design

from studies import faults
from tuners.trust.basis import functions_for
from tuners.trust.black_box import black_box
from tuners.trust.fallback import fallback
from tuners.trust.fit import fit, noise_level
from tuners.trust.intervals import GAUSSIAN, conformal
from tuners.trust.limits import MESSAGES
from tuners.tuner.recording import Recording
from tuners.tuner.rivals import GrayBox, Nominal, Oracle
from tuners.tuner.training import calibrate
from tuners.tuner.tuner import Tuner
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded, sample
from yawrate_env.plant.metric import Metric
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate


@pytest.mark.parametrize("start", ["rest", "unknown"])
@pytest.mark.parametrize("family", LINEAR)
def test_the_fitted_plant_is_as_far_off_as_its_covariance_says(family, start):
    plant, episodes = FAMILIES[family], recordings(family, 40 if family in SLOW else 64)
    model = black_box(plant, trained(family).inspection.black_box, episodes.u, episodes.y, start)
    found = fit(plant, model, episodes.y, episodes.parameters(plant))
    np.testing.assert_array_equal(found.theta[:, plant.known], episodes.known[:, plant.known])
    low, high = plant.limits
    inside = found.converged & ((found.theta > low) & (found.theta < high))[:, plant.unknown].all(1)
    assert inside.mean() > 0.9
    error = (found.theta - episodes.known)[:, plant.unknown] / plant.width
    distance = np.einsum("bi,bij,bj->b", error, np.linalg.inv(found.covariance), error)
    # Chi-square of q degrees: mean q, standard deviation of the mean sqrt(2 q / B).
    q = len(plant.unknown)
    # Ten seconds hold few of the lag's time constants: beside start and offset it is less than
    # linear in the parameters.
    more = 1.7 if "lag" in family and start == "unknown" else 1.0
    assert distance[inside].mean() < more * (q + 4 * np.sqrt(2 * q / len(episodes)))
    assert distance[inside].mean() > q - 4 * np.sqrt(2 * q / len(episodes))


def test_noise_that_counts_is_noise_around_the_crossover():
    rng = np.random.default_rng(0)
    white = rng.standard_normal((20, 10_000))
    np.testing.assert_allclose(noise_level(white, 0.001, 1.5), (white**2).mean(axis=1))
    held = np.repeat(white[:, :1000], 10, axis=1)  # as if interpolated: ten times the power there
    assert 6 < (noise_level(held, 0.001, 1.5) / (held**2).mean(axis=1)).mean() < 14


OF_RESPONSES = {"bend", "halves", "lingering", "limited", "vague", "disturbed"}
ALONE = {"parts", "sticking", "louder", "pattern"}
OF_LOOPS = {"feedback", "reference"}


def test_what_is_predicted_is_what_happens(tuner, plant, episodes):
    gains, found = tuner.assess(episodes)
    actual = plant.metric_values(episodes.known, gains.values)
    assert (np.abs(found.metrics - actual) < 4.5 * found.spread + 1e-9).all()
    assert found.trusted.mean() > 0.9
    judges = plant.loop_target is not None  # the recording's own response, or the fitted plant
    others = ALONE if judges else OF_RESPONSES
    if not plant.linear or plant.in_loop:
        others = others | {"sticking"}
    assert set(MESSAGES) - {"response", "colour"} - OF_LOOPS - others <= set(found.findings)
    assert not others & set(found.findings)
    assert ("response" in found.findings) == (plant.linear and not judges)
    for name, text in plant.messages.items():
        assert name not in found.findings or found.findings[name].message == text


RNG = np.random.default_rng(0)
NOISE = RNG.standard_normal(3000)
FOREIGN = {
    "reversed": lambda u, y: (u, -y),
    "in other units": lambda u, y: (u, np.degrees(y)),
    "input in other units": lambda u, y: (np.degrees(u), y),
    "late": lambda u, y: (u, np.roll(y, len(y) // 16)),
    "backwards": lambda u, y: (u[::-1], y[::-1]),
    "swapped": lambda u, y: (y, u),
    "noise alone": lambda u, y: (u, y.std() * NOISE[: len(y)]),
    "hidden in noise": lambda u, y: (u, y + 3 * y.std() * NOISE[: len(y)]),
    "dead": lambda u, y: (u, 0 * y),
    "stuck": lambda u, y: (u, np.where(np.arange(len(y)) < len(y) // 3, y, y[len(y) // 3])),
    "clipped": lambda u, y: (u, np.clip(y, -0.4 * np.abs(y).max(), 0.4 * np.abs(y).max())),
    "offset jumps": lambda u, y: (u, y + y.std() * (np.arange(len(y)) > len(y) // 2)),
    "weak input": lambda u, y: (u / 100, y / 100 + 0.05 * y.std() * NOISE[: len(y)]),
}


def test_foreign_recordings_are_not_trusted(tuner, plant, episodes):
    given = one(plant, episodes, 0)
    pairs = [change(given["u"], given["y"]) for change in FOREIGN.values()]
    u, y = (np.array([*signals, last]) for signals, last in zip(
        zip(*pairs, strict=True), (given["u"], given["y"]), strict=True))  # fmt: skip
    known = np.repeat(episodes.known[:1], len(y), axis=0)
    gains, found = tuner.assess(Recording(u, y, plant.Ts, known))
    error = np.abs(plant.errors(known, gains.values)) / plant.metric_setting("error")
    harmless = (found.verdicts == 1) & (error <= 1).all(axis=1)  # with care, and right
    names = np.array([*FOREIGN, "good"])
    harmless |= (found.verdicts == 1) & (names == "late") & (plant.loop_target is not None)  # asked
    trusted = found.trusted & ~harmless
    assert dict(zip([*FOREIGN, "good"], trusted.tolist(), strict=True)) == {
        **dict.fromkeys(FOREIGN, False), "good": True,
    }  # fmt: skip


@pytest.mark.parametrize("kind", faults.KINDS)
def test_gains_that_miss_are_not_usable_without_care(kind):
    made = faults.KINDS[kind](VEHICLE, np.random.default_rng(0), 8)
    gains, found = trained("vehicle").assess(made.recording)
    margins, stable = made.reached(VEHICLE, gains.values)
    hit = stable & (np.abs(margins - [60, 1.5]) <= [3, 0.15]).all(axis=1)
    assert (hit | (found.verdicts > 0)).all()
    assert made.real or not found.trusted.any()


@pytest.mark.parametrize("family", ["lag", "vehicle", "motor"])
def test_a_disturbance_around_the_crossover_is_noticed(family):
    plant, episodes = FAMILIES[family], recordings(family).part(slice(0, 8))
    times = plant.Ts * np.arange(len(plant.u))
    hum = np.sin(2 * np.pi * plant.crossover * times)
    disturbed = episodes.y + 0.3 * episodes.y.std(axis=1, keepdims=True) * hum
    found = trained(family).assess(replace(episodes, y=disturbed))[1]
    assert (found.verdicts > 0).all()
    assert (found.findings["colour"].values > found.findings["colour"].limit).any()


@pytest.mark.parametrize("family", ["lag", "vehicle"])
def test_the_fixed_controller_is_not_trusted_where_it_misses(family):
    plant, episodes = FAMILIES[family], recordings(family)
    gains, found = reference(family, Nominal).assess(episodes)
    off = np.abs(plant.errors(episodes.known, gains.values) / plant.metric_setting("error"))
    far, farther = (off > 1.5).any(axis=1), (off > 2.5).any(axis=1)
    assert far.any() and (found.verdicts[far] > 0).all() and not found.trusted[farther].any()


def test_the_twin_that_the_tuner_was_made_for_is_asked():
    plant, episodes = FAMILIES["nonlinear vehicle"], recordings("nonlinear vehicle")
    task = Task(experiment=replace(SHORT, N=300, amplitude=float(np.radians(4.0))))
    assert plant.linear_model.linear and not plant.linear
    right, found = Tuner(plant, Oracle()).assess(episodes)
    np.testing.assert_allclose(found.fit.theta[:, 0], episodes.known[:, 0], rtol=0.1)
    assert found.trusted.mean() > 0.9 and (right.status == 0).all()
    for method in (GrayBox(), Oracle()):  # of the linear vehicle
        assert not Tuner(yaw_rate(task), method).assess(episodes)[1].trusted.any()


def test_conformal_factors_hold_for_any_error():
    rng = np.random.default_rng(1)
    spread = rng.uniform(1, 3, (4000, 2))
    actual = spread * rng.standard_t(3, (4000, 2))
    factors = conformal(np.zeros((2000, 2)), spread[:2000], actual[:2000])
    inside = np.abs(actual[2000:]) <= spread[2000:] * factors
    # Standard error of the share: 0.7 % from each half.
    np.testing.assert_allclose(inside.mean(axis=0), 0.9, atol=0.03)
    assert np.isinf(conformal(np.zeros((5, 2)), spread[:5], actual[:5])).all()


def test_calibration_of_the_gray_box_is_nearly_that_of_a_normal_error():
    tuner = Tuner(FAMILIES["vehicle"], GrayBox())
    assert tuner.calibration == (GAUSSIAN, GAUSSIAN)
    calibrate(tuner, 300)
    np.testing.assert_allclose(tuner.calibration, GAUSSIAN, rtol=0.2)
    assert tuner.training["calibration"] == {"episodes": 300, "seed": 0}


def test_too_few_and_unstable_episodes_calibrate_nothing():
    with pytest.raises(ValueError, match="calibration"):
        calibrate(Tuner(FAMILIES["vehicle"], GrayBox()), 20)
    brittle = described(
        evaluate=lambda theta, gains: np.where(theta[:, :1] > 1.0, np.nan, gains[:, :1]),
        metrics={"gain": 1.0},
        prior={"K": (0.5, 1.4), "T": (0.2, 1.0)},
    )
    with pytest.raises(ValueError, match="unstable or have no gains"):
        calibrate(Tuner(brittle, Nominal()), 60)


DELAYED = Task(target=Target(phase_margin=45.0, crossover=1.0, delay_samples=1))


@pytest.mark.parametrize("name", [*FAMILIES, "delayed"])
def test_the_fallback_is_stable_for_the_whole_prior(name):
    plant = FAMILIES.get(name) or yaw_rate(DELAYED)
    gains = fallback(plant)
    low, high = plant.ranges
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 9).T), axis=-1).reshape(-1, len(low))
    theta = np.concatenate([grid, sample(plant, 200)])
    values, stable = plant.evaluation(theta, np.tile(gains, (len(theta), 1)))
    assert stable.all() and np.isfinite(values[:, :2]).all()
    # It is right for some plant of the prior, and better for all than the prior's extremes.
    least = plant.reward(theta, np.tile(gains, (len(theta), 1))).min()
    extremes = plant.oracle(np.stack([low, high]))
    assert least > max(plant.reward(theta, np.tile(g, (len(theta), 1))).min() for g in extremes)


def test_where_no_gains_suit_everyone_there_is_no_fallback():
    def near(theta, gains):
        off = gains[:, :1] / design(theta)[:, :1] - 1
        return np.where(np.abs(off) < 0.2, off, np.nan)

    stubborn = described(evaluate=near, metrics={"gain": 1.0})
    assert np.isnan(fallback(stubborn)).all()
    block = recorded(stubborn, "test", 0, 1)
    result = Tuner(stubborn, GrayBox()).tune(block.u[0], block.y[0])
    assert np.isnan(list(result.fallback.values())).all()
    assert np.isfinite(list(result.gains.values())).all()


def test_how_large_errors_may_be_is_the_plants_to_say():
    strict = described(
        evaluate=lambda theta, gains: gains[:, :1] / design(theta)[:, :1],
        metrics={"gain [1]": Metric(0.3, error=1e-9)},
        target=(1.0,),
    )
    block = recorded(strict, "test", 0, 4)
    tuner = Tuner(strict, trained("lag").method)
    found = tuner.assess(Recording(block.u, block.y, strict.Ts))[1]
    assert found.findings["gain_error"].limit == 1e-9 and not found.trusted.any()
    assert found.findings["gain_spread"].limit == pytest.approx(0.03)


def test_a_parameter_that_is_a_point_is_known():
    method = trained("lag").method
    plant = described(prior={"K": (0.5, 2.0), "T": (0.4, 0.4)})
    block = recorded(plant, "test", 0, 1)
    result = Tuner(plant, method).tune(plant.u, block.y[0])
    assert result.fit.parameters["T"] == 0.4 and set(result.fit.deviations) == {"K"}
    nothing = described(prior={"K": (1.0, 1.0), "T": (0.4, 0.4)})
    found = Tuner(nothing, method).tune(plant.u, block.y[0] * 0)
    assert found.fit.parameters == {"K": 1.0, "T": 0.4} and not found.trusted


def test_as_many_functions_as_noise_asks_for():
    for plant in (p for p in FAMILIES.values() if p.linear and p.black_box is None):
        y = plant.respond(sample(plant, 64))
        rest, moving = (
            black_box(plant, functions_for(plant), plant.u[None], y, start).residual
            for start in ("rest", "unknown")
        )
        assert (rest - moving <= 4.0 * plant.sigma(y) ** 2).all()
