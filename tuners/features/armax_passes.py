"""Compiled passes of the ARMAX fit: cost, slopes and Levenberg and Marquardt's steps.

C is kept stable by working on its reflection coefficients, ``c1 = k1 (1 + k2), c2 = k2``, which a
stable C keeps in a box: a coefficient that presses against its side is held there while the others
settle.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel

PARAMETERS = ("a1", "a2", "b1", "b2", "c1", "c2")

_P = len(PARAMETERS)
_EDGE = 1.0 - 1e-6  # largest reflection coefficient

# Rows of the workspace, LANES numbers each.  One flat array with offsets known to the
# compiler is what lets it vectorise over the lanes: five times faster than 2-D arrays.
_A1, _A2, _B1, _B2, _C1, _C2 = (row * LANES for row in range(_P))
_PSI = 6 * LANES  # regressors, -de/dtheta
_Y1, _Y2, _U1, _U2, _E1, _E2 = (row * LANES for row in range(12, 18))
COST = 18 * LANES
_GRADIENT = 19 * LANES
_HESSIAN = 25 * LANES  # 6 x 6, the upper half is used
ROWS = 61
_MAX_PASSES = 400
_TOLERANCE = 1e-8  # of the cost: a hundredth of a coefficient's standard deviation
_MU_START, _MU_LEAST, _MU_MAX = 1e-3, 1e-12, 1e10


@kernel
def normal_equations(
    u: NDArray[np.float64], y: NDArray[np.float64], work: NDArray[np.float64]
) -> None:
    """Sum of e^2, half its gradient and its Gauss-Newton Hessian, lane by lane.

    `u` and `y` hold (N, LANES) numbers, `work` (ROWS, LANES) of them with the
    parameters in its first rows.
    """
    for i in range(_PSI, ROWS * LANES):
        work[i] = 0.0
    for start in range(0, len(y), LANES):
        for lane in range(LANES):
            c1, c2 = work[_C1 + lane], work[_C2 + lane]
            y1, u1, e1 = work[_Y1 + lane], work[_U1 + lane], work[_E1 + lane]
            e = y[start + lane] + work[_A1 + lane] * y1 + work[_A2 + lane] * work[_Y2 + lane]
            e -= work[_B1 + lane] * u1 + work[_B2 + lane] * work[_U2 + lane]
            e -= c1 * e1 + c2 * work[_E2 + lane]
            for row, value in ((0, -y1), (2, u1), (4, e1)):
                i = _PSI + row * LANES + lane
                old = work[i]
                work[i] = value - c1 * old - c2 * work[i + LANES]
                work[i + LANES] = old
            work[_Y2 + lane], work[_Y1 + lane] = y1, y[start + lane]
            work[_U2 + lane], work[_U1 + lane] = u1, u[start + lane]
            work[_E2 + lane], work[_E1 + lane] = e1, e
            work[COST + lane] += e * e
            for i in range(_P):
                psi = work[_PSI + i * LANES + lane]
                work[_GRADIENT + i * LANES + lane] -= psi * e
                for j in range(i, _P):
                    at = _HESSIAN + (_P * i + j) * LANES + lane
                    work[at] += psi * work[_PSI + j * LANES + lane]


@kernel
def _solve(
    H: NDArray[np.float64], g: NDArray[np.float64], mu: float, x: NDArray[np.float64]
) -> bool:
    """Solve (H + mu diag H) x = -g by Cholesky's method; false if H is not positive definite."""
    size = len(g)
    R = np.empty((size, size))
    for i in range(size):
        for j in range(i + 1):
            s = H[i, j] * (1.0 + mu) if i == j else H[i, j]
            for k in range(j):
                s -= R[i, k] * R[j, k]
            if i > j:
                R[i, j] = s / R[j, j]
            elif s > 0.0:
                R[i, i] = np.sqrt(s)
            else:
                return False
    for i in range(size):
        s = -g[i]
        for k in range(i):
            s -= R[i, k] * x[k]
        x[i] = s / R[i, i]
    for i in range(size - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, size):
            s -= R[k, i] * x[k]
        x[i] = s / R[i, i]
    return True


@kernel
def _local_model(
    work: NDArray[np.float64],
    lane: int,
    theta: NDArray[np.float64],
    g: NDArray[np.float64],
    H: NDArray[np.float64],
) -> None:
    """Gradient and Hessian of one lane in (a1, a2, b1, b2, k1, k2), held sides taken out."""
    k1, k2 = theta[4], theta[5]
    for i in range(_P):
        g[i] = work[_GRADIENT + i * LANES + lane]
        for j in range(i, _P):
            H[i, j] = work[_HESSIAN + (_P * i + j) * LANES + lane]
            H[j, i] = H[i, j]
    # c1 = k1 (1 + k2), c2 = k2
    g[4], g[5] = (1.0 + k2) * g[4], k1 * g[4] + g[5]
    for i in range(_P):
        H[i, 4], H[i, 5] = (1.0 + k2) * H[i, 4], k1 * H[i, 4] + H[i, 5]
    for i in range(_P):
        H[4, i], H[5, i] = (1.0 + k2) * H[4, i], k1 * H[4, i] + H[5, i]
    for i in (4, 5):
        if abs(theta[i]) >= _EDGE and theta[i] * g[i] < 0.0:
            for j in range(_P):
                H[i, j], H[j, i] = 0.0, 0.0
            H[i, i], g[i] = 1.0, 0.0


@kernel
def _load(work: NDArray[np.float64], lane: int, theta: NDArray[np.float64]) -> None:
    """Put one lane's parameters into the workspace, C in its coefficients again."""
    for i in range(4):
        work[i * LANES + lane] = theta[i]
    work[_C1 + lane] = theta[4] * (1.0 + theta[5])
    work[_C2 + lane] = theta[5]


@kernel
def _start(
    u: NDArray[np.float64],
    y: NDArray[np.float64],
    pole: float,
    work: NDArray[np.float64],
    theta: NDArray[np.float64],
) -> None:
    """Least squares in (a, b) for a C with a double pole; theta is (LANES, 6)."""
    g, H, step = np.empty(_P), np.empty((_P, _P)), np.empty(4)
    theta[:] = 0.0
    theta[:, 4] = -2.0 * pole / (1.0 + pole * pole)
    theta[:, 5] = pole * pole
    for lane in range(LANES):
        _load(work, lane, theta[lane])
    normal_equations(u, y, work)
    for lane in range(LANES):
        _local_model(work, lane, theta[lane], g, H)
        if _solve(H[:4, :4], g[:4], 0.0, step):
            for i in range(4):
                theta[lane, i] = step[i]


@kernel
def fit(
    u: NDArray[np.float64],
    y: NDArray[np.float64],
    pole: float,
    theta: NDArray[np.float64],
    best: NDArray[np.float64],
    ending: NDArray[np.int64],
) -> None:
    """Minimise lane by lane; `ending` gets status and passes."""
    work = np.zeros(ROWS * LANES)
    _start(u, y, pole, work, theta)
    trial = theta.copy()
    g, H = np.zeros((LANES, _P)), np.zeros((LANES, _P, _P))
    step = np.empty(_P)
    mu, growth, promised = np.full(LANES, _MU_START), np.full(LANES, 2.0), np.zeros(LANES)
    best[:] = np.inf
    ending[:, 0] = -1
    for count in range(1, _MAX_PASSES):
        running = False
        for lane in range(LANES):
            _load(work, lane, trial[lane])
        normal_equations(u, y, work)
        for lane in range(LANES):
            if ending[lane, 0] >= 0:
                continue
            ending[lane, 1] = count + 1
            cost = work[COST + lane]
            gained = best[lane] - cost
            if gained > 0.0:
                best[lane] = cost
                theta[lane] = trial[lane]
                _local_model(work, lane, theta[lane], g[lane], H[lane])
                # Damping by the gain ratio (Nielsen, 1999): where the reduced order leaves
                # a large residual, undamped steps zigzag across the valley for ever.
                if promised[lane] > 0.0:
                    surprise = 2.0 * gained / promised[lane] - 1.0
                    factor = max(1.0 / 3.0, 1.0 - surprise**3)
                    mu[lane] = max(mu[lane] * factor, _MU_LEAST)
                growth[lane] = 2.0
            else:
                mu[lane] *= growth[lane]
                growth[lane] *= 2.0
            if not np.isfinite(best[lane]):
                ending[lane, 0] = 2
            while ending[lane, 0] < 0:
                if mu[lane] > _MU_MAX:
                    ending[lane, 0] = 1
                elif _solve(H[lane], g[lane], mu[lane], step):
                    promised[lane] = 0.0
                    for i in range(_P):
                        pull = mu[lane] * H[lane, i, i] * step[i]
                        promised[lane] += step[i] * (pull - g[lane, i])
                        trial[lane, i] = theta[lane, i] + step[i]
                    for i in (4, 5):
                        trial[lane, i] = min(max(trial[lane, i], -_EDGE), _EDGE)
                    if promised[lane] < _TOLERANCE * best[lane] and gained < 1e-6 * best[lane]:
                        ending[lane, 0] = 0
                    break
                else:
                    mu[lane] *= 10.0
            running = running or ending[lane, 0] < 0
        if not running:
            break
    for lane in range(LANES):
        if ending[lane, 0] < 0:
            ending[lane, 0] = 1
        k1, k2 = theta[lane, 4], theta[lane, 5]
        theta[lane, 4] = k1 * (1.0 + k2)
