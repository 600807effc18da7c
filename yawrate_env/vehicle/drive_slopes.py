"""Prediction errors of a window, and their slopes by everything that may be wrong with a car.

The predictor is that of `yawrate_env.vehicle.drive_information`.  With its transition in observer
form, F, the prediction is the response to ``beta u + kappa y``, and its slope by a parameter p is
that of the same filter to ``d beta/dp u - d alpha/dp w_1 + d kappa/dp e``.  All these are sums of

    v+ = F' v + (1, 0, ..., 0)' s,     s = u or w_1,

so that two states of order n serve any number of parameters: inner products of errors and slopes
are a linear map of those of errors and v.  Only the noise's two parameters, which move kappa, have
filters of their own.  Slopes begin each window at zero: a manoeuvre ends within its window.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.discretisation import DiscretePlant, zoh
from yawrate_env.loop.observer_form import polynomials
from yawrate_env.vehicle.discrete import plants
from yawrate_env.vehicle.drive_gains import entry, gain_slopes, outer
from yawrate_env.vehicle.drive_information import Noise
from yawrate_env.vehicle.drive_signals import delayed, signal_products
from yawrate_env.vehicle.kalman import kalman
from yawrate_env.vehicle.single_track import Context, Vehicle, context_of, state_space

Array = NDArray[np.float64]

CONSTANTS = ("C_f", "J_z", "omega_n", "xi", "l_rel_r", "l_f", "l_r")
"""Of `Vehicle`, as logarithms of what they are over what the data say.  C_r is not among them: with
other friction, it is C_f.  Nor is l_rel_f, of which the windows tell nothing."""

_MOVING = ("friction", "mass", "speed", *CONSTANTS)  # other plants; the others need none
PARAMETERS = (*_MOVING, "load", "gain", "late", "offset", "disturbance", "time", "colour")
"""Coordinates: logarithms of friction and total mass; of speed, constants, mass beyond the load,
gyro gain, disturbance and its time constant over what they are taken for; dead time [s]; and the
gyro's offset [rad/s]."""

AT = {name: i for i, name in enumerate(PARAMETERS)}
"""Where each is."""

NOISE = [AT["disturbance"], AT["time"], AT["colour"]]
LATEST = 0.1
"""Longest dead time [s]."""

_DIFFERENCE = 1e-5
_LEAST = 1e-9  # rad, of what renews the disturbance
_ACTUATOR = 4, 5  # its rate and angle among the states


@dataclass(frozen=True, slots=True, eq=False)
class Past:
    """What reading B windows needs of those before.

    Attributes
    ----------
    x : NDArray
        (B, 7) state that is predicted for the first sample.
    u : NDArray
        (B, L) last commands [rad].
    """

    x: Array
    u: Array

    @classmethod
    def rest(cls, count: int, Ts: float) -> Self:
        """The past of straight driving."""
        return cls(np.zeros((count, 7)), np.zeros((count, 2 + int(np.ceil(LATEST / Ts)))))


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """What B windows say near coordinates z.

    Attributes
    ----------
    energy : NDArray
        (B,) sum of squared prediction errors in units of their variance.
    pull : NDArray
        (B, P) inner products of errors and slopes.
    information : NDArray
        (B, P, P) inner products of slopes.
    slow : NDArray
        (B,) mean square of sums of errors over twelve samples, over what it is of white ones.
    x : NDArray
        (B, 7) state predicted for the sample after the last.
    response : NDArray
        (B, P + 1) complex, slopes of the logarithm of the plant's response at the frequency of
        interest, by the coordinates, and by the logarithm of the frequency.
    """

    energy: Array
    pull: Array
    information: Array
    slow: Array
    x: Array
    response: NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Reader:
    """Reads windows of cars that may differ from their data.

    Attributes
    ----------
    vehicle : Vehicle
        What is claimed of every car.
    noise : Noise
        What is claimed to move the yaw rate beside the command.
    Ts : float
        Sampling time of the logger [s].
    frequency : float
        Of interest: the loops' crossover [Hz].
    """

    vehicle: Vehicle
    noise: Noise
    Ts: float
    frequency: float

    def plants(self, z: Array, v_x: Array, Ts: float) -> DiscretePlant:
        """Plants from command to measured yaw rate, of coordinates (B, P) at speeds (B,)."""
        dead_time = np.clip(z[:, [AT["late"]]], 0.0, LATEST)
        theta = np.append(self._theta(z, v_x), dead_time, axis=1)
        found = plants(self.vehicle, context_of(theta, (*CONSTANTS, "dead_time")), Ts)
        return _amplified(found, z)

    def __call__(self, u: Array, y: Array, v_x: Array, past: Past, z: Array) -> Slopes:
        """Read windows with predictors of coordinates z.

        Parameters
        ----------
        u, y : (B, N) float64
            Command [rad] and measured yaw rate [rad/s].
        v_x : (B,) float64
            Speed [m/s].
        z : (B, P) float64
            Coordinates, in the order of `PARAMETERS`.
        """
        count, P = z.shape
        moved, speeds = _moved(z), np.tile(v_x, 1 + len(_MOVING))
        context = context_of(self._theta(moved, speeds), CONSTANTS)
        plant = _amplified(_balanced(self.vehicle, context, self.Ts), moved)
        n = plant.B.shape[1] + 1
        share = np.exp(-self.Ts / (self.noise.time * np.exp(z[:, AT["time"]])))
        whole, column = _joined(plant, np.tile(share, 1 + len(_MOVING)))
        row = np.append(plant.C, 0.0)
        c = np.trace(whole[:count], axis1=1, axis2=2) / n
        alpha, beta, rows = polynomials(whole, column, row, np.tile(c, 1 + len(_MOVING)))
        rows = rows[:count]
        form, variance = self._form(plant, rows, alpha[:count], beta[:count], row, c, z)
        kappa = form[:, 1 + 2 * n : 1 + 3 * n]
        start = (rows * past.x[:, None]).sum(axis=2)
        late = self._late(u, past.u, z[:, AT["late"]])
        gram, last, slow = signal_products(n, form, start, late, y - z[:, [AT["offset"]]])
        signals = np.zeros((count, 1 + P, gram.shape[1]))
        signals[:, 0, 0] = 1.0
        own = signals[:, 1:]
        for j in range(len(_MOVING)):
            part = slice((j + 1) * count, (j + 2) * count)
            own[:, j, 1 : 1 + n] = (beta[part] - beta[:count]) / _DIFFERENCE
            own[:, j, 1 + n : 1 + 2 * n] = (alpha[:count] - alpha[part]) / _DIFFERENCE
        own[:, AT["load"]] = own[:, AT["mass"]]
        own[:, AT["gain"], 1 : 1 + n] = beta[:count]
        own[:, AT["offset"], 1 + 2 * n] = _constant(c, alpha[:count] + kappa, kappa)
        own[:, AT["late"], 2 + 2 * n] = 1 / self.Ts
        own[:, NOISE, [3 + 2 * n, 4 + 2 * n, 5 + 2 * n]] = 1.0
        found = signals @ gram @ signals.transpose(0, 2, 1) / variance[:, None, None]
        x = np.asarray(np.linalg.solve(rows, last[..., None])[..., 0])
        return Slopes(found[:, 0, 0], found[:, 1:, 0], found[:, 1:, 1:], slow / variance, x,
                      self._response(own, form, n))  # fmt: skip

    def _response(self, own: Array, form: Array, n: int) -> NDArray[np.complex128]:
        """Slopes (B, P + 1) of the plant's response (see `Slopes`)."""
        c, alpha, beta = form[:, :1], form[:, 1 : 1 + n], form[:, 1 + n : 1 + 2 * n]
        angle = 2j * np.pi * self.frequency
        low, high = ((np.exp(angle * factor * self.Ts) - c) ** np.arange(n - 1, -1, -1)
                     for factor in (1.0, 1.0 + _DIFFERENCE))  # fmt: skip
        over, more = ((beta * s).sum(axis=1) for s in (low, high))
        under, further = (s[:, -2] * s[:, 0] + (alpha * s).sum(axis=1) for s in (low, high))
        slopes = np.empty((len(own), own.shape[1] + 1), dtype=np.complex128)
        slopes[:, :-1] = (own[:, :, 1 : 1 + n] * low[:, None]).sum(axis=2) / over[:, None]
        slopes[:, :-1] += (own[:, :, 1 + n : 1 + 2 * n] * low[:, None]).sum(axis=2) / under[:, None]
        slopes[:, AT["late"]] -= angle
        slopes[:, -1] = (np.log(more / over) - np.log(further / under)) / _DIFFERENCE
        return slopes

    def after(self, past: Past, u: Array, found: Slopes) -> Past:
        """What reading the next window needs."""
        size = past.u.shape[1]
        return Past(found.x, np.concatenate([past.u, u], axis=1)[:, -size:])

    def _theta(self, z: Array, v_x: Array) -> Array:
        """Coordinates (B, P) as friction, load, speed and constants."""
        vehicle = self.vehicle
        mass = np.exp(z[:, AT["mass"]] + z[:, AT["load"]])
        speed = v_x * np.exp(z[:, AT["speed"]])
        constants = [getattr(vehicle, name) * np.exp(z[:, AT[name]]) for name in CONSTANTS]
        return np.stack([np.exp(z[:, 0]), mass - vehicle.M_0, speed, *constants], axis=1)

    def _form(
        self,
        plant: DiscretePlant,
        rows: Array,
        alpha: Array,
        beta: Array,
        row: Array,
        c: Array,
        z: Array,
    ) -> tuple[Array, Array]:
        """Coefficients (B, 1 + 8 n) of the recursion, and variances (B,) of prediction errors.

        They are c, alpha, beta, kappa, the slopes of kappa by the disturbance's size and by the
        gyro's colour, and those of alpha, beta and kappa by the time constant, whose pole is a
        factor of all three.
        """
        count, n = alpha.shape
        share, (size, colour) = self._noises(z)
        longer = z.copy()
        longer[:, NOISE[1]] += _DIFFERENCE
        slower, (other_size, other_colour) = self._noises(longer)
        whole, column = _joined(_first(plant, count), share)
        moved = whole.copy()
        moved[:, -1, -1] = slower
        others = polynomials(moved, column, row, c)
        d_alpha, d_beta, d_rows = (
            (a - b) / _DIFFERENCE for a, b in zip(others, (alpha, beta, rows), strict=True)
        )
        Q, Q_longer = np.zeros_like(whole), np.zeros_like(whole)
        coloured = outer(entry(rows, alpha, share - c))
        Q[:] = colour[:, None, None] * coloured
        Q[:, -1, -1] += size
        Q_longer[:] = other_colour[:, None, None] * outer(entry(others[2], others[0], slower - c))
        Q_longer[:, -1, -1] += other_size
        dA, dQ = np.zeros((count, 3, n, n)), np.zeros((count, 3, n, n))
        dA[:, 1, -1, -1] = (slower - share) / _DIFFERENCE
        dQ[:, 0, -1, -1] = 2 * size
        dQ[:, 1] = (Q_longer - Q) / _DIFFERENCE
        unit = self.noise.gyro**2 * (1 - share**2)
        dQ[:, 2] = unit[:, None, None] * coloured
        K, variance, covariance = kalman(whole, row, Q, self.noise.gyro**2)
        dK = np.empty((count, 3, n))
        gain_slopes(whole, row, dA, dQ, K, variance, covariance, dK)
        kappa, of_size, of_time, of_colour = (
            (rows * gain[:, None]).sum(axis=2) for gain in (K, dK[:, 0], dK[:, 1], dK[:, 2])
        )
        of_time += (d_rows * K[:, None]).sum(axis=2)
        parts = c[:, None], alpha, beta, kappa, of_size, of_colour, d_alpha, d_beta, of_time
        return np.concatenate(parts, axis=1), variance

    def _noises(self, z: Array) -> tuple[Array, tuple[Array, Array]]:
        """Share (B,) of disturbance and colour that stays; variances (B,) of what renews them."""
        share = np.exp(-self.Ts / (self.noise.time * np.exp(z[:, NOISE[1]])))
        fresh = 1 - share**2
        size = (self.noise.disturbance * np.exp(z[:, NOISE[0]])) ** 2 * fresh
        colour = self.noise.gyro**2 * np.maximum(z[:, NOISE[2]], 0.0) * fresh
        return share, (np.maximum(size, _LEAST**2), colour)

    def _late(self, u: Array, before: Array, dead_time: Array) -> Array:
        """Commands (B, N) as they were a dead time (B,) ago, with lines between samples."""
        late = np.empty_like(u)
        delayed(u, before, np.clip(dead_time, 0.0, LATEST) / self.Ts, late)
        return late


def _balanced(vehicle: Vehicle, context: Context, Ts: float) -> DiscretePlant:
    """`plants`, without dead time, with half the squarings: the actuator's rate is scaled first."""
    A, B, C = state_space(vehicle, context)
    z, delta = _ACTUATOR
    scale = np.sqrt(-A[:, [z], delta])
    A[:, z] /= scale
    A[:, :, z] *= scale
    B[:, z] /= scale[:, 0]
    found = zoh(A, B, C, Ts)
    found.A[:, z] *= scale
    found.A[:, :, z] /= scale
    found.B[:, z] *= scale[:, 0]
    return found


def _amplified(plant: DiscretePlant, z: Array) -> DiscretePlant:
    """With the gyro's gain, at the input: the states are those of a car of gain one times it."""
    gain = np.exp(z[:, AT["gain"]])
    D = None if plant.D is None else plant.D * gain
    return DiscretePlant(plant.A, plant.B * gain[:, None], plant.C, plant.Ts, D, plant.delay)


def _first(plant: DiscretePlant, count: int) -> DiscretePlant:
    return DiscretePlant(plant.A[:count], plant.B[:count], plant.C, plant.Ts)


def _moved(z: Array) -> Array:
    """Coordinates ((1 + m) B, P): themselves, and with one of `_MOVING` a little larger."""
    count = len(z)
    moved = np.tile(z, (1 + len(_MOVING), 1))
    for j in range(len(_MOVING)):
        moved[(j + 1) * count : (j + 2) * count, j] += _DIFFERENCE
    return moved


def _joined(plant: DiscretePlant, share: Array) -> tuple[Array, Array]:
    """Transitions (B, n + 1, n + 1) and columns with the disturbance, which adds to the command."""
    count, n = plant.B.shape
    whole = np.zeros((count, n + 1, n + 1))
    whole[:, :n, :n], whole[:, :n, n], whole[:, n, n] = plant.A, plant.B, share
    return whole, np.append(plant.B, np.zeros((count, 1)), axis=1)


def _constant(c: Array, back: Array, kappa: Array) -> Array:
    """What an offset of one leaves in the prediction error once it has settled, (B,)."""
    powers = (1 - c)[:, None] ** -np.arange(kappa.shape[1])
    v = powers / ((1 - c) + (back * powers).sum(axis=1))[:, None]
    return np.asarray(1 - (kappa * v).sum(axis=1))
