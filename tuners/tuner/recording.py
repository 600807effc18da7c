"""What a tuner gets: recorded episodes."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yawrate_env import validation
from yawrate_env.batch import take
from yawrate_env.vehicle.plausible import UNSTEADY
from yawrate_env.vehicle.single_track import LARGEST, Context

_LARGEST = 1e6  # [rad], [rad/s]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """B episodes of one length and sampling time.

    Attributes
    ----------
    u : NDArray
        (1, N) or (B, N) float64, steering command [rad].
    y : NDArray
        (B, N) float64, measured yaw rate [rad/s].
    Ts : float
        Sampling time [s].
    v_x : NDArray or None
        (B,) speed [m/s], where it is known.
    context : Context or None
        The truth, where it is visible; only the oracle looks at it.
    oversampled : float
        Samples for each independent one: above 1 where samples were interpolated.
    speed_variation : float
        Peak-to-peak speed over its mean, which `v_x` holds.
    """

    u: NDArray[np.float64]
    y: NDArray[np.float64]
    Ts: float
    v_x: NDArray[np.float64] | None = None
    context: Context | None = None
    oversampled: float = 1.0
    speed_variation: float = 0.0

    @classmethod
    def of(cls, u: ArrayLike, y: ArrayLike, Ts: float, v_x: ArrayLike | None = None) -> Self:
        """One episode from two arrays (N,), checked."""
        command = _signal("u", u)
        measured = _signal("y", y)
        if len(command) != len(measured):
            raise ValueError(
                f"u has {len(command)} samples and y has {len(measured)}. Cut them to one length."
            )
        validation.count("number of samples", len(command), at_least=2, remedy="Record more.")
        validation.number("Ts", Ts, above=0.0, remedy="Give the sampling time in seconds.")
        if v_x is None:
            return cls(command[None], measured[None], Ts)
        mean, variation = _mean_speed(v_x, len(measured))
        return cls(command[None], measured[None], Ts, np.array([mean]), speed_variation=variation)

    @classmethod
    def of_observations(cls, obs: ArrayLike, Ts: float) -> tuple[Self, bool]:
        """Episodes from environment observations, and whether it was a single one.

        Parameters
        ----------
        obs : (rows, N) or (B, rows, N)
            Rows as in the environment: command, yaw rate, then ``v_x`` if the speed is
            visible, and ``mu_s, M_delta`` too if the context is.
        """
        array = validation.real_array("obs", obs)
        if array.dtype != np.float32:  # a batch of the environment's is converted last, in parts
            array = np.asarray(array, dtype=np.float64)
        single = array.ndim == 2
        array = array[None] if single else array
        if array.ndim != 3 or array.shape[1] not in (2, 3, 5) or not array.shape[2]:
            raise ValueError(
                f"obs has shape {np.shape(obs)}, wanted (rows, N) or (B, rows, N) with 2, 3 or 5 "
                "rows, as yawrate/PITuning-v0 gives them."
            )
        if not np.isfinite(array).all():
            validation.finite_array("obs", array, shape=(None, None, None))  # says where
        _squarable("obs", array[:, :2])
        _positive(array[:, 2:3, 0])
        u = array[:, 0]
        u = u[:1] if (u == u[:1]).all() else u
        v_x = array[:, 2, 0].astype(np.float64) if array.shape[1] > 2 else None
        context = (
            Context.of(array[:, 3, 0], array[:, 4, 0], v_x)
            if v_x is not None and array.shape[1] == 5
            else None
        )
        command, measured = (x.astype(np.float64, order="C") for x in (u, array[:, 1]))
        return cls(command, measured, Ts, v_x, context), single

    def __len__(self) -> int:
        return len(self.y)

    def beside(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        """Values (B, m) of the context that are known beside the signals."""
        shown = self.context
        if shown is None and names:
            if self.v_x is None or names != ("v_x",):
                raise ValueError(f"The recording must come with {', '.join(names)}.")
            return self.v_x[:, None]
        columns = [getattr(shown, name) for name in names]
        return np.stack(columns, axis=1) if columns else np.empty((len(self), 0))

    def part(self, index: slice) -> "Recording":
        """Some of the episodes."""
        u = self.u if len(self.u) == 1 else self.u[index]
        v_x = None if self.v_x is None else self.v_x[index]
        context = None if self.context is None else take(self.context, index)
        return Recording(u, self.y[index], self.Ts, v_x, context, self.oversampled)

    def resampled(self, Ts: float) -> "Recording":
        """The same episodes sampled at another `Ts` [s].

        The command is held between its samples, as a digital output holds it; the yaw rate,
        four integrations further on, is smooth and follows a cubic spline.
        """
        if np.isclose(self.Ts, Ts, rtol=1e-6):
            return self
        from scipy.interpolate import make_interp_spline

        N = self.y.shape[1]
        if N < 4:
            raise ValueError(f"{N} samples are too few to interpolate. Record for longer.")
        at = np.arange(int(np.floor((N - 1) * self.Ts / Ts + 0.1)) + 1) * (Ts / self.Ts)
        # What holds over the larger part of a sample: clocks may differ by a few ppm.
        held = np.minimum(np.floor(at + min(Ts / self.Ts, 1.0) / 2), N - 1).astype(np.intp)
        y = make_interp_spline(np.arange(N), self.y, k=3, axis=1)(at)
        return replace(
            self,
            u=self.u[:, held],
            y=np.ascontiguousarray(y),
            Ts=Ts,
            oversampled=max(self.oversampled, self.Ts / Ts),
        )


def _signal(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Finite values (N,) of a size that can be squared."""
    signal = validation.finite_array(name, value, shape=(None,))
    _squarable(name, signal)
    return signal


def _squarable(name: str, values: NDArray[np.floating]) -> None:
    if values.size:
        largest = float(max(values.max(), -values.min()))
        validation.number(
            f"largest |{name}|", largest, at_most=_LARGEST, remedy="Use rad and rad/s."
        )


def _positive(speeds: NDArray[np.floating]) -> None:
    for speed in (speeds.min(), speeds.max()) if speeds.size else ():
        validation.number("v_x", speed, above=0.0, at_most=LARGEST["v_x"], remedy="Use m/s.")


def _mean_speed(v_x: ArrayLike, N: int) -> tuple[float, float]:
    """Mean and relative variation of one speed, or of one for each of `N` samples."""
    speeds = validation.finite_array(
        "v_x", np.atleast_1d(validation.real_array("v_x", v_x)), shape=(None,)
    )
    if len(speeds) not in (1, N):
        raise ValueError(
            f"v_x has {len(speeds)} values for {N} samples. Give one speed, or one a sample."
        )
    _positive(speeds)
    mean, variation = float(speeds.mean()), float(np.ptp(speeds) / speeds.mean())
    if variation > UNSTEADY:
        raise ValueError(
            f"v_x varies by {variation:.0%} of its mean, at most {UNSTEADY:.0%} can be used. "
            "Cut a stretch of steady speed."
        )
    return mean, variation
