"""C programs of the controllers with ``@NAME@`` for their numbers, which the page fills in."""

import re
from collections.abc import Iterable
from typing import Any

from tuners.export.controllers import form_of
from tuners.export.gains import Gains
from tuners.tuner.result import Result
from yawrate_env.loop.controllers import CONTROLLERS

_CONSTANT = re.compile(r"(static const \w+ (\w+) =) [^;]+;")
_FIXED = "LOW", "HIGH"  # constants that no slider moves
_OF_HEADER = re.compile(r"\b(kp|Ti|Kp|Ki|Kd|Tf|b|c) = [-\d.e+]+")


def programs(result: Result, kinds: Iterable[str]) -> dict[str, Any] | None:
    """Texts by kind of controller, and the limits; None where the plant knows no limits.

    A state feedback has none: its program has as many numbers as there are states.
    """
    known = Gains.of(result)
    if known.limits is None or known.Ts is None:
        return None
    texts = {kind: _text(kind, known) for kind in kinds if kind in CONTROLLERS}
    return {"texts": texts, "limits": list(known.limits)} if texts else None


def _text(kind: str, known: Gains) -> str:
    """One program's header and source, written for any gains of the kind."""
    slow = 100.0 * (known.Ts or 1.0)
    values = {name: slow if name.startswith("T") else 1.0 for name in CONTROLLERS[kind].gains}
    gains = Gains(values, known.Ts, known.signals, known.limits, controller=kind)
    form = form_of(gains)
    header, source, _ = form.program(form.make(gains, None, None)).values()
    header = _OF_HEADER.sub(lambda m: f"{m[1]} = @{m[1]}@", header)
    return header + _CONSTANT.sub(_placed, source)


def _placed(match: re.Match[str]) -> str:
    return match[0] if match[2] in _FIXED else f"{match[1]} @{match[2]}@;"
