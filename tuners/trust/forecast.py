"""Forecast of intervals before a recording is made: their half widths on the prior's plants.

Recordings of some of the prior's plants are simulated, with noise of a given standard deviation
whatever their input.  For a linear plant with a loop target the half width is the one that the
black box claims of such a recording alone (`tuners.trust.response`).  For any other plant nothing
but a simulator can say, and it is the Cramér-Rao bound of the plant (`tuners.trust.bound`).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.trust.basis import functions_for
from tuners.trust.black_box import SAMPLES, black_box
from tuners.trust.bound import metric_slopes, spread
from tuners.trust.identification import covariance_of, output_slopes
from tuners.trust.intervals import GAUSSIAN
from tuners.trust.response import Response
from yawrate_env.loop.target import Target
from yawrate_env.plant.channels import by_channel
from yawrate_env.plant.episodes import sample
from yawrate_env.plant.noise import snr as noise_of
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.noise import KEY_WORDS, standard_normal
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]

PLANTS = 32
"""Plants of the prior that are simulated."""

_SEED = 22
_AT_ONCE = 1_000_000  # samples in memory: 8 MB a signal


@dataclass(frozen=True, eq=False)
class Forecast:
    """Half widths of the first counted metric's 90 % interval, on some of the prior's plants.

    Attributes
    ----------
    plant : Plant
        Their description.
    theta : NDArray
        (B, p) their parameters; those for which the design rule finds no gains are left out.
    sigma : NDArray
        (B,) standard deviations of the measurement noise.
    seed : int
        Of a random input.
    """

    plant: Plant
    theta: Array
    sigma: Array
    seed: int = 0

    @property
    def alone(self) -> bool:
        """Whether the recording alone gives the metric, without the simulator."""
        return self.plant.loop_target is not None

    @property
    def needed(self) -> int:
        """Samples without which nothing can be said."""
        return SAMPLES * self._functions.order if self.alone else 1

    @cached_property
    def clean(self) -> Array:
        """(B, N) noise-free outputs of today's experiment, stacked."""
        return self.plant.answers(self.theta, self.input(1.0, self.plant.samples))

    def input(self, amplitude: float, samples: int) -> Array:
        """Input (samples,): the experiment's times a factor, and again until it is long enough.

        Where every episode has an input of its own, others follow the first.  Of several inputs
        (m, samples), each goes on so, and they stay as independent as the experiment's are.
        """
        plant, count = self.plant, -(-samples // self.plant.samples)
        integers = np.random.default_rng(self.seed).integers(0, 2**64, count, np.uint64)
        rows = [np.resize(row, samples) for row in by_channel(plant.inputs(integers))]
        return np.asarray(amplitude * np.stack(rows).reshape(*plant.u.shape[:-1], samples))

    def half_widths(self, amplitude: float, samples: int) -> Array:
        """Half widths (B,) for an `input`; ``inf`` where the recording gives no gains."""
        u = self.input(amplitude, samples)
        size = max(_AT_ONCE // samples, 1)
        rows = [slice(i, i + size) for i in range(0, len(self.theta), size)]
        target = self.plant.loop_target
        if target is not None:
            found = [self._claimed(u, some, target) for some in rows]
        else:
            found = [self._least(u, some) for some in rows]
        half = GAUSSIAN * np.concatenate(found)
        return np.where(np.isfinite(half), half, np.inf)

    @cached_property
    def _functions(self) -> Laguerre:
        return functions_for(self.plant)

    def _claimed(self, u: Array, rows: slice, target: Target) -> Array:
        """Standard deviations that the black box claims of noisy recordings."""
        plant, clean = self.plant, self.plant.answers(self.theta[rows], u)
        keys = stream(_SEED, 0, len(self.theta), KEY_WORDS)[rows]
        y = clean + self.sigma[rows, None] * standard_normal(keys, clean.shape[1])
        model = black_box(plant, self._functions, u[None], plant.unstacked(y), "auto")
        response = Response.of(model, target)
        with np.errstate(all="ignore"):
            return np.asarray(response.spread(response.gains)[:, 0])

    def _least(self, u: Array, rows: slice) -> Array:
        """The bound's standard deviations."""
        theta = self.theta[rows]
        covariance = covariance_of(output_slopes(self.plant, theta, u), self.sigma[rows])
        with np.errstate(all="ignore"):
            return np.asarray(spread(metric_slopes(self.plant, theta), covariance)[:, 0])


def forecast(
    plant: Plant, *, noise: float | None = None, snr: float | None = None, seed: int = 0
) -> Forecast:
    """Prepare the forecast of a plant's experiments.

    Parameters
    ----------
    noise : float, optional
        Standard deviation of the sensor's noise, in the unit of the output, of a plant with one.
    snr : float, optional
        Signal-to-noise ratio of today's experiment [dB], instead.  Without both the noise is
        the plant's own at today's experiment.
    """
    theta = sample(plant, PLANTS)
    theta = theta[plant.designs(theta)[1]]
    if not len(theta):
        raise ValueError(
            f"design finds no gains for any of {PLANTS} plants of the prior: no experiment helps. "
            "Choose a target that can be reached, or another prior."
        )
    clean = Forecast(plant, theta, np.zeros(len(theta)), seed).clean
    if noise is not None:
        if len(plant.outputs_named) > 1:
            raise ValueError(
                f"noise = {noise:g} is one output's, and this plant has "
                f"{len(plant.outputs_named)}. Describe it in the plant, or give snr."
            )
        sigma = np.full(len(theta), noise)
    elif snr is not None:
        sigma = noise_of(snr)(clean)
    else:
        sigma = plant.sigma(clean)
    return Forecast(plant, theta, np.array(sigma), seed)
