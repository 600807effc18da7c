"""Controllers as MATLAB scripts, and as function blocks of IEC 61131-3 structured text."""

from tuners.export import literals
from tuners.export.digital_pi import DigitalPI
from tuners.export.digital_pid import DigitalPID
from tuners.export.digital_state_feedback import DigitalStateFeedback
from tuners.export.programs import REALS, render
from yawrate_env import validation

_TYPES = {"double": ("LREAL", "1.0E308"), "float": ("REAL", "3.0E38")}
"""Of structured text, and the largest number that counts as finite."""


def matlab_script(pid: DigitalPID) -> str:
    """A script: objects of the Control System Toolbox, and a function for every sample.

    They are ``pid`` and ``pidstd`` of the error, or ``pid2`` and ``pidstd2`` of reference and
    measurement where these differ, and ``tf``.
    """
    reference, output, command = pid.difference_equation()
    values = {
        "pid": pid,
        "one": reference == output,
        "standard": pid.Kp > 0 and pid.Ki > 0 and pid.Kd >= 0,
        "reference": reference,
        "output": output,
        "command": command,
    }
    return render("pid.m", values)


def pi_script(pi: DigitalPI) -> str:
    """The script of a PI, as `matlab_script` has it."""
    return matlab_script(DigitalPID.of_pi(pi))


def state_feedback_script(of: DigitalStateFeedback) -> str:
    """The script of a state feedback, a static ``ss`` from reference and states."""
    return render("state_feedback.m", {"state_feedback": of})


def pid_block(pid: DigitalPID, *, real: str = "double", name: str = "YawratePid") -> str:
    """A function block with automatic and manual mode, saturation and back-calculation.

    Parameters
    ----------
    pid : DigitalPID
        The controller.
    real : {"double", "float"}
        Type of all numbers: LREAL or REAL.
    name : str
        Of the block.
    """
    return _block("pid", {"pid": pid}, real, name)


def pi_block(pi: DigitalPI, *, real: str = "double", name: str = "YawratePid") -> str:
    """The function block of a PI, as `pid_block` has it."""
    return pid_block(DigitalPID.of_pi(pi), real=real, name=name)


def state_feedback_block(
    of: DigitalStateFeedback, *, real: str = "double", name: str = "YawrateStateFeedback"
) -> str:
    """A function block with an input for each state.

    Parameters
    ----------
    of : DigitalStateFeedback
        The controller.
    real, name
        As of `pid_block`.
    """
    return _block("state_feedback", {"state_feedback": of}, real, name)


def _block(template: str, values: dict[str, object], real: str, name: str) -> str:
    validation.one_of("real", real, REALS)
    literals.check_name(name)
    of, finite = _TYPES[real]
    more = {"real": real, "type": of, "finite": finite, "name": name}
    return render(f"{template}.st", {**values, **more})
