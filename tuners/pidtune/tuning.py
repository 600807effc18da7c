"""``pidtune``: the design rule of `yawrate_env.loop.design` for any plant and any PID."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.pidtune.closing import Loop
from tuners.pidtune.crossover import free_crossovers, needed_phase
from tuners.pidtune.law import FILTER_LAG, KINDS, Kind, law, reach
from tuners.pidtune.system import System
from yawrate_env import validation
from yawrate_env.loop.design import Status, within_reach

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
        Why the target is missed; empty if it is met.
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
    Tf = _filter_time(plant, kind, v, Tf)
    G = complex(plant(np.asarray(wc)))
    if not (np.isfinite(G) and G):
        return None, _nothing("The plant's response at wc is zero or infinite: move wc.")
    needed = float(needed_phase(plant, wc, pm))
    low, high = reach(kind, v, Tf)
    if kind.zeros:
        statuses, phases = within_reach(np.array([needed]), low, high)
        status, phase = Status(statuses[0]), float(phases[0])
    else:
        enough = high - np.pi + np.radians(pm) < needed <= high + _ROUNDING
        status, phase = (Status.OK if enough else Status.PHASE_LIMITED), high
    if status == Status.UNREACHABLE:
        return None, _nothing(
            f"At wc the controller must turn the phase by {np.degrees(needed):.4g} deg; this kind "
            f"supplies {np.degrees(low):.4g} to {np.degrees(high):.4g} deg. Raise wc or pm, or "
            "choose a kind with less lead."
        )
    found = law(kind, -np.log(abs(G)), phase, v, Tf)
    found = replace(found, rho=plant.sign * found.rho)
    C = found.transfer_function(plant.Ts)
    return C, _info(Loop(plant, C), found.gains(), found.Tf, status, wc)


def _filter_time(plant: System, kind: Kind, v: float, Tf: float | None) -> float:
    if not kind.derives:
        return 0.0
    if kind.filtered:
        return float(max(np.tan(FILTER_LAG) / v if Tf is None else Tf, plant.Ts / 2))
    return plant.Ts / 2


def _info(
    loop: Loop, gains: tuple[float, float, float], Tf: float, status: Status, wc: float
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
    elif status == Status.PHASE_LIMITED:
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
