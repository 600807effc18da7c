"""Train a tuner on simulated episodes and save it.

python scripts/train.py ts-ff --episodes 1500 --seed 0 --out my.tuner
python scripts/train.py rl --episodes 20000 --out my-rl.tuner
python scripts/train.py rl-sac --out my-sac.tuner
python scripts/train.py rl --plant my_plant:plant --out plant-rl.tuner
"""

from pathlib import Path
from typing import Any

import click

import tuners
from studies.program import counted, env_kwargs, environment, program, seed
from tuners.agents.settings import ALGORITHMS, Training
from tuners.catalogue import AGENTS, CALIBRATION, REGISTERS, SPEEDS
from tuners.cli.arguments import Output
from tuners.cli.progress import Bars
from tuners.cli.train import accuracy
from tuners.features import BY_NAME, features_named
from tuners.tuner.tuner_file import SUFFIX
from yawrate_env.plant.entry import find

EPISODES = 1000
"""That calibrate the intervals of a vehicle's tuner."""

AGENT_EPISODES = 20_000


@program(__doc__)
@click.argument("name", metavar="NAME", type=click.Choice([*tuners.RECIPES, *AGENTS]))
@counted("--episodes", None, "Simulated for training.  [default: the recipe's, rl 20000]")
@seed(help="Of the data and of the learner.")
@click.option("--out", type=Output(SUFFIX), required=True, help="File to write, *.tuner.")
@env_kwargs
@counted(
    "--calibration", None,
    f"Episodes that calibrate its intervals.  [default: {EPISODES}, a plant's {CALIBRATION}]",
)  # fmt: skip
@click.option(
    "--plant", metavar="MODULE:ATTRIBUTE",
    help="Train for a plant of your own instead of vehicles (docs/plants.md).",
)  # fmt: skip
@click.option("--algorithm", type=click.Choice(list(ALGORITHMS)), help="rl only.  [default: naf]")
@click.option("--features", type=click.Choice(list(BY_NAME)), default="laguerre", help="rl only.")
@click.option("--log", help="rl only: folder for TensorBoard.")
@click.option(
    "--checkpoint", type=click.Path(dir_okay=False, path_type=Path),
    help="rl only: zip written on the way and resumed from; it holds pickles, use your own only.",
)  # fmt: skip
def main(
    name: str,
    episodes: int | None,
    seed: int,
    out: Path,
    env_kwargs: dict[str, Any],
    calibration: int | None,
    plant: str | None,
    algorithm: str | None,
    features: str,
    log: str | None,
    checkpoint: Path | None,
) -> None:
    if algorithm and name != "rl":
        raise click.UsageError("--algorithm goes with rl.")
    if plant and (name not in AGENTS or env_kwargs):
        raise click.UsageError(
            "--plant goes with rl, without --env-kwargs; for other tuners use yawrate train."
        )
    calibration = calibration or (CALIBRATION if plant else EPISODES)
    own = {"v_x": list(SPEEDS[name])} if name in SPEEDS else {}
    own |= {"register": REGISTERS[name]} if name in REGISTERS else {}
    trained_for = find(plant) if plant else environment({**own, **env_kwargs}).plant
    with Bars() as bars:
        if name in AGENTS:
            from tuners.agents import training

            # Those of yawrate/PITuningFeatures-v0, or suited to the plant.
            stage = features if plant else features_named(features)
            chosen = algorithm or AGENTS[name]
            settings = Training(chosen, stage, episodes or AGENT_EPISODES, seed=seed)
            tuner = training.train(
                settings, trained_for, log=log, checkpoint=checkpoint, calibration=calibration,
                progress=bars,
            )  # fmt: skip
        else:
            tuner = tuners.train(
                name, trained_for, episodes=episodes, seed=seed, calibration=calibration,
                progress=bars,
            )  # fmt: skip
    tuner.save(out)
    print(f"{out}: {name}, {tuner.training}\n{accuracy(tuner, seed)}")


if __name__ == "__main__":
    main()
