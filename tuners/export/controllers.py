"""How controllers are written in C, JSON, MATLAB and structured text.

A table has one record for each controller, under the name that plants and results give it
(`yawrate_env.loop.controllers`).  To write a further controller, add its record.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tuners.export.digital_pi import DigitalPI
from tuners.export.documents import json_text, pid_text, state_feedback_text
from tuners.export.gains import Gains
from tuners.export.loops_program import Loop, program_of
from tuners.export.pi_program import pi_program
from tuners.export.pid_program import pid_program, state_feedback_program
from tuners.export.scripts import (
    matlab_script,
    pi_block,
    pi_script,
    pid_block,
    state_feedback_block,
    state_feedback_script,
)
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.state_feedback import STATE_FEEDBACK


@dataclass(frozen=True, slots=True)
class Form:
    """How one kind of controller is written.

    Attributes
    ----------
    make : callable
        ``make(gains, Ts, limits)``: the controller as a program runs it.
    program : callable
        ``program(controller, real=real)``: its C99 files, by name.
    document : callable
        ``document(controller, gains)``: JSON.
    script : callable
        ``script(controller)``: MATLAB.
    block : callable
        ``block(controller, real=real)``: a function block in structured text.
    """

    make: Callable[[Gains, float | None, Any], Any]
    program: Callable[..., dict[str, str]]
    document: Callable[[Any, Gains], str]
    script: Callable[[Any], str]
    block: Callable[..., str]

    def text(self, target: str, controller: Any, gains: Gains, real: str) -> str:
        """The controller for a target of one file."""
        if target == "json":
            return self.document(controller, gains)
        return self.block(controller, real=real) if target == "st" else self.script(controller)


def form_of(gains: Gains) -> Form:
    """How the controller of gains, or those of several loops, is written.

    ``ValueError`` where none is.
    """
    if gains.channels is not None:
        return _LOOPS
    if gains.refusal:
        raise ValueError(gains.refusal)
    return FORMS[gains.controller]


def _pi_text(pi: DigitalPI, gains: Gains) -> str:
    return json_text(pi)


def _loops(gains: Gains, Ts: float | None, limits: Any) -> list[Loop]:
    return Loop.all_of(gains, limits, Ts)


def _no_text(loops: list[Loop], gains: Gains) -> str:
    raise ValueError("limits: several loops go to target json without them, or to target c.")


def _no_script(loops: list[Loop], real: str = "double") -> str:
    raise ValueError(
        "targets matlab and st are for one controller. Export several loops to target c."
    )


_LOOPS = Form(_loops, program_of, _no_text, _no_script, _no_script)
_PI = Form(Gains.pi, pi_program, _pi_text, pi_script, pi_block)
_PID = Form(Gains.pid, pid_program, pid_text, matlab_script, pid_block)

FORMS = {
    **dict.fromkeys(CONTROLLERS, _PID),
    "": _PI,
    "PI": _PI,
    STATE_FEEDBACK: Form(
        Gains.state_feedback, state_feedback_program, state_feedback_text, state_feedback_script,
        state_feedback_block,
    ),
}  # fmt: skip
"""By the controller's name; where it is not known, gains kp and Ti are a PI's."""
