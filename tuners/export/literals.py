"""Numbers and names as C and structured text write them."""

import re
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray


def digits(value: float) -> str:
    """A number to be read in a comment."""
    return f"{value:.9g}"


def number(value: float, real: str = "double") -> str:
    """A literal that reads back as the same number; it must be finite, also in `real`."""
    single = real == "float"
    with np.errstate(over="ignore"):
        kept = np.float32(value) if single else np.float64(value)
    if not np.isfinite(kept):
        raise ValueError(f"{value:g} is no finite {real}. Export gains of ordinary size.")
    digits = str(kept) if single else repr(float(value))
    if not set(digits) & set(".e"):
        digits += ".0"
    return digits + ("f" if real == "float" else "")


def iec(value: float, real: str = "double") -> str:
    """A real literal of IEC 61131-3, which needs a point, for the same number."""
    text = number(value, real).removesuffix("f")
    mantissa, e, exponent = text.partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (e and f"E{int(exponent)}")


def remark(text: str) -> str:
    """A name for a comment in ``(* *)``, which it cannot end; on one line."""
    return comment(text).replace("*)", "* )").replace("(*", "( *")


def sample(value: float, real: str = "double") -> str:
    """A literal of a signal, where a sample may be missing."""
    if np.isfinite(value):
        return number(value, real)
    return "NAN" if np.isnan(value) else ("INFINITY" if value > 0 else "-INFINITY")


def rows(values: Iterable[float], real: str = "double") -> str:
    """The inside of a signal's initialiser, four numbers a line."""
    texts = [sample(value, real) for value in values]
    return ",\n".join("    " + ", ".join(texts[i : i + 4]) for i in range(0, len(texts), 4))


def table(values: Iterable[NDArray[np.float64]]) -> str:
    """The inside of a matrix' initialiser, one row after the other."""
    return ",\n".join(f"    {{\n{rows(row)}\n    }}" for row in values)


def comment(text: str) -> str:
    """A signal's or a gain's name for a comment, which it cannot end; on one line.

    Characters that are not printable, such as those that reverse the direction of text, become
    question marks.
    """
    printable = "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))
    return printable.replace("*/", "* /").replace("/*", "/ *")


def check_name(name: str) -> None:
    """Refuse what cannot begin every identifier of a C file."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name):
        raise ValueError(
            f"name = {name!r} is no C identifier of at most 31 characters. Use letters, digits "
            "and underscores."
        )
