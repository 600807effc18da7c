"""Numbers in the report's typography."""


def minus(number: str) -> str:
    """A number with a true minus sign."""
    return number.replace("-", "−")


def hertz(frequency: float) -> str:
    """A frequency with two decimals, or two digits below 0.1 Hz."""
    return f"{frequency:.2f}" if frequency >= 0.1 else f"{frequency:.2g}"


def seconds(time: float) -> str:
    """A time with its unit: milliseconds below ten seconds."""
    if time >= 10:
        return f"{time:.1f} s"
    return f"{1e3 * time:.0f} ms" if time >= 0.01 else f"{1e3 * time:.2g} ms"
