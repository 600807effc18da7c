"""What the programs in scripts/ share: their command, its errors, and types of arguments."""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tuners.cli.arguments import COUNT, SEED
from yawrate_env.env.yaw_rate_env import PITuningEnv, PITuningNonlinearEnv

FOLDER = click.Path(file_okay=False, path_type=Path)


class Program(click.Command):
    """A command whose errors are one line and exit status 2."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run and exit."""
        kwargs["standalone_mode"] = False
        try:
            super().main(*args, **kwargs)
        except click.ClickException as error:
            _refuse(error.format_message())
        except click.Abort:
            sys.exit(130)
        except (ValueError, OSError, OverflowError, MemoryError) as error:
            _refuse(str(error) or type(error).__name__)
        sys.exit(0)


class Json(click.ParamType):  # type: ignore[type-arg]
    """Keyword arguments as a JSON object."""

    name = "json"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Parse and check."""
        if isinstance(value, dict):
            return value
        try:
            found = json.loads(value)
        except json.JSONDecodeError as error:
            self.fail(f"not JSON: {error}.", param, ctx)
        if not isinstance(found, dict):
            self.fail(f"{value} is no JSON object such as '{{\"snr_db\": 20}}'.", param, ctx)
        return found


def program(doc: str | None) -> Callable[[Callable[..., None]], Program]:
    """Make a function a program whose help is a module's docstring, lines kept as they are."""
    paragraphs = (doc or "").strip().split("\n\n")
    return click.command(
        cls=Program,
        help="\n\n".join(f"\b\n{paragraph}" for paragraph in paragraphs),
        context_settings={"show_default": True, "max_content_width": 100},
    )


def counted(name: str, default: int | None, help: str) -> Callable[[Any], Any]:
    """An option that takes a positive whole number; ``1e6`` is one."""
    return click.option(name, type=COUNT, default=default, help=help)


def seed(default: int = 0, help: str = "Of the test set.") -> Callable[[Any], Any]:
    """The option ``--seed``."""
    return click.option("--seed", type=SEED, default=default, help=help)


def folders(function: Any) -> Any:
    """The options ``--results`` and ``--figures``."""
    for name, what in (("figures", "pictures"), ("results", "tables")):
        function = click.option(
            f"--{name}", type=FOLDER, default=Path(name), help=f"Folder for {what}, made if absent."
        )(function)
    return function


def env_kwargs(function: Any) -> Any:
    """The option ``--env-kwargs``."""
    return click.option(
        "--env-kwargs",
        type=Json(),
        default={},
        metavar="JSON",
        show_default=False,
        help="Conditions of the environment, e.g. '{\"snr_db\": 20}' or '{\"nonlinear\": true}'.",
    )(function)


def policies(function: Any) -> Any:
    """The options ``--policy``, ``--sb3`` and ``--algo`` (`tuners.agents.policies`)."""
    options = (
        click.option(
            "--policy", multiple=True, metavar="MODULE:FACTORY",
            help="Your own: factory() returns an object whose predict(obs, state, episode_start, "
            "deterministic) gives (actions, state); may be repeated.",
        ),
        click.option(
            "--sb3", multiple=True, metavar="ZIP",
            help="A Stable-Baselines3 model trained in the same environment; may be repeated. "
            "Trusted files only: they hold pickles.",
        ),
        click.option(
            "--algo", metavar="MODULE:CLASS",
            help="Class of the --sb3 models, such as stable_baselines3:SAC.",
        ),
    )  # fmt: skip
    for option in reversed(options):
        function = option(function)
    return function


def environment(kwargs: dict[str, Any]) -> PITuningEnv:
    """The environment with these keyword arguments; ``nonlinear`` chooses the other vehicle."""
    given = dict(kwargs)
    kind = PITuningNonlinearEnv if given.pop("nonlinear", False) else PITuningEnv
    try:
        return kind(**given)
    except TypeError as error:
        reason = re.sub(r".*__init__\(\) got an", "--env-kwargs:", str(error))
        raise ValueError(reason) from None


def _refuse(message: str) -> None:
    click.echo(f"error: {' '.join(message.split())}", err=True)
    sys.exit(2)
