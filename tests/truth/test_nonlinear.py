"""The nonlinear vehicle against scipy's solve_ivp, the linear vehicle, and physics."""

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from systems import contexts

from studies.nonlinear_reference import axle, solve
from yawrate_env.batch import take
from yawrate_env.compiled import LANES, kernel, over_blocks
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.nonlinear import Limits, NonlinearTwin, Tyre
from yawrate_env.vehicle.nonlinear import tyre as tyres
from yawrate_env.vehicle.nonlinear.body import GRAVITY
from yawrate_env.vehicle.nonlinear.steering import PIECE, PIECES, cut
from yawrate_env.vehicle.single_track import Context, Vehicle
from yawrate_env.vehicle.task import twin_from
from yawrate_env.vehicle.twin import LinearTwin

TWIN = NonlinearTwin()
CORNERS = Context.of([0.3, 0.3, 1.1, 1.1], [0.0, 300.0, 0.0, 300.0], [20.0, 33.0, 10.0, 33.0])


def driven(twin, context, u, Ts=0.001, vehicle=None):
    u = np.atleast_2d(u)
    y = np.empty((len(context), u.shape[1]))
    simulate = twin.simulator(vehicle or Vehicle(), context, u, Ts)
    over_blocks(lambda i, j: simulate(y[i:j], i, j), len(context), LANES)
    return y


def command(degrees, N=1500, Ts=0.001):
    return prbs(N, Ts, 0.1, math.radians(degrees))[0]


@kernel
def elementary(x, arctan, sine):
    for i in range(len(x)):
        arctan[i] = tyres.arctan(x[i])
        sine[i] = tyres.sine(x[i])


def test_polynomials_are_arctangent_and_sine():
    x = np.concatenate([np.linspace(-np.pi, np.pi, 5001), [1.0, -1.0, 0.0, 1e-9]])
    arctan, sine = np.empty_like(x), np.empty_like(x)
    elementary(x, arctan, sine)
    np.testing.assert_allclose(arctan, np.arctan(x), rtol=1e-12)
    np.testing.assert_allclose(sine, np.sin(x), rtol=0, atol=1e-12)
    far = np.array([3.0, -1e3, 1e9, -1e300])
    elementary(far, arctan[:4], sine[:4])
    np.testing.assert_allclose(arctan[:4], np.arctan(far), rtol=1e-12)


def test_the_tyres_slope_and_peak_are_those_asked_for():
    slip = np.linspace(0, 2, 200_001)
    force = tyres.lateral_force(slip, 60e3, 5e3)
    assert force[1] / slip[1] == pytest.approx(60e3, rel=1e-6)
    assert force.max() == pytest.approx(5e3, rel=1e-8)
    np.testing.assert_array_equal(tyres.lateral_force(-slip, 60e3, 5e3), -force)


@pytest.mark.parametrize("mass", [1895.0, 2195.0])
def test_an_axle_with_load_transfer_is_the_sum_of_its_wheels(mass):
    # Closed forms of the summed D and K against the formula of each wheel.
    rng, tyre, q_gain = np.random.default_rng(0), Tyre(), 500.0
    rated = 1895.0 * GRAVITY / 4
    load = mass * GRAVITY / 4
    expected = axle(TWIN, 120e3, load, rated, q_gain)
    relative = load / rated

    @kernel
    def ours(slip, xx, peak, fade, nn, shape, curvature):
        return tyres.axle_force(slip, xx, 120e3, peak, fade, nn, shape, curvature)

    grip = float(tyres.friction(tyre, np.array(relative)))
    for slip, q in zip(rng.uniform(-0.5, 0.5, 50), rng.uniform(-12, 12, 50), strict=True):
        x = q_gain * q / load
        found = ours(slip, min(x * x, 1.0), 2 * load * grip, tyre.friction_loss * relative / grip,
                     (relative / tyre.stiffest_load) ** 2, tyre.shape, tyre.curvature)  # fmt: skip
        assert found == pytest.approx(expected(slip, q), rel=1e-11)


# At 4 degrees the steering rate is limited; 0.01 s is the controller's sampling time.
@pytest.mark.parametrize("degrees, Ts", [(1.0, 0.001), (4.0, 0.001), (4.0, 0.01)])
def test_integration_error_is_below_1e_8(degrees, Ts):
    u = command(degrees, round(1.5 / Ts), Ts)
    y = driven(TWIN, CORNERS, u, Ts)
    for b, c in enumerate(np.stack([CORNERS.mu_s, CORNERS.M_delta, CORNERS.v_x], axis=1)):
        expected = solve(Vehicle(), TWIN, tuple(c.tolist()), u, Ts)
        assert np.abs(y[b] - expected).max() < 1e-8
        assert np.abs(y[b]).max() > 0.1 * math.radians(degrees)


def test_small_signals_see_the_linear_vehicle():
    context = contexts(20, seed=0)
    difference = {}
    for amplitude in (1e-3, 1e-4, 1e-5):
        u = np.sign(command(1.0, N=3000)) * amplitude
        linear = driven(LinearTwin(), context, u)
        gap = np.abs(driven(TWIN, context, u) - linear).max(axis=1)
        difference[amplitude] = (gap / np.abs(linear).max(axis=1)).max()
    assert difference[1e-4] < 1e-6
    # What is left is of second order, until integration errors show.
    assert difference[1e-3] / difference[1e-4] == pytest.approx(100, rel=0.02)
    assert difference[1e-4] / difference[1e-5] == pytest.approx(100, rel=0.1)


def test_a_mirrored_command_is_answered_by_the_mirrored_yaw_rate():
    u = command(4.0)
    mirrored = -driven(TWIN, CORNERS, -u)
    np.testing.assert_allclose(driven(TWIN, CORNERS, u), mirrored, rtol=0, atol=1e-13)


def test_cornering_is_bounded_by_friction():
    context = Context.of([0.3, 0.6, 1.0], 0.0, 20.0)
    command = np.full(6000, math.radians(20.0))
    # On average r v is a_y <= mu g; the vehicle slides, and speed falls by a fifth.
    bound = context.mu_s * Tyre().friction * GRAVITY / context.v_x
    assert (driven(TWIN, context, command).mean(axis=1) < 1.3 * bound).all()
    assert (driven(LinearTwin(), context, command).mean(axis=1) > 2 * bound).all()


@pytest.mark.parametrize("B", [1, 17])
def test_one_vehicle_does_not_depend_on_the_batch(B):
    context, rng = contexts(40, seed=5), np.random.default_rng(5)  # 10 to 33 m/s: 1 or 2 steps
    bits = rng.choice([-1.0, 1.0], (40, 5))
    u = np.repeat(math.radians(6.0) * bits, 100, axis=1)
    together = driven(TWIN, context, u)
    for i in range(0, 40, B):
        part = slice(i, i + B)
        np.testing.assert_array_equal(driven(TWIN, take(context, part), u[part]), together[part])


def actuator(command, rate_limit, Ts, omega=31.4, xi=0.9):
    """Angles and rates at the samples, and the pieces of every sample."""
    angle, rate, found = 0.0, 0.0, []
    pieces = np.zeros((PIECES, PIECE))
    for u in command:
        rate = cut(angle, rate, float(u), Ts, omega, xi, rate_limit, pieces)
        assert pieces[:, 0].sum() == pytest.approx(Ts, rel=1e-12)
        assert (pieces[:, 0] >= 0).all() and pieces[0, 1] == angle
        angle = pieces[-1, 3]
        found.append((angle, rate, int((pieces[:, 0] > 0).sum())))
    return np.array(found).T


@pytest.mark.parametrize("xi", [0.3, 0.9, 1.0, 1.4])
def test_the_limited_actuator_does_not_depend_on_the_sampling_time(xi):
    steps = np.repeat([0.1, -0.1, 0.05, 0.3], 100)
    fine = actuator(np.repeat(steps, 10), 0.8, 1e-4, xi=xi)
    coarse = actuator(steps, 0.8, 1e-3, xi=xi)
    np.testing.assert_allclose(coarse[:2], fine[:2, 9::10], rtol=0, atol=1e-12)
    assert np.abs(coarse[1]).max() == 0.8  # the limit acts, and holds
    assert coarse[2].max() > 1 and coarse[2].mean() < 1.2  # cut, but rarely


def test_the_command_is_clipped_to_the_angle_limit():
    narrow = replace(TWIN, limits=Limits(angle=math.radians(2.0)))
    np.testing.assert_array_equal(
        driven(narrow, CORNERS, command(4.0)), driven(narrow, CORNERS, command(2.0))
    )


@pytest.mark.parametrize("twin", [LinearTwin(), TWIN, replace(TWIN, tyre=Tyre(friction=0.8))])
def test_a_twin_is_rebuilt_from_its_parameters(twin):
    assert twin_from(json.loads(json.dumps(asdict(twin)))) == twin


def test_numerical_trouble_is_refused_beforehand():
    with pytest.raises(ValueError, match="steps of integration a sample"):
        driven(TWIN, Context.of(1.0, 0.0, 1e3), command(1.0), vehicle=Vehicle(l_rel_f=5e-4))
    with pytest.raises(ValueError, match="M_delta"):
        driven(TWIN, Context.of(0.5, 9000.0, 20.0), command(1.0))


BAD = [("tyre", "shape", 2.5), ("tyre", "friction_loss", 1.0), ("body", "front_share", 1.2)]
BAD += [("body", "drag", 1e6), ("limits", "rate", 1e9), ("limits", "angle", 35.0)]


def test_bad_and_unknown_parameters_are_refused():
    for part, setting, value in BAD:
        with pytest.raises(ValueError, match=f"{part} {setting} = "):
            NonlinearTwin.of(**{part: {setting: value}})
    for parts in ({"limits": {"speed": 1.0}}, {"tyre": 3.0}):
        with pytest.raises(ValueError, match=next(iter(parts))):
            NonlinearTwin.of(**parts)
