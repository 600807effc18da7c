"""The first stage on Laguerre functions as a C99 program: sample by sample, in constant memory.

It filters as `tuners.features.laguerre` and accumulates the normal equations, from which the
features follow at the end; always in double precision, because the equations square the
condition number.  All such stages solve symmetric equations by Cholesky's method: the normal
equations, whose solution are the features or gives a frequency response, or those of the
principal components.
"""

from collections.abc import Sequence

import numpy as np

from tuners.export.first_stage import OnLaguerre, first_stage
from tuners.export.golden import GoldenSignals
from tuners.export.programs import program
from yawrate_env import validation

_TOLERANCE = 1e-8  # of the largest feature: the equations lose half of the digits


def features_program(
    stage: OnLaguerre,
    Ts: float,
    *,
    inputs: Sequence[str] = ("u",),
    outputs: Sequence[str] = ("y",),
    name: str = "yawrate_laguerre",
) -> dict[str, str]:
    """Header, source and test program, by file name.

    Parameters
    ----------
    stage : Laguerre, Regularised or FrequencyResponse
        A tuner's first stage.
    Ts : float
        Sampling time of the episodes [s].
    inputs, outputs : sequence of str
        Their names, with units.
    name : str
        Prefix of the files and of all that they declare.
    """
    validation.number("Ts", Ts, above=0.0, remedy="Give the sampling time in seconds.")
    written = first_stage(stage)
    pole = float(np.exp(-stage.pole * Ts))
    test = GoldenSignals.of(stage.pole, Ts, inputs=len(inputs), outputs=len(outputs))
    golden = stage(*test(), Ts)[0][0]
    values = {
        "stage": stage,
        "Ts": Ts,
        "inputs": inputs,
        "outputs": outputs,
        "pole": pole,
        "gain": np.sqrt(1 - pole * pole),
        "golden": golden,
        "golden_signals": test,
        "tolerance": _TOLERANCE * np.abs(golden).max(),
        **sizes(stage, len(inputs), len(outputs)),
        "solve": written.solve,
        "description": written.description,
        **written.constants(stage, Ts),
    }
    return program("features", name, values)


def sizes(stage: OnLaguerre, inputs: int, outputs: int) -> dict[str, int]:
    """Samples that a recording must have, and bytes of state, constants and (roughly) stack."""
    n = stage.order * inputs
    solved, constants, least = first_stage(stage).counts(stage, n)
    return {
        "least_samples": least,
        "state_size": 8 * (1 + inputs + n + n * n + outputs * n),
        "constant_size": 8 * (4 + constants),
        "stack_size": 8 * solved * (solved + 4),
    }
