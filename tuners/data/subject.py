"""What a data set is of: the vehicles of a task, or the plants of a description.

Both are simulated, compressed and learned from as plants.  They differ in how a manifest
names them, and in what a vehicle's table holds besides.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tuners.features import COMPRESSORS
from yawrate_env.loop.design import Status
from yawrate_env.plant import entry, fingerprint
from yawrate_env.plant.episodes import Examples
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.contexts import ContextSet
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import context_of, yaw_rate

Columns = dict[str, NDArray[Any]]

FEATURE = re.compile(rf"({'|'.join(COMPRESSORS)})_\d+")
"""How columns of features are called."""


@dataclass(frozen=True, slots=True)
class Vehicles:
    """Those of a task; a manifest holds it whole.

    The table says of every vehicle how far the design rule came, and holds gains that miss
    the target too.
    """

    coordinates: ClassVar[str] = "loop"
    signals: ClassVar[tuple[str, str]] = ("steer", "yaw_rate")
    units: ClassVar[Mapping[str, str]] = {
        "mu_s": "1", "M_delta": "kg", "v_x": "m/s", "kp": "s", "Ti": "s", "log_gain": "1",
        "phase": "rad", "steer": "rad", "yaw_rate": "rad/s",
    }  # fmt: skip

    task: Task

    def plant(self, contexts: ContextSet) -> Plant:
        """As plants, of the set's prior."""
        return yaw_rate(replace(self.task, prior=contexts.prior(self.task.prior)))

    def to_json(self) -> dict[str, Any]:
        """What a manifest holds."""
        return {"task": asdict(self.task)}

    def check(self, contexts: ContextSet) -> None:
        """Vehicles can be of any set."""

    def home(self) -> Path | None:
        """Where the code is that this package lacks: there is none."""
        return None

    def designed(self, rows: Examples) -> tuple[Columns, NDArray[np.float64]]:
        """Further columns, and gains (m, 2) of the design rule."""
        gains, status = rows.gains.copy(), np.zeros(len(rows), np.int8)
        missed = np.isnan(gains).any(axis=1)
        if missed.any():
            found = loops(self.task, context_of(rows.theta[missed])).design()
            gains[missed] = np.stack([found.kp, found.Ti], axis=1)
            status[missed] = found.status
        return {"status": status}, gains

    def reached(self, values: Columns) -> NDArray[np.bool_]:
        """(m,) rows whose gains give what they should."""
        return np.asarray(values["status"] == Status.OK)


@dataclass(frozen=True, slots=True)
class Plants:
    """Those of a description; a manifest names its entry, and what it answers to a trial."""

    coordinates: ClassVar[str] = "own"
    signals: ClassVar[tuple[str, str]] = ("u", "y")
    units: ClassVar[Mapping[str, str]] = {}

    described: Plant

    def plant(self, contexts: ContextSet) -> Plant:
        """Themselves: no set has a prior for them."""
        return self.described

    def check(self, contexts: ContextSet) -> None:
        """``ValueError`` where they cannot be found again, or their table not be written."""
        entry.named(self.described, "A data set")
        if contexts.beyond is not None:
            raise ValueError(
                f"contexts = {contexts.name!r} has vehicles of its own. For other plants choose "
                "train, test or calibration, or describe a plant with another prior."
            )
        targets = target_names(self.described)
        targets = () if targets == self.described.gains else targets
        names = [*self.described.prior, *self.described.gains, *targets]
        for name, count in Counter([*names, "episode", "usable", *self.signals]).items():
            if count > 1 or FEATURE.fullmatch(name):
                raise ValueError(
                    f"{name!r} would be the name of two columns. Rename the plant's parameter, "
                    "gain or coordinate."
                )

    def to_json(self) -> dict[str, Any]:
        """What a manifest holds."""
        names = {"entry": self.described.entry, "targets": target_names(self.described)}
        return {"plant": names | fingerprint.of_episodes(self.described)}

    def home(self) -> Path | None:
        """The folder of the plant's module, which workers import."""
        return entry.home(self.described)

    def designed(self, rows: Examples) -> tuple[Columns, NDArray[np.float64]]:
        """Further columns, of which there are none, and gains (m, k) of the design rule."""
        return {}, rows.gains

    def reached(self, values: Columns) -> NDArray[np.bool_]:
        """(m,) rows whose gains give what they should: those that have any."""
        return np.ones(len(values["usable"]), np.bool_)


Subject = Vehicles | Plants


def subject_of(what: Task | Plant) -> Subject:
    """What a data set of it needs to know."""
    if isinstance(what, Plant):
        return Plants(what)
    if isinstance(what, Task):
        return Vehicles(what)
    raise ValueError(f"{what!r} is neither a Task nor a tuners.plants.Plant. Describe one of them.")


def target_names(plant: Plant) -> tuple[str, ...]:
    """What the learner's targets are called."""
    if plant.parametrisation.names is not None:
        return plant.parametrisation.names(plant.gains)
    width = plant.parametrisation.encode(plant.oracle(plant.middle)).shape[1]
    return tuple(f"coordinate_{i}" for i in range(1, width + 1))
