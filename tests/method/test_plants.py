"""Tuners for any plant, on one whose parameters, bound and gains are known in closed form."""

import numpy as np
import pytest
from first_order import SIGMA, TAU, U, described, design, plant, simulate, slopes

import tuners
from tuners import Recipe, Recording, Tuner
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.trust.black_box import black_box, functions_for, suited
from tuners.trust.bound import cramer_rao, parameter_covariance
from tuners.trust.fit import fit
from tuners.trust.identification import identify
from tuners.tuner import tuner_file
from tuners.tuner.evaluation import GRAY_BOX, NOMINAL, ORACLE, TUNER, compare
from tuners.tuner.tuner_file import TunerFileError
from yawrate_env.plant.episodes import recorded, sample
from yawrate_env.plant.parametrisation import Parametrisation

FEW = Recipe(
    Laguerre(8, 2.0), FeedForwardSettings(neurons=8, epochs=200, max_fail=20), noise_draws=4
)


@pytest.fixture(scope="module")
def tuner():
    return tuners.train(FEW, plant, episodes=500, calibration=512)


def values(tuner, y):
    """Gains (B, k) of outputs (B, N)."""
    return tuner.gains(Recording(U[None], y, plant.Ts)).values


@pytest.fixture(scope="module")
def tested():
    return recorded(plant, "test", 0, 256)


def bound_by_hand(theta):
    """Least standard deviations of the relative errors of T/(K TAU) and T."""
    d = slopes(theta)
    K, T = theta
    J = np.array([[-1 / K, 1 / T], [0.0, 1 / T]])
    return np.sqrt(np.diag(J @ np.linalg.inv(d @ d.T / SIGMA**2) @ J.T))


def test_the_gray_box_finds_the_parameters_of_clean_outputs():
    theta = sample(plant, 40)
    found = identify(plant, U, simulate(theta, U, None))
    assert found.converged.all()
    np.testing.assert_allclose(found.theta, theta, rtol=1e-6)


def test_the_bound_is_that_of_the_closed_form():
    theta = sample(plant, 5)
    expected = [bound_by_hand(row) for row in theta]
    np.testing.assert_allclose(cramer_rao(plant, theta), expected, rtol=1e-4)
    width = np.array([1.5, 0.8])
    fisher = [np.linalg.inv(slopes(row) @ slopes(row).T) * SIGMA**2 for row in theta]
    by_width = parameter_covariance(plant, theta) * np.outer(width, width)
    np.testing.assert_allclose(by_width, fisher, rtol=1e-4)


def test_the_gray_box_scatters_as_the_bound_says_and_as_it_says_itself(tested):
    model = black_box(plant, functions_for(plant), tested.u, tested.y, "rest")
    found = fit(plant, model, tested.y, np.repeat(plant.middle, 256, axis=0))
    inside = (np.abs(found.theta - np.mean(plant.ranges, axis=0)) < [0.7, 0.36]).all(axis=1)
    error = (found.theta - tested.theta)[inside] / plant.width
    own = np.einsum("bi,bij,bj->b", error, np.linalg.inv(found.covariance[inside]), error)
    # Chi squared with 2 degrees: mean 2, standard error 2/sqrt(256).
    assert own.mean() == pytest.approx(2.0, abs=0.4)


def test_the_two_stage_tuner_is_near_the_bound_and_beats_not_looking(tuner):
    found = compare(tuner, 256, 0)
    bound = np.sqrt((found.bound**2).mean(axis=0))
    assert (found.rms(TUNER) < 1.6 * bound).all()
    # The root mean square of 256 errors has a standard error of 4.4 %.
    np.testing.assert_allclose(found.rms(GRAY_BOX), bound, rtol=0.18)
    assert (found.rms(NOMINAL) > 20 * bound).all()
    assert (found.rms(ORACLE) == 0).all() and found.unstable(TUNER) == 0


def test_intervals_hold_as_often_as_they_say(tuner):
    # 256 test episodes at 90 %: standard error 1.9 %; 512 calibrate: 1.3 %.
    assert compare(tuner, 256, 0).covered.mean(axis=0) == pytest.approx([0.9, 0.9], abs=0.07)


@pytest.mark.parametrize(
    "recipe",
    [
        Recipe(FrequencyResponse(8, 2.0, 0.05, 2.0), FeedForwardSettings(neurons=4, epochs=20)),
        Recipe(Laguerre(6, 2.0), GBMSettings(n_estimators=80)),
    ],
)
def test_the_other_stages_compose(recipe, tested):
    tuner = tuners.train(recipe, plant, episodes=150)
    error = plant.metric_values(tested.theta, values(tuner, tested.y))
    nominal = plant.metric_values(tested.theta, np.repeat(plant.oracle(plant.middle), 256, axis=0))
    assert np.sqrt((error**2).mean()) < 0.25 * np.sqrt((nominal**2).mean())


def test_the_pole_suits_the_plants():
    assert 0.7 < suited(plant, 4).pole < 6.0  # rad/s; the plants' are 1 to 5


def test_gains_of_any_sign_have_their_own_coordinates():
    def negative(theta):
        return -design(theta)

    own = described(design=negative, parametrisation=Parametrisation(lambda g: g, lambda x: x))
    tuner = tuners.train(FEW, own, episodes=100)
    test = recorded(own, "test", 0, 64)
    assert np.abs(own.metric_values(test.theta, values(tuner, test.y))).mean() < 0.1


def test_good_recordings_are_trusted(tuner, tested):
    gains, found = tuner.assess(Recording(U[None], tested.y, plant.Ts))
    np.testing.assert_array_equal(gains.values, values(tuner, tested.y))
    assert found.trusted.mean() > 0.95


@pytest.mark.parametrize(
    "spoilt, check",
    [
        (lambda y: -y, "misfit"),
        (lambda y: 4 * y, "outside"),
        (lambda y: np.roll(y, 30), "misfit"),
        (lambda y: y + np.random.default_rng(0).normal(size=len(y)), "noise"),
        (lambda y: 0 * y, "noise"),
    ],
)
def test_foreign_recordings_are_not(tuner, tested, spoilt, check):
    result = tuner.tune(U, spoilt(tested.y[0]), plant.Ts)
    assert not result.trusted and result.reasons
    assert check in {each.name for each in result.checks if not each.passed}
    assert result.fallback["kp"] > 0


def test_a_result_says_what_was_found(tuner, tested):
    result = tuner.tune(U, tested.y[0])
    K, T = tested.theta[0]
    assert result.gains["kp"] == pytest.approx(T / (K * TAU), rel=0.05)
    assert result.fit.parameters == pytest.approx({"K": K, "T": T}, rel=0.05)
    assert result.kp == result.gains["kp"]
    interval = result.intervals["relative_error_of_kp"]
    assert interval.low < interval.value < interval.high
    assert result.notes == () and result.trusted
    assert tuner.tune(U[:400], tested.y[0, :400]).notes != ()
    with pytest.raises(ValueError, match=r"Ts = 0.3 must be .* at most 0.2. .*record faster"):
        tuner.tune(U, tested.y[0], 0.3)
    with pytest.raises(ValueError, match="number of samples .* at most 200000"):
        tuner.tune(np.ones(30_000), np.ones(30_000), 0.2)


@pytest.mark.parametrize("Ts", [0.005, 0.04])
def test_another_sampling_time_gives_the_same(tuner, Ts):
    """Of ten seconds: of slower samples fewer, so that the intervals are wider."""
    theta, rng = np.array([[1.2, 0.5]]), np.random.default_rng(4)
    parts = round(max(Ts, plant.Ts) / plant.Ts)
    u = np.repeat(np.sin(np.cumsum(np.linspace(0.05, 0.4, 500 // parts))), parts)
    y = plant.respond(theta, u)[0] + SIGMA * rng.normal(size=500)
    if parts > 1:
        logged = u[::parts], y[::parts]
    else:
        logged = np.repeat(u, 4), np.interp(np.arange(2000) / 4, np.arange(500), y)
    whole, part = tuner.tune(u, y), tuner.tune(*logged, Ts)
    assert whole.trusted and part.trusted, part.reasons
    assert f"Ts is {Ts:g} s" in part.notes[0] and "resampled" in part.notes[0]
    for name, right in zip(plant.gains, plant.oracle(theta)[0], strict=True):
        one, other = (r.intervals[f"relative_error_of_{name}"] for r in (whole, part))
        assert other.low < one.value < other.high
        wider = (other.high - other.low) / (one.high - one.low)
        assert wider == pytest.approx(np.sqrt(parts), rel=0.25)
        assert other.low < part.gains[name] / right - 1 < other.high


def test_a_saved_tuner_answers_the_same(tuner, tested, tmp_path):
    path = tmp_path / "first.tuner"
    tuner.save(path)
    again = tuners.load(path)
    y = tested.y[:8]
    np.testing.assert_array_equal(values(again, y), values(tuner, y))
    assert again.calibration == tuner.calibration and again.training == tuner.training
    assert again.plant.entry == "first_order:plant"


@pytest.mark.parametrize(
    "change, words",
    [
        ({"design": lambda t: 1.01 * design(t)}, "its design changed"),
        ({"simulate": lambda t, u, rng: 1.01 * simulate(t, u, rng)}, "its simulate changed"),
        ({"prior": {"K": (0.5, 2.1), "T": (0.2, 1.0)}}, "its prior changed"),
        ({"noise": 0.1}, "its noise changed"),
    ],
)
def test_a_plant_that_changed_since_is_noticed(tuner, tmp_path, change, words):
    path = tmp_path / "first.tuner"
    tuner.save(path)
    with pytest.raises(TunerFileError, match=words):
        tuners.load(path, described(**change))


def test_a_plant_without_an_entry_cannot_be_saved_nor_one_that_is_gone_loaded(tuner, tmp_path):
    path = tmp_path / "first.tuner"
    with pytest.raises(ValueError, match='entry="module:attribute"'):
        Tuner(described(entry=""), tuner.method).save(path)
    assert not path.exists()
    Tuner(described(entry="gone:plant"), tuner.method).save(path)
    with pytest.raises(TunerFileError, match="there is no module 'gone'"):
        tuners.load(path)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"features": None}, "Train it again"),
        ({"features": {"name": "laguerre", "order": 0, "pole": 2.0}}, "order = 0"),
        ({"calibration": [1.0]}, "calibration"),
        ({"calibration": [-1.0, 1.0]}, "calibration"),
        ({"calibration": ["a", "b"]}, "calibration"),
        ({"training": "yes"}, "training"),
        ({"plant": 5}, "Train it again"),
    ],
)
def test_settings_that_cannot_be_used_are_refused(tuner, tmp_path, change, words):
    path = tmp_path / "first.tuner"
    tuner.save(path)
    settings, arrays = tuner_file.read(path)
    tuner_file.write(path, settings | change, arrays)
    with pytest.raises(TunerFileError, match=f"first.tuner .*{words}"):
        tuners.load(path)


@pytest.mark.parametrize("lost", ["features", "learner", "method", "plant", "calibration", "W1"])
def test_files_that_are_incomplete_are_refused(tuner, tmp_path, lost):
    path = tmp_path / "first.tuner"
    tuner.save(path)
    parts = tuner_file.read(path)
    for part in parts:
        part.pop(lost, None)
    tuner_file.write(path, *parts)
    with pytest.raises(TunerFileError, match=f"lacks or misnames '{lost}'"):
        tuners.load(path)


def test_the_tuner_is_a_policy_of_the_plants_environment(tuner, tested):
    obs = np.stack([np.broadcast_to(U, tested.y[:3].shape), tested.y[:3]], axis=1)
    actions, state = tuner.predict(obs, state="as given")
    np.testing.assert_allclose(actions, values(tuner, tested.y[:3]))
    assert state == "as given"
    np.testing.assert_allclose(tuner.predict(obs[0].astype(np.float32))[0], actions[0], rtol=1e-4)
    blind, _ = tuner.predict(np.zeros((2, len(U))))
    np.testing.assert_array_equal(blind, tuner.fallback)  # nothing moves
    with pytest.raises(ValueError, match="obs"):
        tuner.predict(obs[:, :, 1:])
