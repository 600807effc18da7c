"""The lateral force of an axle: Pacejka's magic formula with load dependence.

    F(alpha) = D sin(C arctan(B alpha - E (B alpha - arctan(B alpha)))),   B = K / (C D)

H. B. Pacejka, *Tire and Vehicle Dynamics* (3rd ed., 2012), chapter 4, for pure lateral
slip without camber and shifts.  For a wheel with the load F_z, and
``n = F_z / (p_Ky2 F_z0)``:

======  =================================  =============================================
symbol  value                              meaning
======  =================================  =============================================
D       mu_s (p_Dy1 - p_Dy2 df) F_z        peak force; ``df = (F_z - F_z0) / F_z0``
K       proportional to 2n / (1 + n^2)     slope at zero slip: ``sin(2 arctan n)``
C, E    p_Cy1, p_Ey1                       shape and curvature
======  =================================  =============================================

Two things tie the curve to the linear vehicle.  K is scaled so that the axle has the
slope ``C_f mu_s`` (``C_r mu_s``) of eq. (10) at its static load, extra mass included;
and the rated load F_z0 is the static one without extra mass.  Friction thus scales
stiffness and peak alike, as in eq. (10), and B does not depend on it.

Both wheels of an axle have the same slip, so the axle has one curve, with their summed
D and K (Pacejka's effective axle characteristics, chapter 1).  When the load moves
from one wheel to the other, ``F_z (1 +- x)``, the sums have closed forms:

    D / D(0) = 1 - fade x^2,           fade = p_Dy2 W / mu(W),   W = F_z / F_z0
    K / K(0) = (1 + n^2)(1 + n^2 (1 - x^2)) / (1 + 2 n^2 (1 + x^2) + n^4 (1 - x^2)^2)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yawrate_env import validation
from yawrate_env.compiled import inlined


@dataclass(frozen=True, slots=True)
class Tyre:
    """Parameters of the magic formula, the same for both axles.

    The defaults are of the size that passenger-car tyres have (such as a 205/60R15); they
    are typical values, not a measured tyre's.

    Attributes
    ----------
    shape : float
        p_Cy1, the formula's C; between 1 and 2 the curve has a peak.
    curvature : float
        p_Ey1, the formula's E.
    friction : float
        p_Dy1, peak force over load at the rated load, for mu_s = 1.
    friction_loss : float
        -p_Dy2, what the friction loses when the load doubles.
    stiffest_load : float
        p_Ky2, the load of greatest cornering stiffness over the rated load.
    """

    shape: float = 1.193
    curvature: float = -1.003
    friction: float = 0.990
    friction_loss: float = 0.145
    stiffest_load: float = 2.130

    def __post_init__(self) -> None:
        for name, bounds in (
            ("shape", {"at_least": 1e-3, "at_most": 2.0}),
            ("curvature", {"at_least": -100.0, "at_most": 1.0}),
            ("friction", {"at_least": 1e-3, "at_most": 1e3}),
            ("friction_loss", {"at_least": 0.0, "at_most": self.friction}),
            ("stiffest_load", {"at_least": 2e-3, "at_most": 2e3}),
        ):
            validation.number(
                f"tyre {name}",
                getattr(self, name),
                **bounds,
                remedy="Give Pacejka's dimensionless coefficient.",
            )


def friction(tyre: Tyre, load: NDArray[np.float64]) -> NDArray[np.float64]:
    """Peak force over load for mu_s = 1 at a load in units of the rated one."""
    return tyre.friction - tyre.friction_loss * (load - 1)


def lateral_force(
    slip: ArrayLike, stiffness: ArrayLike, peak: ArrayLike, tyre: Tyre | None = None
) -> NDArray[np.float64]:
    """The curve of an axle without load transfer.

    Parameters
    ----------
    slip : float
        Tangent of the slip angle.
    stiffness : float
        Slope at zero slip [N].
    peak : float
        Greatest force [N].
    """
    tyre = tyre or Tyre()
    Balpha = np.asarray(stiffness) / (tyre.shape * np.asarray(peak)) * np.asarray(slip)
    bent = Balpha - tyre.curvature * (Balpha - np.arctan(Balpha))
    return np.asarray(peak * np.sin(tyre.shape * np.arctan(bent)))


# The compiled form. The library's arctan and sin would keep the lanes from running side
# by side, so polynomials take their place, good to 3e-13.


_HALF_PI = 0.5 * np.pi


@inlined
def arctan(x: float) -> float:
    """Arctangent, by a minimax polynomial on [-1, 1] and ``pi/2 - arctan(1/x)`` beyond."""
    size = abs(x)
    large = size > 1.0
    s = (-1.0 if large else size) / (size if large else 1.0)
    w = s * s
    p = 0.0001704604046618824
    p = p * w - 0.0014666686334116588
    p = p * w + 0.005936376596452122
    p = p * w - 0.01523249190907656
    p = p * w + 0.028410612112699588
    p = p * w - 0.042324616793255394
    p = p * w + 0.054582394542429476
    p = p * w - 0.06536228811849373
    p = p * w + 0.07663177357754078
    p = p * w - 0.09086360660727331
    p = p * w + 0.11110640790649381
    p = p * w - 0.14285684661254053
    p = p * w + 0.1999999901342103
    p = p * w - 0.3333333332025471
    p = p * w + 0.99999999999971
    angle = s * p + (_HALF_PI if large else 0.0)
    return angle if x >= 0.0 else -angle


@inlined
def sine(x: float) -> float:
    """Sine between -pi and pi, by its Taylor series."""
    w = x * x
    p = -3.868170170630684e-23
    p = p * w + 1.9572941063391263e-20
    p = p * w - 8.22063524662433e-18
    p = p * w + 2.8114572543455206e-15
    p = p * w - 7.647163731819816e-13
    p = p * w + 1.6059043836821613e-10
    p = p * w - 2.505210838544172e-08
    p = p * w + 2.7557319223985893e-06
    p = p * w - 0.0001984126984126984
    p = p * w + 0.008333333333333333
    p = p * w - 0.16666666666666666
    return x + x * w * p


@inlined
def axle_force(
    slip: float,
    xx: float,
    stiffness: float,
    peak: float,
    fade: float,
    nn: float,
    shape: float,
    curvature: float,
) -> float:
    """Lateral force of an axle whose load transfer x, squared, is `xx`."""
    D = peak * (1.0 - fade * xx)
    rest = nn * (1.0 - xx)
    K = stiffness * (1.0 + nn) * (1.0 + rest)
    Balpha = K * slip / ((1.0 + 2.0 * nn * (1.0 + xx) + rest * rest) * shape * D)
    bent = Balpha - curvature * (Balpha - arctan(Balpha))
    return D * sine(shape * arctan(bent))
