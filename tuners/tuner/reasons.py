"""Reasons of a verdict in words: what failed, without what contradicts it."""

from tuners.trust.verdict import Check, Verdict
from tuners.tuner.method import Rung
from yawrate_env.plant.names import check_name
from yawrate_env.plant.plant import Plant

_OF_RESPONSES = "limited", "bend", "halves", "lingering", "vague", "disturbed"
_HOPELESS = 30.0  # times the spread that needs no care: no advice of this kind helps
_BESIDE = ("feedback", "implausible", "noise", "unsolved")


def looped(checks: tuple[Check, ...]) -> bool:
    """Whether a recording was found to be one in a closed loop."""
    return any(check.name == "feedback" and not check.passed for check in checks)


def reasons(
    plant: Plant, checks: tuple[Check, ...], why: tuple[str, ...], rung: Rung
) -> tuple[str, ...]:
    """What checks that failed mean; where the plant was left, why, in place of its checks."""
    why = why if rung > Rung.FITTED_PLANT else ()
    explained = {"misfit", "outside", *(check_name(name, "contrast") for name in plant.counted)}
    failed = [c for c in checks if not c.passed]
    if looped(checks):  # which explains what else is odd
        failed = [c for c in failed if c.name in _BESIDE]
    spreads = [check_name(name, "spread") for name in plant.counted]
    if plant.loop_target is not None and any(
        c.name in spreads and c.verdict is Verdict.REFUSE for c in failed
    ):  # where the recording tells next to nothing, its contradictions mean nothing
        errors = [check_name(name, "error") for name in plant.counted]
        doubtful = {*explained, *errors, *_OF_RESPONSES}
        failed = [c for c in failed if c.name not in doubtful]
    if any(c.name == "logs" for c in failed):  # recordings that differ widen every interval
        failed = [c for c in failed if c.name not in spreads]
    others = [c.message for c in failed if not (why and c.name in explained)]
    return tuple(dict.fromkeys([*(why if failed else ()), *others, *_wanted(failed, spreads)]))


def _wanted(failed: list[Check], spreads: list[str]) -> list[str]:
    """How much longer or stronger to record, where the recording tells too little.

    A standard deviation falls with the amplitude, and with the root of the length.
    """
    ratios = [c.value / c.limit for c in failed if c.name in spreads and c.limit > 0]
    factor = max(ratios, default=0.0)
    if not 1 < factor < _HOPELESS:
        return []
    longer = f"{factor**2:.1f}" if factor < 3 else f"{factor**2:.0f}"
    return [
        f"About {longer} times as long, or {factor:.1f} times as strong in the same noise, would "
        "be enough."
    ]
