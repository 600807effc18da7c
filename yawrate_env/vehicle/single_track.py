"""The single-track vehicle with tyre lag and steer-by-wire actuator, eqs. (6) to (12).

State ``x = [beta, r, alpha_f, alpha_r, z, delta_f]``, input ``delta_f^cmd``, output ``r``:

====================  ==============================  =========
symbol                meaning                         unit
====================  ==============================  =========
``beta``              side-slip angle                 rad
``r``                 yaw rate                        rad/s
``alpha_f, alpha_r``  lagged tyre slip angles         rad
``z``                 actuator's internal state       rad/s
``delta_f``           road-wheel angle                rad
====================  ==============================  =========

A yaw-rate sensor with a lag adds a seventh state, the measured yaw rate [rad/s], which is then
the output.  Dead time is in none of these matrices (`yawrate_env.vehicle.discrete`).

Eq. (8) is printed with ``alpha_f`` in the rear tyre's equation too, which leaves the
plant nearly undamped; it is read as ``alpha_r`` here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import SimpleNamespace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yawrate_env import validation

N_STATES = 6

LARGEST = {"mu_s": 100.0, "M_delta": 1e6, "v_x": 1e3}
"""Beyond these a context is refused as a mistake of units [1, kg, m/s]."""

SMALLEST = {"mu_s": 1e-3, "v_x": 0.0}
"""Least friction, below which nothing steers, and speed, exclusive."""

CONTEXT = tuple(LARGEST)
"""Names of what always differs from vehicle to vehicle."""

_MOST = {"dead_time": 0.5, "sensor_lag": 1.0}  # s
_SHORTEST = {"l_rel_f": 1e-4, "l_rel_r": 1e-4, "sensor_lag": 1e-6}  # m, m, s: less counts as this


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Known parameters of the vehicle (Table II); SI units, angles in rad.

    Attributes
    ----------
    M_0 : float
        Mass without the unknown extra load, eq. (11) [kg].
    J_z : float
        Yaw inertia [kg m^2].
    l_f, l_r : float
        Centre of gravity to front and rear axle [m].
    C_f, C_r : float
        Nominal cornering stiffness, front and rear, eq. (10) [N/rad].
    l_rel_f, l_rel_r : float
        Relaxation length of the front and rear tyre, eq. (8) [m].  The slip angles stay states:
        a length below 0.1 mm, zero among them, counts as 0.1 mm.
    omega_n : float
        Natural frequency of the steering actuator, eq. (9) [rad/s].
    xi : float
        Damping ratio of the steering actuator, eq. (9).
    dead_time : float
        From the command to the steering actuator, any value from 0 to 0.5 [s].
    sensor_lag : float
        Time constant of the yaw-rate sensor, a first-order lag [s].
    """

    M_0: float = 1895.0
    J_z: float = 2400.0
    l_f: float = 1.18
    l_r: float = 1.53
    C_f: float = 124.9e3
    C_r: float = 166e3
    l_rel_f: float = 0.4
    l_rel_r: float = 0.8
    omega_n: float = 2 * np.pi * 5
    xi: float = 0.9
    dead_time: float = 0.0
    sensor_lag: float = 0.0

    def __post_init__(self) -> None:
        for name in CONSTANTS:
            check_constant(f"vehicle {name}", name, getattr(self, name))
        for name in ("l_rel_f", "l_rel_r"):
            object.__setattr__(self, name, max(getattr(self, name), _SHORTEST[name]))


CONSTANTS: dict[str, Any] = {each.name: each.default for each in fields(Vehicle)}
"""A vehicle's parameters and their usual values."""

OTHERS = tuple(name for name in CONSTANTS if name != "M_0")
"""Those that may differ from vehicle to vehicle, as `Context` has them; the mass does anyway."""


def bounds(name: str) -> tuple[float, float]:
    """Least and largest value of one of a vehicle's parameters that is accepted."""
    if name in _MOST:
        return 0.0, _MOST[name]
    usual = CONSTANTS[name]
    return 0.0 if name in _SHORTEST else 1e-3 * usual, 1e3 * usual


def check_constant(title: str, name: str, value: Any, remedy: str = "Use SI units.") -> float:
    """A value of one of a vehicle's parameters, or ``ValueError`` that begins with the title."""
    least, largest = bounds(name)
    return validation.number(title, value, at_least=least, at_most=largest, remedy=remedy)


@dataclass(frozen=True, slots=True, eq=False)
class Context:
    """Parameters that differ between vehicles, for a batch of B; all arrays (B,) float64.

    Attributes
    ----------
    mu_s : NDArray
        Tyre-road friction scale, eq. (10).
    M_delta : NDArray
        Extra mass, eq. (11) [kg].
    v_x : NDArray
        Longitudinal speed, constant over an episode [m/s].
    others : dict
        Parameters of `Vehicle` that differ too, by name; units as there.
    """

    mu_s: NDArray[np.float64]
    M_delta: NDArray[np.float64]
    v_x: NDArray[np.float64]
    others: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @classmethod
    def of(cls, mu_s: ArrayLike, M_delta: ArrayLike, v_x: ArrayLike, **others: ArrayLike) -> Self:
        """Batch from anything that broadcasts to one dimension, checked."""
        given = dict(zip(CONTEXT, (mu_s, M_delta, v_x), strict=True)) | others
        arrays = np.broadcast_arrays(
            *(np.atleast_1d(validation.real_array(name, each)) for name, each in given.items())
        )
        checked = {
            name: validation.finite_array(name, array.copy(), shape=(None,))
            for name, array in zip(given, arrays, strict=True)
        }
        for name in others:
            validation.one_of("a vehicle's parameter", name, OTHERS)
        for name, array in checked.items():
            for value in (array.min(), array.max()) if array.size else ():
                check_parameter(name, value)
        first, second, third = (checked.pop(name) for name in CONTEXT)
        return cls(first, second, third, checked)

    def __len__(self) -> int:
        return len(self.mu_s)


def check_parameter(name: str, value: float, remedy: str = "Use SI units.") -> float:
    """A value of any parameter that may differ between vehicles, if it is physical."""
    if name not in LARGEST:
        return check_constant(name, name, value, remedy)
    least, above = SMALLEST.get(name, -np.inf), 0.0 if name in SMALLEST else -np.inf
    most = LARGEST[name]
    return validation.number(name, value, above=above, at_least=least, at_most=most, remedy=remedy)


def constants(vehicle: Vehicle, context: Context) -> Any:
    """The vehicle's parameters as attributes: numbers, or (B,) where the context has others."""
    if not context.others:
        return vehicle
    own = {name: np.maximum(each, _SHORTEST[name]) if name in _SHORTEST else each
           for name, each in context.others.items()}  # fmt: skip
    return SimpleNamespace(**({name: getattr(vehicle, name) for name in CONSTANTS} | own))


def has(vehicle: Vehicle, context: Context, name: str) -> bool:
    """Whether vehicles may have a dead time or a sensor lag."""
    return name in context.others or getattr(vehicle, name) > 0


def total_mass(vehicle: Vehicle, context: Context) -> NDArray[np.float64]:
    """M_veh = M_0 + M_delta, eq. (11), (B,) [kg]; ``ValueError`` where it is not positive."""
    mass = vehicle.M_0 + context.M_delta
    if len(mass):
        validation.number(
            "total mass M_0 + M_delta", mass.min(), above=0.0, remedy="Raise M_0 or M_delta."
        )
    return mass


def state_space(
    vehicle: Vehicle, context: Context
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Continuous-time matrices of eqs. (6) to (9), of order n = 6, or 7 with a sensor's lag.

    Returns
    -------
    A : (B, n, n)
    B : (B, n)
    C : (n,)
        Picks the yaw rate, as measured.
    """
    mass, v = total_mass(vehicle, context), context.v_x
    lagged = has(vehicle, context, "sensor_lag")
    vehicle = constants(vehicle, context)
    C_f, C_r = vehicle.C_f * context.mu_s, vehicle.C_r * context.mu_s
    n = N_STATES + lagged
    A = np.zeros((len(context), n, n))
    beta, r, alpha_f, alpha_r, z, delta = range(N_STATES)
    A[:, beta, r] = -1.0
    A[:, beta, alpha_f] = -C_f / (mass * v)
    A[:, beta, alpha_r] = -C_r / (mass * v)
    A[:, r, alpha_f] = -vehicle.l_f * C_f / vehicle.J_z
    A[:, r, alpha_r] = vehicle.l_r * C_r / vehicle.J_z
    A[:, alpha_f, alpha_f] = -v / vehicle.l_rel_f
    A[:, alpha_f, beta] = v / vehicle.l_rel_f
    A[:, alpha_f, r] = vehicle.l_f / vehicle.l_rel_f
    A[:, alpha_f, delta] = -v / vehicle.l_rel_f
    A[:, alpha_r, alpha_r] = -v / vehicle.l_rel_r
    A[:, alpha_r, beta] = v / vehicle.l_rel_r
    A[:, alpha_r, r] = -vehicle.l_r / vehicle.l_rel_r
    A[:, z, delta] = -(vehicle.omega_n**2)
    A[:, delta, z] = 1.0
    A[:, delta, delta] = -2 * vehicle.xi * vehicle.omega_n
    B = np.zeros((len(context), n))
    B[:, z] = vehicle.omega_n**2
    C = np.zeros(n)
    C[-1 if lagged else r] = 1.0
    if lagged:
        bandwidth = 1 / np.maximum(vehicle.sensor_lag, _SHORTEST["sensor_lag"])
        A[:, -1, r], A[:, -1, -1] = bandwidth, -bandwidth
    return A, B, C


def state_space_sensitivity(vehicle: Vehicle, context: Context) -> NDArray[np.float64]:
    """Derivative of A with respect to (mu_s, M_delta), (B, 2, 6, 6); B and C have none.

    A is linear in mu_s and in mu_s / M_veh, so the derivatives are read off its entries.
    """
    A, _, _ = state_space(vehicle, context)
    tyre_forces = np.zeros_like(A)
    tyre_forces[:, :2, 2:4] = A[:, :2, 2:4]
    by_mu_s = tyre_forces / context.mu_s[:, None, None]
    by_M_delta = np.zeros_like(A)
    mass = total_mass(vehicle, context)
    by_M_delta[:, 0, 2:4] = -tyre_forces[:, 0, 2:4] / mass[:, None]
    return np.stack([by_mu_s, by_M_delta], axis=1)


def context_of(theta: NDArray[np.float64], others: Sequence[str] = ()) -> Context:
    """Parameters (B, p) as vehicles; after the first three they are the named ones."""
    mu_s, M_delta, v_x, *columns = theta.T.copy()
    return Context(mu_s, M_delta, v_x, dict(zip(others, columns, strict=True)))


def theta_of(context: Context) -> NDArray[np.float64]:
    """Vehicles as parameters (B, p)."""
    others = (context.others[name] for name in OTHERS if name in context.others)
    columns = context.mu_s, context.M_delta, context.v_x, *others
    return np.stack(columns, axis=1)
