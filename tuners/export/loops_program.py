"""The PI loops of a plant with several channels as one C99 program.

Each loop is the program of `tuners.export.pi_program` under a name of its own; one more file starts
and steps them all.  The k-th loop answers the k-th output's error by the k-th input.  A loop whose
gain is negative is a controller of the opposite error: its limits and its recovery from them are
those of any other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from tuners.export.digital_pi import DigitalPI
from tuners.export.pi_program import TOLERANCES, golden_errors, pi_program
from tuners.export.programs import program
from tuners.tuner.result import Result
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

NAME = "yawrate_loops"

_GAINS = "kp", "Ti"


@dataclass(frozen=True, slots=True)
class Loop:
    """One of several controllers.

    Attributes
    ----------
    name : str
        What its gains' names end with, as in ``kp_top``.
    pi : DigitalPI
        Of a positive gain.
    sign : int
        -1 where the controller is one of the opposite error.
    """

    name: str
    pi: DigitalPI
    sign: int

    @classmethod
    def all_of(
        cls,
        plant: Plant,
        gains: Mapping[str, float],
        limits: Sequence[tuple[float, float]] | None,
        Ts: float | None = None,
    ) -> list[Self]:
        """The loops of a plant, in the order of its channels; ``ValueError`` where it has none.

        Parameters
        ----------
        limits : sequence of (low, high)
            Of each input, in its unit.
        """
        inputs, outputs = plant.inputs_named, plant.outputs_named
        names = [name.removeprefix("kp_") for name in gains if name.startswith("kp_")]
        wanted = [f"{of}_{name}" for name in names for of in _GAINS]
        if list(gains) != wanted or not len(names) == len(inputs) == len(outputs):
            raise ValueError(
                f"gains {', '.join(gains)} are not those of {len(inputs)} PI loops, from each "
                "output to the input of the same number: kp_one, Ti_one, kp_two and so on. "
                "Export them to target json."
            )
        if limits is None or np.shape(limits) != (len(inputs), 2):
            raise ValueError(
                f"limits of {', '.join(inputs)} are missing: give limits=((low, high), ...), a "
                "pair for each input."
            )
        loops = []
        for name, pair, *signals in zip(names, limits, inputs, outputs, strict=True):
            kp, Ti = gains[f"kp_{name}"], gains[f"Ti_{name}"]
            low, high = map(float, pair)
            sampling = plant.Ts if Ts is None else Ts
            pi = DigitalPI(abs(kp), Ti, sampling, low, high, (signals[0], signals[1]))
            loops.append(cls(split(name)[0], pi, -1 if kp < 0 else 1))
        return loops


def loops_program(
    result: Result,
    limits: Sequence[tuple[float, float]] | None,
    Ts: float | None = None,
    real: str = "double",
) -> dict[str, str]:
    """Headers, sources and test programs of all loops and of each, by file name.

    Parameters
    ----------
    result : Result
        Of a plant with a PI for each channel.
    limits : sequence of (float, float), optional
        Lowest and highest command of each loop; the plant's if omitted.
    Ts : float, optional
        Sampling time of the controllers [s]; the plant's if omitted.
    real : {"double", "float"}
        Type of the programs' numbers.
    """
    loops = Loop.all_of(result.plant, result.gains, limits, Ts)
    files: dict[str, str] = {}
    for loop in loops:
        files |= pi_program(loop.pi, real=real, name=f"yawrate_{loop.name}")
    runs = [(*golden_errors(loop.pi), loop) for loop in loops]
    errors = np.stack([loop.sign * errors for errors, _, loop in runs], axis=1)
    commands = np.stack([loop.pi.run(e, start=start) for e, start, loop in runs], axis=1)
    largest = max(abs(end) for loop in loops for end in (loop.pi.low, loop.pi.high))
    values = {
        "loops": loops,
        "Ts": loops[0].pi.Ts,
        "real": real,
        "errors": errors,
        "commands": commands,
        "starts": [(loop.sign * start[0], start[1]) for _, start, loop in runs],
        "tolerance": TOLERANCES[real] * max(largest, 1.0),
    }
    return files | program("loops", NAME, values)
