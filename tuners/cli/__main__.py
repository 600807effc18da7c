"""``python -m tuners.cli`` is ``yawrate``."""

from tuners.cli import main

main(prog_name="yawrate")
