"""Numbers and names as C writes them."""

import re
from collections.abc import Iterable

import numpy as np


def number(value: float, real: str = "double") -> str:
    """A literal that reads back as the same number."""
    if not np.isfinite(value):
        return "NAN" if np.isnan(value) else ("INFINITY" if value > 0 else "-INFINITY")
    digits = str(np.float32(value)) if real == "float" else repr(float(value))
    if not set(digits) & set(".e"):
        digits += ".0"
    return digits + ("f" if real == "float" else "")


def rows(values: Iterable[float], real: str = "double") -> str:
    """The inside of an array's initialiser, four numbers a line."""
    words = [number(value, real) for value in values]
    return ",\n".join("    " + ", ".join(words[i : i + 4]) for i in range(0, len(words), 4))


def check_name(name: str) -> None:
    """Refuse what cannot begin every identifier of a C file."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name):
        raise ValueError(
            f"name = {name!r} is no C identifier of at most 31 characters. Use letters, digits "
            "and underscores."
        )
