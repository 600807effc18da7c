"""How every command's help ends."""


def example(line: str) -> str:
    """An epilog that click does not wrap."""
    return f"\b\nExample:\n  {line}"
