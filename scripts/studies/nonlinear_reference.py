"""The nonlinear vehicle once more, for ``scipy.integrate.solve_ivp``: reference and rival.

The same equations as `yawrate_env.vehicle.nonlinear`, written for one vehicle with the standard
library's functions, and integrated with SciPy's step control from one change of the
command to the next.  Where the steering rate can reach its limit, events find when it
does and when it leaves it.
"""

from collections.abc import Callable
from math import atan, cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.vehicle.nonlinear import NonlinearTwin
from yawrate_env.vehicle.nonlinear.body import GRAVITY
from yawrate_env.vehicle.single_track import Vehicle

Array = NDArray[np.float64]


def axle(
    twin: NonlinearTwin, stiffness: float, load: float, rated_load: float, per_q: float
) -> Callable[[float, float], float]:
    """Force of an axle over (slip, q), wheel by wheel.

    Parameters
    ----------
    stiffness : float
        Of the axle at this load [N].
    load, rated_load : float
        Of a wheel [N].
    per_q : float
        Load that moves from wheel to wheel per lateral acceleration [N s^2/m].
    """
    tyre = twin.tyre
    C, E = tyre.shape, tyre.curvature

    def slope(F_z: float) -> float:
        return sin(2 * atan(F_z / (tyre.stiffest_load * rated_load)))

    def peak(F_z: float) -> float:
        return (tyre.friction - tyre.friction_loss * (F_z / rated_load - 1)) * F_z

    def force(slip: float, q: float) -> float:
        moved = min(abs(per_q * q), load)
        K = stiffness * (slope(load + moved) + slope(load - moved)) / (2 * slope(load))
        D = peak(load + moved) + peak(load - moved)
        x = K * slip / (C * D)
        return D * sin(C * atan(x - E * (x - atan(x))))

    return force


def solve(
    vehicle: Vehicle,
    twin: NonlinearTwin,
    context: tuple[float, float, float],
    u: Array,
    Ts: float,
    *,
    method: str = "DOP853",
    rtol: float = 1e-12,
    atol: float = 1e-14,
    limited: bool = True,
) -> Array:
    """Yaw rate (N,) of one vehicle (mu_s, M_delta, v_x) at the samples of `u` (N,).

    Parameters
    ----------
    limited : bool
        Watch for the steering rate's limit; without, it is taken not to be reached.
    """
    import scipy.integrate

    solve_ivp: Any = scipy.integrate.solve_ivp
    free, held = equations(vehicle, twin, context)
    x = np.array([0.0, 0.0, context[2], 0.0, 0.0, 0.0, 0.0, 0.0])
    y = np.empty(len(u))
    y[0] = 0.0
    changes = [0, *(np.flatnonzero(np.diff(u)) + 1), len(u)]
    for first, last in zip(changes[:-1], changes[1:], strict=True):
        command = max(-twin.limits.angle, min(twin.limits.angle, float(u[first])))
        k, at_limit, t = first, False, first * Ts
        while k < last:
            times = np.arange(k + 1, last + 1) * Ts
            found = solve_ivp(
                held if at_limit else free,
                (t, times[-1]),
                x,
                method=method,
                t_eval=times,
                events=_event(vehicle, twin, at_limit, x[7], command) if limited else None,
                rtol=rtol,
                atol=atol,
                args=(command,),
            )
            done = found.y.shape[1] if found.y.size else 0
            y[k + 1 : k + 1 + done] = found.y[1][: len(y) - k - 1] if done else []
            k += done
            if found.status == 1:
                t, x = found.t_events[0][0], found.y_events[0][0]
                at_limit = not at_limit
                if at_limit:
                    x[7] = np.copysign(twin.limits.rate, x[7])
            else:
                x = found.y[:, -1]
    return y


def _event(
    vehicle: Vehicle, twin: NonlinearTwin, at_limit: bool, rate: float, command: float
) -> Callable[..., float]:
    """Zero where the rate leaves its limit, or where it reaches it."""
    omega, xi, side = vehicle.omega_n, vehicle.xi, np.copysign(1.0, rate)

    def leaves(t: float, x: Array, _: float) -> float:
        return float(side * (omega * (command - x[6]) - 2 * xi * x[7]))

    def reaches(t: float, x: Array, _: float) -> float:
        return float(abs(x[7]) - twin.limits.rate)

    event = leaves if at_limit else reaches
    event.terminal, event.direction = True, -1.0 if at_limit else 1.0  # type: ignore[attr-defined]
    return event


def equations(
    vehicle: Vehicle, twin: NonlinearTwin, context: tuple[float, float, float]
) -> tuple[Callable[..., list[float]], Callable[..., list[float]]]:
    """Right-hand sides of [v_y, r, v_x, a_f, a_r, q, delta, s] with free and held rate."""
    mu_s, M_delta, v_0 = context
    body = twin.body
    mass, l_f, l_r, J = vehicle.M_0 + M_delta, vehicle.l_f, vehicle.l_r, vehicle.J_z
    relax_f, relax_r, omega, xi = vehicle.l_rel_f, vehicle.l_rel_r, vehicle.omega_n, vehicle.xi
    roll, drag, L = body.roll_lag, body.drag, vehicle.l_f + vehicle.l_r
    moved = mass * body.height / body.track
    wheels = GRAVITY / (2 * L)
    front = axle(twin, vehicle.C_f, mass * wheels * l_r, vehicle.M_0 * wheels * l_r,
                 body.front_share * moved)  # fmt: skip
    rear = axle(twin, vehicle.C_r, mass * wheels * l_f, vehicle.M_0 * wheels * l_f,
                (1 - body.front_share) * moved)  # fmt: skip

    def rates(x: Array) -> list[float]:
        v_y, r, v_x, a_f, a_r, q, delta, _ = x.tolist()
        c, s = cos(delta), sin(delta)
        F_f, F_r = -mu_s * front(a_f, q), -mu_s * rear(a_r, q)
        lateral = (F_f * c + F_r) / mass
        across = v_y + l_f * r
        return [
            lateral - v_x * r,
            (l_f * F_f * c - l_r * F_r) / J,
            v_y * r - (F_f * s + drag * (v_x * abs(v_x) - v_0 * v_0)) / mass,
            (across * c - v_x * s - abs(v_x * c + across * s) * a_f) / relax_f,
            (v_y - l_r * r - abs(v_x) * a_r) / relax_r,
            (lateral - q) / roll,
        ]

    def free(t: float, x: Array, command: float) -> list[float]:
        return [*rates(x), x[7], omega * (omega * (command - x[6]) - 2 * xi * x[7])]

    def held(t: float, x: Array, command: float) -> list[float]:
        return [*rates(x), x[7], 0.0]

    return free, held
