"""Several recordings of one plant: information adds up, and the one that differs is named."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from first_order import SIGMA, TS, U, linear, plant
from vehicle_logs import VEHICLE, black, drive, learned

import tuners
from tuners.trust.basis import functions_for
from tuners.trust.black_box import black_box
from tuners.trust.fit import fit
from tuners.tuner.method import Rung
from tuners.tuner.pooling.agreement import Estimates, against_others
from tuners.tuner.pooling.coordinates import Coordinates, mean, pooled, shifted
from tuners.tuner.pooling.joint import joint_fit
from tuners.tuner.recording import Recording
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

TRUTH = np.array([1.2, 0.5])
SETS, LOGS = 64, 4


@cache
def lags(sigmas=(SIGMA,) * LOGS, gains=(TRUTH[0],) * LOGS, sets=SETS):
    """Models, own fits and outputs of sets of recordings of a first-order lag, one a noise."""
    rng, models, fits, outputs = np.random.default_rng(5), [], [], []
    functions = functions_for(linear)
    for sigma, gain in zip(sigmas, gains, strict=True):
        clean = linear.respond(np.array([[gain, TRUTH[1]]]))
        y = clean + sigma * rng.standard_normal((sets, len(U)))
        models.append(black_box(linear, functions, U[None], y, "rest"))
        start = np.tile(linear.middle, (sets, 1))
        fits.append(fit(linear, models[-1], y, start))
        outputs.append(y)
    return models, fits, outputs


def scaled(theta):
    return theta[:, linear.unknown] / linear.width


def test_four_recordings_halve_the_error():
    models, fits, outputs = lags()
    joint = joint_fit(linear, models, fits, outputs)
    error = scaled(joint.fits[0].theta) - TRUTH / linear.width
    whitened = np.einsum("bi,bij,bj->b", error, np.linalg.inv(joint.fits[0].covariance), error)
    # Chi-square of 128 degrees of freedom: three standard deviations are 48.
    assert joint.fits[0].converged.all() and abs(whitened.sum() - 2 * SETS) < 48
    one = np.einsum("bii->bi", fits[0].covariance)
    np.testing.assert_allclose(np.einsum("bii->bi", joint.fits[0].covariance) / one, 0.25, rtol=0.2)


def test_shares_are_those_of_the_information():
    joint = joint_fit(linear, *lags((SIGMA, 2 * SIGMA, SIGMA, SIGMA)))
    np.testing.assert_allclose(joint.shares.sum(axis=0), 1.0)
    expected = np.array([4, 1, 4, 4]) / 13
    np.testing.assert_allclose(joint.shares.mean(axis=1), expected, rtol=0.05)


def test_the_order_of_recordings_does_not_matter():
    models, fits, outputs = lags()
    there = joint_fit(linear, models, fits, outputs).fits[0].theta
    back = joint_fit(linear, models[::-1], fits[::-1], outputs[::-1]).fits[0].theta
    np.testing.assert_allclose(back, there, rtol=1e-5)


def estimates(fits):
    return Estimates.of_fits(list(fits), linear.unknown, linear.width)


def test_chi_squares_of_one_plant_are_chance():
    found = estimates(lags()[1])
    chi_square, chance, apart = against_others(found)
    # Means of 64 x 4 (of which a set's four share their data): 2 by the distribution, sd 0.2.
    assert found.freedom == 2 and abs(chi_square.mean() - 2) < 0.6
    assert abs((chance < 0.5).mean() - 0.5) < 0.15
    assert apart.any(axis=0).mean() <= 0.05


def test_the_recording_of_another_plant_is_named_alone():
    gains = (TRUTH[0], TRUTH[0], 1.3 * TRUTH[0], TRUTH[0])
    _, _, apart = against_others(estimates(lags(gains=gains)[1]))
    assert apart[2].all() and apart[[0, 1, 3]].mean() <= 0.03


def test_of_two_that_differ_both_do():
    gains = (TRUTH[0], 1.3 * TRUTH[0])
    _, _, apart = against_others(estimates(lags((SIGMA, SIGMA), gains)[1]))
    assert apart.all()


def test_offsets_are_pooled_by_their_covariances():
    rng = np.random.default_rng(2)
    A = rng.standard_normal((3, 5, 2, 2))
    precision, offsets = A @ A.swapaxes(2, 3), rng.standard_normal((3, 5, 2))
    covariance, found = mean(offsets, precision)
    for b in range(5):
        total = sum(precision[i, b] for i in range(3))
        right = sum(precision[i, b] @ offsets[i, b] for i in range(3))
        np.testing.assert_allclose(covariance[b] @ total, np.eye(2), atol=1e-9)
        np.testing.assert_allclose(found[b], np.linalg.solve(total, right))


@cache
def at_20():
    return [drive(0.7, 20.0, k) for k in range(3)]


@pytest.mark.parametrize("tuner, rung", [(learned, Rung.FITTED_PLANT), (black, Rung.BLACK_BOX)])
def test_pooled_intervals_are_narrower_and_hold_the_truth(tuner, rung):
    one, all_ = tuner().pool(at_20()[:1]), tuner().pool(at_20())
    assert all_.rung == rung and all_.trusted and all(log.agrees for log in all_.logs)
    assert sum(log.share for log in all_.logs) == pytest.approx(1.0, abs=0.02)
    gains = np.array([list(all_.gains.values())])
    for error, (name, wide) in zip(
        VEHICLE.errors(np.array([[0.7, 120.0, 20.0]]), gains)[0], one.intervals.items(), strict=True
    ):
        narrow = all_.intervals[name]
        ratio = (wide.high - wide.low) / (narrow.high - narrow.low)
        assert ratio == pytest.approx(np.sqrt(3), rel=0.25)
        assert abs(error) < narrow.high - narrow.low


def test_one_recording_is_tuned_as_by_itself():
    (one,) = at_20()[:1]
    assert learned().pool([one]).gains == learned().results(one)[0].gains


def test_recordings_at_several_speeds_give_gains_for_another():
    drives = [drive(0.7, v, k) for k, v in enumerate((12.0, 18.0, 30.0))]
    result = learned().pool(drives, {"v_x": 24.0})
    truth = VEHICLE.oracle(np.array([[0.7, 120.0, 24.0]]))[0]
    assert list(result.gains.values()) == pytest.approx(truth.tolist(), rel=2e-3)
    assert result.verdict == "usable"
    with pytest.raises(ValueError, match="speed.*12 to 30"):
        learned().pool(drives)
    with pytest.raises(ValueError, match="black-box"):
        black().pool(drives, {"v_x": 24.0})


def test_far_from_all_recordings_gains_take_care():
    near, far = (learned().pool(at_20(), {"v_x": v}) for v in (21.0, 30.0))
    assert near.verdict == "usable" and far.verdict == "usable_with_care"
    assert [c.name for c in far.checks if not c.passed] == ["extrapolated"]


def test_another_friction_is_named_and_refused():
    names = ["a", "b", "c", "wet"]
    result = learned().pool([*at_20(), drive(0.45, 20.0, 9)], names=names)
    assert [log.name for log in result.logs if not log.agrees] == ["wet"]
    assert result.verdict == "refuse" and "friction 0.45 instead of 0.7" in result.reasons[0]
    # Its own plant's margins with these gains, less the others', as the truth has them.
    gains = np.array([list(result.gains.values())] * 2)
    theta = np.array([[0.45, 120.0, 20.0], [0.7, 120.0, 20.0]])
    wet, dry = VEHICLE.metric_values(theta, gains)
    expected = wet - dry
    assert list(result.logs[3].shift.values()) == pytest.approx(expected, abs=0.8, rel=0.15)


def test_where_the_plant_is_wrong_recordings_of_the_wanted_speed_answer():
    stiff = replace(Task().vehicle, C_f=1.2 * Task().vehicle.C_f, J_z=0.85 * Task().vehicle.J_z)
    drives = [drive(0.7, v, k, vehicle=stiff) for k, v in enumerate((12.0, 18.0, 18.0, 30.0))]
    result = learned().pool(drives, {"v_x": 18.0})
    assert result.rung == Rung.BLACK_BOX and result.verdict == "usable_with_care"
    gains = np.array([list(result.gains.values())])
    errors = yaw_rate(Task(stiff)).errors(np.array([[0.7, 120.0, 18.0]]), gains)[0]
    assert abs(errors[0]) < 0.5 and abs(errors[1]) < 0.02


def test_fit_in_percent_is_that_of_matlabs_compare():
    tuned, further = at_20()[:2]
    held = learned().pool([tuned], validate=further).validation
    parameters = learned().results(tuned)[0].fit.parameters
    simulated = VEHICLE.respond(np.array([list(parameters.values())]), further.u)[0]
    y = further.y[0]
    nrmse = 100 * (1 - np.linalg.norm(y - simulated) / np.linalg.norm(y - y.mean()))
    assert held.fit == pytest.approx(nrmse, abs=0.02)
    assert held.agrees and held.fit <= held.attainable + 0.01


@pytest.mark.slow
@pytest.mark.parametrize("change", ["friction", "l_rel_f", "xi", "mass"])
def test_another_car_is_called_out(change):
    base, called, count = Task().vehicle, 0, 6
    rng = np.random.default_rng(7)
    for k in range(count):
        mu_s = rng.uniform(0.5, 0.9)
        tuned = drive(mu_s, 20.0, 100 + k, seconds=5.0, snr_db=20.0)
        other = {"mu_s": mu_s, "M_delta": 120.0, "vehicle": base}
        if change == "friction":
            other["mu_s"] = mu_s + 0.2
        elif change == "mass":
            other["M_delta"] += 0.2 * (base.M_0 + 120.0)
        else:
            other["vehicle"] = replace(base, **{change: 1.2 * getattr(base, change)})
        further = drive(v_x=20.0, episode=200 + k, seconds=5.0, snr_db=20.0, **other)
        called += not learned().pool([tuned], validate=further).validation.agrees
    assert called == count


@pytest.mark.slow
def test_the_right_car_is_rarely_called_out():
    rng, called, count = np.random.default_rng(8), 0, 40
    for k in range(count):
        mu_s = rng.uniform(0.35, 1.05)
        tuned, further = (drive(mu_s, 20.0, 300 + 2 * k + i, seconds=5.0) for i in (0, 1))
        called += not learned().pool([tuned], validate=further).validation.agrees
    assert called <= 6  # 5 % of 40, and three standard deviations


def test_a_shifted_response_asks_for_so_much_more():
    tuner = black()
    looks = [tuner.inspection.look(each) for each in at_20()]
    zero = np.zeros((3, 1, 2))
    response = pooled([look.response for look in looks],
                      Coordinates.of([look.response for look in looks], zero, zero[0]))  # fmt: skip
    change = np.array([[0.05, np.radians(2.0)]])
    assert response.metrics(response.gains)[0] == pytest.approx([60.0, 1.5], abs=0.02)
    moved = shifted(response, change)
    margin, _ = (moved.metrics(moved.gains) - response.metrics(response.gains))[0]
    assert abs(margin) < 0.02  # its own gains are right for it
    assert (moved.required - response.required)[0] == pytest.approx(change[0])


def test_a_plant_without_a_loop_target_is_pooled_too():
    tuner = tuners.load("gb", plant)
    y = [plant.respond(TRUTH[None])[0] + SIGMA * np.random.default_rng(k).standard_normal(len(U))
         for k in range(3)]  # fmt: skip
    given = [Recording.of(plant, U, each, TS) for each in y]
    result = tuner.pool(given)
    assert result.gains["Ti"] == pytest.approx(TRUTH[1], rel=0.02)
    other = plant.respond(np.array([[1.6, 0.5]]))[0]
    named = tuner.pool([*given, Recording.of(plant, U, other + y[0] - y[1], TS)])
    assert [log.agrees for log in named.logs] == [True, True, True, False]


def test_recordings_of_other_lengths_and_rates_are_pooled():
    first = at_20()[0]
    u = prbs(3000, 0.002, 0.1, 0.02)[0]
    fine = VEHICLE.respond(np.array([[0.7, 120.0, 20.0]]), np.repeat(u, 2)[None])[0, ::2]
    noisy = fine + 1e-3 * np.random.default_rng(0).standard_normal(len(fine))
    second = Recording.of(VEHICLE, u, noisy, 0.002, {"v_x": 20.0})
    result = learned().pool([first, second])
    assert result.trusted and all(log.agrees for log in result.logs)


def test_a_recording_without_excitation_is_named():
    still, rng = at_20()[0], np.random.default_rng(0)
    dead = [
        replace(still, u=0 * still.u, y=1e-3 * rng.standard_normal(still.y.shape)) for _ in "ab"
    ]
    result = learned().pool([*at_20(), dead[0]], names=["a", "b", "c", "dead"])
    assert result.verdict == "refuse" and result.logs[3].share < 0.01
    assert all(reason.startswith("dead: ") for reason in result.reasons)
    nothing = learned().pool(dead)
    assert nothing.verdict == "refuse" and np.isnan(list(nothing.gains.values())).all()


def test_what_cannot_be_pooled_is_refused():
    tuner, (one, *_) = learned(), at_20()
    with pytest.raises(ValueError, match="number of recordings"):
        tuner.pool([])
    with pytest.raises(ValueError, match=r"recordings\[1\]"):
        tuner.pool([one, one])
    with pytest.raises(ValueError, match=r"recordings\[0\]"):
        tuner.pool([replace(one, y=np.repeat(one.y, 2, axis=0), known=None)])
    with pytest.raises(ValueError, match="names"):
        tuner.pool(at_20(), names=["a"])
    with pytest.raises(ValueError, match="v_x"):
        tuner.pool(at_20(), {"v_x": -3.0})
