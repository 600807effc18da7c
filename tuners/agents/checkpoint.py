"""What an agent's checkpoint was made for, kept beside it, so that no other training goes on in it.

A plant is compared as a saved tuner's is: its settings by value, its functions by what they
answer.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tuners.tuner import tuner_file as model_file
from yawrate_env.plant import fingerprint
from yawrate_env.plant.plant import Plant

_KIND = "checkpoint"


@dataclass(frozen=True, slots=True)
class Origin:
    """What a training is of.

    Attributes
    ----------
    plant : Plant
        Whose episodes; vehicles as those of `yawrate_env.vehicle.yaw_rate`.
    settings : dict
        Algorithm, first stage and what else is seen, as plain JSON values.
    """

    plant: Plant
    settings: dict[str, Any]

    def write(self, path: Path) -> None:
        """Write it to a file."""
        plant = fingerprint.settings(self.plant)
        content = {"kind": _KIND, "plant": plant, "settings": self.settings}
        model_file.write(path, content, fingerprint.trial(self.plant))

    def check(self, path: Path) -> None:
        """``ValueError`` where a file is of another one."""
        content, answers = model_file.read(path)
        if content.get("kind") != _KIND:
            raise ValueError(f"{path} says nothing of a checkpoint")
        with model_file.rebuilding(path):
            then = content["settings"]
            other = fingerprint.changed(self.plant, content["plant"], answers)
        for name, now in self.settings.items():
            if then.get(name) != now:
                raise ValueError(f"its {name} is {then.get(name)!r}, not {now!r}")
        if other:
            raise ValueError(f"it is of another plant: its {other} is not this one's")
