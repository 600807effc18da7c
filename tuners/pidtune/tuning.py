"""``pidtune``: rule R of `yawrate_env.loop.law` for any plant and any PID."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.pidtune.closing import Loop
from tuners.pidtune.crossover import free_crossovers, needed_phase
from tuners.pidtune.system import System
from yawrate_env import validation
from yawrate_env.loop.law import KINDS, Kind, Law, Status, filter_time, reach, supply

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # rad
_MET = 1e-6  # relative, of crossover and margin


@dataclass(frozen=True, slots=True)
class Info:
    """Properties of a tuned loop, under MATLAB's names, and its controller's gains.

    Attributes
    ----------
    Stable : bool
        Whether the closed loop is.
    CrossoverFrequency : float
        Where the magnitude of the loop falls through 1 for good [rad/s]; ``nan`` where it
        does not.
    PhaseMargin : float
        There, between -180 and 180 [deg].
    status : Status
        ``OK``: crossover and margin meet the target; for P and I, the margin is at least that.
        ``PHASE_LIMITED``: the crossover does, the margin is less.  ``UNREACHABLE``: no
        controller of this kind, or by our rule for a PID, gives this crossover.
    note : str
        Why the target is missed; empty if it is met, and where a P or an I, which have a
        crossover alone to meet, leaves less than the margin.
    crossings : tuple of float
        Every frequency at which the magnitude passes 1 [rad/s].
    Kp, Ki, Kd : float
        ``Kp + Ki/s + Kd s/(1 + Tf s)``; a discrete controller has Tustin's formula for s.
    Ti, Td, Tf : float
        Integral, derivative and filter time, ``Kp/Ki, Kd/Kp, Tf`` [s].
    """

    Stable: bool
    CrossoverFrequency: float
    PhaseMargin: float
    status: Status
    note: str
    crossings: tuple[float, ...]
    Kp: float
    Ki: float
    Kd: float
    Ti: float
    Td: float
    Tf: float


def pidtune(
    sys: Any,
    kind: str = "PI",
    *,
    wc: float | None = None,
    pm: float = 60.0,
    delay: float = 0.0,
    Tf: float | None = None,
) -> tuple[Any, Info]:
    """Tune a controller for unit negative feedback.

    Parameters
    ----------
    sys : control.TransferFunction or control.StateSpace
        One input, one output, continuous or discrete, stable or not.  Polynomials in z
        whose roots crowd near z = 1 lose digits: with five or six of them at fast sampling
        the margin is met to about 1e-4 degrees only.
    kind : {"PI", "P", "I", "PD", "PDF", "PID", "PIDF"}
        P and I meet the crossover only.  In discrete time a PD and a PID take the
        derivative as a backward difference, which is the filter ``Tf = Ts/2``.
    wc : float, optional
        Target gain crossover [rad/s]; chosen by our own rule if not given.
    pm : float
        Target phase margin [deg].
    delay : float
        Pure delay in series with `sys` [s], exact; a multiple of the sampling time if there is one,
        and 200 of them at most.  Stability is decided for up to 10 000 turns of the delay at
        the frequencies that count; beyond, ``ValueError``.
    Tf : float, optional
        Time constant of the derivative filter of a PDF or PIDF [s]; by default a lag of
        0.5 degrees at the crossover, and at least half a sampling time.

    Returns
    -------
    C : control.TransferFunction or None
        The controller, in the time of `sys`; None where there is none.
    info : Info

    Examples
    --------
    >>> import control
    >>> C, info = pidtune(control.tf(1, [1, 3, 3, 1]), "PI", wc=0.5)
    >>> round(info.Kp, 3), round(info.PhaseMargin, 6), info.Stable
    (1.066, 60.0, True)
    """
    form = KINDS[validation.one_of("kind", str(kind).upper(), tuple(KINDS))]
    validation.number("pm", pm, above=0.0, at_most=180.0, remedy="Give it in degrees.")
    if Tf is not None:
        validation.number("Tf", Tf, above=0.0, remedy="Use kind PID or PD for no filter.")
        if not form.filtered:
            raise ValueError(f"Tf = {Tf:g} s is for kinds PDF and PIDF. Choose one of these.")
    plant = System.of(sys, delay)
    if wc is not None:
        validation.number("wc", wc, above=0.0, at_most=plant.largest_crossover(),
                          remedy="Give it in rad/s, below Nyquist's frequency.")  # fmt: skip
        return _tuned(plant, form, float(wc), pm, Tf)
    tried = (_tuned(plant, form, w, pm, Tf) for w in free_crossovers(plant, form, pm))
    first = next(tried)
    good = (found for found in (first, *tried) if found[1].Stable and found[1].status == Status.OK)
    return next(good, first)


def _tuned(plant: System, kind: Kind, wc: float, pm: float, Tf: float | None) -> tuple[Any, Info]:
    v = float(plant.warped(np.asarray(wc)))
    Tf = filter_time(kind, v, plant.Ts, Tf)
    G = complex(plant(np.asarray(wc)))
    if not (np.isfinite(G) and G):
        return None, _nothing("The plant's response at wc is zero or infinite: move wc.")
    needed = np.atleast_1d(needed_phase(plant, wc, pm))
    magnitude = np.array([-np.log(abs(G))])
    found, (status,) = supply(kind, magnitude, needed, v, Tf, np.pi - np.radians(pm))
    if status == Status.UNREACHABLE:
        low, high = np.degrees(reach(kind, v, Tf))
        return None, _nothing(
            f"At wc the controller must turn the phase by {np.degrees(needed[0]):.4g} deg; this "
            f"kind supplies {low:.4g} to {high:.4g} deg. Raise wc or pm, or choose a kind with "
            "less lead."
        )
    C = _transfer_function(found, plant.sign, plant.Ts)
    Kp, Ki, Kd = (float(plant.sign * gain[0]) for gain in found.gains())
    return C, _info(Loop(plant, C), kind, (Kp, Ki, Kd), found.Tf, Status(status), wc)


def _transfer_function(found: Law, sign: float, Ts: float) -> Any:
    """As a ``control.TransferFunction``, by Tustin's formula where `Ts` [s] is not 0."""
    import control

    kind, T, Tf = found.kind, float(found.T[0]), found.Tf
    n, m, f = kind.zeros, kind.integrators, int(kind.derives and Tf > 0)
    rho = sign * float(found.k[0]) / (T if n and m else 1.0)
    if not Ts:
        num = _power([T, 1.0], n)
        lag = np.polymul(_power([1.0, 0.0], m), _power([Tf, 1.0], f))
        return control.tf(rho * num, lag)
    a = 2 / Ts  # 1 + T s becomes (1 + a T) z + (1 - a T), over z + 1
    zero, pole = ([1 + a * t, 1 - a * t] for t in (T, Tf))
    top = np.polymul(_power(zero, n), _power([1.0, 1.0], m + f - n))
    bottom = np.polymul(_power([a, -a], m), _power(pole, f))
    return control.tf(rho * top, bottom, Ts)


def _power(polynomial: list[float], exponent: int) -> Array:
    return np.asarray((np.poly1d(polynomial) ** exponent).coeffs, dtype=float)


def _info(
    loop: Loop, kind: Kind, gains: tuple[float, float, float], Tf: float, status: Status, wc: float
) -> Info:
    Kp, Ki, Kd = gains
    crossings = loop.crossings(wc)
    last = float(crossings[-1]) if len(crossings) and loop.falls_for_good(wc) else np.nan
    stable = loop.stable(wc)
    notes = []
    if not abs(last - wc) <= _MET * wc:
        status = Status.UNREACHABLE
        notes.append(
            f"The loop passes magnitude 1 again above wc = {wc:.6g} rad/s, "
            + (f"last at {last:.6g} rad/s." if np.isfinite(last) else "and stays there.")
        )
    elif status == Status.PHASE_LIMITED and kind.zeros:  # a P or I is asked for no phase
        notes.append("This kind cannot supply the phase at wc: margin is given up. Lower wc.")
    if not stable:
        notes.append("The closed loop is not stable.")
    return Info(
        stable,
        last,
        loop.phase_margin(last) if np.isfinite(last) else np.nan,
        status,
        " ".join(notes),
        tuple(float(w) for w in crossings),
        *gains,
        Ti=Kp / Ki if Ki else np.inf,
        Td=Kd / Kp if Kp else 0.0,
        Tf=Tf,
    )


def _nothing(note: str) -> Info:
    nan = float("nan")
    return Info(False, nan, nan, Status.UNREACHABLE, note, (), nan, nan, nan, nan, nan, nan)
