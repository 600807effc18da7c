"""Write examples/log.csv: a drive that no tuner was trained on, simulated by python-control.

    python scripts/make_example_log.py [--output examples/log.csv]

Another register than the training's and 18 m/s; sampled at 100 Hz, starting in mid-drive,
with an offset on both channels and noise.  Friction 0.8 and a load of 120 kg are what a
tuner does not know.
"""

import argparse
from pathlib import Path

import control
import numpy as np

from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.single_track import Context, Vehicle, state_space

MU_S, M_DELTA, V_X = 0.8, 120.0, 18.0
FINE, EVERY = 0.001, 10
START, END = 3.0, 15.0  # [s] of the drive that was recorded
STEER_OFFSET, YAW_RATE_OFFSET = np.radians(0.1), np.radians(0.2)
SNR_DB = 30.0


def drive() -> np.ndarray:
    """Columns t, steer, yaw_rate, speed of the recorded part, (N, 4)."""
    time = FINE * np.arange(round(END / FINE))
    register = {"order": 14, "start": np.array([77], np.uint64)}
    command = prbs(len(time), FINE, 0.1, np.radians(1.0), **register)[0]
    A, B, C = state_space(Vehicle(), Context.of(MU_S, M_DELTA, V_X))
    plant = control.ss(A[0], B[0][:, None], C[None], 0).sample(FINE, "zoh")
    yaw_rate = control.forced_response(plant, inputs=command).outputs
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(len(time)) * 10 ** (-SNR_DB / 20) * yaw_rate.std()
    columns = [
        time,
        command + STEER_OFFSET,
        yaw_rate + noise + YAW_RATE_OFFSET,
        np.full(len(time), V_X),
    ]
    return np.stack(columns, axis=1)[round(START / FINE) :: EVERY]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    default = Path(__file__).parents[1] / "examples" / "log.csv"
    parser.add_argument("--output", type=Path, default=default)
    args = parser.parse_args()
    np.savetxt(
        args.output, drive(), fmt=["%.2f", "%.6f", "%.6f", "%.2f"], delimiter=",", comments="",
        header="t,steer,yaw_rate,speed",
    )  # fmt: skip


if __name__ == "__main__":
    main()
