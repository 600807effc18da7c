"""Plants with several inputs and outputs.

A batch has its inputs in ``(B, m, N)`` and its outputs in ``(B, q, N)``; a plant with one of each
keeps ``(B, N)``.  Sums over recordings, of squares and of products with slopes, are the same for
both once outputs are *stacked*: one after the other, (B, q N), and weighted so that the noise of
each is of one size.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.names import check_unique, split

Array = NDArray[np.float64]
Names = tuple[str, ...]
Noise = float | tuple[float, ...] | Callable[[Array], Array]
Rows = TypeVar("Rows", bound=NDArray[Any])

_OF_ONE = (
    "integrating", "in_loop", "initial", "crossover", "record", "sensitivity",
    "linear_model", "actuator", "remarks", "suspects", "doubtful", "display", "black_box",
)  # fmt: skip


class Channels:
    """What follows from the channels: the part of a `Plant` that knows how many there are."""

    __slots__ = ()

    u: Array
    gains: Names
    noise: Noise
    signals: tuple[str, str]
    channels: tuple[Names, Names] | None

    @property
    def samples(self) -> int:
        """N, the experiment's length."""
        return int(self.u.shape[-1])

    @property
    def inputs_named(self) -> Names:
        """Names of the m inputs."""
        return self.signals[:1] if self.channels is None else self.channels[0]

    @property
    def outputs_named(self) -> Names:
        """Names of the q outputs."""
        return self.signals[1:] if self.channels is None else self.channels[1]

    @property
    def columns(self) -> dict[str, str]:
        """Names of a table's columns of recordings, inputs first, to the signals they hold."""
        if self.channels is None:
            return dict(zip("uy", self.signals, strict=True))
        return {split(name)[0]: name for name in (*self.inputs_named, *self.outputs_named)}

    @property
    def rows(self) -> int:
        """Signals of an observation (B, rows, N): inputs, then outputs; further rows may follow."""
        return len(self.inputs_named) + len(self.outputs_named)

    @property
    def output_rows(self) -> slice:
        """Where the outputs are among these."""
        return slice(len(self.inputs_named), self.rows)

    def inputs_in(self, obs: Rows) -> Rows:
        """Inputs of observations (B, rows, N), a view: (B, N), or of several (B, m, N)."""
        return obs[:, 0 if self.channels is None else slice(len(self.inputs_named))]  # type: ignore[return-value]

    def outputs_in(self, obs: Rows) -> Rows:
        """Outputs of observations (B, rows, N), a view: (B, N), or of several (B, q, N)."""
        rows = self.output_rows
        return obs[:, rows.start if self.channels is None else rows]  # type: ignore[return-value]

    def recordings_in(self, obs: NDArray[Any]) -> tuple[Array, Array]:
        """Inputs (1 or B, N) and outputs (B, N) of observations, of several (…, m, N) and so on.

        Inputs that all episodes share are given once.
        """
        u = self.inputs_in(obs)
        u = u[:1] if (u == u[:1]).all() else u
        return u.astype(np.float64, order="C"), self.outputs_in(obs).astype(np.float64, order="C")

    @property
    def loops(self) -> dict[str, tuple[str, str]]:
        """PI loops by name, to their input and output (`loops_of`)."""
        return loops_of(self.gains, self.inputs_named, self.outputs_named)

    def stacked(self, y: Array) -> Array:
        """Outputs (B, q, N) as (B, q N); those of one output, and stacked ones, stay so."""
        return y if y.ndim == 2 else (self.weights * y).reshape(len(y), -1)

    def unstacked(self, y: Array) -> Array:
        """Outputs (B, q, N) that were `stacked`; (B, N) of one output."""
        if self.channels is None:
            return y
        return np.asarray(y.reshape(len(y), len(self.weights), -1) / self.weights)

    def in_a_row(self, parts: Sequence[Array]) -> Array:
        """Stacked outputs (..., q N) of several recordings, one after the other."""
        count, before = len(self.outputs_named), parts[0].shape[:-1]
        apart = [part.reshape(*before, count, -1) for part in parts]
        return np.concatenate(apart, axis=-1).reshape(*before, -1)

    @property
    def declared_noise(self) -> float | None:
        """Standard deviation of stacked outputs' noise; None where it depends on the output."""
        if callable(self.noise):
            return None
        each = np.asarray(self.noise, np.float64)
        return float(np.exp(np.log(each).mean())) if each.ndim else float(each)

    @property
    def weights(self) -> Array:
        """(q, 1) by which outputs are multiplied where they are stacked."""
        level, each = self.declared_noise, np.ones(len(self.outputs_named))
        return np.asarray(level / (each * self.noise) if level else each)[:, None]  # type: ignore[operator]


def by_channel(signals: Rows) -> Rows:
    """Signals (B, m, N), or (B, N) of one channel, with the channels first: (m, B, N)."""
    return signals.reshape(len(signals), -1, signals.shape[-1]).swapaxes(0, 1)  # type: ignore[return-value]


def loops_of(gains: Sequence[str], inputs: Names, outputs: Names) -> dict[str, tuple[str, str]]:
    """Several PI loops by what their gains' names end with, to their input and output.

    The k-th loop answers the k-th output's error by the k-th input, and its gains are called
    ``kp_name`` and ``Ti_name``.  Empty where gains are others.
    """
    bare = [split(name)[0] for name in gains]
    names = [name.removeprefix("kp_") for name in bare if name.startswith("kp_")]
    paired = bare == [f"{of}_{name}" for name in names for of in ("kp", "Ti")]
    if not (paired and len(names) == len(inputs) == len(outputs) > 1):
        return {}
    return dict(zip(names, zip(inputs, outputs, strict=True), strict=True))


def check_channels(plant: Mapping[str, Any]) -> None:
    """Names, inputs and noise of several channels belong together, and not all else does."""
    u, channels, noise = plant["u"], plant["channels"], plant["noise"]
    if channels is None:
        if u.ndim == 2:
            raise ValueError(
                f"u has {len(u)} inputs: name them, and the outputs, by "
                'channels=(("u1", "u2"), ("y1", "y2")), or give one input (N,).'
            )
        if np.ndim(noise):
            raise ValueError(f"noise = {noise}: this plant has one output. Give one number.")
        return
    inputs, outputs = channels
    if u.shape[:-1] != (len(inputs),):
        raise ValueError(
            f"u has shape {u.shape}, and channels name {len(inputs)} inputs. Give (m, N), an input "
            "for each name."
        )
    if callable(noise) or (np.ndim(noise) and len(noise) != len(outputs)):
        raise ValueError(
            f"noise of {len(outputs)} outputs must be one number, or one for each. Give numbers."
        )
    for name in _OF_ONE:
        if plant[name]:
            raise ValueError(
                f"{name} is for plants with one input and one output. Leave it, or channels, out."
            )
    check_unique({"channel": (*inputs, *outputs)})
