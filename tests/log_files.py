"""Recordings of two plants and the text files that hold them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from drives import drive
from first_order import SIGMA, TS, U, gauged

from tuners.logs import Options, read_log
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate


@dataclass(frozen=True)
class Case:
    """A plant, its recording, and the names that a log gives time, input, output, parameter."""

    plant: Plant
    Ts: float
    u: Any
    y: Any
    measured: str
    value: float
    names: tuple[str, str, str, str]

    @property
    def columns(self):
        t = self.Ts * np.arange(len(self.u))
        parameter = np.full(len(self.u), self.value)
        return dict(zip(self.names, (t, self.u, self.y, parameter), strict=True))

    def changed(self, **roles):
        """The columns with `time`, `input`, `output` or `measured` replaced."""
        keys = dict(zip(("time", "input", "output", "measured"), self.names, strict=True))
        return self.columns | {keys[role]: values for role, values in roles.items()}


def _vehicle():
    u, _, r = drive(Ts=0.01, seconds=8.0)
    plant = yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0))))
    return Case(plant, 0.01, u, r, "v_x", 18.0, ("t", "steer", "yaw_rate", "speed"))


def _lag():
    noise = SIGMA * np.random.default_rng(0).standard_normal(len(U))
    y = gauged.respond(np.array([[1.25, 0.5]]))[0] + noise
    return Case(gauged, TS, U, y, "K", 1.25, ("t", "valve", "flow", "K"))


CASES = {"vehicle": _vehicle(), "lag": _lag()}


def write(path, columns, *, delimiter=",", decimal=".", above="", row="", encoding="utf-8"):
    """Write columns (lists or arrays by name) as text, with a row of units or without."""
    lines = [delimiter.join(columns), *([row] if row else [])]
    for values in zip(*columns.values(), strict=True):
        cells = (f"{v:.12g}" if isinstance(v, float) else str(v) for v in values)
        lines.append(delimiter.join(cell.replace(".", decimal) for cell in cells))
    path.write_bytes((above + "\n".join(lines) + "\n").encode(encoding))
    return path


def read(path, plant, **options):
    return read_log(path, plant, Options(**options))


def check_same(log, case, rtol=1e-9):
    """Whether a log is the whole recording of a case."""
    np.testing.assert_allclose(log.u, case.u, rtol=rtol)
    np.testing.assert_allclose(log.y, case.y, rtol=rtol)
    np.testing.assert_allclose(log.measured[case.measured], case.value, rtol=rtol)
    assert log.Ts == case.Ts and log.t0 == 0.0
    assert log.duration == len(log.time) * log.Ts
