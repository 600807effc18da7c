"""Explanations of a recording that contradicts the plant, from the plant's suspects, in words.

Each suspect (`yawrate_env.plant.suspect`) adds one number to the plant's unknown parameters.
Those that promise most by their slope are fitted, with the parameters, by Gauss-Newton steps; the
one that leaves least of what the black box explains and the plant does not is named.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.fit import Fit
from yawrate_env.plant.calls import call
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.suspect import Suspect

Array = NDArray[np.float64]

_TRIED = 6  # suspects that are fitted
_STEPS = 12
_DAMPING = 1e6
_EXPLAINED = 0.75  # of the energy that contradicts: a suspect that explains it
_ALSO = 0.5  # of it: an error of the log alone that is asked about
_STEP = 1e-3  # of a range


@dataclass(frozen=True, slots=True)
class _Problem:
    """One recording, and the energy that no model of it can explain."""

    plant: Plant
    model: BlackBox
    i: int

    def errors(self, outputs: Array) -> Array:
        """Output errors (B, N), without what offset and free response explain."""
        error = self.model.y[self.i] - outputs
        return self.model.projected_like(self.i, error)

    @property
    def u(self) -> Array:
        """(1, N) input."""
        return self.model.u[[self.i % len(self.model.u)]]


def explanations(plant: Plant, model: BlackBox, fitted: Fit, i: int) -> tuple[str, ...]:
    """Sentences on what explains that recording `i` contradicts the plant; none may do.

    The first names what explains most; where it may be the plant, a second asks about the log.
    """
    if plant.suspects is None:
        return ()
    problem, theta = _Problem(plant, model, i), fitted.theta[i]
    left = float((problem.errors(plant.respond(theta[None], problem.u)) ** 2).sum())
    floor = float(model.residual[i])
    if not left > floor:
        return ()
    suspects = call("suspects", plant.suspects)
    promised = [_promised(problem, theta, suspect) for suspect in suspects]
    found = []
    for k in np.argsort(promised)[:_TRIED]:
        cost, value = _fitted(problem, theta, suspects[k])
        if value not in suspects[k].limits or value == suspects[k].nominal:
            found.append(((left - cost) / (left - floor), value, suspects[k]))
    found.sort(key=lambda each: -each[0])
    best = [each for each in found if each[0] >= _EXPLAINED][:1]
    best += [each for each in found if each[2].logged and each[0] >= _ALSO and each not in best][:1]
    return tuple(suspect.sentence(value) for _, value, suspect in best)


def _promised(problem: _Problem, theta: Array, suspect: Suspect) -> float:
    """Energy that a step of all parameters and the suspect's number would leave."""
    error, slopes = _slopes(problem, theta, suspect.nominal, suspect)
    solution = np.linalg.lstsq(slopes.T, error, rcond=1e-9)[0]
    return float(((error - solution @ slopes) ** 2).sum())


def _fitted(problem: _Problem, theta: Array, suspect: Suspect) -> tuple[float, float]:
    """Least energy left, and the suspect's number there."""
    plant, value, damping = problem.plant, suspect.nominal, 1e-4
    low, high = plant.limits
    free = plant.unknown
    error, slopes = _slopes(problem, theta, value, suspect)
    cost = float((error**2).sum())
    for _ in range(_STEPS):
        gram = slopes @ slopes.T
        lift = damping * np.diag(gram) + 1e-12 * np.trace(gram)
        step = np.linalg.solve(gram + np.diag(lift), slopes @ error)
        step *= min(1.0, 0.5 / max(np.abs(step[:-1]).max(initial=0.0), 1e-300))
        trial = theta.copy()
        trial[free] = np.clip(theta[free] + step[:-1] * plant.width, low[free], high[free])
        changed = float(np.clip(value + step[-1] * suspect.step, *suspect.limits))
        found = _slopes(problem, trial, changed, suspect)
        reached = float((found[0] ** 2).sum())
        if not reached < cost:
            damping *= 30
            if damping > _DAMPING:
                break
            continue
        done = cost - reached < 1e-4 * cost
        theta, value, cost, damping, (error, slopes) = trial, changed, reached, damping / 10, found
        if done:
            break
    return cost, value


def _slopes(problem: _Problem, theta: Array, value: float, suspect: Suspect) -> tuple[Array, Array]:
    """Output error (N,), and slopes (q + 1, N) to the parameters' ranges and the suspect's step."""
    plant, q = problem.plant, len(problem.plant.unknown)
    steps = np.zeros((q, len(theta)))
    steps[np.arange(q), plant.unknown] = _STEP * plant.width
    moved = np.concatenate([theta[None], theta + steps, theta - steps, theta[None], theta[None]])
    low, high = suspect.limits
    ends = [min(value + suspect.step, high), max(value - suspect.step, low)]
    values = np.concatenate([np.full(2 * q + 1, value), ends])
    errors = problem.errors(suspect.respond(moved, values, problem.u))
    inner = (errors[1 + q : 1 + 2 * q] - errors[1 : 1 + q]) / (2 * _STEP)
    own = (errors[-1] - errors[-2]) * suspect.step / (ends[0] - ends[1])
    return errors[0], np.concatenate([inner, own[None]])
