"""``python -m tuners.cli`` is ``yawrate``."""

from tuners.cli import run

if __name__ == "__main__":
    run()
