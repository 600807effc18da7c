"""The PI controller as a C99 program."""

import numpy as np
from numpy.typing import NDArray

from tuners.export.digital_pi import DigitalPI
from tuners.export.programs import controller_program

TOLERANCES = {"double": 1e-12, "float": 2e-5}


def pi_program(pi: DigitalPI, *, real: str = "double", name: str = "yawrate_pi") -> dict[str, str]:
    """Header, source and test program, by file name.

    Parameters
    ----------
    pi : DigitalPI
        The controller.
    real : {"double", "float"}
        Type of all numbers.
    name : str
        Prefix of the files and of all that they declare.
    """
    errors, start = golden_errors(pi)
    signals = {"start": start, "errors": errors, "commands": pi.run(errors, start=start)}
    return controller_program("pi", pi, signals, TOLERANCES, real=real, name=name)


def golden_errors(pi: DigitalPI) -> tuple[NDArray[np.float64], tuple[float, float]]:
    """Errors (240,) that reach every branch of the program, and (error, command) at the start.

    Linear operation, both limits, the return from each, missing samples and absurd ones.
    """
    size = (pi.high - pi.low) / (8 * pi.gain)
    errors = size * np.random.default_rng(0).uniform(-1, 1, 240)
    errors[0] = 0.5 * size
    errors[60:110] = 12 * size
    errors[130:190] = -12 * size
    errors[[20, 21, 80, 150]] = np.nan, np.inf, -np.inf, np.nan
    errors[[40, 120, 200]] = 1e6 * size, -3e38, 3e38
    return errors, (float(errors[0]), pi.low + 0.6 * (pi.high - pi.low))
