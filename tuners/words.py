"""Numbers as people read them."""

import math

from tuners.result import Interval


def between(interval: Interval, unit: str) -> str:
    """A value with its unit and interval, to the digits that the interval is worth."""
    if not math.isfinite(interval.value):
        return "unknown"
    width = interval.high - interval.low
    places = 2 if not 0 < width < math.inf else min(max(1 - math.floor(math.log10(width)), 0), 4)
    value, low, high = (f"{v:.{places}f}" for v in (interval.value, interval.low, interval.high))
    return f"{value}{unit}, between {low} and {high} (90 %)"


def instead(fallback: tuple[float, float]) -> str:
    """What to use in place of gains that are not trusted, (kp, Ti) [s]."""
    kp, Ti = fallback
    if math.isnan(kp):
        return (
            "No gains are stable for every vehicle that the tuner was made for: narrow the prior, "
            "or ask for a slower crossover."
        )
    return f"Stable for every vehicle that the tuner was made for: kp {kp:.4g} s, Ti {Ti:.4g} s."
