"""Information on friction and mass in a window of driving: prediction errors and their slopes.

Gyro noise is white, the steering disturbance d a first-order autoregression inside the loop:

    x+ = A x + B (u + d),   d+ = a d + w,   y = C x + v

The one-step prediction of the stationary Kalman filter needs the logged command and yaw rate
alone.  At the true vehicle its errors are white, whatever the controller did with them, so that
neither reference nor gains are needed and feedback biases nothing (Ljung, 1999, sec. 13.4).  With
the prediction in observer form, ``e = y - w_1``,

    w_i+ = c w_i + w_{i+1} - alpha_i w_1 + beta_i u + kappa_i e

and slopes by the logarithms of friction and total mass as in `yawrate_env.vehicle.sensitivity`,
with kappa held: what its slopes would add is of second order in the errors.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel, over_blocks
from yawrate_env.loop.observer_form import polynomials
from yawrate_env.vehicle.discrete import plants
from yawrate_env.vehicle.kalman import kalman
from yawrate_env.vehicle.single_track import Vehicle, context_of

Array = NDArray[np.float64]

_DIFFERENCE = 1e-5  # of a logarithm: slopes need four digits, and complex steps take thrice as long


@dataclass(frozen=True, slots=True)
class Noise:
    """What moves the yaw rate beside the command.

    Attributes
    ----------
    gyro : float
        Standard deviation of the white measurement noise [rad/s].
    disturbance : float
        Root mean square at the steering [rad].
    time : float
        Time constant of the disturbance [s].
    """

    gyro: float
    disturbance: float
    time: float


@dataclass(frozen=True, slots=True, eq=False)
class Predictor:
    """Kalman predictors of B vehicles with the disturbance as last state, and their slopes.

    Attributes
    ----------
    A, B, K : NDArray
        (B, n, n), (B, n), (B, n) transition, command's column and Kalman gain.
    variance : NDArray
        (B,) of the prediction error [rad^2/s^2].
    form : NDArray
        (B, 1 + 7 n) centre, alpha, beta, kappa and the slopes of alpha and beta.
    rows, d_rows : NDArray
        (B, n, n), (B, 2, n, n) states to observer form, and their slopes.
    """

    A: Array
    B: Array
    K: Array
    variance: Array
    form: Array
    rows: Array
    d_rows: Array

    @classmethod
    def of(
        cls,
        vehicle: Vehicle,
        theta: Array,
        noise: Noise,
        Ts: float,
        gain: tuple[Array, Array] | None = None,
    ) -> Self:
        """Predictors of vehicles (B, 3) at a sampling time [s].

        Parameters
        ----------
        gain : tuple of NDArray, optional
            Kalman gains (B, n) and variances (B,) of vehicles nearby: with them errors are a
            little less white, and a third of the time is saved.
        """
        count = len(theta)
        plant = plants(vehicle, context_of(_moved(theta, vehicle)), Ts)
        share = float(np.exp(-Ts / noise.time))
        whole, row = _joined(plant.A, plant.B, share), np.append(plant.C, 0.0)
        n = whole.shape[1]
        column = np.append(plant.B, np.zeros((len(plant), 1)), axis=1)
        A, B = whole[:count], column[:count]
        fresh = noise.disturbance**2 * (1 - share**2)
        K, variance = _gains(A, row, fresh, noise) if gain is None else gain
        c = np.trace(A, axis1=1, axis2=2) / n
        found = polynomials(whole, column, row, np.tile(c, 3))
        alpha, beta, rows = (each[:count] for each in found)
        d_alpha, d_beta, d_rows = (_slopes(each) for each in found)
        kappa = _applied(np.ascontiguousarray(rows), K)
        parts = (c[:, None], alpha, beta, kappa, d_alpha.reshape(count, -1),
                 d_beta.reshape(count, -1))  # fmt: skip
        return cls(A, B, K, variance, np.concatenate(parts, axis=1), rows, d_rows)

    def __len__(self) -> int:
        return len(self.A)

    def gram(self, u: Array, y: Array, x: Array) -> tuple[Array, Array]:
        """Inner products of prediction error and slopes over a window, and the last state.

        Parameters
        ----------
        u, y : (B, N) float64
            Command as it reaches the vehicle [rad], measured yaw rate [rad/s].
        x : (B, n) float64
            State that is predicted for the first sample.

        Returns
        -------
        gram : (B, 3, 3) float64
            Of error, slope by log friction and slope by log mass, in units of `variance`.
        x : (B, n) float64
            State predicted for the sample after the last.
        """
        count, n = self.B.shape
        start = _applied(self.rows, x)
        slopes = _applied(self.d_rows.reshape(-1, n, n), np.repeat(x, 2, axis=0))
        packed = np.concatenate([self.form, start, slopes.reshape(count, -1)], axis=1)
        gram, last = np.empty((count, 3, 3)), np.empty((count, n))
        upper = np.triu_indices(3)

        def one_block(i: int, j: int) -> None:
            lanes = np.minimum(np.arange(i, i + LANES), j - 1)
            size = packed.shape[1]
            work = np.zeros((size + 6, LANES))
            work[:size] = packed[lanes].T
            _recursion(n)(work.reshape(-1), u, y, lanes)
            last[i:j] = work[1 + 7 * n : 1 + 8 * n, : j - i].T
            sums = work[size:, : j - i].T
            gram[i:j, upper[0], upper[1]] = sums
            gram[i:j, upper[1], upper[0]] = sums

        over_blocks(one_block, count, LANES)
        after = np.linalg.solve(self.rows, last[..., None])[..., 0]
        return gram / self.variance[:, None, None], np.asarray(after, dtype=np.float64)


def _moved(theta: Array, vehicle: Vehicle) -> Array:
    """Vehicles (3 B, 3): themselves, with a little more friction, and with a little more mass."""
    friction, mass = theta.copy(), theta.copy()
    friction[:, 0] *= np.exp(_DIFFERENCE)
    mass[:, 1] += np.expm1(_DIFFERENCE) * (mass[:, 1] + vehicle.M_0)
    return np.concatenate([theta, friction, mass])


def _slopes(values: Array) -> Array:
    """Slopes (B, 2, ...) by the logarithms of friction and mass, of values for `_moved`."""
    here, friction, mass = np.split(values, 3)
    return np.stack([friction - here, mass - here], axis=1) / _DIFFERENCE


def _joined(A: Array, B: Array, share: float) -> Array:
    """Transitions (B, n + 1, n + 1) with the disturbance, which adds to the command."""
    n = A.shape[1]
    whole = np.zeros((len(A), n + 1, n + 1))
    whole[:, :n, :n], whole[:, :n, n], whole[:, n, n] = A, B, share
    return whole


def _gains(A: Array, row: Array, fresh: float, noise: Noise) -> tuple[Array, Array]:
    """Gains and variances where noise of variance `fresh` enters the last state."""
    Q = np.zeros_like(A)
    Q[:, -1, -1] = fresh
    return kalman(A, row, Q, noise.gyro**2)[:2]


def _applied(M: Array, v: Array) -> Array:
    """Products (B, n) of matrices and vectors, the same in any batch."""
    out = np.empty_like(v)
    _product(M, v, out)
    return out


@kernel
def _product(M: NDArray[np.float64], v: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    for b in range(len(v)):
        for i in range(v.shape[1]):
            out[b, i] = 0.0
            for j in range(v.shape[1]):
                out[b, i] += M[b, i, j] * v[b, j]


@cache
def _recursion(n: int) -> Any:
    """Compile for order `n`, known to the compiler so that it unrolls the sums."""
    ALPHA, BETA, KAPPA = LANES, (1 + n) * LANES, (1 + 2 * n) * LANES
    D_ALPHA, D_BETA = (1 + 3 * n) * LANES, (1 + 5 * n) * LANES
    STATE = (1 + 7 * n) * LANES
    FIRST, SECOND = STATE + n * LANES, STATE + 2 * n * LANES
    SUMS = STATE + 3 * n * LANES

    @kernel
    def recursion(
        work: NDArray[np.float64],
        u: NDArray[np.float64],
        y: NDArray[np.float64],
        own: NDArray[np.int64],
    ) -> None:
        command, measured = np.empty(LANES), np.empty(LANES)
        for k in range(y.shape[1]):
            for lane in range(LANES):
                command[lane], measured[lane] = u[own[lane], k], y[own[lane], k]
            for lane in range(LANES):
                c, push = work[lane], command[lane]
                output = work[STATE + lane]
                s1, s2 = work[FIRST + lane], work[SECOND + lane]
                e = measured[lane] - output
                work[SUMS + lane] += e * e
                work[SUMS + LANES + lane] += e * s1
                work[SUMS + 2 * LANES + lane] += e * s2
                work[SUMS + 3 * LANES + lane] += s1 * s1
                work[SUMS + 4 * LANES + lane] += s1 * s2
                work[SUMS + 5 * LANES + lane] += s2 * s2
                for i in range(n):
                    at = i * LANES + lane
                    alpha, kappa = work[ALPHA + at], work[KAPPA + at]
                    back = alpha + kappa
                    x = c * work[STATE + at] - alpha * output + work[BETA + at] * push + kappa * e
                    t1 = c * work[FIRST + at] - back * s1
                    t1 += work[D_BETA + at] * push - work[D_ALPHA + at] * output
                    t2 = c * work[SECOND + at] - back * s2
                    t2 += work[D_BETA + n * LANES + at] * push
                    t2 -= work[D_ALPHA + n * LANES + at] * output
                    if i + 1 < n:
                        x += work[STATE + at + LANES]
                        t1 += work[FIRST + at + LANES]
                        t2 += work[SECOND + at + LANES]
                    work[STATE + at], work[FIRST + at], work[SECOND + at] = x, t1, t2

    return recursion
