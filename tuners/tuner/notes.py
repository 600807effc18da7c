"""Notes on how a recording differs from the experiment that the tuner was made for."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.trust.feedback import share
from tuners.trust.fit import Fit, left_open
from tuners.trust.limits import Limits
from tuners.tuner.recording import STEADY, Recording
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

ROUNDED = 1e-3
"""Of the largest input, or of a sampling time: differences by rounding in logs."""

_SLOW = 0.5  # of the recording's length: a Ti beyond it is very slow
_FEW = 10  # samples for each distinct value, or more


def notes(
    plant: Plant, given: Recording, fitted: Fit, i: int, any_experiment: bool
) -> tuple[str, ...]:
    """Notes on one recording.

    Parameters
    ----------
    fitted : Fit
        Plants fitted to recordings, of which this one has index `i`.
    any_experiment : bool
        Whether another input and sampling time than the plant's make no difference.
    """
    found = []
    if not any_experiment and not np.isclose(given.Ts, plant.Ts, rtol=ROUNDED):
        found.append(f"Ts is {given.Ts:g} s: resampled to the {plant.Ts:g} s of the experiment.")
    if not any_experiment and plant.excite is None and not _same_input(plant, given):
        found.append("The input is not that of the experiment trained on.")
    if given.variation > STEADY:
        label = " or ".join(split(plant.label(name))[0] for name in plant.measured)
        found.append(f"The {label} varies by {given.variation:.0%}; its mean counts.")
    outputs = np.atleast_2d(given.y[0])
    residuals = np.atleast_2d(plant.unstacked(fitted.residual[[i]])[0])
    left = _left_open(plant, left_open(fitted)[i] & plant.lasting)
    for signal, y, residual in zip(plant.outputs_named, outputs, residuals, strict=True):
        left = (*left, *_quantised(y, residual, *split(signal)))
    return (*found, *left)


def projected(given: Recording, u: Array, Ts: float) -> tuple[str, ...]:
    """A note where a closed loop's input was replaced by what the reference explains, (N,)."""
    if given.reference is None:
        return ()
    whole = float(share(u[None], given.resampled(Ts).u)[0])
    return (
        f"Recorded in a closed loop: the reference explains {whole:.1%} of the input, which was "
        "used in its place.",
    )


def unfollowed(left_over: float) -> tuple[str, ...]:
    """A note where the reference model leaves a share of right outputs over."""
    if not left_over > Limits().misfit:
        return ()
    return (
        "The reference model cannot follow this plant, so a misfit cannot be checked: only the "
        "residual and parts of the recording can contradict the fitted plant.",
    )


def hidden(faults: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """A note on faults that no recording of the plant shows (`tuners.tuner.hidden_faults`)."""
    if not faults:
        return ()
    listed = "; ".join(str(each["fault"]) for each in faults)
    return (f"No check of this plant's recordings sees {listed}: exclude them yourself.",)


def _left_open(plant: Plant, hidden: NDArray[np.bool_]) -> tuple[str, ...]:
    """A note on the unknown parameters (q,) that a recording leaves open."""
    names = [split(plant.label(list(plant.prior)[i]))[0] for i in plant.unknown[hidden]]
    if not names:
        return ()
    return (f"The recording does not tell {', '.join(names)}: most of the prior remains possible.",)


def stretched(plant: Plant, given: Recording) -> bool:
    """Whether the input is the experiment's sample by sample, at another sampling time."""
    same = plant.excite is None and len(given.u) == 1 and _is_experiment(plant, given.u[0])
    return same and not np.isclose(given.Ts, plant.Ts, rtol=ROUNDED)


def slow_integral(plant: Plant, gains: Array, seconds: float) -> tuple[str, ...]:
    """A note where a PI's gains (2,) integrate so slowly that a recording hardly shows it."""
    if plant.loop_target is None or not gains[1] > _SLOW * seconds:
        return ()
    return (
        f"Integral action is very slow: Ti is {gains[1]:.3g} s, the recording has {seconds:.3g} s. "
        "Near that limit Ti is uncertain and hardly matters at the crossover.",
    )


def _same_input(plant: Plant, given: Recording) -> bool:
    return _is_experiment(plant, given.resampled(plant.Ts).u[0])


def _is_experiment(plant: Plant, u: Array) -> bool:
    rounding = ROUNDED * np.abs(plant.u).max()
    return u.shape == plant.u.shape and bool((np.abs(u - plant.u) <= rounding).all())


def _quantised(y: Array, residual: Array, name: str, unit: str) -> tuple[str, ...]:
    """A note where few values (N,) are so far apart that rounding is not just more noise."""
    if len(np.unique(y[: len(y) // _FEW + 1])) > len(y) / _FEW:  # enough, without sorting all
        return ()
    values = np.unique(y)
    if not 1 < len(values) < len(y) / _FEW:
        return ()
    step = float(np.diff(values).min())
    if step <= np.sqrt(np.mean(residual**2)):
        return ()
    size = f"{step:.2g} {unit}".rstrip()
    return (f"{name} is quantised in steps of {size}: intervals may be too narrow.",)
