"""PID tuning for python-control: MATLAB's ``pidtune``, as far as it can be done honestly.

``C, info = pidtune(sys, "PI", wc=1.0, pm=60.0)`` gives the controller whose open loop falls
through magnitude 1 at `wc` [rad/s] with phase margin `pm` [deg].
"""

from tuners.pidtune.tuning import Info, pidtune

__all__ = ["Info", "pidtune"]
