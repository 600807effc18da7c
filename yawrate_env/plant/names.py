"""Names of a plant's parameters, gains and metrics, with their units in brackets."""

from collections.abc import Iterable, Mapping

INFO = ("clipped", "stable")
"""Entries of the environment's info beside gains, metrics and parameters."""

ORACLE = "oracle_"
"""Begins the info's entries for the design rule's gains."""

MARGINS = ("phase_margin", "crossover")
"""Metrics of a loop that a recording's own frequency response gives."""

CHECKS = (
    "implausible", "misfit", "response", "noise", "colour", "outside", "bend", "halves", "parts",
    "louder", "pattern", "limited", "undesigned", "unsolved", "between", "stretched", "logs",
    "extrapolated", "vague", "disturbed", "lingering",
)  # fmt: skip
"""Checks that every plant's recordings undergo."""

OF_METRICS = ("error", "spread", "contrast")
"""What is checked of each counted metric: `check_name`."""


def split(name: str) -> tuple[str, str]:
    """Split ``speed [rad/s]`` into name and unit."""
    bare, _, unit = name.partition(" [")
    return bare, unit.removesuffix("]")


def valued(name: str, value: float) -> str:
    """A quantity and its value: ``speed 20 rad/s``."""
    bare, unit = split(name)
    return f"{bare} {value:.4g} {unit}".rstrip()


def word(signal: str, otherwise: str) -> str:
    """A signal's name without its unit, or `otherwise` where the name is a symbol or missing."""
    name, _ = split(signal)
    return name if len(name) > 1 else otherwise


def check_name(metric: str, of: str) -> str:
    """Name of the check of a metric's ``error``, ``spread`` or ``contrast``."""
    return f"{_identifier(metric)}_{of}"


def check_unique(kinds: Mapping[str, Iterable[str]]) -> None:
    """``ValueError`` where two names are equal but for their units.

    Parameters
    ----------
    kinds : dict
        Kinds of names, such as ``gain``, to the names.
    """
    seen = dict.fromkeys(INFO, "entry of the environment's info")
    for kind, names in kinds.items():
        for name in names:
            bare = _identifier(name)
            if bare in seen:
                raise ValueError(
                    f"{name!r} is the name of a {kind} and of a {seen[bare]}. Rename one; units "
                    "in brackets do not count."
                )
            if bare.startswith(ORACLE):
                raise ValueError(
                    f"{kind} {name!r} begins with {ORACLE}, as the design rule's gains do in the "
                    "environment's info. Rename it."
                )
            seen[bare] = kind


def _identifier(name: str) -> str:
    return split(name)[0].replace(" ", "_")
