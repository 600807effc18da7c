"""Calls of functions that somebody else wrote: whatever they raise says where it came from."""

from collections.abc import Callable
from typing import Any


def call(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """What the function answers, or ``ValueError`` with its name and what it raised.

    What it raised is the error's ``__cause__``.
    """
    try:
        return function(*arguments)
    except Exception as error:
        raise ValueError(f"{name} failed: {said(error)}") from error


def said(error: BaseException) -> str:
    """An error's type and text in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")


one_line = said
