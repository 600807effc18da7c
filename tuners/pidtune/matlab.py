"""``armax``, ``greyest`` and ``pidtune`` for those who know them from MATLAB.

Thin names over what the package does anyway; models come back as python-control systems.
The differences are in ``docs/matlab.md``.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tuners.export.control_models import vehicle_model
from tuners.features import armax as fitting
from tuners.pidtune import Info
from tuners.pidtune import pidtune as tune
from tuners.trust.vehicle_identification import identify
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import nominal_context
from yawrate_env import validation
from yawrate_env.vehicle.single_track import LARGEST, Vehicle
from yawrate_env.vehicle.task import Prior

ORDERS = (2, 2, 2, 1)


@dataclass(frozen=True, slots=True)
class ArmaxModel:
    """``y = G u + H e``.

    Attributes
    ----------
    G, H : control.TransferFunction
        B/A and C/A.
    cost : float
        Mean squared one-step prediction error.
    converged : bool
        Whether the fit ended at a minimum.
    """

    G: Any
    H: Any
    cost: float
    converged: bool


@dataclass(frozen=True, slots=True)
class GreyModel:
    """An identified vehicle.

    Attributes
    ----------
    model : control.StateSpace or None
        Steering command to yaw rate, continuous; None where the search ended at no vehicle.
    mu_s, M_delta, v_x : float
        Friction scale and extra mass [kg] found, speed as given [m/s].
    cost : float
        Mean squared output error [(rad/s)^2].
    converged : bool
        Whether the search ended at a minimum.
    """

    model: Any
    mu_s: float
    M_delta: float
    v_x: float
    cost: float
    converged: bool


def armax(
    u: ArrayLike, y: ArrayLike, Ts: float, orders: tuple[int, int, int, int] = ORDERS
) -> ArmaxModel:
    """Fit an ARMAX model from rest; `orders` [na nb nc nk] can only be [2 2 2 1].

    Parameters
    ----------
    u, y : (N,)
        Input and output.
    Ts : float
        Sampling time [s].
    """
    import control

    if not np.array_equal(orders, ORDERS):
        raise ValueError(f"orders = {orders!r} is not fitted here, only {list(ORDERS)}.")
    recording = Recording.of(u, y, Ts)
    samples, least = recording.y.shape[1], 10 * len(fitting.PARAMETERS)
    validation.count("number of samples", samples, at_least=least, remedy="Record more.")
    fit = fitting.armax(recording.u, recording.y, Ts)
    a1, a2, b1, b2, c1, c2 = fit.theta[0]
    A = [1.0, a1, a2]
    return ArmaxModel(
        control.tf([b1, b2], A, Ts),
        control.tf([1.0, c1, c2], A, Ts),
        float(fit.cost[0]),
        bool(fit.status[0] == fitting.FitStatus.CONVERGED),
    )


def greyest(
    u: ArrayLike,
    y: ArrayLike,
    Ts: float,
    *,
    v_x: float = 20.0,
    vehicle: Vehicle = Vehicle(),  # noqa: B008, frozen
    prior: Prior = Prior(),  # noqa: B008, frozen
) -> GreyModel:
    """Find friction and mass of the vehicle from an episode that starts from rest.

    Parameters
    ----------
    u, y : (N,)
        Steering command [rad] and yaw rate [rad/s].
    Ts : float
        Sampling time [s].
    v_x : float
        Speed [m/s].
    vehicle : Vehicle
        What is known of the vehicle.
    prior : Prior
        The search starts in its middle.
    """
    validation.number("v_x", v_x, above=0.0, at_most=LARGEST["v_x"], remedy="Give one in m/s.")
    recording = Recording.of(u, y, Ts, v_x)
    found = identify(vehicle, recording, nominal_context(prior), np.array([float(v_x)]))
    mu_s, M_delta = float(found.context.mu_s[0]), float(found.context.M_delta[0])
    try:
        model = vehicle_model(mu_s, M_delta, v_x, vehicle=vehicle)
        converged = bool(found.converged[0])
    except ValueError:  # the search left for where no vehicle is: the output is dead
        model, converged = None, False
    return GreyModel(
        model,
        mu_s,
        M_delta,
        float(v_x),
        float(found.cost[0]),
        converged,
    )


def pidtune(
    sys: Any, type: str = "PI", wc: float | None = None, *, PhaseMargin: float = 60.0
) -> tuple[Any, Info]:
    """``[C, info] = pidtune(sys, type, wc)``; see `tuners.pidtune.pidtune` for more options."""
    return tune(sys, type, wc=wc, pm=PhaseMargin)
