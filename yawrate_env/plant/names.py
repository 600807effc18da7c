"""Names that a plant gives: each stands for one thing in an info, a check and a result."""

from collections.abc import Sequence

INFO = ("clipped", "stable")
"""What the environment's info says beside gains, figures and parameters."""

ORACLE = "oracle_"
"""Before a gain's name in the info: what the design rule gives."""

CHECKS = (
    "implausible", "misfit", "response", "noise", "colour", "outside", "unsolved", "between",
)  # fmt: skip
"""Checks of a recording that no plant names."""


def split(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit: ``speed [rad/s]`` in two."""
    words, _, unit = name.partition(" [")
    return words, unit.removesuffix("]")


def valued(name: str, value: float) -> str:
    """A quantity and its value: ``speed 20 rad/s``."""
    words, unit = split(name)
    return f"{words} {value:.4g} {unit}".rstrip()


def word(signal: str, otherwise: str) -> str:
    """A signal's name without its unit; what it is, where the name is a symbol or missing."""
    name, _ = split(signal)
    return name if len(name) > 1 else otherwise


def check_names(
    prior: Sequence[str], gains: Sequence[str], figures: Sequence[str], measured: Sequence[str]
) -> None:
    """``ValueError`` where one name would stand for two things."""
    seen = dict.fromkeys(INFO, "word of the environment's info")
    for what, names in (("parameter", prior), ("gain", gains), ("figure", figures)):
        for name in names:
            if name in seen:
                raise ValueError(f"{name!r} is the name of a {what} and of a {seen[name]}. "
                                 "Rename one.")  # fmt: skip
            if name.startswith(ORACLE):
                raise ValueError(f"{what} {name!r}: names that begin with {ORACLE} are the design "
                                 "rule's gains. Rename it.")  # fmt: skip
            seen[name] = what
    checks = dict.fromkeys(CHECKS, "check of every recording")
    checks |= dict.fromkeys(measured, "measured parameter")
    if clash := set(CHECKS) & set(measured):
        raise ValueError(f"measured {min(clash)!r} is the name of a check too. Rename it.")
    for name in figures:
        for what in ("error", "spread"):
            check = check_name(name, what)
            if check in checks:
                raise ValueError(
                    f"figure {name!r} would have a check {check!r}, as has {checks[check]!r}. "
                    "Rename one; units in brackets do not tell them apart."
                )
            checks[check] = name


def check_name(figure: str, what: str) -> str:
    """How the check of a figure's ``error`` or ``spread`` is called: without its unit."""
    return f"{split(figure)[0].replace(' ', '_')}_{what}"
