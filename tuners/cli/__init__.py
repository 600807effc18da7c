"""The ``yawrate`` command: one module for each of its commands, imported when it is called.

Arguments, text, JSON, progress bars and the report.  What a program would call as well belongs
in the library, which neither prints nor exits.
"""

import gc
import logging
import os
import sys
import warnings
from importlib import import_module
from typing import Any

try:
    import click
except ImportError:
    sys.exit('error: the yawrate command needs click: pip install "yawrate[tune]"')

from tuners.cli.arguments import example

COMMANDS = {
    "tune": "Tune a controller from a LOG of a plant's input and output.",
    "app": "Open a page on this machine: drop LOGs, choose, and see the report.",
    "schedule": "Make a table of gains over speed from LOGs of one plant.",
    "check": "Check the margins that gains achieve, from a LOG of a drive with them.",
    "watch": "Follow one car through its LOGS, files or folders of them, in time order.",
    "train": "Train a tuner for a vehicle or another plant, and print its accuracy.",
    "excite": "Write the input signal of the experiment.",
    "export": "Write a controller, or a tuner, for another program.",
    "init": "Write a plant's file to fill in: ranges of its parameters, each with a comment.",
    "dataset": "Simulate a data set of episodes, on this machine's cores or on a cluster.",
    "completion": "Print the script that makes SHELL complete commands and flags.",
}
"""The commands, in the order of use, and what the list of them says: it need not import them."""


_ALLOCATIONS = 100_000
"""Objects between two garbage collections: most that a command makes live to its end, so that
Python's 700 would cost a tenth of a report."""

_ABOVE = {"app": "tuners.app.command"}
"""Where commands of packages above this one are; the others are modules of this one."""


class Commands(click.Group):
    """The commands; turns every error into one line and an exit status."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """In the order of use."""
        return list(COMMANDS)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command's module; each one has its own ``command``."""
        if cmd_name not in COMMANDS:
            return None
        if cmd_name in ("tune", "app"):
            # One recording is too small for BLAS's threads: they would wait for each other.
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        module = _ABOVE.get(cmd_name, f"tuners.cli.{cmd_name}")
        command: click.Command = import_module(module).command
        return command

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run and exit; errors are one line, and status 1 for unusable input, 2 for wrong usage."""
        kwargs["standalone_mode"] = False
        try:
            sys.exit(super().main(*args, **kwargs) or 0)
        except click.exceptions.NoArgsIsHelpError as error:
            error.show()
            sys.exit(2)
        except click.Abort:
            _end("interrupted.", 130)
        except click.ClickException as error:
            _end(in_words(error), error.exit_code)
        except ERRORS as error:
            _end(in_words(error), 1)


ERRORS = click.ClickException, ValueError, OSError, MemoryError, OverflowError, ModuleNotFoundError
"""What a user is told in a line; anything else is a defect of the program."""


def in_words(error: Exception) -> str:
    """An error of `ERRORS` as one line."""
    if isinstance(error, click.ClickException):
        message = error.format_message()
    elif isinstance(error, ModuleNotFoundError):
        message = f'{error}. Install what is missing: pip install "yawrate[tuners]".'
    else:
        message = str(error) or type(error).__name__
    return " ".join(message.split())


def _end(line: str, status: int) -> None:
    click.echo(f"error: {line}", err=True)
    sys.exit(status)


def _version(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        import yawrate_env

        click.echo(f"yawrate, version {yawrate_env.__version__}")
        ctx.exit()


@click.group(
    cls=Commands,
    no_args_is_help=True,
    epilog=example("yawrate tune log.csv --report report.html"),
    context_settings={"max_content_width": 96},
)
@click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_version,
    help="Show the version and exit.",
)
def main() -> None:
    """Tune a controller from one recording of a plant's input and output."""


def run() -> None:
    """Run the command as a program: stderr is for its own errors, not for libraries' warnings."""
    gc.set_threshold(_ALLOCATIONS)
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    logging.getLogger().addHandler(logging.NullHandler())
    main(prog_name="yawrate")
