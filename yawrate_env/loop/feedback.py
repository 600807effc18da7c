"""A sampled linear controller of reference and output, and its loop around B plants.

    u = (N_r reference - N_y output) / D

with polynomials in ``delta = (z - 1)/Ts``.  The loop's states are the plant's, the d inputs on
their way through dead time and computation delay (the most of the batch), and the controller's in
observer form,

    u = n_r0 reference - n_y0 output + w_1
    w_i+ = w_i + Ts (w_{i+1} - d_i u + n_ri reference - n_yi output)

Of a plant with fewer samples on their way than others, the last of their states do nothing.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import over_blocks
from yawrate_env.loop import controller
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction

Array = NDArray[np.float64]

_BLOCK = 64


@dataclass(frozen=True, slots=True, eq=False)
class Compensator:
    """B controllers.

    Attributes
    ----------
    reference, output, denominator : NDArray
        (B, q + 1) coefficients of N_r, N_y and D, highest power first, ``D[:, 0] = 1``.
    """

    reference: Array
    output: Array
    denominator: Array

    @classmethod
    def of(cls, kp: Array, Ti: Array, target: Target) -> "Compensator":
        """The PI of a target, or its printed form, for gains (B,)."""
        n1, n0, d0 = controller.coefficients(kp, Ti, target)
        top = np.stack([n1, n0], axis=1)
        return cls(top, top, np.stack([np.ones_like(d0), d0], axis=1))

    def around(self, plant: TransferFunction) -> TransferFunction:
        """Open loops ``N_y/D`` times plant."""
        return TransferFunction(self.output, self.denominator, plant.Ts) * plant


@dataclass(frozen=True, slots=True, eq=False)
class Feedback:
    """B closed loops, ``x+ = A x + b reference + e disturbance``.

    Attributes
    ----------
    A : NDArray
        (B, m, m) transition matrices.
    reference, disturbance : NDArray
        (B, m) columns of the reference, and of a disturbance of the plant's input.
    output : NDArray
        (B, m) rows of the plant's output, which no feedthrough reaches at once.
    command : NDArray
        (B, m) rows of the command, which has ``direct`` (B,) times the reference beside.
    """

    A: Array
    reference: Array
    disturbance: Array
    output: Array
    command: Array
    direct: Array
    _poles: list[NDArray[np.complex128]] = field(default_factory=list, repr=False)

    @classmethod
    def of(
        cls,
        plant: DiscretePlant,
        compensator: Compensator,
        delay_samples: int = 0,
        fed_back: Array | None = None,
    ) -> "Feedback":
        """Close the loops.

        Parameters
        ----------
        fed_back : (B, n) float64, optional
            Rows of what the controller sees of the plant's states, if not the output.
        """
        delay = delays(plant, delay_samples)
        row = output_row(plant, delay_samples)
        seen = row if fed_back is None else np.zeros_like(row)
        if fed_back is not None:
            seen[:, : fed_back.shape[1]] = fed_back
        n, inner, q = plant.A.shape[1], row.shape[1], compensator.denominator.shape[1] - 1
        m = inner + q
        n_r, n_y, d = compensator.reference, compensator.output, compensator.denominator

        command = np.zeros((len(plant), m))
        command[:, :inner] = -n_y[:, :1] * seen
        command[:, inner : inner + 1] = 1.0

        A, late = np.zeros((len(plant), m, m)), np.flatnonzero(delay)
        A[:, :n, :n] = plant.A
        for k in range(n, inner - 1):
            A[:, k, k + 1] = 1.0
        A[late, n + delay[late] - 1] = 0.0  # the command is the newest input on its way
        column = entrance(plant, delay, m)
        A += column[:, :, None] * command[:, None, :]
        reference = column * n_r[:, :1]
        if len(late):
            A[late, :n, n] = plant.B[late]
        for i in range(1, q + 1):
            at = inner + i - 1
            A[:, at, at] += 1.0
            A[:, at, at + 1 : at + 2] += plant.Ts * (i < q)
            A[:, at] -= plant.Ts * d[:, i : i + 1] * command
            A[:, at, :inner] -= plant.Ts * n_y[:, i : i + 1] * seen
            reference[:, at] = plant.Ts * (n_r[:, i] - d[:, i] * n_r[:, 0])
        output = np.zeros((len(plant), m))
        output[:, :inner] = row
        own = np.zeros(len(plant), np.int64) if plant.delay is None else plant.delay
        disturbed = entrance(plant, own, m)
        return cls(A, reference, disturbed, output, command, n_r[:, 0])

    def __len__(self) -> int:
        return len(self.A)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Closed-loop poles in z, (B, m)."""
        if not self._poles:
            found = np.empty(self.A.shape[:2], dtype=np.complex128)

            def some(i: int, j: int) -> None:
                found[i:j] = np.linalg.eigvals(self.A[i:j])

            over_blocks(some, len(self), _BLOCK)
            self._poles.append(found)
        return self._poles[0]

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether all poles lie inside the unit circle, (B,)."""
        return np.asarray((np.abs(self.poles) < 1).all(axis=1))

    def respond(self, reference: Array, disturbance: Array | None = None) -> tuple[Array, Array]:
        """Outputs and commands (B, N) from rest for a reference (N,) and a disturbance (N,)."""
        x = np.zeros_like(self.reference)
        y, u = (np.empty((len(self), len(reference))) for _ in range(2))
        for k, r in enumerate(reference):
            y[:, k] = np.einsum("bi,bi->b", self.output, x)
            u[:, k] = np.einsum("bi,bi->b", self.command, x) + self.direct * r
            x = np.einsum("bij,bj->bi", self.A, x) + self.reference * r
            if disturbance is not None:
                x += self.disturbance * disturbance[k]
        return y, u


def delays(plant: DiscretePlant, delay_samples: int) -> NDArray[np.int64]:
    """Samples from the controller to the plant, (B,)."""
    delay = np.full(len(plant), delay_samples)
    return delay if plant.delay is None else delay + plant.delay


def entrance(plant: DiscretePlant, delay: NDArray[np.int64], m: int) -> NDArray[np.float64]:
    """Where an input with so many samples to go (B,) enters the m states, (B, m)."""
    n = plant.A.shape[1]
    column, late = np.zeros((len(plant), m)), np.flatnonzero(delay)
    column[:, :n] = np.where(delay == 0, plant.B.T, 0.0).T
    column[late, n + delay[late] - 1] = 1.0
    return column


def output_row(plant: DiscretePlant, delay_samples: int) -> NDArray[np.float64]:
    """The output's row in the plant's states and the d inputs on their way, (B, n + d)."""
    n, delay = plant.A.shape[1], delays(plant, delay_samples)
    row = np.zeros((len(plant), n + int(delay.max(initial=0))))
    row[:, :n] = plant.C
    if plant.D is not None and row.shape[1] > n:
        row[:, n] = np.where(delay > 0, plant.D, 0.0)
    return row
