"""What every tuner does, for every plant: tune, act as a policy, be saved and loaded."""

import numpy as np
import pytest
from families import FAMILIES, SLOW, VEHICLE, observed, one, reference, trained
from families import tested as recordings
from first_order import SIGMA, linear

from tuners.trust.verdict import Verdict
from tuners.tuner.comparison import GRAY_BOX, NOMINAL, ORACLE, TUNER, compare
from tuners.tuner.method import Gains, Rung
from tuners.tuner.recording import Recording
from tuners.tuner.rivals import GrayBox, Nominal, Oracle
from tuners.tuner.tuner import Tuner
from yawrate_env.loop.design import Status
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate


def vehicle(method, task=VEHICLE) -> Tuner:
    return Tuner(yaw_rate(task), method, {"name": method.kind})


def test_the_tuner_is_near_the_bound_and_beats_a_fixed_controller(tuner, family):
    count = 16 if family in SLOW else 64
    found = compare(tuner, count, 0)
    bound = np.sqrt((found.bound**2).mean(axis=0))
    error = 1 / np.sqrt(2 * count)  # of a root mean square of normal errors, relative
    assert (found.rms(TUNER) < 5 * bound).all()
    np.testing.assert_allclose(found.rms(GRAY_BOX), bound, rtol=4 * error)
    assert (found.rms(NOMINAL) > 8 * bound).all()
    assert (found.rms(ORACLE) == 0).all() and found.unstable(TUNER) == 0
    assert found.trusted.mean() > 0.95 and found.converged.all()
    error = np.sqrt(0.09 / count + 0.09 / tuner.training["calibration"]["episodes"])
    assert np.abs(found.covered.mean(axis=0) - 0.9).max() < 4 * error


def test_batch_single_and_log_agree(tuner, plant, episodes):
    obs, state = observed(plant, episodes)[:4], (np.ones(3),)
    batch, passed = tuner.predict(obs, state, np.ones(4, dtype=bool), deterministic=False)
    assert passed is state and tuner.predict(obs[:0])[0].shape == (0, len(plant.gains))
    assert batch.shape == (4, len(plant.gains)) and batch.dtype == np.float64
    climbed, _ = tuner.climb(episodes.part(slice(0, 4)))
    for index in range(4):
        single, _ = tuner.predict(obs[index])
        result = tuner.tune(**one(plant, episodes, index))
        # Matrix products of other sizes round otherwise.
        np.testing.assert_allclose(single, batch[index], rtol=1e-9)
        gains = list(result.gains.values())
        np.testing.assert_allclose(gains, climbed.gains.values[index], rtol=1e-7)
        assert result.rung == climbed.rung[index]
        if result.rung is Rung.METHOD:
            np.testing.assert_allclose(gains, single, rtol=1e-9)
    np.testing.assert_allclose(tuner.predict(obs.astype(np.float32))[0], batch, rtol=1e-3)
    np.testing.assert_array_equal(tuner.act(episodes.part(slice(0, 4))), batch)


def test_a_result_says_what_was_found(tuner, plant, episodes):
    result = tuner.tune(**one(plant, episodes, 0))
    theta = episodes.known[0]
    for name, interval in result.intervals.items():
        assert getattr(result, split(name)[0]) is interval
    assert result.status is Status.OK and result.converged is True and result.trusted
    assert result.reasons == () and all(c.passed for c in result.checks)
    assert len(result.notes) == (not plant.linear)  # that a reference model cannot follow it
    assert list(result.gains) == list(plant.gains) and list(result.intervals) == list(plant.counted)
    assert result.kp == result.gains["kp"]
    actual = plant.metric_values(theta[None], np.array([list(result.gains.values())]))[0]
    for value, interval in zip(actual, result.intervals.values(), strict=True):
        assert interval.low <= interval.value <= interval.high
        assert abs(value - interval.value) <= 3 * (interval.high - interval.value) + 1e-9
    fit = result.fit
    for i, name in enumerate(plant.prior):
        allowed = 5 * fit.deviations.get(name, 0.0)
        assert fit.parameters[name] == pytest.approx(theta[i], abs=allowed + 1e-9)
    np.testing.assert_allclose(fit.measured, episodes.y[0], atol=1e-9 * np.abs(episodes.y).max())
    np.testing.assert_allclose(fit.residual, fit.measured - fit.simulated)
    assert fit.from_rest and fit.offset == 0 and fit.initial == 0 and fit.snr_db > 10
    fallback = np.array([list(result.fallback.values())])
    assert not np.isnan(
        plant.metric_values(episodes.known, np.repeat(fallback, len(episodes), 0))
    ).any()
    with pytest.raises(AttributeError, match="spring"):
        result.spring  # noqa: B018


def test_tuners_take_lists_and_leave_their_arguments_alone():
    tuner, plant = trained("vehicle"), FAMILIES["vehicle"]
    given = one(plant, recordings("vehicle"), 0)
    u, y = given["u"].copy(), given["y"].copy()
    plain = tuner.tune(u, y, plant.Ts)
    np.testing.assert_array_equal([u, y], [given["u"], given["y"]])
    again = tuner.tune(u.tolist(), y.tolist(), float(plant.Ts))
    assert (again.gains, again.checks) == (plain.gains, plain.checks)


@pytest.mark.parametrize(
    "wrong, words",
    [({"measured": 3}, "measured = 3"), ({"measured": {"v_x": 20.0}, "v_x": 21.0}, "given twice")],
)
def test_measured_parameters_are_given_once_by_name(wrong, words):
    given = one(FAMILIES["vehicle"], recordings("vehicle"), 0)
    with pytest.raises(ValueError, match=words):
        trained("vehicle").tune(given["u"], given["y"], **wrong)


def test_what_is_no_recording_is_refused():
    u = np.ones(500)
    with pytest.raises(ValueError, match="recording = None"):
        trained("vehicle").assess(None)
    for y in (u, u[None, 1:]):
        with pytest.raises(ValueError, match="Recording.of"):
            Recording(u[None], y, 0.02)


STILL = {
    "no input": lambda u, y: (0 * u, y),
    "no output": lambda u, y: (u, 0 * y),
    "nothing": lambda u, y: (0 * u, 0 * y),
    "constant input": lambda u, y: (0 * u + np.abs(u).max(), y),
    "constant output": lambda u, y: (u, 0 * y + np.abs(y).max()),
    "next to nothing": lambda u, y: (1e-300 * u, 1e-300 * y),
}


@pytest.mark.parametrize("name, method", [*((n, None) for n in FAMILIES), ("vehicle", GrayBox)])
def test_where_nothing_moves_tune_finds_no_gains_and_the_policy_gives_the_fallback(name, method):
    tuner, plant, episodes = trained(name), FAMILIES[name], recordings(name)
    if method:
        tuner = reference(name, method)
    good = observed(plant, episodes)[:1]
    still = np.repeat(good, len(STILL), axis=0)
    for row, change in zip(still, STILL.values(), strict=True):
        row[0], row[1] = change(*good[0, :2])
    actions, _ = tuner.predict(np.concatenate([still, good]))
    np.testing.assert_array_equal(actions[:-1], np.tile(tuner.fallback, (len(STILL), 1)))
    assert (actions[-1] != tuner.fallback).any()
    for u, y in still[:, :2] if name in ("lag", "vehicle") else still[:1, :2]:
        result = tuner.tune(**one(plant, episodes, 0) | {"u": u, "y": y})
        assert np.isnan(list(result.gains.values())).all() and not result.converged
        assert result.status is Status.UNREACHABLE and not result.trusted and result.reasons
        assert list(result.fallback.values()) == tuner.fallback.tolist()


def test_a_step_from_rest_is_not_nothing():
    plant = yaw_rate(Task(experiment=Experiment(N=700)))  # the first seven bits are the same
    block = recorded(plant, "test", 0, 2)
    assert np.ptp(block.u) == 0
    actions = Tuner(plant, GrayBox()).act(Recording(block.u, block.y, plant.Ts))
    np.testing.assert_allclose(actions, plant.oracle(block.theta), rtol=0.1)


class Lost:
    """Finds gains for every second recording."""

    kind, needs_excitation, any_measured, any_experiment = "lost", False, False, True

    def gains(self, plant: Plant, recording: Recording) -> Gains:
        lost = np.arange(len(recording)) % 2 == 0
        values = np.where(lost[:, None], np.nan, 0.5) * np.ones((1, len(plant.gains)))
        return Gains.of(values, ~lost, ~lost)


def test_where_a_method_finds_no_gains_the_policy_gives_the_fallback():
    tuner = reference("lag", Lost)
    actions, _ = tuner.predict(observed(FAMILIES["lag"], recordings("lag"))[:4])
    np.testing.assert_array_equal(actions[0::2], np.tile(tuner.fallback, (2, 1)))
    np.testing.assert_array_equal(actions[1::2], 0.5)


OBSERVATIONS = {
    "too short": lambda N: np.zeros((2, N - 1)),
    "too long": lambda N: np.zeros((3, 2, 2 * N)),
    "rows": lambda N: np.zeros((7, N)),
    "one row": lambda N: np.zeros(N),
    "no samples": lambda N: np.zeros((2, 0)),
    "huge": lambda N: np.full((2, N), 1e150),
    "masked": lambda N: np.ma.masked_equal(np.zeros((2, N)), 0.0),
    "a number": lambda N: 3.0,
    "not finite": lambda N: np.full((2, N), np.nan),
    "text": lambda N: np.full((2, N), "a"),
    "a speed of nought": lambda N: np.zeros((3, N)),
}


@pytest.mark.parametrize("case", OBSERVATIONS)
def test_observations_that_do_not_fit_are_refused(case):
    with pytest.raises(ValueError, match="obs|v_x"):
        reference("vehicle", Nominal).predict(OBSERVATIONS[case](1000))


LOGS = [
    ("u", lambda u: np.zeros(9)),
    ("y", lambda u: np.zeros((len(u), 1))),
    ("y", lambda u: np.full(len(u), np.inf)),
    ("y", lambda u: np.ma.masked_less(u, 0.0)),
    ("u", lambda u: u * 1j),
    ("u", lambda u: u.astype(str)),
    ("u", lambda u: u * 1e100),
    ("u", lambda u: [[0.0], [0.0, 1.0]]),
    ("y", lambda u: np.where(u > 0, np.nan, u)),
    ("Ts", lambda u: 0.0),
    ("Ts", lambda u: -0.001),
    ("Ts", lambda u: "fast"),
    ("start", lambda u: "moving"),
]


@pytest.mark.parametrize("argument, value", LOGS)
def test_logs_that_cannot_be_used_are_refused(argument, value):
    given = one(FAMILIES["lag"], recordings("lag"), 0)
    with pytest.raises(ValueError, match=argument):
        reference("lag", Nominal).tune(**given | {argument: value(given["u"])})


@pytest.mark.parametrize("v_x", [0.0, np.nan, True, "fast", np.ones(3), np.linspace(17, 23, 1000)])
def test_measured_values_that_cannot_be_used_are_refused(v_x):
    plant = FAMILIES["vehicle"]
    given = one(plant, recordings("vehicle"), 0)
    with pytest.raises(ValueError, match="v_x"):
        vehicle(Nominal()).tune(**given | {"measured": {"v_x": v_x}})


def test_measured_parameters_are_asked_for_by_name():
    tuner, plant = trained("lag of measured gain"), FAMILIES["lag of measured gain"]
    given = one(plant, recordings("lag of measured gain"), 0)
    K = given.pop("measured")["K"]
    result = tuner.tune(**given, K=K)
    assert result.trusted and result.fit.parameters["K"] == K
    with pytest.raises(ValueError, match="K is needed"):
        tuner.tune(**given)
    with pytest.raises(ValueError, match="'T'.*Choose one of K"):
        tuner.tune(**given, measured={"T": 1.0})
    beyond = tuner.tune(**given, measured={"K": 2.2})
    (reason,) = (c.message for c in beyond.checks if c.name == "K")
    assert reason in beyond.reasons
    with pytest.raises(ValueError, match="'x'"):
        trained("lag").tune(**one(FAMILIES["lag"], recordings("lag"), 0) | {"measured": {"x": 1.0}})


@pytest.mark.parametrize(
    "v_x, noted, trusted",
    [
        (20.2, False, True),
        (np.linspace(19.6, 20.4, 1000), False, True),
        (np.linspace(19.0, 21.0, 1000), True, True),
        (33.0, False, False),
        (19.7, False, False),
    ],
)
def test_another_speed_takes_care_and_a_varying_one_is_noted(v_x, noted, trusted):
    plant = FAMILIES["vehicle"]
    result = trained("vehicle").tune(
        **one(plant, recordings("vehicle"), 0) | {"measured": {"v_x": v_x}}
    )
    assert sum("speed" in note for note in result.notes) == noted
    (speed,) = (check for check in result.checks if check.name == "speed")
    assert speed.passed == trusted and (result.verdict is Verdict.USABLE) == trusted
    assert trusted or result.rung is Rung.BLACK_BOX


def test_the_gray_box_may_have_any_speed():
    plant, theta = yaw_rate(VEHICLE), np.array([[0.7, 100.0, 25.0]])
    y = plant.respond(theta)[0]
    rng = np.random.default_rng(0)
    y = y + 0.03 * y.std() * rng.standard_normal(len(y))
    result = vehicle(GrayBox()).tune(plant.u, y, v_x=25.0)
    assert result.trusted and result.notes == ()


def test_another_sampling_time_gives_the_same_answer(tuner, plant, episodes):
    """Of slower samples there are fewer, so that the intervals are wider."""
    given = one(plant, episodes, 0)
    whole = tuner.tune(**given)
    fine = {**given, "u": np.repeat(given["u"], 4), "Ts": plant.Ts / 4}
    times = np.arange(4 * len(given["y"])) / 4
    fine["y"] = np.interp(times, np.arange(len(given["y"])), given["y"])
    part = tuner.tune(**fine)
    assert part.trusted, part.reasons
    assert any(f"{plant.Ts / 4:g} s" in note for note in part.notes)
    for name, interval in whole.intervals.items():
        other = part.intervals[name]
        assert abs(other.value - interval.value) <= interval.high - interval.low + 1e-9


def test_slow_samples_are_as_good_where_they_show_the_plant():
    tuner, theta = trained("lag"), np.array([[1.2, 0.5]])
    rng = np.random.default_rng(4)
    u = np.repeat(np.sin(np.cumsum(np.linspace(0.05, 0.4, 250))), 2)
    y = linear.respond(theta, u)[0] + SIGMA * rng.normal(size=500)
    whole, part = tuner.tune(u, y), tuner.tune(u[::2], y[::2], 0.04)
    assert whole.trusted and part.trusted, part.reasons
    for name, right in zip(linear.gains, linear.oracle(theta)[0], strict=True):
        first, second = (r.intervals[f"relative_error_of_{name}"] for r in (whole, part))
        wider = (second.high - second.low) / (first.high - first.low)
        assert wider == pytest.approx(np.sqrt(2), rel=0.25)
        assert second.low < part.gains[name] / right - 1 < second.high


def test_what_bends_between_slow_samples_is_not_trusted():
    tuner = trained("lag")
    theta, every = np.array([[1.0, 0.2]]), 8
    u = np.repeat(np.where(np.arange(63) % 2, -1.0, 1.0), every)[:500]
    y = linear.respond(theta, u)[0]
    slow = tuner.tune(u[::every], y[::every], every * linear.Ts)
    (check,) = (c for c in slow.checks if c.name == "between")
    assert not check.passed and not slow.trusted


def test_sampling_times_and_lengths_that_cannot_work_are_refused():
    tuner = reference("lag", Nominal)
    with pytest.raises(ValueError, match="Ts"):
        tuner.tune(np.zeros(300), np.zeros(300), 0.5)
    slow = np.zeros(30_000)  # before anything is resampled
    with pytest.raises(ValueError, match="number of samples"):
        tuner.tune(slow, slow, 0.099 / linear.crossover)


def test_another_input_is_noted_unless_it_makes_no_difference():
    given = one(FAMILIES["lag"], recordings("lag"), 0)
    cut = {**given, "u": given["u"][:-50], "y": given["y"][:-50]}
    assert len(trained("lag").tune(**cut).notes) == 1
    assert reference("lag", Nominal).tune(**cut).notes == ()


def test_a_quantised_output_is_noted():
    tuner, given = reference("lag", Nominal), one(FAMILIES["lag"], recordings("lag"), 0)
    span = np.ptp(given["y"])
    fine, coarse = (
        tuner.tune(**given | {"y": step * np.round(given["y"] / step)})
        for step in (1e-7 * span, span / 5)
    )
    assert fine.notes == ()
    assert len(coarse.notes) == 1 and "quantised" in coarse.notes[0]


def test_magnitudes_that_no_plant_reaches_are_not_trusted():
    given, tuner = one(FAMILIES["vehicle"], recordings("vehicle"), 0), trained("vehicle")
    for scale in (1e2, 1e6):  # both in other units: the ratio is right
        result = tuner.tune(**given | {"u": scale * given["u"], "y": scale * given["y"]})
        (check,) = (c for c in result.checks if c.name == "implausible")
        assert not check.passed and not result.trusted


def test_oracle_and_nominal_follow_the_design_rule(plant, episodes):
    theta, part = episodes.known[:3], episodes.part(slice(0, 3))
    oracle = Tuner(plant, Oracle())
    np.testing.assert_array_equal(oracle.act(part), plant.oracle(theta))
    middle = np.repeat(plant.oracle(plant.middle), 3, axis=0)
    np.testing.assert_array_equal(Tuner(plant, Nominal()).act(part), middle)
    for attempt in (
        lambda: oracle.tune(**one(plant, episodes, 0)),
        lambda: oracle.predict(observed(plant, episodes)[:2]),
    ):
        with pytest.raises(ValueError, match="oracle"):
            attempt()
