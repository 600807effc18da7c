"""Recordings of processes with lags and a dead time, simulated by SciPy in fine steps.

Nothing here comes from the package's own simulators: each lag is a first-order section of
``scipy.signal.lfilter`` for a held input, the dead time shifts the output along lines between
steps, and what is wrong with a recording happens on the fine grid, between the samples.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Valve = Callable[[Array, float, np.random.Generator], Array]

FINE = 20
"""Steps of the simulation for each sample."""

_STUCK = 7.0  # s, the longest that a sticking valve stays
_BAND = 0.3  # of the largest command: how far a valve with friction lets it go before it follows
_STICK, _SLIP = 0.4, 0.1  # of the largest command: what He and Kano call S and J


@dataclass(frozen=True, slots=True)
class Fault:
    """What is wrong with recordings.

    Attributes
    ----------
    name : str
        In words.
    late : int
        Samples by which the plant is later than its parameters say.
    scale : float
        Of the logged output.
    stretch : float
        Of the sampling time that is told to the tuner.
    offset, drift : float
        Of the output, in its standard deviations; the drift's at the end.
    valve : callable, optional
        Command (n,) in steps [s] to what the plant gets.
    """

    name: str
    late: int = 0
    scale: float = 1.0
    stretch: float = 1.0
    offset: float = 0.0
    drift: float = 0.0
    valve: Valve | None = None


def clipped(command: Array, step: float, rng: np.random.Generator) -> Array:
    """An actuator that gives 70 % of the largest command at most."""
    most = 0.7 * np.abs(command).max()
    return np.clip(command, -most, most)


def sticking(command: Array, step: float, rng: np.random.Generator) -> Array:
    """A valve that follows a change of the command up to `_STUCK` seconds late."""
    return _stuck(command, step, rng, 1.0)


def sticking_at_times(command: Array, step: float, rng: np.random.Generator) -> Array:
    """The same at every third change, on average."""
    return _stuck(command, step, rng, 1 / 3)


def _stuck(command: Array, step: float, rng: np.random.Generator, share: float) -> Array:
    given, until = command.copy(), 0
    for at in (np.flatnonzero(np.diff(command)) + 1).tolist():
        if at >= until and rng.uniform() < share:
            until = at + int(rng.uniform(0, _STUCK) / step)
            given[at:until] = given[at - 1]
    return given


def rubbing(command: Array, step: float, rng: np.random.Generator) -> Array:
    """A valve with friction, which moves once the command is `_BAND` away and then jumps to it."""

    def follow(u: Array) -> Iterator[float]:
        at = u[0]
        for value in u:
            at = value if abs(value - at) > _BAND * np.abs(u).max() else at
            yield at

    return _moved(command, follow)


def loose(command: Array, step: float, rng: np.random.Generator) -> Array:
    """A valve with a dead band of `_BAND` of the command's range: it is behind by half of it."""

    def follow(u: Array) -> Iterator[float]:
        at, half = u[0], _BAND * np.ptp(u) / 2
        for value in u:
            at = min(max(at, value - half), value + half)
            yield at

    return _moved(command, follow)


def skipping(command: Array, step: float, rng: np.random.Generator) -> Array:
    """A valve after He et al. (Ind. Eng. Chem. Res. 46, 2007): friction builds up, then slips."""

    def follow(u: Array) -> Iterator[float]:
        most = np.abs(u).max()
        static, kinetic = (_STICK + _SLIP) / 2 * most, (_STICK - _SLIP) / 2 * most
        at, force = u[0], 0.0
        for change, value in zip(np.diff(u, prepend=u[0]), u, strict=True):
            force += change
            if abs(force) > static:
                at, force = value - np.sign(force) * kinetic, np.sign(force) * kinetic
            yield at

    return _moved(command, follow)


def returning(command: Array, step: float, rng: np.random.Generator) -> Array:
    """A valve after Kano et al. (IFAC DYCOPS, 2004): it sticks where the command turns."""

    def follow(u: Array) -> Iterator[float]:
        most, at, direction, stuck, turn, last = np.abs(u).max(), u[0], 1.0, True, u[0], 0.0
        for change, value in zip(np.diff(u, prepend=u[0]), u, strict=True):
            if not stuck and change * last <= 0:
                stuck, turn = True, value - change
            moved = direction * (value - turn)
            if stuck and (-moved > _STICK * most or moved > _SLIP * most):
                direction, stuck = np.sign(moved) * direction, False
            if not stuck:
                at = value - direction * (_STICK - _SLIP) / 2 * most
            last = change
            yield at

    return _moved(command, follow)


def _moved(command: Array, follow: Callable[[Array], Iterator[float]]) -> Array:
    """What a valve gives that moves when the command changes, from the values that this takes."""
    at = np.r_[0, np.flatnonzero(np.diff(command)) + 1]
    values = np.fromiter(follow(command[at]), np.float64, len(at))
    return np.repeat(values, np.diff(np.r_[at, len(command)]))


def curved(command: Array, step: float, rng: np.random.Generator) -> Array:
    """An equal-percentage valve of rangeability 10, between the command's extremes."""
    most = np.abs(command).max()
    opening = (command / most + 1) / 2
    return np.asarray(most * (2 * (10**opening - 1) / 9 - 1))


FAULTS = (
    Fault("none"),
    Fault("5 samples later", late=5),
    Fault("output x 1.5", scale=1.5),
    Fault("Ts x 1.1", stretch=1.1),
    Fault("Ts x 2", stretch=2.0),
    Fault("saturation at 70 %", valve=clipped),
    Fault("offset", offset=0.3),
    Fault("drift", drift=0.5),
    Fault("valve up to 7 s late", valve=sticking),
    Fault("valve up to 7 s late, at times", valve=sticking_at_times),
    Fault("valve with friction", valve=rubbing),
    Fault("equal-percentage valve", valve=curved),
    Fault("valve with a dead band", valve=loose),
    Fault("valve after He", valve=skipping),
    Fault("valve after Kano", valve=returning),
)


def output(parameters: Mapping[str, float], command: Array, step: float, late: float) -> Array:
    """Output (n,) of ``K e^{-L s} / ((T1 s + 1) ...)``, or of ``K e^{-L s} / s``, in steps [s].

    Lags are the parameters whose names begin with T; without one the plant integrates.
    """
    y = parameters["K"] * np.r_[0.0, command]
    lags = [value for name, value in parameters.items() if name.startswith("T")]
    if not lags:
        y = np.cumsum(y * step)
    for number, lag in enumerate(lags):
        a = np.exp(-step / lag)
        if number == 0:  # y[k] is held from step k - 1 to step k
            y = lfilter([1 - a], [1, -a], y)
        else:  # behind a lag signals are nearly straight lines between steps
            y = lfilter([1 - a, 1 - a], [2, -2 * a], y)
    times = step * np.arange(len(y))
    return np.asarray(np.interp(times - parameters["L"] - late, times, y, left=0.0))


def recordings(
    plant: Plant, theta: Array, fault: Fault, seed: Sequence[int] | int, inputs: Array | None = None
) -> tuple[Array, Array, float]:
    """Inputs (1 or B, N), measured outputs (B, N) and told sampling time of plants (B, p)."""
    rng = np.random.default_rng(seed)
    u = plant.u[None] if inputs is None else inputs
    step, N = plant.Ts / FINE, u.shape[1]
    found = np.empty((len(theta), N))
    for i, row in enumerate(theta):
        command = np.repeat(u[i % len(u)], FINE)
        if fault.valve is not None:
            command = fault.valve(command, step, rng)
        of = dict(zip(plant.prior, row.tolist(), strict=True))
        found[i] = output(of, command, step, fault.late * plant.Ts)[:-1:FINE]
    size = found.std(axis=1, keepdims=True)
    line = np.linspace(0.0, 1.0, N)
    found = fault.scale * found + (fault.offset + fault.drift * line) * size
    found += plant.sigma(found)[:, None] * rng.standard_normal(found.shape)
    return u, found, fault.stretch * plant.Ts
