"""Train a tuner for a plant whose simulator takes long: calls, time, and the answer's cost.

    python scripts/slow_plant.py                      # 50 ms a simulation, all cores
    python scripts/slow_plant.py --seconds 0.2 --workers 4 --results results

The plant is the lag of docs/plants.md; its simulator waits as long as asked.  Printed are the
simulations of a default training, its time beside that of the simulations alone, how many
simulations a recording of the experiment takes and one of another input, by how many standard
deviations an emulator's error moves the latter's metrics, and the counts for the same plant
without ``slow``.
"""

import json
import time
from pathlib import Path

import click
import numpy as np
from scipy.signal import lfilter

import tuners
from tuners.tuner.emulator_check import emulator_shift
from tuners.tuner.simulations import STAGE
from yawrate_env.compiled import cores
from yawrate_env.plant import Plant
from yawrate_env.signals.excitation import multilevel, prbs

U = prbs(N=500, Ts=0.02, bit_time=0.5, amplitude=1.0)[0]
OTHER = multilevel(N=600, Ts=0.02, bit_time=0.4, amplitude=0.8, levels=4)[0]
"""Inputs of the experiment, and of a recording that no training has seen."""


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


def described(lag: Lag, slow: bool) -> Plant:
    return Plant(
        prior={"K": (0.5, 2.0), "T": (0.2, 1.0)},
        simulate=lag, design=design, gains=("kp", "Ti"), batched=False, slow=slow,
        u=U, Ts=0.02, noise=0.02,
    )  # fmt: skip


def calls_of_tune(tuner: tuners.Tuner, lag: Lag, u: np.ndarray) -> int:
    """Most simulations that a recording with an input takes."""
    most = 0
    for K, T in ((0.6, 0.9), (1.3, 0.45), (1.9, 0.25), (0.8, 0.75)):
        y = lag(np.array([K, T]), u, None)
        before = lag.calls
        tuner.tune(u, y + 0.02 * np.random.default_rng(1).standard_normal(len(u)))
        most = max(most, lag.calls - before)
    return most


@click.command()
@click.option("--seconds", type=float, default=0.05, show_default=True, help="A simulation.")
@click.option("--workers", type=int, help="Processes. [default: one a core]")
@click.option("--results", type=click.Path(path_type=Path), help="Folder for slow_plant.json.")
def main(seconds: float, workers: int | None, results: Path | None) -> None:
    """Print calls and times."""
    lag, workers = Lag(seconds), workers or cores()
    counted = [0]

    def progress(what: str, done: int, of: int) -> None:
        if what == STAGE:
            counted[0] = done

    begun = time.perf_counter()
    tuner = tuners.train(described(lag, True), workers=workers, progress=progress)
    taken, alone = time.perf_counter() - begun, counted[0] * seconds / workers
    found = {
        "simulations": counted[0],
        "of_a_recording": calls_of_tune(tuner, lag, tuner.plant.u),
        "of_another_input": calls_of_tune(tuner, lag, OTHER),
        "shift_of_another_input": round(emulator_shift(tuner, u=OTHER, plants=8), 4),
    }
    shift = tuner.training["emulator"]["shift"]
    plain = Lag(0.0)
    tuner = tuners.train(described(plain, False))
    found |= {
        "simulations_plain": plain.calls,
        "of_a_recording_plain": calls_of_tune(tuner, plain, U),
    }
    click.echo(json.dumps(found, indent=1))
    click.echo(
        f"{taken:.0f} s, {taken / alone:.2f} times the {alone:.0f} s of the simulations on "
        f"{workers} cores; the emulator moves metrics by {shift:.2g} of their standard deviations"
    )
    if results is not None:
        (results / "slow_plant.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
