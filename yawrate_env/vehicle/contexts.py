"""Named sets of contexts, so that results can be compared between people.

A set and a seed determine every episode; sets never share one, whatever the seeds.
"""

from dataclasses import dataclass

from yawrate_env import validation
from yawrate_env.signals.noise import KEY_WORDS
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.episode import WORDS, Draw
from yawrate_env.vehicle.task import Prior


@dataclass(frozen=True, slots=True)
class ContextSet:
    """A named family of episodes.

    Attributes
    ----------
    name : str
        What it is called.
    tag : int
        Keeps its random streams apart from every other set's.
    beyond : Prior or None
        A prior of its own, instead of the task's.
    """

    name: str
    tag: int
    beyond: Prior | None = None

    def draw(self, prior: Prior, seed: int, first: int, count: int, repeat: int = 0) -> Draw:
        """Episodes ``first`` to ``first + count`` of `seed`; speed is always the task's.

        Another `repeat` has the same vehicles and inputs, and fresh noise.
        """
        words = stream((self.tag, seed), first, count, WORDS)
        if repeat:
            words[:, -KEY_WORDS:] = stream((self.tag, seed, repeat), first, count, WORDS)[
                :, -KEY_WORDS:
            ]
        return Draw.of(words, self.prior(prior))

    def prior(self, of_task: Prior) -> Prior:
        """What the set's vehicles are drawn from: the task's prior, or beyond it."""
        if self.beyond is None:
            return of_task
        return Prior(self.beyond.mu_s, self.beyond.M_delta, of_task.v_x)


CONTEXT_SETS = {
    "train": ContextSet("train", 1),
    "test": ContextSet("test", 2),
    # Stickier and heavier than anything in eq. (12).
    "extrapolation": ContextSet("extrapolation", 3, Prior((1.1, 1.3), (300.0, 500.0))),
    "calibration": ContextSet("calibration", 4),
}


def context_set(name: str) -> ContextSet:
    """The set called `name`, or ``ValueError``."""
    return CONTEXT_SETS[validation.one_of("context", name, tuple(CONTEXT_SETS))]
