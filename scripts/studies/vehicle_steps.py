"""Steps before the drive: what is true of the vehicle, and how the command reaches it."""

from dataclasses import replace

import numpy as np

from studies.drives import Drive, Step
from studies.faulty import Array, Rng, scaled

NAMES = ("M_0", "J_z", "l_f", "l_r", "C_f", "C_r", "l_rel_f", "l_rel_r", "omega_n", "xi")
"""The vehicle's data: all that a tuner takes for known, but for the speed."""


def wrong(*names: str, by: float) -> Step:
    """Each parameter multiplied by a factor of its own, up to this share off."""

    def step(drive: Drive, rng: Rng) -> Drive:
        context = drive.context
        for name in names:
            factor = rng.uniform(1 - by, 1 + by, len(drive))
            context = scaled(drive.task.vehicle, context, name, factor)
        return replace(drive, context=context)

    return step


def without_relaxation(drive: Drive, rng: Rng) -> Drive:
    """Tyres that answer at once."""
    context = drive.context
    for name in ("l_rel_f", "l_rel_r"):
        context = scaled(drive.task.vehicle, context, name, np.zeros(len(drive)))
    return replace(drive, context=context)


def masked_inertia(drive: Drive, rng: Rng) -> Drive:
    """Inertia and front axle distance off by the same factor of 0.7 to 1.3."""
    factor, context = rng.uniform(0.7, 1.3, len(drive)), drive.context
    for name in ("J_z", "l_f"):
        context = scaled(drive.task.vehicle, context, name, factor)
    return replace(drive, context=context)


def masked_lag(drive: Drive, rng: Rng) -> Drive:
    """Actuator bandwidth times 0.8 to 1.3; the front tyre makes up for its delay."""
    vehicle, context = drive.task.vehicle, drive.context
    factor = rng.uniform(0.8, 1.3, len(drive))
    later = 2 * vehicle.xi / vehicle.omega_n * (1 / factor - 1)
    context = scaled(vehicle, context, "omega_n", factor)
    tyre = 1 - context.v_x * later / vehicle.l_rel_f
    return replace(drive, context=scaled(vehicle, context, "l_rel_f", tyre))


def speed_off(least: float, most: float) -> Step:
    """Vehicles are faster or slower than the recording claims, by so much [m/s]."""

    def step(drive: Drive, rng: Rng) -> Drive:
        off = rng.choice([-1, 1], len(drive)) * rng.uniform(least, most, len(drive))
        context = replace(drive.context, v_x=drive.context.v_x + off)
        return replace(drive, context=context)

    return step


def sensor_gain(drive: Drive, rng: Rng) -> Drive:
    """A yaw-rate sensor whose gain is up to 3 % off, in the loop too."""
    return replace(drive, gain=rng.uniform(0.97, 1.03, len(drive)))


def dead_time(drive: Drive, rng: Rng) -> Drive:
    """A dead time of 0 to 40 ms that nobody knows of."""
    late = rng.uniform(0.0, 0.04, len(drive))
    others = {**drive.context.others, "dead_time": late}
    return replace(drive, context=replace(drive.context, others=others))


def friction_changes(after: float) -> Step:
    """Friction falls to 0.5 to 0.8 of itself after a share of the recording."""

    def step(drive: Drive, rng: Rng) -> Drive:
        mu_s = drive.context.mu_s * rng.uniform(0.5, 0.8, len(drive))
        first = int(after * drive.shape[1])
        return replace(drive, later=((first, replace(drive.context, mu_s=mu_s)),))

    return step


def speed_falls(drive: Drive, rng: Rng) -> Drive:
    """Speed falls by 2 to 15 % in ten steps; gains are judged at its mean, which is claimed."""
    pieces, N = 10, drive.shape[1]
    fall = rng.uniform(0.02, 0.15, len(drive))
    mean = drive.context.v_x
    speeds = [mean * (1 + fall * (0.5 - (i + 0.5) / pieces)) for i in range(pieces)]
    first = (0, *(N * i // pieces for i in range(1, pieces)))
    contexts = (replace(drive.context, v_x=v_x) for v_x in speeds)
    return replace(drive, later=tuple(zip(first, contexts, strict=True)))


def deadband(drive: Drive, rng: Rng) -> Drive:
    """The actuator ignores 0.1 to 0.5 deg around zero."""
    width = np.radians(rng.uniform(0.1, 0.5, (len(drive), 1)))
    return replace(drive, applied=np.sign(drive.u) * np.maximum(np.abs(drive.u) - width, 0.0))


def backlash(drive: Drive, rng: Rng) -> Drive:
    """The steering has 0.2 to 0.8 deg of play."""
    half = np.radians(rng.uniform(0.2, 0.8, len(drive))) / 2
    return replace(drive, applied=_followed(drive.u, -half, half, relative=True))


def rate_limit(drive: Drive, rng: Rng) -> Drive:
    """The actuator moves by 0.15 to 0.6 rad/s at most."""
    most = rng.uniform(0.15, 0.6, len(drive)) * drive.task.experiment.Ts
    return replace(drive, applied=_followed(drive.u, -most, most, relative=False))


def asymmetry(drive: Drive, rng: Rng) -> Drive:
    """To one side the actuator goes only 0.5 to 0.9 of the way."""
    share = rng.uniform(0.5, 0.9, (len(drive), 1))
    return replace(drive, applied=np.where(drive.u > 0, drive.u, share * drive.u))


def _followed(u: Array, low: Array, high: Array, *, relative: bool) -> Array:
    """What follows commands (B, N): held where they are near, or moved by no more, (B,) bounds."""
    out, x = np.empty_like(u), np.zeros(len(u))
    for k in range(u.shape[1]):
        wanted = u[:, k]
        x = np.clip(x, wanted + low, wanted + high) if relative else x + np.clip(
            wanted - x, low, high
        )  # fmt: skip
        out[:, k] = x
    return out
