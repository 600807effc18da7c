"""Controllers in the forms that vendors use, and a PI's difference equation.

=================  ====================================================  ========================
form               C(s)                                                  gains
=================  ====================================================  ========================
parallel           Kp + Ki/s + Kd s                                      Kp, Ki, Kd
standard (ideal)   Kc (1 + 1/(tau_I s) + tau_D s)                        Kc, tau_I, tau_D
series             Kc (1 + 1/(tau_I s)) (1 + tau_D s)                    Kc, tau_I, tau_D
proportional band  100 %/PB, and minutes                                 PB, minutes, rate
=================  ====================================================  ========================

A derivative's filter ``1/(Tf s + 1)`` stays what it is.  The series form exists where
``tau_I >= 4 tau_D``.  A proportional band is a percentage of the controller's spans of input and
output: where these are not 0 to 100 of their units, multiply it by the output's span over the
input's.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from yawrate_env.loop import controller
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.target import Target
from yawrate_env.plant.plant import Plant


@dataclass(frozen=True, slots=True)
class Forms:
    """Forms of a PI controller that runs every `Ts` seconds.

    Attributes
    ----------
    Kp, Ki, Ti : float
        Parallel form ``Kp + Ki/s`` and standard form ``Kp (1 + 1/(Ti s))``; the printed
        controller of eq. (13) has no integral gain, ``nan``.
    a1, b0, b1 : float
        ``u[k] = -a1 u[k-1] + b0 e[k] + b1 e[k-1]``, with ``e`` the reference minus the
        measured output.
    Ts : float
        Sampling time [s].
    """

    Kp: float
    Ki: float
    Ti: float
    a1: float
    b0: float
    b1: float
    Ts: float

    @classmethod
    def of(cls, kp: float, Ti: float, target: Target) -> "Forms":
        """From the standard form, as the loop's target discretises it."""
        columns = controller.coefficients(np.array([kp]), np.array([Ti]), target)
        n1, n0, d0 = (float(c[0]) for c in columns)
        Ki = kp / Ti if target.controller == "pi" else float("nan")
        return cls(kp, Ki, Ti, d0 * target.Ts - 1, n1, n0 * target.Ts - n1, target.Ts)

    @property
    def equation(self) -> str:
        """The difference equation as text."""
        last = "u[k-1]" if self.a1 == -1 else f"{-self.a1:.6g} u[k-1]"
        sign = "-" if self.b1 < 0 else "+"
        return f"u[k] = {last} + {self.b0:.6g} e[k] {sign} {abs(self.b1):.6g} e[k-1]"


def controller_of(plant: Plant) -> str:
    """Name of the controller that a plant's gains are of; empty where it is not known."""
    target = plant.parametrisation.target
    if plant.controller or target is None:
        return plant.controller
    return "PI" if target.controller == "pi" else ""


def vendors_forms(name: str, gains: Mapping[str, float], Ts: float) -> dict[str, dict[str, float]]:
    """A controller's gains in every form that it has, by form; empty for other controllers.

    Parameters
    ----------
    name : str
        Of the controller, in `yawrate_env.loop.controllers`.
    gains : dict
        By name.
    Ts : float
        Sampling time [s].
    """
    if name not in CONTROLLERS or not all(np.isfinite(value) for value in gains.values()):
        return {}
    made = CONTROLLERS[name].parallel(np.array([list(gains.values())]), Ts)
    Kp, Ki, Kd, Tf = (float(v[0]) for v in (made.Kp, made.Ki, made.Kd, made.Tf))
    filtered = {"Tf": Tf} if made.derives else {}
    weights = {"b": float(made.b[0]), "c": float(made.c[0])} if name in ("PI-D", "2DOF") else {}
    rest = filtered | weights
    forms = {"parallel": {"Kp": Kp, "Ki": Ki, "Kd": Kd} | rest}
    if not (Kp > 0 and Ki > 0 and Kd >= 0):
        return forms
    tau_I, tau_D = Kp / Ki, Kd / Kp
    forms["standard"] = {"Kc": Kp, "tau_I": tau_I, "tau_D": tau_D} | rest
    if tau_I >= 4 * tau_D * (1 - 1e-9):
        part = (1 + np.sqrt(max(1 - 4 * tau_D / tau_I, 0.0))) / 2
        series = {"Kc": Kp * part, "tau_I": tau_I * part, "tau_D": tau_D / part}
        forms["series"] = {of: float(value) for of, value in series.items()} | rest
    forms["proportional band"] = {
        "PB_percent": 100 / Kp, "minutes": tau_I / 60, "rate_minutes": tau_D / 60,
    }  # fmt: skip
    return forms
