"""Simulation of plants: their responses to inputs, and what is measured of them."""

from collections.abc import Callable
from copy import copy
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.plant.calls import call, rows
from yawrate_env.plant.channels import Channels
from yawrate_env.plant.emulator import Emulator
from yawrate_env.plant.parameters import Parameters
from yawrate_env.signals.noise import add_white_noise

Array = NDArray[np.float64]
Integers = NDArray[np.uint64]
Out = NDArray[np.floating] | None
Written = Callable[[int, int], None]


class Simulator(Parameters, Channels):
    """What follows from the simulator and the noise: the part of a `Plant` that simulates."""

    __slots__ = ()

    simulate: Callable[[Array, Array, Any], Array]
    excite: Callable[[Integers], Array] | None
    record: Callable[[Array, Array, Integers, Out, Written], NDArray[np.floating]] | None
    emulator: Emulator | None
    in_loop: bool
    batched: bool

    def respond(self, theta: Array, u: Array | None = None, rng: Any = None) -> Array:
        """Outputs (B, N) without measurement noise, by default of the experiment's input.

        Parameters
        ----------
        u : (N,), (1, N) or (B, N) float64, optional
            One input for all, or one for each; of several channels (m, N) and so on.
        """
        given = self.u if u is None else u
        given = given[None] if given.ndim == self.u.ndim else given
        own = (given,) if len(given) > 1 else ()
        several = () if self.channels is None else (len(self.channels[1]),)
        shape = (*several, given.shape[-1])
        batched = getattr(self.simulate, "batched", self.batched)

        def simulated(t: Array, v: Array | None = None) -> Array:
            return self.simulate(t, given[0].copy() if v is None else v, rng)

        names = tuple(self.prior)
        return rows("simulate", simulated, shape, batched, theta, *own, names=names)[0]

    def answers(self, theta: Array, u: Array | None = None) -> Array:
        """What `respond` gives, stacked."""
        return self.stacked(self.respond(theta, u))

    def with_simulator(self, simulate: Any, emulator: Emulator | None = None) -> Self:
        """The same plant with another way to simulate it, which is not tried."""
        other = copy(self)
        object.__setattr__(other, "simulate", simulate)
        object.__setattr__(other, "emulator", emulator)
        return other

    def emulated(self, u: Array | None = None) -> Self:
        """The plant with its emulator for a simulator, where that knows the input; or itself.

        Parameters
        ----------
        u : (N,), (1, N) or (B, N) float64, optional
            Inputs, if not the experiment's.
        """
        given = np.atleast_2d(self.u if u is None else u)
        if self.emulator is None or not self.emulator.knows(given):
            return self
        return self.with_simulator(self.emulator)

    def inputs(self, integers: Integers) -> Array:
        """Inputs of B experiments, (1, N) or (B, N), from a random integer each.

        Of several inputs (1 or B, m, N).
        """
        if self.excite is None:
            return self.u[None]
        u = validation.float_array("excite's answer", call("excite", self.excite, integers))
        if u.ndim != self.u.ndim + 1 or u.shape[1:-1] != self.u.shape[:-1]:
            raise ValueError(
                f"excite's answer has shape {u.shape}. Give an input for each integer, (B, N), or "
                "of several (B, m, N)."
            )
        return u

    def measure(
        self,
        theta: Array,
        u: Array,
        keys: Integers,
        rng: Any = None,
        out: Out = None,
        written: Written = lambda i, j: None,
    ) -> Array:
        """Measured outputs (B, N) for inputs (1 or B, N), each noise from its own key (B, 4).

        They are written into `out` float32 or float64, if given; it may be a strided view.  Of
        several channels inputs are (1 or B, m, N), and outputs (B, q, N).
        ``written(i, j)`` is called once episodes i to j are there, from any thread.
        """
        if self.record is not None:
            return np.asarray(call("record", self.record, theta, u, keys, out, written))
        clean = np.ascontiguousarray(self.stacked(self.respond(theta, u, rng)))
        sigma = self.sigma(clean).copy()
        if self.in_loop:
            noise = np.zeros_like(clean)
            add_white_noise(noise, sigma, keys, noise)
            clean, sigma = self.respond(theta, u - noise, rng), np.zeros_like(sigma)
            clean = clean + noise
        one = out is not None and out.ndim == 2
        noisy: Any = out if one else np.empty_like(clean)

        def work(i: int, j: int) -> None:
            add_white_noise(clean[i:j], sigma[i:j], keys[i:j], noisy[i:j])
            if out is not None and not one:
                out[i:j] = self.unstacked(noisy[i:j])
            written(i, j)

        over_blocks(work, len(clean), LANES)
        return np.asarray(self.unstacked(noisy) if out is None else out)

    def sigma(self, clean: Array) -> Array:
        """Standard deviations of the measurement noise of stacked outputs, (B,)."""
        value: Any = self.declared_noise
        if callable(self.noise):
            value = call("noise", self.noise, clean)
        sigma = validation.float_array("noise's answer", value)
        if sigma.shape not in ((), (1,), (len(clean),)):
            raise ValueError(f"noise's answer has shape {sigma.shape}, not {(len(clean),)}.")
        return np.broadcast_to(sigma, len(clean))
