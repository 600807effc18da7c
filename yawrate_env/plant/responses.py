"""The closed loop of one plant as a report draws it: open-loop response and time responses.

Either may be missing: a nonlinear loop has no frequency response.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yawrate_env import validation
from yawrate_env.loop.margins import Margins

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """One signal of a loop over time, after an event at the start.

    Attributes
    ----------
    title : str
        The event, as in ``Step of the level by 2 cm``.
    time, value : NDArray
        (N,) [s], and the signal; ``nan`` where it has diverged.
    setpoint : float
        Setpoint of the signal; ``nan`` if it has none.
    label : str
        The signal and its unit, as in ``pump [V]``; the plant's output if not given.
    """

    title: str
    time: Array
    value: Array
    setpoint: float = np.nan
    label: str = ""

    def __post_init__(self) -> None:
        validation.text("a response's title", self.title)
        validation.instance("a response's label", self.label, str, remedy="Give text.")
        setpoint = self.setpoint
        if not (isinstance(setpoint, float) and np.isnan(setpoint)):
            setpoint = validation.number(
                "a response's setpoint", setpoint, remedy="Give nan for none."
            )
        time = _rising("a response's time", self.time)
        value = validation.float_array("a response's value", self.value)
        if value.shape != time.shape:
            raise ValueError(
                f"{self.title!r} has values of shape {value.shape}, not one for each of its "
                f"{len(time)} times."
            )
        object.__setattr__(self, "setpoint", setpoint)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "value", value)


@dataclass(frozen=True, slots=True, eq=False)
class OpenLoop:
    """The open loop's frequency response, without the minus sign of the feedback.

    Attributes
    ----------
    frequency : NDArray
        (F,) [Hz].
    response : NDArray
        (F,) complex128.
    margins : Margins, optional
        A batch of one; read off the response if not given.
    pulse : NDArray, optional
        (K,) output of the plant alone at the controller's samples, for an input of one during
        the first of them, without the controller's computation delay.
    """

    frequency: Array
    response: NDArray[np.complex128]
    margins: Margins | None = None
    pulse: Array | None = None

    def __post_init__(self) -> None:
        frequency = _rising("an open loop's frequency", self.frequency)
        remedy = "Leave frequency 0 out."
        validation.number("an open loop's lowest frequency", frequency[0], above=0.0, remedy=remedy)
        response = _response(self.response)
        if response.shape != frequency.shape:
            raise ValueError(
                f"an open loop has a response of shape {response.shape}, not one for each of "
                f"its {len(frequency)} frequencies."
            )
        if self.margins is not None:
            remedy = "Give the Margins of one loop, or None."
            validation.instance("an open loop's margins", self.margins, Margins, remedy=remedy)
        if self.pulse is not None:
            pulse = validation.finite_array("an open loop's pulse", self.pulse, shape=(None,))
            object.__setattr__(self, "pulse", pulse)
        object.__setattr__(self, "frequency", frequency)
        object.__setattr__(self, "response", response)

    @property
    def marked(self) -> Margins:
        """The given margins, or else those read off the response."""
        return self.margins or _read_off(self.frequency, self.response)

    @property
    def magnitude(self) -> Array:
        """(F,) [dB]."""
        return np.asarray(20 * np.log10(np.abs(self.response)))

    @property
    def phase(self) -> Array:
        """(F,) without jumps, the first between -270 and 90 [deg]."""
        phase = np.unwrap(np.angle(self.response))
        phase -= 2 * np.pi * np.ceil((phase[0] - np.pi / 2) / (2 * np.pi))
        return np.asarray(np.degrees(phase))


@dataclass(frozen=True, slots=True, eq=False)
class ClosedLoop:
    """One loop around one plant.

    Attributes
    ----------
    responses : tuple of Response
        Drawn below each other.
    open : OpenLoop, optional
        Of a linear loop.
    stable : bool
        False if the loop is known to be unstable.
    """

    responses: tuple[Response, ...] = ()
    open: OpenLoop | None = None
    stable: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.responses, tuple | list):
            raise ValueError(f"responses = {self.responses!r} must be a tuple of Response.")
        for response in self.responses:
            validation.instance("a loop's response", response, Response, remedy="Give a Response.")
        if self.open is not None:
            remedy = "Give an OpenLoop, or None."
            validation.instance("open", self.open, OpenLoop, remedy=remedy)
        object.__setattr__(self, "responses", tuple(self.responses))
        object.__setattr__(self, "stable", validation.flag("stable", self.stable))
        if not self.responses and self.open is None:
            raise ValueError("a ClosedLoop has nothing to draw. Give responses or open.")


def _response(values: ArrayLike) -> NDArray[np.complex128]:
    """(F,) finite complex numbers other than 0."""
    try:
        response = np.asarray(values, dtype=np.complex128)
    except (TypeError, ValueError):
        raise ValueError("an open loop's response is not an array of complex numbers.") from None
    odd = response[~np.isfinite(response) | (response == 0)]
    if len(odd):
        raise ValueError(
            f"an open loop's response is {odd[0]:g} somewhere; every value must be finite and not "
            "0. Leave such frequencies out."
        )
    return response


def _rising(name: str, values: ArrayLike) -> Array:
    array = validation.finite_array(name, values, shape=(None,))
    if len(array) < 2 or not (np.diff(array) > 0).all():
        raise ValueError(f"{name} must rise from value to value, with at least two.")
    return array


def _read_off(frequency: Array, response: NDArray[np.complex128]) -> Margins:
    """Margins between the frequencies, by python-control."""
    from control import stability_margins

    phase, omega = np.degrees(np.unwrap(np.angle(response))), 2 * np.pi * frequency
    gain, phase_margin, modulus, turn, crossover, _ = map(
        float, stability_margins((np.abs(response), phase, omega))
    )
    with np.errstate(invalid="ignore"):
        delay = np.radians(np.mod(phase_margin, 360)) / crossover
        found = (phase_margin, crossover / (2 * np.pi), 20 * np.log10(gain), turn / (2 * np.pi),
                 modulus, delay)  # fmt: skip
    return Margins(*(np.array([value]) for value in found))
