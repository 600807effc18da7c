"""Controllers of the PID's family, and state feedbacks, as C99 programs."""

import numpy as np
from numpy.typing import NDArray

from tuners.export.digital_pid import DigitalPID
from tuners.export.digital_state_feedback import DigitalStateFeedback
from tuners.export.pi_program import TOLERANCES
from tuners.export.programs import controller_program

Array = NDArray[np.float64]

_TOLERANCES = {"double": 1e-11, "float": 1e-3}
_COUNT = 240


def pid_program(
    pid: DigitalPID, *, real: str = "double", name: str = "yawrate_pid"
) -> dict[str, str]:
    """Header, source and test program, by file name.

    Parameters
    ----------
    pid : DigitalPID
        The controller.
    real : {"double", "float"}
        Type of all numbers.
    name : str
        Prefix of the files and of all that they declare.
    """
    reference, measured, start = golden_signals(pid)
    signals = {
        "start": start,
        "references": reference,
        "measured": measured,
        "commands": pid.run(reference, measured, start=start),
    }
    return controller_program("pid", pid, signals, _TOLERANCES, real=real, name=name)


def golden_signals(pid: DigitalPID) -> tuple[Array, Array, tuple[float, float, float]]:
    """References, outputs (240,), and the start, that reach every branch of the program.

    Linear operation on a reference that moves, both limits, the return from each, missing samples
    and absurd ones.
    """
    size = (pid.high - pid.low) / (8 * (pid.Kp + pid.half + abs(pid.rate)))
    rng = np.random.default_rng(0)
    reference = size * (60 + np.repeat(rng.uniform(-2, 2, _COUNT // 20), 20))
    errors = size * rng.uniform(-1, 1, _COUNT)
    errors[0] = 0.5 * size
    errors[60:110] = 40 * size
    errors[130:190] = -40 * size
    measured = reference - errors
    measured[[20, 21, 80, 150]] = np.nan, np.inf, -np.inf, np.nan
    measured[[40, 120, 200]] = -1e6 * size, 3e38, -3e38
    reference[[45, 205]] = np.nan, np.inf
    start = float(reference[0]), float(measured[0]), pid.low + 0.6 * (pid.high - pid.low)
    return reference, measured, start


def state_feedback_program(
    of: DigitalStateFeedback, *, real: str = "double", name: str = "yawrate_state_feedback"
) -> dict[str, str]:
    """Header, source and test program, by file name.

    Parameters
    ----------
    of : DigitalStateFeedback
        The controller.
    real : {"double", "float"}
        Type of all numbers.
    name : str
        Prefix of the files and of all that they declare.
    """
    rng, n = np.random.default_rng(0), len(of.gains)
    wide = of.high - of.low
    sizes = wide / np.maximum(np.abs(list(of.gains.values())), 1e-3 * wide)
    states = sizes * rng.uniform(-1, 1, (60, n))
    reference = wide / max(abs(of.reference_gain), 1e-3 * wide) * rng.uniform(-0.3, 0.3, 60)
    states[[20, 30], 0], reference[40], start = (np.nan, np.inf), np.nan, of.low + 0.6 * wide
    signals = {
        "start": start,
        "references": reference,
        "states": states.ravel(),
        "commands": of.run(reference, states, start=start),
    }
    return controller_program("state_feedback", of, signals, TOLERANCES, real=real, name=name)
