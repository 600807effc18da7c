"""Markdown tables, and numbers in their cells."""

import math
from collections.abc import Iterable, Sequence


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table of cells; a row must have as many as there are heads.

    Columns are not padded: a changed cell then changes one line of a page.
    """
    first, *others = (
        f"| {' | '.join(str(cell) for _, cell in zip(heads, line, strict=True))} |\n"
        for line in (heads, *rows)
    )
    return "".join([first, "|", "---|" * len(heads), "\n", *others])


def short(value: float) -> str:
    """Three significant digits without an exponent."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    if value < 1e-7:
        return f"{value:.0e}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(value)))}f}"


def general(value: float | None, ratio: float | None = None) -> str:
    """Three digits, and a ratio in brackets; a dash where there is no value."""
    if value is None:
        return "–"
    return f"{value:.3g}" + ("" if ratio is None else f" ({ratio:.3g})")


def ratios(values: Iterable[float]) -> str:
    """Ratios to a bound, separated by slashes; rounding errors are 0."""
    return " / ".join("0" if ratio < 1e-6 else f"{ratio:.3g}" for ratio in values)
