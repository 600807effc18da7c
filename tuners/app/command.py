"""``yawrate app``: a page on this machine that tunes from logs."""

import secrets
import socket
import threading
import webbrowser
from pathlib import Path

import click

from tuners.cli.arguments import READABLE, example

HOST = "127.0.0.1"


@click.command(epilog=example("yawrate app"))
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    help="Port to listen on. [default: one that is free]",
)
@click.option(
    "--tuner",
    "own",
    type=READABLE,
    multiple=True,
    help="A tuner of your own, for any plant and controller, beside those of the package; it is "
    "the page's default.  Several may be given.",
)
@click.option("--no-browser", is_flag=True, help="Print the address and open no browser.")
def command(port: int, own: tuple[Path, ...], no_browser: bool) -> None:
    """Open a page on this machine: drop LOGs, choose, and see the report.

    The page shows columns and units as they were understood, lets you change them, choose the
    stretch on a plot and the tuner, and answers as `yawrate tune` does, report included.  Only
    this machine can reach it, and only with the token in its address.  Nothing is sent
    anywhere; logs are kept in a temporary folder that is removed at the end.  Ctrl-C ends it.
    """
    try:
        import uvicorn

        from tuners.app.server import application
    except ModuleNotFoundError as error:
        raise click.ClickException(
            f'{error}. The page needs more packages: pip install "yawrate[app]".'
        ) from None
    token = secrets.token_urlsafe(32)
    with _listening(port) as listening:
        address = f"http://{HOST}:{listening.getsockname()[1]}/{token}/"
        click.echo(f"{address}\nCtrl-C ends it.")
        if not no_browser:  # a browser in the terminal returns when it is closed
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        config = uvicorn.Config(
            application(token, tuple(map(str, own))),
            http="h11",
            ws="none",
            lifespan="on",
            log_level="error",  # a log of requests would show the token
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=2,
        )
        try:
            uvicorn.Server(config).run(sockets=[listening])
        except KeyboardInterrupt:
            click.echo("Ended; the logs are removed.")


def _listening(port: int) -> socket.socket:
    """A socket that this machine alone can reach."""
    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        raise click.ClickException(f"--port {port}: {error.strerror}. Choose another.") from None
