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

Eq. (8) is printed with ``alpha_f`` in the rear tyre's equation too, which leaves the
plant nearly undamped; it is read as ``alpha_r`` here.
"""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yawrate_env import validation

N_STATES = 6

LARGEST = {"mu_s": 100.0, "M_delta": 1e6, "v_x": 1e3}
"""Beyond these a context is refused as a mistake of units [1, kg, m/s]."""

SMALLEST = {"mu_s": 1e-3, "v_x": 0.0}
"""Least friction, below which nothing steers, and speed, exclusive."""


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
        Relaxation length of the front and rear tyre, eq. (8) [m].
    omega_n : float
        Natural frequency of the steering actuator, eq. (9) [rad/s].
    xi : float
        Damping ratio of the steering actuator, eq. (9).
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

    def __post_init__(self) -> None:
        for field in fields(self):
            validation.like(f"vehicle {field.name}", getattr(self, field.name), field.default)


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
    """

    mu_s: NDArray[np.float64]
    M_delta: NDArray[np.float64]
    v_x: NDArray[np.float64]

    @classmethod
    def of(cls, mu_s: ArrayLike, M_delta: ArrayLike, v_x: ArrayLike) -> Self:
        """Batch from anything that broadcasts to one dimension, checked."""
        arrays = np.broadcast_arrays(
            *(
                np.atleast_1d(validation.real_array(name, values))
                for name, values in zip(cls.__slots__, (mu_s, M_delta, v_x), strict=True)
            )
        )
        checked = {
            name: validation.finite_array(name, array.copy(), shape=(None,))
            for name, array in zip(cls.__slots__, arrays, strict=True)
        }
        for name, array in checked.items():
            if array.size:
                validation.number(name, array.max(), at_most=LARGEST[name], remedy="Use SI units.")
        for name, smallest in SMALLEST.items():
            if checked[name].size:
                validation.number(
                    name, checked[name].min(), above=0.0, at_least=smallest, remedy="Raise it."
                )
        return cls(**checked)

    def __len__(self) -> int:
        return len(self.mu_s)


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
    """Continuous-time matrices of eqs. (6) to (9).

    Returns
    -------
    A : (B, 6, 6)
    B : (B, 6)
    C : (6,)
        Picks the yaw rate.
    """
    mass, v = total_mass(vehicle, context), context.v_x
    C_f, C_r = vehicle.C_f * context.mu_s, vehicle.C_r * context.mu_s
    A = np.zeros((len(context), N_STATES, N_STATES))
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
    B = np.zeros((len(context), N_STATES))
    B[:, z] = vehicle.omega_n**2
    C = np.zeros(N_STATES)
    C[r] = 1.0
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
