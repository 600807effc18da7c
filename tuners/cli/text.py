"""Numbers as people read them."""

import math

from tuners.tuner.result import Interval


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


def best(fallback: dict[str, float]) -> str:
    """What to use in place of a plant's gains that are not trusted, by name."""
    if any(map(math.isnan, fallback.values())):
        return "No gains are stable for every plant of the prior: narrow it, or ask for less."
    listed = ", ".join(f"{name} {value:.4g}" for name, value in fallback.items())
    return f"Best for every plant of the prior: {listed}."


def every(Ts: float) -> str:
    """A sampling time [s]."""
    return f"every {Ts:.4g} s" if Ts >= 1 else f"every {1e3 * Ts:.4g} ms"
