"""Recorded episodes, checked: the input of every tuner."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners.tuner.spline import spline
from yawrate_env import validation
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.hold import HOLDS, held_like_lines

Array = NDArray[np.float64]

STEADY, UNSTEADY = 0.05, 0.25
"""Variation of a measured parameter over its mean (or the prior's range, where that contains zero)
that is noted, and that is refused."""

_SPLINE = 0.873  # variance of white noise after interpolation by cubic splines
_LARGEST = 1e6  # in any unit: values that can be squared


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """B episodes of one length and sampling time.

    Attributes
    ----------
    u : NDArray
        (1, N) or (B, N) float64, inputs; of several (1, m, N) or (B, m, N).
    y : NDArray
        (B, N) float64, measured outputs; of several (B, q, N).
    Ts : float
        Sampling time [s].
    known : NDArray or None
        (B, p) parameters of the plants that are known, ``nan`` where they are not: the measured
        ones, or all where the truth is visible.
    oversampled : float
        Samples for each independent one: above 1 where samples were interpolated.
    variation : float
        Largest relative peak-to-peak variation of a measured parameter.
    input : {"held", "lines"}
        Whether inputs keep a sample's value until the next, or are joined by lines.
    reference : NDArray or None
        (1, N) or (B, N) references of the loop in which the episodes were recorded, in the
        output's unit; None where there was none, or where it is not known.
    """

    u: Array
    y: Array
    Ts: float
    known: Array | None = None
    oversampled: float = 1.0
    variation: float = 0.0
    input: str = "held"
    reference: Array | None = None

    def __post_init__(self) -> None:
        u, y = np.shape(self.u), np.shape(self.y)
        if not (len(u) == len(y) in (2, 3) and u[-1] == y[-1] and u[0] in (1, y[0])):
            raise ValueError(
                f"u and y have shapes {u} and {y}, not (1, N) or (B, N) and (B, N). Give arrays "
                "(N,), or of several channels (m, N) and (q, N), to Recording.of(plant, u, y, Ts)."
            )
        validation.one_of("input", self.input, HOLDS)
        if self.reference is not None and np.shape(self.reference) not in (y, (1, y[1])):
            raise ValueError(
                f"reference has shape {np.shape(self.reference)}, not {(1, y[1])} or {y}. Give one "
                "value for each sample."
            )

    @classmethod
    def of(
        cls,
        plant: Plant,
        u: ArrayLike,
        y: ArrayLike,
        Ts: float | None = None,
        measured: Mapping[str, ArrayLike | None] | None = None,
        between: str | None = None,
        reference: ArrayLike | None = None,
    ) -> Self:
        """One episode of a plant from arrays (N,), or (m, N) and (q, N), checked.

        Parameters
        ----------
        Ts : float, optional
            Sampling time [s]; the plant's if omitted.
        measured : dict, optional
            Measured parameters to one value, or one a sample, whose mean counts.
        between : {"held", "lines"}, optional
            How the input runs between samples; as the plant's recordings do if omitted.
        reference : (N,), optional
            Reference of the loop in which it was recorded, in the output's unit.

        Raises
        ------
        ValueError
            The episode cannot be used; the message says why and what to do.
        """
        u, y = _signals("u", u, plant.channels, 0), _signals("y", y, plant.channels, 1)
        N = y.shape[-1]
        if u.shape[-1] != N:
            raise ValueError(f"u has {u.shape[-1]} samples and y has {N}. Cut them to one length.")
        validation.count("number of samples", N, at_least=2, remedy="Record more.")
        Ts = plant.Ts if Ts is None else Ts
        validation.number("Ts", Ts, above=0.0, remedy="Give the sampling time in seconds.")
        given = {name: value for name, value in (measured or {}).items() if value is not None}
        known, variation = _measured(plant, given, N)
        hold = plant.input if between is None else between
        if reference is not None and plant.channels is not None:
            raise ValueError("reference is for plants with one input and one output. Leave it out.")
        wanted = None if reference is None else _signal("reference", reference)[None]
        return cls(u[None], y[None], float(Ts), known, 1.0, variation, hold, wanted)

    @classmethod
    def of_observations(cls, plant: Plant, obs: ArrayLike) -> tuple[Self, bool]:
        """Episodes from observations of a plant's environment, and whether it was a single one.

        Parameters
        ----------
        obs : (rows, N) or (B, rows, N)
            Rows as in the environment: inputs, outputs, then the measured parameters if they are
            visible, and all others too if the truth is.
        """
        array = validation.real_array("obs", obs)
        if array.dtype != np.float32:  # a batch of the environment's is converted last, in parts
            array = np.asarray(array, dtype=np.float64)
        single = array.ndim == 2
        array = array[None] if single else array
        rows = _rows(plant)
        if array.ndim != 3 or array.shape[1] not in rows or not array.shape[2]:
            allowed = ", ".join(map(str, sorted(rows)))
            raise ValueError(
                f"obs has shape {np.shape(obs)}, not (rows, N) or (B, rows, N) with {allowed} "
                "rows, as the plant's environment gives them."
            )
        if array.shape[2] != plant.samples:
            raise ValueError(
                f"obs has {array.shape[2]} samples, this tuner's episodes have {plant.samples} of "
                f"{plant.Ts:g} s. Use tune(u, y, Ts), or train a tuner for this experiment."
            )
        if not np.isfinite(array).all():
            validation.finite_array("obs", array, shape=(None, None, None))  # says where
        _check_size("obs", array[:, : plant.rows])
        known = None
        if names := rows[array.shape[1]]:
            known = np.full((len(array), len(plant.prior)), np.nan)
            known[:, plant.indices(names)] = array[:, plant.rows :, 0]
            _check_known(plant, names, known)
        return cls(*plant.recordings_in(array), plant.Ts, known), single

    def __len__(self) -> int:
        return len(self.y)

    def part(self, index: slice | list[int]) -> "Recording":
        """Some of the episodes."""
        u = self.u if len(self.u) == 1 else self.u[index]
        known = None if self.known is None else self.known[index]
        reference = self.reference
        if reference is not None and len(reference) > 1:
            reference = reference[index]
        return replace(self, u=u, y=self.y[index], known=known, reference=reference)

    def resampled(self, Ts: float) -> "Recording":
        """The same episodes sampled at another `Ts` [s], their inputs held.

        An input that is joined by lines becomes one that is held and acts alike
        (`yawrate_env.signals.hold`).  The output follows a cubic spline.
        """
        N, same = self.y.shape[-1], bool(np.isclose(self.Ts, Ts, rtol=1e-6))
        if same and self.input == "held":
            return self
        if N < 4:
            raise ValueError(f"{N} samples are too few to interpolate. Record for longer.")
        at = np.arange(N if same else int(np.floor((N - 1) * self.Ts / Ts + 0.1)) + 1)
        if same:
            Ts, y = self.Ts, self.y
        else:
            place = np.asarray(at * (Ts / self.Ts), dtype=np.float64)
            y = spline(self.y.reshape(-1, N), place).reshape(*self.y.shape[:-1], -1)
        if self.input == "lines":
            times = Ts * at.astype(np.float64)
            u = held_like_lines(self.u.reshape(-1, N), self.Ts, times, Ts)
            u = u.reshape(*self.u.shape[:-1], -1)
        else:
            u = self._held(self.u, at, Ts)
        return replace(
            self,
            u=u,
            reference=None if self.reference is None else self._held(self.reference, at, Ts),
            y=np.ascontiguousarray(y),
            Ts=Ts,
            oversampled=max(self.oversampled, self.Ts / Ts / (_SPLINE if self.Ts > Ts else 1.0)),
            input="held",
        )

    def _held(self, signals: Array, at: NDArray[np.intp], Ts: float) -> Array:
        """What holds over the larger part of samples `at` of `Ts`: clocks may differ by ppm."""
        half, last = min(Ts / self.Ts, 1.0) / 2, signals.shape[-1] - 1
        return signals[..., np.minimum(np.floor(at * (Ts / self.Ts) + half), last).astype(np.intp)]

    def parameters(self, plant: Plant, *, needed: bool = True) -> Array:
        """Parameters (B, p) with the measured ones as known, and the others in mid-prior.

        ``ValueError`` where a measured one is missing, if it is needed.
        """
        theta = np.tile(plant.middle, (len(self), 1))
        for name in plant.measured:
            (i,) = plant.indices((name,))
            values = np.full(len(self), np.nan) if self.known is None else self.known[:, i]
            low, high = plant.prior[name]
            if needed and low < high and np.isnan(values).any():
                raise ValueError(
                    f"{name} is needed: this tuner covers {low:g} to {high:g}. Give what was "
                    f"measured with the recording, as in {name}={high:g}."
                )
            theta[:, i] = np.where(np.isnan(values), theta[:, i], values)
        return theta


def variation(plant: Plant, name: str, values: Array) -> tuple[float, str]:
    """Relative peak-to-peak variation of a measured parameter, and the name of what it is of."""
    low, high = plant.prior[name]
    mean = abs(float(values.mean()))
    whole, name_of_whole = (mean, "its mean") if low > 0 else (high - low, "the prior's range")
    return float(np.ptp(values)) / whole if whole > 0 else 0.0, name_of_whole


def _rows(plant: Plant) -> dict[int, tuple[str, ...]]:
    """Numbers of rows that observations may have, to the parameters after the signals."""
    measured = tuple(name for name in plant.prior if name in plant.measured)
    every = measured + tuple(name for name in plant.prior if name not in plant.measured)
    return {plant.rows + len(names): names for names in (every, measured, plant.measured_names, ())}


def _signal(name: str, value: ArrayLike) -> Array:
    """Finite values (N,) of a size that can be squared."""
    signal = validation.finite_array(name, value, shape=(None,))
    _check_size(name, signal)
    return signal


def _signals(name: str, value: ArrayLike, channels: Any, of: int) -> Array:
    """One signal (N,), or a row for each of a plant's inputs or outputs."""
    if channels is None:
        return _signal(name, value)
    found = validation.finite_array(name, value, shape=(len(channels[of]), None))
    _check_size(name, found)
    return found


def _check_size(name: str, values: NDArray[np.floating]) -> None:
    if values.size:
        largest = float(max(values.max(), -values.min()))
        validation.number(f"largest |{name}|", largest, at_most=_LARGEST, remedy="Use SI units.")


def _check_known(plant: Plant, names: tuple[str, ...], known: Array) -> None:
    """Refuse measured parameters (B, p) that no recording of the plant has."""
    for name in names:
        if name in plant.measured and len(known):
            values = known[:, plant.indices((name,))]
            plant.check_value(name, values.min())
            plant.check_value(name, values.max())


def _measured(plant: Plant, given: Mapping[str, Any], N: int) -> tuple[Array | None, float]:
    """Known parameters (1, p) and the largest variation of one."""
    known, variation = np.full((1, len(plant.prior)), np.nan), 0.0
    for name, value in given.items():
        if not plant.measured:
            raise ValueError(
                f"measured {name!r}: this plant has no measured parameters. Leave it out."
            )
        validation.one_of("measured parameter", name, tuple(plant.measured))
        mean, varies = _mean(plant, name, value, N)
        known[0, plant.indices((name,))] = plant.check_value(name, mean)
        variation = max(variation, varies)
    return (known if given else None), variation


def _mean(plant: Plant, name: str, value: ArrayLike, N: int) -> tuple[float, float]:
    """Mean and relative variation of one value, or of one for each of `N` samples."""
    values = validation.finite_array(
        name, np.atleast_1d(validation.real_array(name, value)), shape=(None,)
    )
    if len(values) not in (1, N):
        raise ValueError(
            f"{name} has {len(values)} values for {N} samples. Give one, or one a sample."
        )
    for value in (values.min(), values.max()):
        plant.check_value(name, value)
    varies, whole = variation(plant, name, values)
    if varies > UNSTEADY:
        label = split(plant.label(name))[0]
        raise ValueError(
            f"{name} varies by {varies:.0%} of {whole}, at most {UNSTEADY:.0%} can be used. "
            f"Cut a stretch of steady {label}."
        )
    return float(values.mean()), varies
