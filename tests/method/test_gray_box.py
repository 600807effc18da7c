"""Identification of friction and mass, and its sums of sensitivities."""

import itertools

import numpy as np
import pytest
from recordings import drawn, recorded

from tuners.trust.vehicle_identification import identify, output_gram
from tuners.tuner.gray_box import GrayBox
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import nominal_context
from yawrate_env.loop.simulation import simulate
from yawrate_env.vehicle.episode import excitation, loops, plants, record
from yawrate_env.vehicle.single_track import Context, Vehicle, total_mass
from yawrate_env.vehicle.task import Experiment, Prior, Task

CORNERS = np.array(list(itertools.product((0.3, 0.7, 1.1), (0.0, 300.0), (10.0, 20.0, 33.0)))).T
START = nominal_context(Prior())


def noise_free(context, experiment):
    u = excitation(experiment, np.arange(len(context), dtype=np.uint64) * np.uint64(997))
    y = simulate(plants(Vehicle(), context, experiment.Ts), u)
    return Recording(u, y, experiment.Ts, context.v_x, context)


def found_in(recording):
    speeds = np.full(len(recording), 20.0) if recording.v_x is None else recording.v_x
    return identify(Vehicle(), recording, START, speeds)


@pytest.mark.parametrize(
    "experiment",
    [
        Experiment(),
        Experiment(Ts=0.01, N=1000),
        Experiment(register="random"),
        Experiment(N=2500),
    ],
    ids=["default", "100 Hz", "own inputs", "short"],
)
def test_finds_noise_free_vehicles_from_the_middle_of_the_prior(experiment):
    context = Context.of(*CORNERS)
    found = found_in(noise_free(context, experiment))
    assert found.converged.all()
    np.testing.assert_allclose(found.context.mu_s, context.mu_s, rtol=1e-6)
    np.testing.assert_allclose(
        total_mass(Vehicle(), found.context), total_mass(Vehicle(), context), rtol=1e-6
    )
    assert (found.steps < 20).all()  # Gauss-Newton without residual is quadratic


def test_finds_vehicles_beyond_the_prior():
    context = Context.of([1.3, 0.15], [500.0, -200.0], 20.0)
    found = found_in(noise_free(context, Experiment()))
    assert found.converged.all()
    np.testing.assert_allclose(found.context.mu_s, context.mu_s, rtol=1e-6)
    np.testing.assert_allclose(found.context.M_delta, context.M_delta, rtol=1e-5)


def test_cost_is_the_noise_variance_less_two_parameters():
    recording = recorded(20)
    found = found_in(recording)
    clean = simulate(plants(Vehicle(), drawn(20).context, 0.001), recording.u)
    variance = (clean**2).mean(axis=1) * 1e-3  # 30 dB
    assert found.converged.all()
    # Means of 10 000 squares of noise: standard error 1.4 %.
    np.testing.assert_allclose(found.cost, variance, rtol=5 * 0.0142)
    truth = output_gram(Vehicle(), drawn(20).context, recording, np.arange(20))[:, 0, 0] / 10_000
    assert (found.cost < truth).all()  # a minimum is below the truth,
    np.testing.assert_allclose(found.cost, truth, rtol=2e-3)  # by about 2 in 10 000


def test_the_found_cost_is_a_minimum():
    recording = recorded(3)
    found = found_in(recording)
    mass = total_mass(Vehicle(), found.context)
    for by_mu_s, by_mass in ((1e-3, 0), (-1e-3, 0), (0, 1e-3), (0, -1e-3)):
        beside = Context(
            found.context.mu_s * (1 + by_mu_s), mass * (1 + by_mass) - 1895, found.context.v_x
        )
        gram = output_gram(Vehicle(), beside, recording, np.arange(3))
        assert (gram[:, 0, 0] / 10_000 > found.cost).all()


@pytest.mark.parametrize("register", ["same", "random"])
def test_sums_against_finite_differences_of_the_simulation(register):
    recording = recorded(3, Experiment(register=register, N=3000))
    context = Context.of([0.35, 0.8, 1.05], [280.0, 10.0, 150.0], [12.0, 20.0, 31.0])
    mass, h = total_mass(Vehicle(), context), 1e-5  # truncation and rounding both near 1e-10

    def response(by_mu_s, by_mass):
        moved = Context(context.mu_s * np.exp(by_mu_s), mass * np.exp(by_mass) - 1895, context.v_x)
        return simulate(plants(Vehicle(), moved, recording.Ts), recording.u)

    rows = np.stack(
        [
            recording.y - response(0, 0),
            (response(h, 0) - response(-h, 0)) / (2 * h),
            (response(0, h) - response(0, -h)) / (2 * h),
        ],
        axis=1,
    )
    expected = rows @ rows.transpose(0, 2, 1)
    found = output_gram(Vehicle(), context, recording, np.arange(3))
    scale = np.sqrt(np.einsum("bii,bjj->bij", expected, expected))  # of vectors that may be normal
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-7)


def test_rows_choose_episodes():
    recording = recorded(5, Experiment(register="random"))
    rows = np.array([4, 0, 4])
    context = Context.of([0.4, 0.5, 0.6], 100.0, 20.0)
    found = output_gram(Vehicle(), context, recording, rows)
    for i, row in enumerate(rows):
        one = Context(context.mu_s[[i]], context.M_delta[[i]], context.v_x[[i]])
        alone = output_gram(Vehicle(), one, recording.part(slice(row, row + 1)), np.zeros(1, int))
        np.testing.assert_array_equal(found[[i]], alone)


@pytest.mark.parametrize("register", ["same", "random"])
@pytest.mark.parametrize("count", [1, 3, 17])
def test_an_episodes_vehicle_does_not_depend_on_the_batch(register, count):
    whole = recorded(20, Experiment(register=register))
    found, part = found_in(whole), found_in(whole.part(slice(0, count)))
    for name in ("mu_s", "M_delta"):
        np.testing.assert_array_equal(
            getattr(part.context, name), getattr(found.context, name)[:count]
        )
    np.testing.assert_array_equal(part.cost, found.cost[:count])
    np.testing.assert_array_equal(part.steps, found.steps[:count])


N = 10_000
U, Y = recorded(1).u[0], recorded(1).y[0]
HOPELESS = {
    "zero output": (U, np.zeros(N)),
    "constant output": (U, np.full(N, 0.1)),
    "zero input": (np.zeros(N), Y),
    "nothing": (np.zeros(N), np.zeros(N)),
    "wrong sign": (U, -Y),
    "degrees": (U, np.degrees(Y)),
    "noise": (U, np.random.default_rng(0).standard_normal(N)),
}


@pytest.mark.parametrize("case", HOPELESS)
def test_hopeless_data_are_not_called_converged(case):
    u, y = HOPELESS[case]
    result = GrayBox(Task()).tune(u, y, 0.001)
    assert not result.converged
    assert any("did not converge" in note for note in result.notes)
    assert np.isfinite([result.kp, result.Ti]).all() and result.kp > 0 and result.Ti > 0


def test_hopeless_episodes_leave_their_neighbours_alone():
    u = np.array([u for u, _ in HOPELESS.values()] + [U])
    y = np.array([y for _, y in HOPELESS.values()] + [Y])
    among, alone = found_in(Recording(u, y, 0.001)), found_in(recorded(1))
    assert among.converged.tolist() == [False] * len(HOPELESS) + [True]
    assert among.context.mu_s[-1] == alone.context.mu_s[0]
    assert among.context.M_delta[-1] == alone.context.M_delta[0]


def test_gains_are_the_design_rules_for_the_found_vehicle():
    context = Context.of(*CORNERS[:, CORNERS[2] == 20.0])
    design, converged = GrayBox(Task()).gains(noise_free(context, Experiment()))
    truth = loops(Task(), context).design()
    assert converged.all()
    # 1e-6 of the parameters; Ti of the slippery vehicles is ten times as sensitive.
    np.testing.assert_allclose(design.kp, truth.kp, rtol=1e-5)
    np.testing.assert_allclose(design.Ti, truth.Ti, rtol=1e-4)


def test_the_speed_is_the_recordings_or_the_tuners_own():
    task = Task(prior=Prior(v_x=(10.0, 33.0)))
    recording = noise_free(Context.of(0.5, 100.0, 27.0), Experiment())
    truth = loops(task, Context.of(0.5, 100.0, 27.0)).design()
    with pytest.raises(ValueError, match="v_x is needed: this tuner covers 10 to 33 m/s"):
        GrayBox(task).tune(recording.u[0], recording.y[0], 0.001)
    found = GrayBox(task).tune(recording.u[0], recording.y[0], 0.001, v_x=27.0)
    assert found.kp == pytest.approx(truth.kp[0], rel=1e-5) and not found.notes
    assumed = GrayBox(Task()).tune(recording.u[0], recording.y[0], 0.001)  # 20 m/s
    assert assumed.kp != pytest.approx(truth.kp[0], rel=1e-2)


def test_the_known_vehicle_is_the_tasks():
    task = Task(vehicle=Vehicle(omega_n=40.0, C_f=110e3))
    u, y = record(task, drawn(3))
    design, converged = GrayBox(task).gains(Recording(u, np.asarray(y), 0.001))
    truth = loops(task, drawn(3).context).design()
    assert converged.all()
    np.testing.assert_allclose(design.kp, truth.kp, rtol=5e-3)  # 30 dB
    ignorant, _ = GrayBox(Task()).gains(Recording(u, np.asarray(y), 0.001))
    assert (abs(ignorant.kp / truth.kp - 1) > 0.02).all()


def test_a_wrong_yaw_inertia_biases_the_parameters_and_not_the_gains():
    # mu_s, M_veh and J_z scaled together leave the dynamics as they are.
    context = Context.of([0.4, 0.9], [50.0, 250.0], 20.0)
    recording = noise_free(context, Experiment())
    wrong = Vehicle(J_z=1.2 * Vehicle().J_z)
    found = identify(wrong, recording, START, context.v_x)
    np.testing.assert_allclose(found.context.mu_s, 1.2 * context.mu_s, rtol=1e-6)
    np.testing.assert_allclose(
        total_mass(wrong, found.context), 1.2 * total_mass(Vehicle(), context), rtol=1e-6
    )
    truth = loops(Task(), context).design()
    design, _ = GrayBox(Task(vehicle=wrong)).gains(recording)
    np.testing.assert_allclose(design.kp, truth.kp, rtol=1e-5)
