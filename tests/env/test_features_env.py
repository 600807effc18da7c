"""Features instead of recordings, actions in [-1, 1]: the two maps and their wrappers."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from first_order import TS, described, gauged, plant
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RescaleAction
from recordings import recorded

from tuners.agents.feature_map import ActionMap, FeatureMap
from tuners.agents.wrappers import (
    FeatureObservation,
    FeatureVectorObservation,
    UnitAction,
    UnitVectorAction,
)
from tuners.features import laguerre
from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.learners.actor import LIMIT
from tuners.tuner.recipes import features_for
from yawrate_env import ENV_ID, FEATURES_ID, NONLINEAR_ID, PLANT_FEATURES_ID
from yawrate_env.env.tuning_env import plant_env
from yawrate_env.loop.target import Target
from yawrate_env.plant import episodes
from yawrate_env.plant.parametrisation import GAINS
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

SHORT = {"Ts": 0.01, "N": 300}  # the least that ARMAX takes
VARIANTS = {
    "laguerre": (FEATURES_ID, SHORT),
    "armax decimated": (FEATURES_ID, SHORT | {"features": "armax", "decimate": 4}),
    "random": (FEATURES_ID, SHORT | {"register": "random", "v_x": [10, 33], "visible": "speed"}),
    "context": (FEATURES_ID, SHORT | {"visible": "context", "delay_samples": 1}),
    "plant": (PLANT_FEATURES_ID, {"plant": gauged}),
}


def scalar(**kwargs):
    return gymnasium.make(FEATURES_ID, **SHORT | kwargs)


def batch(count, **kwargs):
    return gymnasium.make_vec(FEATURES_ID, num_envs=count, **SHORT | kwargs)


def plain(**kwargs):
    return gymnasium.make(ENV_ID, **SHORT | kwargs)


def plain_batch(count=2, **kwargs):
    return gymnasium.make_vec(ENV_ID, num_envs=count, **SHORT | kwargs)


@pytest.mark.parametrize("own", [False, True], ids=["one input", "an input each"])
def test_regressors_of_an_input_are_kept_from_episode_to_episode(monkeypatch, own):
    env, passes = scalar(register="random" if own else "same"), []
    env.reset(seed=0)
    filtered, products = laguerre.filtered, laguerre.products
    monkeypatch.setattr(laguerre, "filtered", lambda *a: (passes.append("filter"), filtered(*a)))
    monkeypatch.setattr(
        laguerre,
        "products",
        lambda a, b: (passes.extend(["gram"] * (a is b and len(a) > 0)), products(a, b))[1],
    )
    for _ in range(5):
        env.step(np.zeros(2))
        env.reset()
    assert passes.count("filter") == passes.count("gram") == 5 * own


def actions(count, seed):
    """Somewhat more than the action box."""
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (count, 2)).astype(np.float32)


# --- the wrappers


def test_either_order_gives_the_same():
    one = FeatureObservation(UnitAction(plain())), UnitAction(FeatureObservation(plain()))
    many = FeatureVectorObservation(UnitVectorAction(plain_batch())), batch(2)
    for (a, b), action in ((one, actions(2, 0)[0]), (many, actions(2, 0))):
        assert a.observation_space == b.observation_space and a.action_space == b.action_space
        np.testing.assert_array_equal(a.reset(seed=1)[0], b.reset(seed=1)[0])
        x, y = a.step(action), b.step(action)
        np.testing.assert_array_equal(x[0], y[0])
        np.testing.assert_array_equal(x[1], y[1])


def test_specs_keep_the_features_settings():
    env = UnitAction(FeatureObservation(plain(), "laguerre", order=6, pole=9.0))
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.observation_space.shape == (6,)
    np.testing.assert_array_equal(env.reset(seed=2)[0], again.reset(seed=2)[0])


def test_environments_do_not_share_their_spaces_generators():
    for one, other in ((scalar(), scalar()), (batch(2), batch(2))):
        for space in ("action_space", "observation_space"):
            getattr(one, space).seed(0)
            expected = getattr(one, space).sample()
            getattr(one, space).seed(0)
            getattr(other, space).seed(1)
            np.testing.assert_array_equal(getattr(one, space).sample(), expected)


class Foreign(gymnasium.Env):
    observation_space = action_space = gymnasium.spaces.Box(-1, 1, (2,))


def gymnasiums():
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    return gymnasium.make_vec(
        ENV_ID, num_envs=2, vectorization_mode="sync", vector_kwargs=same_step, **SHORT
    )


@pytest.mark.parametrize(
    ("wrap", "env", "message"),
    [
        (FeatureObservation, Foreign, "Foreign"),
        (FeatureObservation, plain_batch, r"gymnasium.make\("),
        (FeatureVectorObservation, plain, r"gymnasium.make_vec\("),
        (FeatureVectorObservation, gymnasiums, "SyncVectorEnv"),
        (FeatureVectorObservation, lambda: None, "NoneType"),
        (FeatureObservation, lambda: FeatureObservation(plain()), "observation_space"),
        (UnitAction, lambda: RescaleAction(plain(), -1, 1), "action_space"),
        (FeatureVectorObservation, lambda: batch(2), "single_observation_space"),
    ],
)
def test_wrong_environments_are_refused(wrap, env, message):
    with pytest.raises(ValueError, match=f"env.*{message}") as raised:
        wrap(env())
    assert f'("{ENV_ID}")' in str(raised.value)


@pytest.mark.parametrize(
    "make", [scalar, lambda **kwargs: gymnasium.make(PLANT_FEATURES_ID, plant=gauged, **kwargs)]
)
def test_unknown_features_and_settings_are_refused(make):
    with pytest.raises(ValueError, match="features = 'fourier'.*armax.*laguerre"):
        make(features="fourier")
    with pytest.raises(ValueError, match="nonlinear = 'no'"):
        gymnasium.make(FEATURES_ID, nonlinear="no")
    with pytest.raises(ValueError, match="nonlinear = 'no'"):
        gymnasium.make_vec(FEATURES_ID, nonlinear="no")
    with pytest.raises(ValueError, match="features 'laguerre'.*poles"):
        FeatureObservation(plant_env(gauged), "laguerre", poles=3)


# --- features


def vehicles(features, of_parameters=lambda theta: theta[:, :0]):
    return FeatureMap.of(yaw_rate(Task()), features, of_parameters)


@pytest.mark.parametrize("name", VARIANTS)
def test_features_are_standardised_over_the_prior(name):
    id, kwargs = VARIANTS[name]
    obs, _ = gymnasium.make_vec(id, num_envs=400, **kwargs).reset(seed=0)
    spread = obs.std(axis=0)
    varied = spread > 1e-3  # a visible constant is zero
    assert varied.sum() >= 4
    # Means of 400 draws less means of 512: within 4.5 of their standard deviation, 0.067.
    np.testing.assert_allclose(obs.mean(axis=0), 0, atol=0.3)
    np.testing.assert_allclose(spread[varied], 1, atol=0.25)
    assert np.abs(obs).max() < LIMIT


@pytest.mark.parametrize("features", [Laguerre(), Armax()], ids=["laguerre", "armax"])
def test_features_are_the_first_stages_and_known_parameters_are_appended(features):
    given, visible = recorded(6), [2, 0, 1]
    known, found = given.known[:, visible], vehicles(features, lambda theta: theta[:, visible])
    values, usable = found(given.u, given.y, given.Ts, known)
    raw, _ = features(given.u, given.y, given.Ts)
    assert usable.all() and values.dtype == np.float32
    np.testing.assert_allclose(
        (values * found.scale + found.mean)[:, :-3], raw, rtol=1e-5, atol=1e-7
    )
    np.testing.assert_array_equal(values[:, -3], 0)  # one speed only
    np.testing.assert_array_equal(found.raw(given.u, given.y, given.Ts, known)[0][:, -3:], known)


@pytest.mark.parametrize(
    ("env", "name", "as_feature"),
    [
        (lambda: plain(v_x=[10, 33], visible="speed"), "v_x", float),
        (lambda: plant_env(gauged), "K", np.log),
    ],
)
def test_a_vehicles_parameters_are_features_as_they_are_a_plants_by_logarithm(
    env, name, as_feature
):
    env = FeatureObservation(env())
    obs, _ = env.reset(seed=0)
    known = as_feature(env.step(env.action_space.sample())[4][name])
    assert obs[-1] == pytest.approx((known - env.map.mean[-1]) / env.map.scale[-1], rel=1e-5)


def test_features_suit_the_plant_unless_settings_are_given():
    assert FeatureObservation(plain()).map.features == Laguerre(10, 12.0)
    suited = features_for(gauged)
    assert FeatureObservation(plant_env(gauged)).map.features == suited and suited.order != 6
    found = FeatureObservation(plant_env(gauged), order=6).map.features
    assert (found.order, found.pole) == (6, suited.pole)
    various = plant_env(described(excite=lambda n: prbs(500, TS, 0.5, 1.0, order=14, start=n)))
    found = FeatureObservation(various)  # of inputs that differ: regularised by the prior
    assert isinstance(found.map.features, Regularised)
    assert found.reset(seed=3)[0].shape == (len(found.map.features.directions),)
    coarse = FeatureObservation(various, order=6).map.features
    assert coarse == Laguerre(6, found.map.features.pole)


def test_the_vehicles_environment_is_that_of_their_plant():
    """To the last bit: what is seen of every episode, and what is done in it."""
    own = plant_env(yaw_rate(Task(experiment=Experiment(**SHORT))))
    ours, theirs = UnitAction(FeatureObservation(own, order=10, pole=12.0)), scalar()
    assert ours.observation_space == theirs.observation_space
    for seed in range(5):
        np.testing.assert_array_equal(ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0])
        action = actions(1, seed)[0]
        (_, reward, *_, mine), (_, expected, *_, info) = ours.step(action), theirs.step(action)
        assert (mine["kp"], mine["Ti"]) == (info["kp"], info["Ti"])
        assert reward == pytest.approx(expected, rel=1e-12)


def test_unusable_recordings_give_zeros_and_outliers_are_clipped():
    given, found, none = recorded(2), vehicles(Laguerre()), np.empty((2, 0))
    features, usable = found(np.zeros_like(given.u), given.y, given.Ts, none)
    assert not usable.any() and not features.any()
    assert np.abs(found(given.u, 100 * given.y, given.Ts, none)[0]).max() == LIMIT


def test_no_usable_features_at_all_is_an_error(monkeypatch):
    nothing = lambda self, u, y, Ts: (np.full((len(y), 6), np.nan), np.zeros(len(y), bool))  # noqa: E731
    monkeypatch.setattr(Armax, "__call__", nothing)
    with pytest.raises(ValueError, match="features = Armax"):
        vehicles(Armax())


@pytest.mark.parametrize(
    "name, first",
    [
        ("laguerre", [0.5536585, 0.76594, -0.53654927, -0.6710978, 0.5273979]),
        ("armax", [0.53342044, -0.57042754, 0.45965064, 0.54136497, -0.390725]),
    ],
)
def test_features_are_what_they_always_were(name, first):
    np.testing.assert_allclose(scalar(features=name).reset(seed=0)[0][:5], first, atol=1e-5)


def test_features_of_the_nonlinear_vehicle():
    hard = SHORT | {"amplitude": 0.07}
    own, _ = scalar(nonlinear=True, **hard).reset(seed=4)
    wrapped = UnitAction(FeatureObservation(gymnasium.make(NONLINEAR_ID, **hard)))
    np.testing.assert_array_equal(wrapped.reset(seed=4)[0], own)
    linear, _ = scalar(**hard).reset(seed=4)
    assert np.abs(linear - own).max() > 0.1


# --- actions

SPEEDS = yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0))))
VEHICLES = {
    "default": yaw_rate(Task()),
    "speeds": SPEEDS,
    "low margin": yaw_rate(Task(target=Target(phase_margin=40.0))),
    "printed": yaw_rate(Task(target=Target(controller="printed"))),
}
BOUNDED = VEHICLES | {
    "logarithms": plant,
    "gains": described(parametrisation=GAINS),
    "loop": replace(SPEEDS, action_bounds=None),
}
FROZEN = {
    "default": [-1.9993818650418442, -0.4273901474141522, -75.0, 0.243796568533, 0.070509374048],
    "speeds": [-2.361839700987645, -0.421745394562924, -75.0, 0.223621132628, 0.070509374048],
    "low margin": [-1.9993818650418442, -0.4273901474141522, -78.3549104655, 0.227467369795,
                   0.063980470071],
    "printed": [-1.9993818650418442, -0.4273901474141522, -75.0, 0.795046228721, 0.159429104018],
}  # fmt: skip
"""Log magnitudes, steepest phase [deg], and (kp, Ti) of (0.5, -0.5), of the first version."""


@pytest.mark.parametrize("name", VEHICLES)
def test_actions_mean_what_they_always_did(name):
    found = ActionMap.of(VEHICLES[name])
    gains = found.gains(np.array([[0.5, -0.5]]))[0]
    now = [found.low[0], found.high[0], np.degrees(found.low[1]), *gains]
    np.testing.assert_allclose(now, FROZEN[name], rtol=1e-9)
    assert np.degrees(found.high[1]) == pytest.approx(-0.5)


@pytest.mark.parametrize("name", BOUNDED)
def test_the_range_holds_every_oracle_with_room_to_spare(name):
    of = BOUNDED[name]
    gains = of.oracle(episodes.recorded(of, "test", 0, 128).theta)
    gains = gains[np.isfinite(gains).all(axis=1)]
    used = (found := ActionMap.of(of)).actions(gains)
    assert np.abs(used).max() < 1
    assert np.ptp(used, axis=0).min() > 0.4  # nor is it so wide that nothing can be resolved
    np.testing.assert_allclose(found.gains(used), gains, rtol=1e-9)


@pytest.mark.parametrize("name", BOUNDED)
def test_all_actions_are_gains_that_the_environment_takes(name):
    of = BOUNDED[name]
    found, box = ActionMap.of(of), plant_env(of).action_space
    units = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    units[:100] = units[:100].round()  # corners, edges, middle
    gains = found.gains(units)
    assert (gains > 0).all() and (gains >= box.low).all() and (gains <= box.high).all()
    np.testing.assert_allclose(found.actions(gains), units, rtol=0, atol=1e-9)
    corners = np.sign(units) + (units == 0)
    np.testing.assert_array_equal(found.gains(3 * corners), found.gains(corners))  # clipped


def test_the_environments_gains_are_the_maps():
    env, found = scalar(), ActionMap.of(VEHICLES["default"])
    corners = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]], np.float32)
    for corner, gains in zip(corners, found.gains(corners), strict=True):
        env.reset(seed=0)
        info = env.step(corner)[4]
        assert not info["clipped"]
        assert (info["kp"], info["Ti"]) == pytest.approx(tuple(gains), rel=1e-12)


def test_a_step_in_phase_is_a_step_in_phase_margin():
    # Design.md, section 3: at the target crossover the phase is the margin, one to one.
    env = UnitAction(plain(mu_s=0.7, M_delta=150.0))
    env.reset(seed=0)
    info = env.step(np.zeros(2))[4]
    oracle = env.map.actions(np.array([[info["oracle_kp"], info["oracle_Ti"]]]))[0]
    step = np.array([0.0, np.radians(5.0) / (env.map.high[1] - env.map.low[1]) * 2])
    env.reset(seed=0)
    assert env.step(oracle - step)[4]["phase_margin"] == pytest.approx(55, abs=1e-6)


def test_a_plant_may_have_its_own_bounds():
    own = described(action_bounds=lambda: ([-1.0, -2.0], [1.0, 0.5]))
    np.testing.assert_allclose(ActionMap.of(own).gains(np.ones((1, 2))), np.exp([[1.0, 0.5]]))


@pytest.mark.parametrize(
    "bounds", [lambda: [[0.0, 1.0], [1.0, 1.0]], lambda: np.ones(2), lambda: 1 / 0, 1.0]
)
def test_wrong_bounds_are_named(bounds):
    with pytest.raises(ValueError, match="action_bounds"):
        ActionMap.of(described(action_bounds=bounds))
