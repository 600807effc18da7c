"""Arguments that the scripts share."""

import argparse
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tuners.agents.wrappers import base_env
from tuners.tuner import tuner_file as model_file
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.files import check_folder, check_regular

MOST = 1e9


def whole(text: str) -> int:
    """A positive whole number up to `MOST`; ``1e6`` is one."""
    value = float(text)
    if not 1 <= value <= MOST or not value.is_integer():
        raise argparse.ArgumentTypeError(f"{text} is not a positive whole number up to {MOST:g}")
    return int(value)


def seed(text: str) -> int:
    """A whole number that is not negative."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative")
    return value


def output(text: str) -> Path:
    """A file to write, in a folder that exists."""
    path = Path(text)
    try:
        check_folder(path.parent)
        check_regular(path)
    except (ValueError, OSError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return path


def model(text: str) -> Path:
    """A tuner file to write."""
    if not text.endswith(model_file.SUFFIX):
        raise argparse.ArgumentTypeError(
            f"{text} must end in {model_file.SUFFIX} to be loaded again"
        )
    return output(text)


def environment_kwargs(text: str) -> dict[str, Any]:
    """Keyword arguments of the environment, as a JSON object."""
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        raise argparse.ArgumentTypeError(f"not JSON: {error}") from None
    if not isinstance(value, dict):
        raise argparse.ArgumentTypeError("wanted a JSON object such as '{\"snr_db\": 20}'")
    return value


def environment(kwargs: dict[str, Any]) -> PITuningEnv:
    """The environment with these keyword arguments; ``nonlinear`` chooses the other vehicle."""
    try:
        return base_env(**kwargs)
    except TypeError as error:
        said = re.sub(r".*__init__\(\) got an", "--env-kwargs:", str(error))
        raise ValueError(said) from None


def run(main: Callable[[], None]) -> None:
    """Run a script; what the user did wrong is one line and exit status 2, not a traceback."""
    try:
        main()
    except (ValueError, OSError, OverflowError, MemoryError) as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
