"""PID tuning for python-control systems: the rule of `yawrate_env.loop.design` from P to PIDF.

``C, info = pidtune(sys, "PI", wc=1.0, pm=60.0)`` gives the controller whose open loop falls
through magnitude 1 at `wc` [rad/s] with phase margin `pm` [deg], as MATLAB's ``pidtune`` does
(``docs/matlab.md``).  Nothing else needs this folder; plants and recordings do not belong here.
"""

from tuners.pidtune.tuning import Info, pidtune

__all__ = ["Info", "pidtune"]
