"""Tuners for any plant, on one whose parameters, bound and gains are known in closed form."""

import sys

import numpy as np
import pytest
from first_order import SIGMA, TAU, U, by_one, described, design, plant, simulate, slopes

from tuners import plants
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.trust.black_box import black_box, functions_for, suited
from tuners.trust.bound import cramer_rao, parameter_covariance
from tuners.trust.fit import fit
from tuners.trust.identification import identify
from tuners.tuner import tuner_file as model_file
from tuners.tuner.plant_evaluation import GRAY_BOX, NOMINAL, ORACLE, TUNER, compare
from tuners.tuner.stages import Recipe
from tuners.tuner.tuner_file import ModelFileError
from yawrate_env.plant.entry import home
from yawrate_env.plant.episodes import episodes, recorded, sample

FEW = Recipe(
    Laguerre(8, 2.0), FeedForwardSettings(neurons=8, epochs=200, max_fail=20), noise_draws=4
)


@pytest.fixture(scope="module")
def tuner():
    return plants.train(plant, FEW, count=500, calibration=512)


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
    tuner = plants.train(plant, recipe, count=150, calibration=0)
    error = plant.metric_values(tested.theta, tuner.gains(U[None], tested.y))
    nominal = plant.metric_values(tested.theta, np.repeat(plant.oracle(plant.middle), 256, axis=0))
    assert np.sqrt((error**2).mean()) < 0.25 * np.sqrt((nominal**2).mean())


def test_the_pole_suits_the_plants():
    assert 0.7 < suited(plant, 4).pole < 6.0  # rad/s; the plants' are 1 to 5


def test_episodes_do_not_depend_on_how_they_are_asked_for():
    whole = recorded(plant, "test", 3, 140)
    parts = list(episodes(plant, "test", 3, 60, 80))
    assert [len(part) for part in parts] == [68, 12]
    for name in ("number", "theta", "y"):
        part = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(getattr(whole, name)[60:], part)
    again = recorded(plant, "test", 3, 140, repeat=1)
    np.testing.assert_array_equal(whole.theta, again.theta)
    noise, other = whole.y - plant.respond(whole.theta), again.y - plant.respond(again.theta)
    assert abs(np.corrcoef(noise.ravel(), other.ravel())[0, 1]) < 0.02
    assert noise.std() == pytest.approx(SIGMA, rel=0.02)
    (trained,) = episodes(plant, "train", 3, 0, 1)
    assert (trained.theta != whole.theta[0]).all()


def test_what_is_random_in_the_simulator_is_the_episodes_own():
    def wandering(theta, u, rng):
        y = simulate(theta, u, None)
        return y if rng is None else y + rng.standard_normal((len(theta), 1))

    own = described(simulate=wandering)
    whole = recorded(own, "test", 3, 70)
    part = next(episodes(own, "test", 3, 66, 4))
    np.testing.assert_array_equal(whole.y[66:], part.y)
    levels = (whole.y - simulate(whole.theta, U, None)).mean(axis=1)
    assert len(np.unique(levels.round(9))) == len(levels) and 0.7 < levels.std() < 1.3


def test_functions_of_one_plant_give_the_same():
    single = described(simulate=by_one(simulate), design=by_one(design), batched=False)
    (batch,), (one,) = (episodes(p, "test", 0, 0, 5) for p in (plant, single))
    np.testing.assert_array_equal(batch.y, one.y)
    np.testing.assert_array_equal(plant.oracle(batch.theta), single.oracle(batch.theta))


def test_noise_by_signal_to_noise_ratio():
    own = described(noise=plants.snr(20.0))
    clean = own.respond(sample(own, 3))
    np.testing.assert_allclose(own.sigma(clean) ** 2, (clean**2).mean(axis=1) / 100)


def judged_unstable(theta, gains):
    return np.full((len(theta), 1), np.nan)


def judged_undefined(theta, gains):
    return np.where(gains[:, :1] > 1.0, np.inf, gains[:, :1])


def test_rewards_grade_and_unstable_loops_earn_least():
    theta = sample(plant, 4)
    right = plant.oracle(theta)
    assert plant.reward(theta, right) == pytest.approx(np.zeros(4))
    # 30 % of one gain count as one, which earns -1/(1 + 1/4).
    assert plant.reward(theta, right * [1.3, 1.0]) == pytest.approx(-0.8 * np.ones(4))
    assert (plant.reward(theta, right * np.nan) == -5).all()
    own = described(evaluate=judged_undefined, metrics={"gain": 1.0}, design=lambda t: 0.5 + 0 * t)
    earned = own.reward(theta[:3], np.array([[2.0, 1.0], [0.5, 1.0], [np.nan, 1.0]]))
    np.testing.assert_array_equal(earned, [-4, 0, -5])


@pytest.mark.parametrize(
    "change, words",
    [
        ({"prior": {}}, "at least one parameter"),
        ({"prior": {"K": (2.0, 0.5), "T": (0.2, 1.0)}}, "low above high"),
        ({"measured": {"x": 0.1}}, "measured parameter = 'x' is unknown. Choose one of K, T"),
        ({"measured": {"K": -0.1}}, "measured K = -0.1"),
        ({"search_limits": {"x": (0, 1)}}, "search_limits' parameter = 'x' is unknown"),
        ({"crossover": 26.0}, "crossover = 26 .*half the sampling rate"),
        ({"target": (1.0,)}, r"target has shape \(1,\)"),
        ({"excite": lambda words: np.zeros((2, 5))}, "excite in the prior's middle has shape"),
        ({"u": [[1.0]]}, "u has shape"),
        ({"u": U * np.nan}, "every value must be finite"),
        ({"Ts": 0.0}, "Ts = 0"),
        ({"gains": "kp"}, "must be names"),
        ({"gains": ("kp",)}, r"design gave shape \(2, 2\), wanted \(2, 1\)"),
        ({"noise": -1.0}, "noise = -1"),
        ({"simulate": by_one(simulate)}, "batched=False"),
        ({"simulate": lambda t, u, rng: simulate(t, u, rng)[:, 1:]}, r"wanted \(2, 500\)"),
        (
            {"simulate": lambda t, u, rng: simulate(t, u, rng) * np.nan},
            "simulate in the prior's middle",
        ),
        ({"simulate": lambda t, u, rng: np.random.default_rng().normal(size=(2, 500))}, "random"),
        ({"design": lambda t: -design(t)}, "coordinates of your own"),
        ({"evaluate": judged_unstable}, "belong together"),
        ({"evaluate": judged_unstable, "metrics": {"x": 1.0}}, "evaluate in the prior's middle"),
        ({"evaluate": judged_unstable, "metrics": {"x": 0.0}}, "metric x = 0"),
    ],
)
def test_a_bad_description_is_refused_with_the_remedy(change, words):
    with pytest.raises(ValueError, match=words):
        described(**change)


def test_gains_of_any_sign_have_their_own_coordinates():
    def negative(theta):
        return -design(theta)

    own = described(design=negative, parametrisation=plants.Coordinates(lambda g: g, lambda x: x))
    tuner = plants.train(own, FEW, count=100, calibration=0)
    (block,) = episodes(own, "test", 0, 0, 64)
    found = tuner.gains(U[None], block.y)
    assert np.abs(own.metric_values(block.theta, found)).mean() < 0.1


def test_good_recordings_are_trusted(tuner, tested):
    gains, found = tuner.assess(U, tested.y)
    np.testing.assert_array_equal(gains, tuner.gains(U, tested.y))
    assert found.trusted.mean() > 0.95


@pytest.mark.parametrize(
    "spoilt, reason",
    [
        (lambda y: -y, "No plant that the simulator knows"),
        (lambda y: 4 * y, "outside the prior"),
        (lambda y: np.roll(y, 30), "No plant that the simulator knows"),
        (lambda y: y + np.random.default_rng(0).normal(size=len(y)), "hardly follows"),
        (lambda y: 0 * y, "hardly follows"),
    ],
)
def test_foreign_recordings_are_not(tuner, tested, spoilt, reason):
    result = tuner.tune(U, spoilt(tested.y[0]), plant.Ts)
    assert not result.trusted and any(reason in r for r in result.reasons)
    assert result.fallback["kp"] > 0


def test_a_result_says_what_was_found(tuner, tested):
    result = tuner.tune(U, tested.y[0])
    K, T = tested.theta[0]
    assert result.gains["kp"] == pytest.approx(T / (K * TAU), rel=0.05)
    assert result.parameters == pytest.approx({"K": K, "T": T}, rel=0.05)
    interval = result.metrics["relative error of kp"]
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
    assert part.notes[0] == f"Ts is {Ts:g} s: resampled to the plant's 0.02 s."
    for name, right in zip(plant.gains, plant.oracle(theta)[0], strict=True):
        one, other = (r.metrics[f"relative error of {name}"] for r in (whole, part))
        assert other.low < one.value < other.high
        wider = (other.high - other.low) / (one.high - one.low)
        assert wider == pytest.approx(np.sqrt(parts), rel=0.25)
        assert other.low < part.gains[name] / right - 1 < other.high


def test_a_saved_tuner_answers_the_same(tuner, tested, tmp_path):
    path = tmp_path / "first.tuner"
    tuner.save(path)
    again = plants.load(path)
    y = tested.y[:8]
    np.testing.assert_array_equal(again.gains(U[None], y), tuner.gains(U[None], y))
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
    with pytest.raises(ModelFileError, match=words):
        plants.load(path, described(**change))


def test_saving_and_loading_say_what_is_missing(tuner, tmp_path, monkeypatch):
    import tuners

    path = tmp_path / "first.tuner"
    nameless = plants.PlantTuner(described(entry=""), tuner.stages, tuner.black_box, {})
    with pytest.raises(ValueError, match='entry="module:attribute"'):
        nameless.save(path)
    assert not path.exists()
    tuner.save(path)
    with pytest.raises(ModelFileError, match="tuners.plants.load"):
        tuners.load(path)
    with pytest.raises(ModelFileError, match="no plant's tuner"):
        plants.load(tuners.catalogue.shipped("ts-ff"))
    gone = plants.PlantTuner(described(entry="gone:plant"), tuner.stages, tuner.black_box, {})
    gone.save(path)
    with pytest.raises(ModelFileError, match="there is no module 'gone'"):
        plants.load(path)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"compressor": None}, "lacks or misnames .* Train it again"),
        ({"compressor": {"name": "laguerre", "order": 5, "pole": 2.0}}, "cannot be used: "),
        ({"compressor": {"name": "laguerre", "order": 0, "pole": 2.0}}, "order = 0 must be"),
        ({"black_box": {"order": 8, "pole": -1.0}}, "pole = -1 must be"),
        ({"calibration": [1.0]}, "calibration has shape"),
        ({"calibration": [-1.0, 1.0]}, "calibration has -1"),
        ({"calibration": ["a", "b"]}, "calibration is not an array of numbers"),
        ({"training": "yes"}, "training = 'yes' is not of type dict"),
        ({"plant": 5}, "cannot be used: "),
    ],
)
def test_settings_that_cannot_be_used_are_refused(tuner, tmp_path, change, words):
    path = tmp_path / "first.tuner"
    tuner.save(path)
    settings, arrays = model_file.read(path)
    model_file.write(path, settings | change, arrays)
    with pytest.raises(ModelFileError, match=f"first.tuner .*{words}"):
        plants.load(path)


@pytest.mark.parametrize("lost", ["compressor", "learner", "entry", "plant", "calibration", "W1"])
def test_files_that_are_incomplete_are_refused(tuner, tmp_path, lost):
    path = tmp_path / "first.tuner"
    tuner.save(path)
    parts = model_file.read(path)
    for part in parts:
        part.pop(lost, None)
    model_file.write(path, *parts)
    with pytest.raises(ModelFileError, match=f"lacks or misnames '{lost}'.* Train it again"):
        plants.load(path)


@pytest.mark.parametrize(
    "entry, words",
    [
        ("first_order", "is no entry point"),
        ("first_order:a b", "is no entry point"),
        ("nowhere:plant", "no module 'nowhere'"),
        ("first_order:nothing", "no such attribute"),
        ("first_order:TS", "holds a float"),
    ],
)
def test_entry_points_that_lead_nowhere(entry, words):
    with pytest.raises(ValueError, match=words):
        plants.find(entry)


def test_a_plant_is_found_under_an_entry_that_it_does_not_name(monkeypatch):
    import first_order

    monkeypatch.setattr(first_order, "nameless", described(entry=""), raising=False)
    found = plants.find("first_order:nameless")
    assert found.entry == "first_order:nameless" and first_order.nameless.entry == ""
    assert found.prior == plant.prior and found.metrics == plant.metrics


SAME_NAME = """
import first_order
import shared_by_both
prior = {"K": shared_by_both.K, "T": (0.2, 1.0)}
plant = first_order.described(prior=prior, entry="clashing:plant")
"""


@pytest.fixture
def clashing(tmp_path):
    """Two folders with modules of the same names."""
    folders = [tmp_path / name for name in "ab"]
    for high, folder in enumerate(folders, start=2):
        folder.mkdir()
        (folder / "clashing.py").write_text(SAME_NAME)
        (folder / "shared_by_both.py").write_text(f"K = (0.5, {high})")
    yield folders
    for name in ("clashing", "shared_by_both"):
        sys.modules.pop(name, None)


def test_modules_of_one_name_are_each_folders_own(clashing, tmp_path):
    found = [plants.find("clashing:plant", folder) for folder in (*clashing, *clashing)]
    assert [p.prior["K"][1] for p in found] == [2, 3, 2, 3]
    assert [home(p) for p in found] == [*clashing, *clashing]
    assert sys.modules["clashing"].plant.prior["K"][1] == 2  # the first stays
    assert str(tmp_path) not in "".join(sys.path)


def test_tuners_of_modules_of_one_name_have_each_its_own(tuner, clashing, tmp_path):
    for folder in clashing:
        own = plants.find("clashing:plant", folder)
        plants.PlantTuner(own, tuner.stages, tuner.black_box, {}).save(folder / "my.tuner")
    found = [plants.load(folder / "my.tuner") for folder in reversed(clashing)]
    assert [t.plant.prior["K"][1] for t in found] == [3, 2]
    (clashing[1] / "my.tuner").rename(tmp_path / "moved.tuner")
    with pytest.raises(ModelFileError, match="another clashing:plant.*its prior changed"):
        plants.load(tmp_path / "moved.tuner")


def test_a_module_that_is_imported_already_is_used_where_the_folder_has_none(tmp_path):
    assert plants.find("first_order:plant", tmp_path) is plant


def test_the_tuner_is_a_policy_of_the_plants_environment(tuner, tested):
    obs = np.stack([np.broadcast_to(U, tested.y[:3].shape), tested.y[:3]], axis=1)
    actions, state = tuner.predict(obs, state="as given")
    np.testing.assert_allclose(actions, tuner.gains(U[None], tested.y[:3]))
    assert state == "as given"
    np.testing.assert_allclose(tuner.predict(obs[0].astype(np.float32))[0], actions[0], rtol=1e-4)
    blind, _ = tuner.predict(np.zeros((2, len(U))))
    np.testing.assert_allclose(blind, plant.oracle(plant.middle)[0])
    with pytest.raises(ValueError, match="obs has shape"):
        tuner.predict(obs[:, :, 1:])
