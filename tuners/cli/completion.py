"""``yawrate completion``."""

import click
from click.shell_completion import get_completion_class

from tuners.cli.arguments import example


@click.command(epilog=example("yawrate completion bash > ~/.yawrate-completion"))
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(shell: str) -> None:
    """Print the script that makes SHELL complete commands and flags."""
    from tuners.cli import main

    found = get_completion_class(shell)
    assert found is not None
    click.echo(found(main, {}, "yawrate", "_YAWRATE_COMPLETE").source())
