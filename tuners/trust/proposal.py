"""Length and amplitude of an experiment whose recordings give intervals of a wanted width.

The half width falls as ``1/(amplitude sqrt(length))``.  That law only makes the next guess, since
a black box gains a little less: every guess is simulated (`tuners.trust.forecast`).
"""

from dataclasses import dataclass

import numpy as np

from tuners.trust.forecast import Forecast
from tuners.trust.limits import Limits
from yawrate_env.plant.names import split

MOST = 0.9
"""Share of the prior's plants whose half width is at most the wanted one."""

WAYS = ("both", "length", "amplitude")
"""What differs from today's experiment."""

_GUESSES = 12
_CLOSE = 0.02  # of the wanted half width
_BOLDEST = 16.0  # times amplitude sqrt(length) from one guess to the next
_STRONGEST = 1e3  # times today's amplitude, where the plant names no limits


class OutOfReachError(ValueError):
    """A wanted half width that no experiment within the limits gives."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """An experiment, and the half widths of its recordings' 90 % intervals.

    Attributes
    ----------
    amplitude : float
        Over that of today's experiment.
    samples : int
        Its length.
    median, most : float
        Half widths that half of the prior's plants do not exceed, and nine out of ten.
    """

    amplitude: float
    samples: int
    median: float
    most: float


@dataclass(frozen=True, slots=True)
class Room:
    """How far an experiment may differ from today's.

    Attributes
    ----------
    amplitude : tuple of float
        Least and largest, over today's.
    samples : tuple of int
        Shortest and longest.
    """

    amplitude: tuple[float, float]
    samples: tuple[int, int]

    def split(self, power: float, today: int, way: str) -> tuple[float, int]:
        """Amplitude and samples whose amplitude sqrt(length) is `power` times today's.

        Amplitude and root of the length take the same share; what one cannot, the other does.
        """
        shortest, longest = (count / today for count in self.samples)
        length = {"both": power, "length": power**2, "amplitude": 1.0}[way]
        length = min(max(length, shortest), longest)
        amplitude = 1.0 if way == "length" else power / np.sqrt(length)
        amplitude = float(np.clip(amplitude, *self.amplitude))
        if way == "both":
            length = min(max((power / amplitude) ** 2, shortest), longest)
        return amplitude, round(length * today)


def room(found: Forecast, shortest: float, longest: int) -> Room:
    """Amplitudes that the actuator and a plausible recording have room for, and lengths.

    The weakest input still moves the output as much as trust in a recording asks for; today's
    experiment is always within.

    Parameters
    ----------
    shortest : float
        Shortest experiment, over today's.
    longest : int
        Samples of the longest.
    """
    plant, u, clean = found.plant, found.input(1.0, found.plant.samples), found.clean
    input, output = plant.plausible
    largest = [_STRONGEST, input / np.abs(u).max(), output / np.abs(clean).max()]
    if plant.command_limits is not None:
        low, high = plant.command_limits
        ends = ((low, u.min()), (high, u.max()))
        largest += [end / value for end, value in ends if end * value > 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        weakest = np.quantile(found.sigma / clean.std(axis=1), MOST) / Limits().noise
    weakest = min(float(np.nan_to_num(weakest, nan=1.0, posinf=1.0)), 1.0)
    today = plant.samples
    least = min(max(int(np.ceil(shortest * today)), found.needed), today)
    return Room((weakest, max(float(min(largest)), 1.0)), (least, max(longest, today)))


def evaluated(found: Forecast, amplitude: float, samples: int) -> Proposal:
    """An experiment of some amplitude and length, and the half widths that it gives."""
    half = found.half_widths(amplitude, samples)
    median, most = np.quantile(half, [0.5, MOST], method="higher")
    return Proposal(amplitude, samples, float(median), float(most))


def propose(found: Forecast, wanted: float, within: Room, way: str = "both") -> Proposal:
    """The experiment whose half width is as wanted for nine out of ten plants of the prior.

    It is the nearest one where the limits end the search.

    Parameters
    ----------
    wanted : float
        Half width of the 90 % interval, in the unit of the first counted metric.
    way : {"both", "length", "amplitude"}
        What may differ from today's experiment.
    """
    today, power = found.plant.samples, 1.0
    low, high = 0.0, np.inf  # powers that are too little, and enough
    tried: dict[tuple[float, int], Proposal] = {}
    for _ in range(_GUESSES):
        guess = within.split(power, today, way)
        if guess in tried:
            break
        now = tried[guess] = evaluated(found, *guess)
        if abs(np.log(now.most / wanted)) < _CLOSE:
            return now
        reached = guess[0] * float(np.sqrt(guess[1] / today))
        low, high = (reached, high) if now.most > wanted else (low, reached)
        power = reached * min(max(now.most / wanted, 1 / _BOLDEST), _BOLDEST)
        if not low < power < high:  # the law overshot
            power = float(np.sqrt(low * high)) if low > 0 else high / 2
    enough = [each for each in tried.values() if each.most <= wanted]
    return max(enough, key=_most) if enough else min(tried.values(), key=_most)


def _most(proposal: Proposal) -> float:
    return proposal.most


def check_wanted(found: Forecast, wanted: float) -> None:
    """`OutOfReachError` for a half width that cannot be forecast, or that is refused anyway."""
    plant = found.plant
    name, unit = split(plant.counted[0])
    widest = float(plant.metric_setting("widest")[0])
    if wanted > widest:
        raise OutOfReachError(
            f"wanted = {wanted:g} must be at most {widest:g} {unit}: gains with wider intervals of "
            f"the {name.replace('_', ' ')} are refused. Ask for less."
        )
    if not found.sigma.any():
        raise OutOfReachError(
            "noise = 0 must be above 0: without noise every experiment is exact. Give the sensor's "
            "standard deviation."
        )


def check_reached(found: Forecast, wanted: float, proposal: Proposal, within: Room) -> None:
    """`OutOfReachError` where a proposal is wider than wanted."""
    if proposal.most <= wanted * (1 + _CLOSE) ** 2:
        return
    plant = found.plant
    unit = split(plant.counted[0])[1]
    if np.isfinite(proposal.most):
        least = f"at least {proposal.most:.3g} {unit}".rstrip()
        remedy = "Ask for more, or use a better sensor."
    else:
        least, remedy = "wider than any experiment's", "Use a better sensor, or another prior."
    seconds = within.samples[1] * plant.Ts
    raise OutOfReachError(
        f"wanted = {wanted:g} must be {least}, which {proposal.amplitude:.3g} times today's "
        f"amplitude for {proposal.samples * plant.Ts:.4g} s give; {within.amplitude[1]:.3g} times "
        f"and {seconds:.4g} s are the most that there is room for. {remedy}"
    )
