"""Why the verdict is no better, in words: what failed, without what contradicts it."""

from tuners.trust.verdict import Check, Verdict
from tuners.tuner.method import Rung
from yawrate_env.plant.names import check_name
from yawrate_env.plant.plant import Plant


def reasons(
    plant: Plant, checks: tuple[Check, ...], why: tuple[str, ...], rung: Rung
) -> tuple[str, ...]:
    """What checks that failed mean; where the plant was left, why, in place of its checks."""
    why = why if rung > Rung.FITTED_PLANT else ()
    explained = {"misfit", "outside", *(check_name(name, "contrast") for name in plant.counted)}
    failed = [c for c in checks if not c.passed]
    spreads = [check_name(name, "spread") for name in plant.counted]
    if plant.loop_target is not None and any(
        c.name in spreads and c.verdict is Verdict.REFUSE for c in failed
    ):  # where the recording tells next to nothing, its contradictions mean nothing
        errors = [check_name(name, "error") for name in plant.counted]
        doubtful = {*explained, *errors, "limited", "bend", "halves"}
        failed = [c for c in failed if c.name not in doubtful]
    others = [c.message for c in failed if not (why and c.name in explained)]
    return tuple(dict.fromkeys([*(why if failed else ()), *others]))
