"""The PI loops of a plant with several channels as one C99 program.

Each loop is the program of `tuners.export.pi_program` under a name of its own; one more file starts
and steps them all.  The k-th loop answers the k-th output's error by the k-th input.  A loop whose
gain is negative is a controller of the opposite error: its limits and its recovery from them are
those of any other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from tuners.export.digital_pi import DigitalPI
from tuners.export.gains import Gains
from tuners.export.pi_program import TOLERANCES, golden_errors, pi_program
from tuners.export.programs import program

NAME = "yawrate_loops"


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
        gains: Gains,
        limits: Sequence[tuple[float, float]] | None,
        Ts: float | None = None,
    ) -> list[Self]:
        """The loops of gains, in the order of their channels; ``ValueError`` where there are none.

        Parameters
        ----------
        limits : sequence of (low, high)
            Of each input, in its unit.
        """
        inputs, _ = gains.channels or ((), ())
        if not gains.loops:
            raise ValueError(
                f"gains {', '.join(gains.values)} are not those of {len(inputs)} PI loops, from "
                "each output to the input of the same number: kp_one, Ti_one, kp_two and so on. "
                "Export them to target json."
            )
        if limits is None or np.shape(limits) != (len(inputs), 2):
            raise ValueError(
                f"limits of {', '.join(inputs)} are missing: give limits=((low, high), ...), a "
                "pair for each input (--limits LOW HIGH once for each)."
            )
        sampling = gains.Ts if Ts is None else Ts
        if sampling is None:
            raise ValueError("Ts of the controllers is missing: give it in seconds, Ts= (--Ts).")
        loops, values = [], np.reshape(list(gains.values.values()), (-1, 2)).tolist()
        for (name, signals), (kp, Ti), pair in zip(
            gains.loops.items(), values, limits, strict=True
        ):
            low, high = map(float, pair)
            pi = DigitalPI(abs(kp), Ti, sampling, low, high, signals)
            loops.append(cls(name, pi, -1 if kp < 0 else 1))
        return loops


def loops_program(
    gains: Gains,
    limits: Sequence[tuple[float, float]] | None,
    Ts: float | None = None,
    real: str = "double",
) -> dict[str, str]:
    """Headers, sources and test programs of all loops and of each, by file name.

    Parameters
    ----------
    gains : Gains
        Of a PI for each channel.
    limits : sequence of (float, float)
        Lowest and highest command of each loop.
    Ts : float, optional
        Sampling time of the controllers [s]; the plant's if omitted.
    real : {"double", "float"}
        Type of the programs' numbers.
    """
    return program_of(Loop.all_of(gains, limits, Ts), real=real)


def program_of(loops: Sequence[Loop], *, real: str = "double") -> dict[str, str]:
    """Header, source and test program of several PI loops, by file name."""
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
