"""Plausibility limits; values beyond them usually mean wrong units."""

import numpy as np

LARGEST_ANGLE = float(np.radians(45))
"""Steering at the road wheel [rad]."""

LARGEST_YAW_RATE = 10.0
"""[rad/s]."""

LARGEST_SPEED = 150.0
"""[m/s]."""
