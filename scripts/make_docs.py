"""Write docs/environment.md from the environment's docstring, in the form of Gymnasium's pages.

    python scripts/make_docs.py [--check] [--output docs/environment.md]

With --check nothing is written; the exit status is 1 if the file is out of date.
"""

import argparse
import inspect
from collections.abc import Sequence
from pathlib import Path

import gymnasium

from yawrate_env import ENV_ID
from yawrate_env.env import PITuningEnv

PAGE = """\
<!-- Written by scripts/make_docs.py from the docstring of PITuningEnv: edit that. -->

# PI tuning

![Vehicles tuned one after the other](../figures/environment.gif)

{summary}

| | |
|---|---|
| Action space | `{action_space}` |
| Observation space | `{observation_space}` |
| Import | `import yawrate_env` |
| Make | `gymnasium.make("{id}")` |

{sections}
"""


def page() -> str:
    summary, sections = inspect.cleandoc(PITuningEnv.__doc__ or "").split("\n\n", 1)
    env = gymnasium.make(ENV_ID)
    return PAGE.format(
        summary=summary,
        action_space=box(env.action_space),
        observation_space=box(env.observation_space),
        id=ENV_ID,
        sections=sections,
    )


def box(space: gymnasium.Space) -> str:
    """One bound a row: the rows of the observation are constant in time."""
    assert isinstance(space, gymnasium.spaces.Box)
    rows = [bound.reshape(space.shape[0], -1)[:, 0] for bound in (space.low, space.high)]
    low, high = ("[" + ", ".join(f"{x:.4g}" for x in row) + "]" for row in rows)
    return f"Box({low}, {high}, {space.shape}, {space.dtype})"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if out of date")
    default = Path(__file__).parents[1] / "docs" / "environment.md"
    parser.add_argument("--output", type=Path, default=default)
    args = parser.parse_args(arguments)
    text = page()
    if args.check:
        if args.output.exists() and args.output.read_text(encoding="utf-8") == text:
            return 0
        print(f"{args.output} is out of date: run scripts/make_docs.py")
        return 1
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
