import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from systems import contexts

from yawrate_env.batch import take
from yawrate_env.loop.design import Status, design, design_from_response, required_response
from yawrate_env.loop.discretisation import zoh
from yawrate_env.loop.margins import margins
from yawrate_env.loop.target import CONTROLLERS, Target
from yawrate_env.loop.transfer_function import TransferFunction, open_loop
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import Vehicle


def transfer_functions(target, count=200, seed=0):
    plant = plants(Vehicle(), contexts(count, seed), target.Ts)
    return TransferFunction.of(plant, target.delay_samples)


def achieved(plant, gains, target):
    return margins(open_loop(plant, gains.kp, gains.Ti, target))


@pytest.mark.parametrize(
    "target",
    [
        Target(),
        Target(phase_margin=50.0, delay_samples=1),
        Target(phase_margin=45.0, crossover=2.0),
        Target(phase_margin=80.0, crossover=1.0, Ts=0.02),
        Target(phase_margin=70.0, Ts=0.001),
        Target(phase_margin=40.0, controller="printed"),
        Target(phase_margin=30.0, delay_samples=2, controller="printed"),
    ],
    ids=str,
)
def test_targets_are_met_where_they_are_said_to_be(target):
    plant = transfer_functions(target)
    gains = design(plant, target)
    ok = gains.status == Status.OK
    assert ok.all() if target == Target() else ok.sum() >= 20
    found = achieved(plant, gains, target)
    np.testing.assert_allclose(found.phase_margin[ok], target.phase_margin, rtol=1e-8)
    np.testing.assert_allclose(found.crossover[ok], target.crossover, rtol=1e-8)
    assert (gains.kp[ok] > 0).all() and (gains.Ti[ok] > 0).all()


def test_required_phase_follows_the_plant_past_minus_180_degrees():
    # 1/(s+1)^6 at tan(50 deg) rad/s has turned by 300 deg, which reads +60 deg when wrapped.
    target = Target(crossover=np.tan(np.radians(50)) / (2 * np.pi), Ts=1e-4)
    A = -np.eye(6) + np.eye(6, k=1)
    plant = zoh(A[None], np.eye(6)[None, 5], np.eye(6)[0], target.Ts)
    G = TransferFunction.of(plant)
    log_magnitude, phase = required_response(G, target)
    # The hold is half a sample of delay: 0.0034 deg, and 1e-9 of magnitude.
    assert np.degrees(phase[0]) == pytest.approx(60 - 180 + 300, abs=0.01)
    assert np.exp(log_magnitude[0]) == pytest.approx(np.cos(np.radians(50)) ** -6, rel=1e-6)
    assert design(G, target).status[0] == Status.PHASE_LIMITED


def test_delay_asks_for_its_own_phase():
    target = Target()
    plain, delayed = (transfer_functions(Target(delay_samples=d), 10) for d in (0, 40))
    (log_plain, phase_plain), (log_delayed, phase_delayed) = (
        required_response(plant, target) for plant in (plain, delayed)
    )
    np.testing.assert_array_equal(log_plain, log_delayed)
    # 40 samples are 216 deg: more than half a turn, which a wrapped phase would lose.
    np.testing.assert_allclose(np.degrees(phase_delayed - phase_plain), 216, rtol=1e-12)


def test_double_integrator_starts_at_minus_180_degrees():
    plant = zoh(np.array([[[0.0, 1], [0, 0]]]), np.array([[0.0, 1]]), np.array([1.0, 0]), 0.01)
    _, phase = required_response(TransferFunction.of(plant), Target())
    half_a_sample = 180 * 1.5 * 0.01
    assert np.degrees(phase[0]) == pytest.approx(60 + half_a_sample, abs=1e-6)


@pytest.mark.parametrize("form", CONTROLLERS)
@pytest.mark.parametrize(
    ("degrees", "status"),
    [
        (-180.0, Status.UNREACHABLE),
        (-90.1, Status.UNREACHABLE),
        (-90.0, Status.UNREACHABLE),
        (-89.9, Status.OK),
        (-0.1, Status.OK),
        (0.0, Status.PHASE_LIMITED),
        (100.0, Status.PHASE_LIMITED),
        (200.0, Status.PHASE_LIMITED),  # tan is positive again here
        (np.nan, Status.UNREACHABLE),
        (np.inf, Status.UNREACHABLE),
    ],
)
def test_status_by_required_phase(form, degrees, status):
    gains = design_from_response(np.array([0.0]), np.radians([degrees]), Target(controller=form))
    assert gains.status[0] == status
    assert np.isnan(gains.kp[0]) == np.isnan(gains.Ti[0]) == (status == Status.UNREACHABLE)


def test_nan_magnitude_is_unreachable_and_stays_in_its_row():
    gains = design_from_response(np.array([np.nan, 0.0]), np.radians([-20.0, -20.0]), Target())
    assert gains.status.tolist() == [Status.UNREACHABLE, Status.OK]
    assert np.isnan(gains.kp).tolist() == [True, False]


@given(st.floats(0, np.pi), st.floats(-5, 5))
def test_phase_limited_designs_keep_the_crossover_and_about_one_degree_of_lag(phase, log):
    target = Target()
    gains = design_from_response(np.array([log]), np.array([phase]), target)
    z = np.exp(1j * target.omega_c * target.Ts)
    C = gains.kp[0] * (1 + target.Ts / (2 * gains.Ti[0]) * (z + 1) / (z - 1))
    assert abs(C) == pytest.approx(np.exp(log), rel=1e-12)
    assert np.degrees(np.angle(C)) == pytest.approx(-1.0027, abs=1e-9)


@pytest.mark.parametrize("count", [1, 17])
def test_one_design_does_not_depend_on_the_batch(count):
    target = Target()
    together = design(transfer_functions(target, 40), target)
    plant = plants(Vehicle(), take(contexts(40, 0), slice(5, 5 + count)), target.Ts)
    alone = design(TransferFunction.of(plant), target)
    np.testing.assert_array_equal(alone.kp, together.kp[5 : 5 + count])
    np.testing.assert_array_equal(alone.Ti, together.Ti[5 : 5 + count])
