"""C99 programs from the templates beside this module: a header, a source and a test.

The test holds golden vectors; its exit status is 0 where the program reproduces them.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

import yawrate_env
from tuners.export import literals
from tuners.export.digital import Limited
from yawrate_env import validation
from yawrate_env.loop.design import Status

REALS = "double", "float"
"""Types of a controller's numbers."""

STATUS = {
    "ok": int(Status.OK),
    "limited": int(Status.PHASE_LIMITED),
    "unreachable": int(Status.UNREACHABLE),
}
"""What programs return for gains."""


def program(template: str, name: str, values: dict[str, Any]) -> dict[str, str]:
    """Header, source and test program, by file name.

    Parameters
    ----------
    template : str
        Which program: the templates ``template.h``, ``template.c`` and ``template_test.c``.
    name : str
        Prefix of the files and of all that they declare.
    values : dict
        What the templates use.
    """
    literals.check_name(name)
    ends = ".h", ".c", "_test.c"
    return {f"{name}{end}": render(f"{template}{end}", {**values, "name": name}) for end in ends}


def controller_program(
    template: str,
    controller: Limited,
    signals: Mapping[str, Any],
    tolerances: Mapping[str, float],
    *,
    real: str,
    name: str,
) -> dict[str, str]:
    """Header, source and test program of a controller, by file name.

    Parameters
    ----------
    template : str
        As for `program`; the templates know the controller by this name, too.
    controller : Limited
        The controller.
    signals : dict
        The test's signals, with the ``commands`` that the controller answers.
    tolerances : dict
        Largest error of the commands, of the larger limit, by type of the numbers.
    real : {"double", "float"}
        Type of all numbers.
    name : str
        Prefix of the files and of all that they declare.
    """
    validation.one_of("real", real, REALS)
    largest = max(abs(controller.low), abs(controller.high), 1.0)
    own = {template: controller, "real": real, "tolerance": tolerances[real] * largest}
    return program(template, name, {**own, **signals})


def render(template: str, values: dict[str, Any]) -> str:
    """One file from its template."""
    common = {"version": yawrate_env.__version__, "status": STATUS}
    text: str = _environment().get_template(template).render({**common, **values})
    return text


@cache
def _environment() -> Any:
    """Jinja's, with C's literals as filters; imported here because exporting JSON needs none."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("tuners.export"),
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    for function in (literals.comment, literals.digits, literals.number, literals.rows,
                     literals.table):  # fmt: skip
        environment.filters[function.__name__] = function
    return environment
