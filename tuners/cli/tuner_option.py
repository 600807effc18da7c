"""The tuner that a command uses: one that the package ships, or a file."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from tuners import Tuner


def loaded(name: str) -> "Tuner":
    """Load by name or from a file; a name that does not exist is wrong usage."""
    import tuners
    from tuners.tuner.tuner_file import SUFFIX

    if name.endswith(SUFFIX):
        if not Path(name).is_file():
            raise click.UsageError(f"No tuner file {name}. Make one with `yawrate train`.")
    elif name not in tuners.NAMES:
        raise click.UsageError(
            f"No tuner {name!r}. Give a *{SUFFIX} file, or one of {', '.join(tuners.NAMES)}."
        )
    return tuners.load(name)
