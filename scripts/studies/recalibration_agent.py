"""A recurrent policy for ``yawrate/PIRecalibration-v0``, taught by the simulator.

A gated recurrent unit (Cho et al., 2014) reads the environment's observations window by window
and gives the gains' two coordinates.  The simulator is the teacher: targets are the coordinates
that the design rule has for the vehicle of the window to come, and the loss is the margins'
distance, smoothed at its foot.  It sees what every agent sees, and nothing of the walk, the noise
or the rule but through drives.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.recalibration import Progress, Row, begun, interface, ride, row
from tuners.recalibration.follower import Follower
from yawrate_env.env.interface import Observation
from yawrate_env.env.recalibration_interface import FEATURES, RecalibrationInterface
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.drive_conditions import WINDOW_INTEGERS, Window
from yawrate_env.vehicle.drives import Course, Driven, Drives

Array = NDArray[np.float64]

HIDDEN, EPOCHS, BATCH, RATE = 48, 60, 64, 4e-3
_FOOT = 0.05  # of the distance, below which it is smooth
_PER_RADIAN, _PER_LOG = np.degrees(1.0) / 10.0, 7.0  # distance for an error of phase, and of gain
_EXPLORED = 0.3  # standard deviation of the gains' coordinates around the filter's, in actions


@dataclass(slots=True, eq=False)
class Taught:
    """A trained network as a rung."""

    network: Any
    made: RecalibrationInterface
    obs: Observation
    hidden: Any = None

    def gains(self, course: Course, coming: Window) -> Array:
        """The network's."""
        import torch

        speeds = self.made.drives.conditions.v_x
        self.obs[:, 8] = 2 * (coming.theta[:, 2] - speeds[0]) / (speeds[1] - speeds[0]) - 1
        with torch.no_grad():
            unit, self.hidden = self.network(torch.from_numpy(self.obs[:, None]), self.hidden)
        actions = np.concatenate([unit[:, 0].double().numpy(), np.ones((len(course), 1))], axis=1)
        return self.made.chosen(actions)

    def learn(self, before: Course, driven: Driven) -> None:
        """Remember what the window tells."""
        coming = Window(driven.theta, driven.reference, driven.u, driven.y)
        self.obs = self.made.observation(driven.estimate, driven.gains, coming)


def at_start(network: Any, made: RecalibrationInterface, start: Course) -> Taught:
    """Before the first window: nothing has been told, and the gains are those of the start."""
    count = len(start)
    obs = np.zeros((count, FEATURES), np.float32)
    obs[:, 6:8] = made.actions(start.gains)[:, :2]
    return Taught(network, made, obs)


def taught(made: RecalibrationInterface, drives: int, seed: int) -> Any:
    """Train a network on drives of a seed."""
    import torch

    torch.manual_seed(seed)
    torch.set_num_threads(1)  # small products: threads wait for each other
    obs, targets = (torch.from_numpy(a) for a in lessons(made, drives, seed))
    network = _network()
    optimiser = torch.optim.Adam(network.parameters(), RATE)
    steps = EPOCHS * -(-drives // BATCH)
    falling = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=steps)
    width = torch.from_numpy((made.high - made.low) / 2 * [_PER_LOG, _PER_RADIAN]).float()
    for epoch in range(EPOCHS):
        order = np.random.default_rng((seed, epoch)).permutation(drives)
        for first in range(0, drives, BATCH):
            rows = torch.from_numpy(order[first : first + BATCH])
            unit, _ = network(obs[rows], None)
            error = (unit - targets[rows]) * width
            loss = (error.square().sum(dim=2) + _FOOT**2).sqrt().mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            falling.step()
    return network


def lessons(made: RecalibrationInterface, count: int, seed: int) -> tuple[Observation, Observation]:
    """Observations (D, T, 9) before windows, and coordinates (D, T, 2) that suit them.

    Gains wander around the filter's, so that the network meets others than its own.
    """
    drives, rng = made.drives, np.random.default_rng(seed)
    course = begun(drives, seed, count, "train")
    follower = Follower.of(drives)
    belief, pupil = follower.known(course.theta), at_start(None, made, course)
    seen, wanted = [], []
    for t in range(made.windows):
        coming = drives.coming(course, stream((61, seed, 1 + t), 0, count, WINDOW_INTEGERS))
        low, high = drives.conditions.v_x
        pupil.obs[:, 8] = 2 * (coming.theta[:, 2] - low) / (high - low) - 1
        seen.append(pupil.obs.copy())
        wanted.append(made.actions(drives.designed(coming.theta))[:, :2])
        actions = made.actions(follower.gains(belief, coming.theta[:, 2]))
        actions[:, :2] += rng.normal(0, _EXPLORED, (count, 1)) * rng.standard_normal((count, 2))
        course, driven = drives.window(course, coming, made.chosen(actions))
        belief = follower.followed(belief, driven.estimate)
        pupil.learn(course, driven)
    return np.stack(seen, axis=1), np.stack(wanted, axis=1).astype(np.float32)


def rows(count: int, lessons: int, seeds: int, seed: int, progress: Progress) -> list[Row]:
    """Networks of several seeds, each taught by so many drives, on `count` drives of a test."""
    usual, found = interface(Drives.of()), []
    start = begun(usual.drives, seed, count)
    for own in range(seeds):
        network = taught(usual, lessons, own)
        rung = at_start(network, usual, start)
        name = f"recurrent network, {lessons} drives, seed {own}"
        found.append(row(name, ride(usual, rung, start, seed)))
        progress("networks", own + 1, seeds)
    return found


def _network() -> Any:
    import torch

    class Network(torch.nn.Module):
        """Gated recurrent unit and two heads."""

        def __init__(self) -> None:
            super().__init__()
            self.memory = torch.nn.GRU(FEATURES, HIDDEN, batch_first=True)
            self.last = torch.nn.Sequential(
                torch.nn.Linear(HIDDEN + FEATURES, HIDDEN), torch.nn.Tanh(),
                torch.nn.Linear(HIDDEN, 2),
            )  # fmt: skip

        def forward(self, obs: Any, hidden: Any) -> Any:
            """Coordinates in [-1, 1] (B, T, 2), and the state."""
            memory, hidden = self.memory(obs, hidden)
            return self.last(torch.cat([memory, obs], dim=2)), hidden

    return Network()
