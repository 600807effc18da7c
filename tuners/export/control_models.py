"""Controllers and vehicles as python-control systems.

``control`` is imported where it is used: it takes longer than most of what is done here.
"""

from typing import Any

import numpy as np

from yawrate_env import validation
from yawrate_env.loop import controller
from yawrate_env.loop.discretisation import zoh
from yawrate_env.vehicle.single_track import Context, Vehicle, state_space

STATES = ("beta", "r", "alpha_f", "alpha_r", "z", "delta_f")


def pi_controller(kp: float, Ti: float, Ts: float) -> Any:
    """The Tustin PI ``kp (1 + Ts/(2 Ti) (z + 1)/(z - 1))`` as a ``control.TransferFunction``.

    Parameters
    ----------
    kp, Ti : float
        Gain [s] and integral time [s].
    Ts : float
        Sampling time [s].
    """
    import control

    for name, value in (("kp", kp), ("Ti", Ti), ("Ts", Ts)):
        validation.number(name, value, above=0.0, remedy="Give gains that a tuner found.")
    n1, n0 = controller.pi_coefficients(np.asarray(kp), np.asarray(Ti), Ts)
    return control.tf([n1, n0 * Ts - n1], [1.0, -1.0], Ts, inputs="error", outputs="delta_f_cmd")


def vehicle_model(
    mu_s: float,
    M_delta: float,
    v_x: float,
    *,
    vehicle: Vehicle = Vehicle(),  # noqa: B008, frozen
    Ts: float | None = None,
) -> Any:
    """Steering command to yaw rate as a ``control.StateSpace``.

    Parameters
    ----------
    mu_s, M_delta, v_x : float
        Friction scale, extra mass [kg] and speed [m/s].
    vehicle : Vehicle
        What is known of the vehicle.
    Ts : float, optional
        Sampling time of a zero-order hold [s]; continuous if not given.
    """
    import control

    A, B, C = state_space(vehicle, Context.of(mu_s, M_delta, v_x))
    if Ts is not None:
        validation.number("Ts", Ts, above=0.0, remedy="Leave it out for a continuous model.")
        plant = zoh(A, B, C, Ts)
        A, B = plant.A, plant.B
    names = {"inputs": "delta_f_cmd", "outputs": "r", "states": list(STATES)}
    return control.ss(A[0], B[0][:, None], C[None], 0.0, Ts or 0.0, **names)
