"""Evaluate tuners on the same episodes and write one row an episode and tuner.

python scripts/evaluate.py --tuner ts-ff --tuner gb --episodes 100 --seed 1 --out rows.csv
python scripts/evaluate.py --tuner ts-ff --policy my.agent:make --out rows.csv
python scripts/evaluate.py --sb3 model.zip --algo stable_baselines3:SAC --out rows.csv
"""

from pathlib import Path
from typing import Any

import click

import tuners
from studies.program import counted, env_kwargs, environment, policies, program, seed
from studies.table3 import row, to_markdown
from tuners.agents.policies import chosen
from tuners.cli.arguments import Output
from tuners.cli.progress import Bars
from tuners.tuner.evaluation import evaluate, write_csv
from yawrate_env.plant.episodes import SETS


@program(__doc__)
@click.option(
    "--tuner", multiple=True, metavar="NAME",
    help=f"A .tuner file or one of {', '.join(tuners.NAMES)}; may be repeated.",
)  # fmt: skip
@policies
@counted("--episodes", 1500, "Of the set.")
@seed()
@click.option("--out", type=Output(), required=True, help="CSV file to write.")
@click.option("--context", type=click.Choice(list(SETS)), default="test", help="Set of episodes.")
@counted("--batch", 1, "Episodes that a tuner gets at a time; 1 times single answers.")
@env_kwargs
def main(
    tuner: tuple[str, ...],
    policy: tuple[str, ...],
    sb3: tuple[str, ...],
    algo: str | None,
    episodes: int,
    seed: int,
    out: Path,
    context: str,
    batch: int,
    env_kwargs: dict[str, Any],
) -> None:
    if not (tuner or policy or sb3):
        raise click.UsageError("nothing to evaluate: give --tuner, --policy or --sb3.")
    env = environment(env_kwargs)
    with Bars() as bars:
        found = evaluate(
            {
                **{name: load(name, env.plant) for name in tuner},
                **chosen(policy, sb3, algo, env),
            },
            env.plant,
            context,
            episodes=episodes,
            seed=seed,
            batch=batch,
            progress=lambda done, of: bars("evaluating", done, of),
        )
    write_csv(out, found)
    print(to_markdown([row(e) for e in found]))


def load(name: str, plant: tuners.Plant) -> tuners.Tuner:
    """A trained tuner with the plant that it was trained for, another for this one."""
    return tuners.load(name, None if name.endswith(".tuner") else plant)


if __name__ == "__main__":
    main()
