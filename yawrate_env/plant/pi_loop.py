"""Linear plants in a PI loop: `ControlLoop` with its defaults, names of gains and metrics."""

from yawrate_env.plant.control_loop import (
    CROSSOVER_SCALE,
    PHASE_SCALE,
    ControlLoop,
    pulse_samples,
)

__all__ = ["CROSSOVER_SCALE", "GAINS", "METRICS", "PHASE_SCALE", "PILoop", "pulse_samples"]

GAINS = ("kp", "Ti")

METRICS = {"phase_margin [deg]": PHASE_SCALE, "crossover [Hz]": CROSSOVER_SCALE}
"""With the errors that count as one in the yaw-rate environment."""

PILoop = ControlLoop
