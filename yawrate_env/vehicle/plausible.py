"""What no car does in a recording worth tuning from: mostly, a unit is not the assumed one."""

import numpy as np

LARGEST_ANGLE = float(np.radians(45))
"""Steering at the road wheel [rad]."""

LARGEST_YAW_RATE = 10.0
"""[rad/s]."""

LARGEST_SPEED = 150.0
"""[m/s]."""

STILL = 1e-9
"""Peak to peak, what stands still [rad], [rad/s]."""

STEADY, UNSTEADY = 0.05, 0.25
"""Variation of the speed, of its mean, that makes no difference, and that no mean describes."""
