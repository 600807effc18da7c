"""Information left in averages and features, against linear algebra and the whole of it."""

import numpy as np
import pytest
from recordings import drawn

from studies.information import after_averaging, in_armax, in_laguerre
from tuners.features.laguerre import Laguerre
from tuners.trust.vehicle_bound import information, noise_variance
from yawrate_env.loop.simulation import simulate
from yawrate_env.vehicle.episode import excitation, plants
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Experiment, Task


def shares(part, whole):
    """Share of the information that is left in the worst and in the best direction, (B, 2)."""
    return np.sort(np.linalg.eigvals(np.linalg.solve(whole, part)).real, axis=1)


def outputs(task, draw, by_mu_s=0.0, by_mass=0.0):
    c = draw.context
    mass = (task.vehicle.M_0 + c.M_delta) * np.exp(by_mass)
    moved = Context(c.mu_s * np.exp(by_mu_s), mass - task.vehicle.M_0, c.v_x)
    u = excitation(task.experiment, draw.start)
    return simulate(plants(task.vehicle, moved, task.experiment.Ts), u)


@pytest.mark.parametrize("register", ["same", "random"])
def test_averages_of_single_samples_keep_everything(register):
    task = Task(experiment=Experiment(register=register))
    kept = shares(after_averaging(task, drawn(4), 1), information(task, drawn(4)))
    np.testing.assert_allclose(kept, 1, rtol=1e-6)


def test_longer_averages_keep_less():
    whole = information(Task(), drawn(4))
    kept = [shares(after_averaging(Task(), drawn(4), block), whole) for block in (10, 40, 160)]
    assert (kept[0] < 1).all() and (kept[1] < kept[0]).all() and (kept[2] < kept[1]).all()
    assert (kept[1] > 0.9).all()


@pytest.mark.parametrize("register", ["same", "random"])
def test_laguerre_coefficients_keep_what_their_regressors_span(register):
    task, stage = Task(experiment=Experiment(register=register)), Laguerre(6, 12.0)
    u, h = excitation(task.experiment, drawn(3).start), 1e-4
    steps = ((h, 0.0), (0.0, h))
    sides = [[outputs(task, drawn(3), s * a, s * b) for a, b in steps] for s in (1, -1)]
    variance = noise_variance(task, outputs(task, drawn(3)))
    found = in_laguerre(task, drawn(3), stage)
    for b in range(3):
        S = np.stack([(up[b] - down[b]) / (2 * h) for up, down in zip(*sides, strict=True)])
        Q, _ = np.linalg.qr(stage.regressors(u[[b % len(u)]], task.experiment.Ts)[0].T)
        np.testing.assert_allclose(found[b], (S @ Q) @ (S @ Q).T / variance[b], rtol=1e-6)


def test_more_functions_keep_more_and_in_the_end_everything():
    whole = information(Task(), drawn(5))
    kept = [shares(in_laguerre(Task(), drawn(5), Laguerre(n, 12.0)), whole) for n in (4, 8, 20)]
    assert (kept[0] < kept[1]).all() and (kept[1] < kept[2]).all()
    np.testing.assert_allclose(kept[2], 1, rtol=1e-4)


class Sums:
    """Six weighted sums of 250 averages, for which everything is known."""

    Ts = 0.04
    weights = np.random.default_rng(1).standard_normal((250, 6))

    def __call__(self, u, y, Ts):
        return y @ self.weights, np.ones(len(y), bool)


def test_recordings_tell_what_linear_algebra_does_of_linear_features():
    task, h, W = Task(), 1e-4, Sums.weights
    found = in_armax(task, drawn(3), Sums(), recordings=4000)
    variance = noise_variance(task, outputs(task, drawn(3))) / 40
    for b in range(3):
        sides = [
            outputs(task, drawn(3), *step)[b].reshape(250, 40).mean(axis=1)
            for step in ((h, 0.0), (-h, 0.0), (0.0, h), (0.0, -h))
        ]
        D = W.T @ np.stack([sides[0] - sides[1], sides[2] - sides[3]], axis=1) / (2 * h)
        expected = D.T @ np.linalg.solve(W.T @ W, D) / variance[b]
        # 4000 recordings: a standard error of 2.2 % for a variance.
        np.testing.assert_allclose(shares(found[[b]], expected[None]), 1, atol=0.08)
