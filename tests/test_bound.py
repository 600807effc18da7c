"""The Cramer-Rao bound against finite differences and against an efficient estimator."""

import numpy as np
import pytest
from recordings import drawn

from tuners.bound import cramer_rao, margin_sensitivity
from tuners.gray_box import GrayBox
from tuners.recording import Recording
from yawrate_env.batch import take
from yawrate_env.contexts import CONTEXT_SETS
from yawrate_env.episode import Draw, excitation, plants, record
from yawrate_env.judge import Judge
from yawrate_env.simulation import simulate
from yawrate_env.task import Experiment, Prior, Target, Task
from yawrate_env.vehicle import Context, Vehicle


def moved(context, by_mu_s, by_M_delta):
    return Context(context.mu_s + by_mu_s, context.M_delta + by_M_delta, context.v_x)


@pytest.mark.parametrize("register", ["same", "random"])
def test_bound_against_finite_differences_in_physical_parameters(register):
    task = Task(experiment=Experiment(register=register), prior=Prior(v_x=(10.0, 33.0)))
    draw = CONTEXT_SETS["test"].draw(task.prior, 0, 0, 5)
    truth, u = Judge.of(task, draw.context), excitation(task.experiment, draw.start)
    steps = [(1e-5, 0.0), (0.0, 0.02)]  # of mu_s, and of M_delta [kg]

    def response(*step):
        return simulate(plants(task.vehicle, moved(draw.context, *step), 0.001), u)

    def margins(*step):
        gains = Judge.of(task, moved(draw.context, *step)).oracle()
        found = truth(gains.kp, gains.Ti).margins
        return np.stack([found.phase_margin, found.crossover], axis=1)

    def derivative(of):
        return np.stack([(of(a, b) - of(-a, -b)) / (2 * (a + b)) for a, b in steps], axis=1)

    sensitivity, J = derivative(response), derivative(margins)
    sigma2 = (response(0, 0) ** 2).mean(axis=1) / 1000
    for b, spread in enumerate(cramer_rao(task, draw)):
        F = sensitivity[b] @ sensitivity[b].T / sigma2[b]
        covariance = J[b].T @ np.linalg.inv(F) @ J[b]
        # Margins are found to 1e-12 and divided by steps of 1e-5.
        np.testing.assert_allclose(spread, np.sqrt(np.diag(covariance)), rtol=1e-5)


def test_margins_move_with_the_estimate():
    context = drawn(3).context
    J = margin_sensitivity(Task(), context)
    assert J.shape == (3, 2, 2)
    step = 1e-3
    better_grip = Context(context.mu_s * np.exp(step), context.M_delta, context.v_x)
    gains = Judge.of(Task(), better_grip).oracle()
    found = Judge.of(Task(), context)(gains.kp, gains.Ti).margins
    # First order: the remainder is of the order of the step.
    np.testing.assert_allclose(found.phase_margin - 60, step * J[:, 0, 0], rtol=0.02)
    np.testing.assert_allclose(found.crossover - 1.5, step * J[:, 1, 0], rtol=0.02)


def test_twenty_decibels_are_a_factor_of_ten():
    spreads = [cramer_rao(Task(experiment=Experiment(snr_db=s)), drawn(5)) for s in (10, 30, 50)]
    np.testing.assert_allclose(spreads[0], 10 * spreads[1], rtol=1e-12)
    np.testing.assert_allclose(spreads[1], 10 * spreads[2], rtol=1e-12)


def test_amplitude_does_not_matter_at_a_given_signal_to_noise_ratio():
    strong = Task(experiment=Experiment(amplitude=0.05))
    np.testing.assert_allclose(cramer_rao(strong, drawn(5)), cramer_rao(Task(), drawn(5)))


def test_longer_episodes_tell_more():
    longer = Task(experiment=Experiment(N=20_000))
    ratio = cramer_rao(longer, drawn(5)) / cramer_rao(Task(), drawn(5))
    # Twice the data; 200 bits of the register are not twice its first 100.
    np.testing.assert_allclose(ratio, 0.5**0.5, rtol=0.05)


def test_root_mean_square_over_the_prior_is_near_an_independent_programs():
    spread = cramer_rao(Task(), drawn(300))
    rms = np.sqrt((spread**2).mean(axis=0))
    # A prototype that shares no code found 0.0097 deg and 0.00037 Hz over other vehicles.
    np.testing.assert_allclose(rms, [0.0097, 0.00037], rtol=0.08)


@pytest.mark.slow
@pytest.mark.parametrize("context", [(0.35, 250.0), (1.0, 50.0)])
def test_the_gray_box_sits_on_the_bound(context):
    count, task = 800, Task()
    draw = CONTEXT_SETS["test"].draw(task.prior, 5, 0, count)
    same = Context.of(np.full(count, context[0]), context[1], 20.0)
    draw = Draw(same, draw.start, draw.key)
    u, y = record(task, draw)
    design, converged = GrayBox(task).gains(Recording(u, np.asarray(y), 0.001))
    found = Judge.of(task, same)(design.kp, design.Ti).margins
    bound = cramer_rao(task, take(draw, slice(0, 1)))[0]
    assert converged.all()
    results = (found.phase_margin, 60.0, bound[0]), (found.crossover, 1.5, bound[1])
    for values, middle, least in results:
        # Standard errors of 800 episodes: 2.5 % of a spread, 3.5 % of it for a mean.
        assert values.std() == pytest.approx(least, rel=4 * 0.025)
        assert abs(values.mean() - middle) < 4 * 0.035 * least


def test_other_targets_and_vehicles_are_taken_into_account():
    plain = cramer_rao(Task(), drawn(3))
    for task in (Task(target=Target(crossover=1.0)), Task(vehicle=Vehicle(J_z=3000.0))):
        assert (abs(cramer_rao(task, drawn(3)) / plain - 1) > 0.01).all()
