"""Checkpoints of a training run: the model, the averaged actor, and their origin.

The origin says what a checkpoint was made for, so that no other training is resumed from it.  A
plant is compared as a saved tuner's is (`yawrate_env.plant.fingerprint`).
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from tuners.agents.actors import ALGORITHMS, Average
from tuners.agents.sb3_vec_env import Sb3VecEnv
from yawrate_env.files import check_folder, replacing, write_text
from yawrate_env.plant.fingerprint import changed, fingerprint
from yawrate_env.plant.plant import Plant


@dataclass(frozen=True, slots=True)
class Origin:
    """What a training is of.

    Attributes
    ----------
    plant : Plant
        Its episodes.
    settings : dict
        Algorithm and features, as plain JSON values.
    """

    plant: Plant
    settings: dict[str, Any]

    def write(self, path: Path) -> None:
        """Write it to a JSON file."""
        plant = {
            "entry": self.plant.entry,
            "arguments": dict(self.plant.arguments),
            "fingerprint": fingerprint(self.plant),
        }
        write_text(path, json.dumps({"plant": plant, "settings": self.settings}, indent=2) + "\n")

    def check(self, path: Path) -> None:
        """``ValueError`` where a file is of another one."""
        try:
            content = json.loads(path.read_bytes())
            then, plant = dict(content["settings"]), dict(content["plant"]["fingerprint"])
        except OSError as error:
            raise ValueError(f"{path}: {error.strerror}") from None
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} is damaged: {error}") from None
        for name, now in json.loads(json.dumps(self.settings)).items():
            if then.get(name) != now:
                raise ValueError(f"its {name} is {then.get(name)!r}, not {now!r}")
        if other := changed(self.plant, plant):
            raise ValueError(f"it is of another plant: its {other} is not this one's")


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Files of one training run.

    Attributes
    ----------
    path : Path
        Stable-Baselines3's zip; the other files have its name and endings of their own.
    origin : Origin
        What it must have been made for.
    """

    path: Path
    origin: Origin

    def __post_init__(self) -> None:
        check_folder(self.path.parent)

    def write(self, model: BaseAlgorithm, average: Average) -> None:
        """Replace the files, each completely."""
        self.origin.write(self._file("origin"))
        with replacing(self.path) as file:
            model.save(file)
        with replacing(self._file("average.pt")) as file:
            torch.save((average.weights, average.batches), file)
        if isinstance(model, OffPolicyAlgorithm):
            with replacing(self._file("buffer.pkl")) as file:
                model.save_replay_buffer(file)

    def read(self, env: Sb3VecEnv) -> tuple[BaseAlgorithm, Average]:
        """The model and the averaged actor, or ``ValueError`` for another training's files."""
        algorithm = self.origin.settings["algorithm"]
        try:
            self.origin.check(self._file("origin"))
            model = ALGORITHMS[algorithm].load(self.path, env=env, device="cpu")
        except Exception as error:  # whatever a foreign zip makes Stable-Baselines3 raise
            raise ValueError(
                f"checkpoint {self.path} is not of this {algorithm} training ({error}). Resume "
                "with the settings that it was written with, or name another file."
            ) from error
        average, buffer = self._file("average.pt"), self._file("buffer.pkl")
        averaged = Average()
        if average.exists():
            averaged = Average(*torch.load(average, weights_only=True))
        if isinstance(model, OffPolicyAlgorithm) and buffer.exists():
            model.load_replay_buffer(buffer)
        return model, averaged

    def _file(self, suffix: str) -> Path:
        return self.path.with_suffix(f".{suffix}")
