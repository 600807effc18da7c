"""A two-stage tuner as C99 programs: from samples to gains.

The first stage is `tuners.export.features_program`, in files of its own; beside it come the
learner, which must be a network, the parametrisation of the gains, and a test program.
"""

from typing import Any

import numpy as np

from tuners.export.features_program import features_program, sizes
from tuners.export.golden import GoldenSignals
from tuners.export.parts import Parts
from tuners.export.programs import program
from tuners.export.second_stage import second_stage
from yawrate_env.loop import controller
from yawrate_env.loop.design import LEAST_LAG
from yawrate_env.plant.episodes import sample

_PLANTS = 24
_TOLERANCE = 1e-9  # relative, of gains


def tuner_program(
    tuner: Any, *, name: str = "yawrate_tuner", first: str = "yawrate_laguerre"
) -> dict[str, str]:
    """Headers, sources and test programs of both stages, by file name.

    Parameters
    ----------
    tuner : Tuner
        With features on Laguerre functions and a network.
    name, first : str
        Prefix of the files and of all that they declare, of the tuner and of its first stage.

    Raises
    ------
    ValueError
        The tuner cannot be written in C; the message says why, and what can.
    """
    parts = Parts.of(tuner)
    plant, learner = parts.plant, second_stage(parts.learner).program(parts.learner)
    channels = plant.inputs_named, plant.outputs_named
    size, network = sizes(parts.features, *map(len, channels)), learner["network"]
    own = 3 * parts.width + len(network.b1)
    learned = sum(np.size(array) for array in parts.learner.arrays().values())
    values = {
        "first": first,
        "gains": plant.gains,
        "inputs": plant.inputs_named,
        "outputs": plant.outputs_named,
        "Ts": plant.Ts,
        "width": parts.width,
        "measured": plant.measured_names,
        "positive": [name for name in plant.measured_names if plant.positive(name)],
        "golden": _golden(parts),
        "golden_signals": _golden_signals(parts),
        **size,
        "constant_size": size["constant_size"] + 8 * int(learned),
        "stack_size": size["stack_size"] + 8 * own,
        **learner,
        **_decoding(parts),
        "signs": parts.signs,
    }
    return {**first_stage_program(tuner, name=first), **program("tuner", name, values)}


def first_stage_program(tuner: Any, *, name: str = "yawrate_laguerre") -> dict[str, str]:
    """The same of the first stage alone, whatever the learner.

    Parameters
    ----------
    tuner : Tuner
        Whose features are Laguerre functions'.
    name : str
        Prefix of the files and of all that they declare.
    """
    parts = Parts.of(tuner)
    plant = parts.plant
    inputs, outputs = plant.inputs_named, plant.outputs_named
    return features_program(parts.features, plant.Ts, inputs=inputs, outputs=outputs, name=name)


def _decoding(parts: Parts) -> dict[str, Any]:
    """What the template needs to make gains of predicted coordinates."""
    target = parts.parametrisation.target
    if target is None:
        return {"target": None, "columns": parts.columns}
    return {
        "target": target,
        "omega": controller.warped(target),
        "least_lag": -LEAST_LAG,
        "quarter_turn": -np.pi / 2,
    }


def _golden_signals(parts: Parts) -> GoldenSignals:
    """A recording in which the lags' outputs are of the size of the plants'."""
    plant = parts.plant
    outputs = plant.respond(sample(plant, 1))
    size = float(np.linalg.norm(outputs[0]) / np.linalg.norm(plant.u))
    counts = {"inputs": len(plant.inputs_named), "outputs": len(plant.outputs_named)}
    return GoldenSignals.of(parts.features.pole, plant.Ts, size, **counts)


def _golden(parts: Parts) -> dict[str, Any]:
    """Features of plants, some of them extreme, and their gains; last those of the signals."""
    plant, theta = parts.plant, sample(parts.plant, _PLANTS)
    features, _ = parts.features(plant.u[None], plant.respond(theta), plant.Ts)
    features[-1, 0], features[-2] = np.nan, -features[-2]
    features[-4:-2] *= [[3.0], [30.0]]
    whole, _ = parts.features(*_golden_signals(parts)(), plant.Ts)
    theta = np.concatenate([theta, theta[:1]])
    gains, status = parts.answer(np.concatenate([features, whole]), theta)
    return {
        "tolerance": _TOLERANCE,
        "features": features,
        "measured": theta[:, plant.indices(plant.measured_names)],
        "gains": gains,
        "status": status,
    }
