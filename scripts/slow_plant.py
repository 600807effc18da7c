"""Train a tuner for a plant whose simulator takes long: calls, time, and the answer's cost.

    python scripts/slow_plant.py                      # 50 ms a simulation, all cores
    python scripts/slow_plant.py --seconds 0.2 --workers 4

The plant is the lag of docs/plants.md; its simulator waits as long as asked.  Printed are the
simulations of a default training, its time beside that of the simulations alone, and how many
simulations one recording takes.
"""

import time

import click
import numpy as np
from scipy.signal import lfilter

import tuners
from tuners.tuner.simulations import STAGE
from yawrate_env.compiled import cores
from yawrate_env.plant import Plant
from yawrate_env.signals.excitation import prbs


class Lag:
    """A lag K/(T s + 1), sampled every 20 ms; calls are counted in its own process."""

    def __init__(self, seconds: float) -> None:
        self.seconds, self.calls = seconds, 0

    def __call__(self, theta, u, rng):
        self.calls += 1
        time.sleep(self.seconds)
        K, T = theta
        a = np.exp(-0.02 / T)
        return lfilter([0, K * (1 - a)], [1, -a], u)


def design(theta):
    K, T = theta
    return T / (0.3 * K), T


@click.command()
@click.option("--seconds", type=float, default=0.05, show_default=True, help="A simulation.")
@click.option("--workers", type=int, help="Processes. [default: one a core]")
def main(seconds: float, workers: int | None) -> None:
    """Print calls and times."""
    lag, workers = Lag(seconds), workers or cores()
    plant = Plant(
        prior={"K": (0.5, 2.0), "T": (0.2, 1.0)},
        simulate=lag, design=design, gains=("kp", "Ti"), batched=False, slow=True,
        u=prbs(N=500, Ts=0.02, bit_time=0.5, amplitude=1.0)[0], Ts=0.02, noise=0.02,
    )  # fmt: skip
    counted = [0]

    def progress(what: str, done: int, of: int) -> None:
        if what == STAGE:
            counted[0] = done

    begun = time.perf_counter()
    tuner = tuners.train(plant, workers=workers, progress=progress)
    taken, alone = time.perf_counter() - begun, counted[0] * seconds / workers
    click.echo(
        f"{counted[0]} simulations; {taken:.0f} s, {taken / alone:.2f} times the {alone:.0f} s of "
        f"the simulations on {workers} cores; emulator: {tuner.training['emulator']}"
    )
    y = lag(np.array([1.3, 0.45]), plant.u, None)
    y = y + 0.02 * np.random.default_rng(1).standard_normal(len(y))
    before, begun = lag.calls, time.perf_counter()
    result = tuner.tune(plant.u, y)
    click.echo(
        f"one recording: {lag.calls - before} simulations, {time.perf_counter() - begun:.2f} s, "
        f"{result.verdict.value}"
    )


if __name__ == "__main__":
    main()
