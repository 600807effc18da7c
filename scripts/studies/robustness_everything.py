"""Would a simulator with every parameter uncertain be a rung?  Its errors beside the black box's.

PYTHONPATH=scripts python -m studies.robustness_everything

Eleven parameters, nine of them by ±30 % of the vehicle's, are drawn to their prior and fitted by
damped Gauss-Newton steps to recordings of vehicles that are wrong.  It is no rung: docs/trust.md.
"""

from dataclasses import replace

import numpy as np

import tuners
from studies.draws import task_of
from studies.drives import record
from studies.faulty import Array
from studies.players import CLIMBER
from studies.robustness import Condition
from studies.robustness_kinds import VEHICLE
from studies.trusting import MISS
from tuners.trust.black_box import BlackBox
from tuners.trust.bound import PRECISION
from tuners.trust.identification import output_slopes
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.yaw_rate import yaw_rate

UNSURE = 0.3  # of the own value of the vehicle

KINDS = "all ± 5 %", "all ± 30 %, another car", "dead time up to 40 ms"
CONDITIONS = Condition(14.0, 5.0), Condition(20.0, 5.0)
COUNT, SEED = 100, 11
UNCERTAIN = "J_z", "l_f", "l_r", "C_f", "C_r", "l_rel_f", "l_rel_r", "omega_n", "xi"
STEPS = 25


def fitted(plant: Plant, model: BlackBox, start: Array) -> tuple[Array, Array]:
    """Most likely parameters (B, p), and the residual's energy over the black box's (B,)."""
    theta, free, (low, high) = start, plant.unknown, plant.limits
    noise, damping = model.residual / model.y.shape[1], np.full(len(start), 1e-2)

    def cost_of(at: Array) -> tuple[Array, Array]:
        error = model.projected((model.y - plant.respond(at, model.u))[:, None])[:, 0]
        away = (((at - start)[:, free] / plant.width) ** 2).sum(axis=1)
        return error, (error**2).sum(axis=1) / noise + PRECISION * away

    error, cost = cost_of(theta)
    for _ in range(STEPS):
        slopes = model.projected(output_slopes(plant, theta, model.u))
        gram = slopes @ slopes.swapaxes(1, 2) / noise[:, None, None]
        gram += PRECISION * np.eye(len(free))
        right = (slopes @ error[..., None])[..., 0] / noise[:, None]
        right -= PRECISION * (theta - start)[:, free] / plant.width
        scale = damping[:, None, None] * np.einsum("bii->bi", gram)[:, :, None] * np.eye(len(free))
        step = np.clip(np.linalg.solve(gram + scale, right[..., None])[..., 0], -0.5, 0.5)
        trial = theta.copy()
        moved = theta[:, free] + step * plant.width
        trial[:, free] = np.clip(moved, low[free], high[free])
        missed, reached = cost_of(trial)
        better = reached < cost
        damping *= np.where(better, 0.2, 10.0)
        theta, error = (
            np.where(better[:, None], *pair) for pair in ((trial, theta), (missed, error))
        )
        cost = np.where(better, reached, cost)
    return theta, (error**2).sum(axis=1) / model.residual


def main() -> None:
    tuner = tuners.load(CLIMBER)
    task = task_of(tuner.plant)
    ranges = {
        n: tuple(getattr(task.vehicle, n) * f for f in (1 - UNSURE, 1 + UNSURE)) for n in UNCERTAIN
    }
    plant = yaw_rate(replace(task, prior=replace(task.prior, **ranges)), check=False)
    for kind in KINDS:
        for condition in CONDITIONS:
            own = condition.of(task)
            made = record(VEHICLE[kind], own, np.random.default_rng(SEED), COUNT)
            _, found = tuner.climb(made.recording)
            assert found.response is not None and made.recording.known is not None
            start = np.tile(plant.middle, (COUNT, 1))
            start[:, plant.indices(("v_x",))] = made.recording.known[:, 2:]
            theta, left = fitted(plant, found.model, start)
            goal, reachable = made.reachable(task)
            goal[reachable] = task.target.phase_margin, task.target.crossover
            words = []
            for name, gains in (
                ("black box", found.response.gains),
                ("everything uncertain", plant.designs(theta)[0]),
            ):
                metrics, stable = made.reached(task, gains)
                error = np.where(stable[:, None], metrics - goal, np.nan)
                misses = int((~(np.abs(error) <= MISS).all(axis=1)).sum())
                rms = np.sqrt(np.nanmean(error[:, 0] ** 2))
                words.append(f"{name} rms {rms:.2f}°, {misses} misses")
            contradicted = int((left > 1.02).sum())
            print(f"{kind}, {condition.name}: {'; '.join(words)}; {contradicted} contradicted")


if __name__ == "__main__":
    main()
