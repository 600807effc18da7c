"""What people would use instead, at its best: one episode each, by other libraries.

Each function prepares what an engineer would prepare once and returns the work that is
timed.  ``pysib`` and ``sippy_unipi`` come with the extra ``benchmark``; without them their
rows are missing.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from importlib import import_module
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.tuner.recording import Recording
from yawrate_env.batch import take
from yawrate_env.vehicle.single_track import Context, context_of, state_space, total_mass
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]


def simulations(task: Task, context: Context, u: Array) -> dict[str, Callable[[], Array]]:
    """Noise-free responses (N,) of the first vehicle to `u` (N,), by name of the library."""
    import control
    from scipy import signal

    A, B, C = (x[0] for x in _matrices(task, context))
    Ts, zero = task.experiment.Ts, np.zeros((1, 1))
    system = control.sample_system(control.ss(A, B, C, zero), Ts, "zoh")
    matrices = (system.A, system.B, system.C, system.D, Ts)
    zeros, poles = system.zeros(), system.poles()  # SciPy's own go through bad polynomials
    gain = (system(1.0) * np.prod(1 - poles) / np.prod(1 - zeros)).real
    sections = signal.zpk2sos(zeros, poles, gain)
    return {
        "python-control forced_response": lambda: np.asarray(
            control.forced_response(system, inputs=u).outputs
        ).ravel(),
        "scipy dlsim": lambda: np.asarray(signal.dlsim(matrices, u)[1]).ravel(),
        # Cascades have as many zeros as poles: one sample of delay is missing.
        "scipy sosfilt": lambda: np.append(0.0, signal.sosfilt(sections, u[:-1])),
    }


def armax_fits(u: Array, y: Array) -> dict[str, Callable[[], Array]]:
    """ARMAX(2, 2, 2, 1) coefficients (6,) of one episode, by name of the library."""
    fits: dict[str, Callable[[], Array]] = {}
    if find_spec("pysib"):
        fits["pysib.armax"] = lambda: _pysib(u, y)
    if find_spec("sippy_unipi"):
        fits["SIPPY ARMAX"] = lambda: _sippy(u, y)
    return fits


def gray_box(task: Task, recording: Recording) -> Callable[[], tuple[float, float]]:
    """mu_s and M_delta of the first episode, by SciPy's least squares around python-control."""
    import control
    from scipy.optimize import least_squares

    start, known = context_of(yaw_rate(task).middle), task.vehicle
    u, y = recording.u[0], recording.y[0]
    v_x = start.v_x

    def vehicle(theta: Array) -> Context:
        mu_s, mass = np.exp(theta)
        return Context(np.array([mu_s]), np.array([mass - known.M_0]), v_x)

    def errors(theta: Array) -> Array:
        A, B, C = (x[0] for x in _matrices(task, vehicle(theta)))
        system = control.ss(A, B, C, np.zeros((1, 1)))
        system = control.sample_system(system, recording.Ts, "zoh")
        return np.asarray(y - control.forced_response(system, inputs=u).outputs.ravel())

    def fit() -> tuple[float, float]:
        first = np.log([start.mu_s[0], total_mass(known, start)[0]])
        found = vehicle(least_squares(errors, first, method="lm").x)
        return float(found.mu_s[0]), float(found.M_delta[0])

    return fit


def laguerre(basis: Laguerre, recording: Recording) -> Callable[[], Array]:
    """Coefficients of the first episode by `scipy.signal.lfilter` and `numpy.linalg.lstsq`."""
    from scipy.signal import lfilter

    a, y = np.exp(-basis.pole * recording.Ts), recording.y[0]

    def fit() -> Array:
        phi = [lfilter([0, np.sqrt(1 - a * a)], [1, -a], recording.u[0])]
        for _ in range(1, basis.order):
            phi.append(lfilter([-a, 1], [1, -a], phi[-1]))
        return np.asarray(np.linalg.lstsq(np.stack(phi, axis=1), y)[0])

    return fit


def _matrices(task: Task, context: Context) -> tuple[Array, Array, Array]:
    A, B, C = state_space(task.vehicle, take(context, slice(0, 1)))
    return A, B[:, :, None], C[None, None]


def _pysib(u: Array, y: Array) -> Array:
    pysib = import_module("pysib")
    with _silence():
        return np.asarray(pysib.armax(u, y, na=2, nb=2, nc=2, nz=1)[0])


def _sippy(u: Array, y: Array) -> Array:
    sippy_unipi = import_module("sippy_unipi")
    orders = [2, 2, 2, 0]  # it counts the delay beyond the first sample
    with _silence():
        model = sippy_unipi.system_identification(y[None], u[None], "ARMAX", ARMAX_orders=orders)
    parts = model.DENOMINATOR[0][0][1:], model.NUMERATOR[0][0], model.NUMERATOR_H[0][0][1:]
    return np.concatenate(parts)


@contextmanager
def _silence() -> Iterator[None]:
    """Send what is printed nowhere, by compiled code too."""
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        kept = os.dup(1)
        os.dup2(nowhere.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(kept, 1)
            os.close(kept)
