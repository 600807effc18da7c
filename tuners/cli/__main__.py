"""``python -m tuners.cli`` is ``yawrate``."""

from tuners.cli import run

run()
