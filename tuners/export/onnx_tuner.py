"""A two-stage tuner on Laguerre features as one ONNX graph, in double precision.

=============  ========================  ==============================================
tensor         shape                     meaning
=============  ========================  ==============================================
the output     (episodes, N)             input, called as the plant calls its output,
                                         without the unit: ``yaw_rate``, ``y``; of several
                                         each
features       (episodes, n)             input instead of it, if asked for: the first
                                         stage's features of a recording
measured       (episodes,) each          further inputs, by name and in their own unit:
parameters                               ``v_x``
the gains      (episodes,) each          by name; ``nan`` where there are none
status         (episodes,) int64         of `yawrate_env.loop.design.Status`
=============  ========================  ==============================================

For a known input the first stage begins with a matrix: the graph holds that of the
experiment.  For any other, `tuners.export.features_program` writes it in C, and the graph
begins at the features.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.export.first_stage import first_stage
from tuners.export.graph import Graph
from tuners.export.parts import Parts
from tuners.export.second_stage import second_stage
from tuners.features.laguerre import Laguerre
from yawrate_env.loop import controller
from yawrate_env.loop.design import LEAST_LAG, Status
from yawrate_env.loop.target import Target
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]


def onnx_model(tuner: Any, *, features: bool = False) -> Any:
    """The tuner as an ``onnx.ModelProto``.

    Parameters
    ----------
    tuner : Tuner
        With features on Laguerre functions.
    features : bool
        Begin at the features instead of the output.

    Raises
    ------
    ValueError
        The tuner cannot be a graph; the message says which can.
    """
    parts, graph = Parts.of(tuner), Graph()
    plant, inputs = parts.plant, {}
    if features:
        X = "features"
        inputs[X] = ["episodes", parts.recorded]
    else:
        recorded = [plain_name(signal) for signal in plant.outputs_named]
        inputs |= {output: ["episodes", plant.samples] for output in recorded}
        X = graph.joined(*(_first_stage(graph, output, parts) for output in recorded))
    inputs |= {name: ["episodes"] for name in plant.measured_names}
    X = graph.joined(X, *(_measured(graph, plant, name) for name in plant.measured_names))
    _decode(graph, second_stage(parts.learner).graph(graph, parts.learner, X), X, parts)
    from onnx import TensorProto

    outputs = dict.fromkeys(plant.gains, TensorProto.DOUBLE) | {"status": TensorProto.INT64}
    description = f"{', '.join(plant.gains)} from one identification episode."
    return graph.model(inputs, outputs, _texts(parts), description)


def plain_name(signal: str) -> str:
    """A signal's name without its unit, in one word."""
    return "_".join(split(signal)[0].split()) or "output"


def _first_stage(graph: Graph, output: str, parts: Parts) -> str:
    """Features of one output of the experiment; (episodes, n)."""
    plant, stage = parts.plant, parts.features
    if plant.excite is not None:
        raise ValueError(
            "every episode has an input of its own, and the first stage is no constant matrix. "
            "Export with features=True (--features), and the first stage to target c."
        )
    rows = Laguerre(stage.order, stage.pole).regressors(np.atleast_2d(plant.u), plant.Ts)
    phi = rows.reshape(-1, plant.samples)
    return first_stage(stage).graph(graph, stage, output, phi, plant.Ts)


def _texts(parts: Parts) -> dict[str, str]:
    """Metadata."""
    texts, target = {"Ts": repr(parts.plant.Ts)}, parts.parametrisation.target
    if target is not None:
        texts["Ts_control"] = repr(target.Ts)
        texts["phase_margin"] = repr(target.phase_margin)
        texts["crossover"] = repr(target.crossover)
    return texts | {"laguerre_pole": repr(parts.features.pole)}


def _measured(graph: Graph, plant: Plant, name: str) -> str:
    """A measured parameter's feature, as `Plant.measured_features` has it; (episodes, 1)."""
    value = graph.apply("Log", name) if plant.positive(name) else name
    return graph.apply("Unsqueeze", value, graph.constant([1], np.int64))


def _decode(graph: Graph, values: str, X: str, parts: Parts) -> None:
    """Gains and status from predicted coordinates and their features, as `Parts.answer` does."""
    into, zero, target = graph.constant, graph.constant(0.0), parts.parametrisation.target
    names = parts.plant.gains
    columns = [graph.apply("Gather", values, into(i, np.int64), axis=1) for i in range(len(names))]
    reached, unreachable = into(int(Status.OK), np.int64), into(int(Status.UNREACHABLE), np.int64)
    rest = graph.apply("ReduceSum", graph.apply("Sub", X, X), into([1], np.int64), keepdims=0)
    found = graph.apply("Equal", rest, zero)  # what is not finite leaves itself not 0
    if target is not None:
        leads = graph.apply("GreaterOrEqual", columns[1], zero)
        limited = into(int(Status.PHASE_LIMITED), np.int64)
        reached = graph.apply("Where", leads, limited, reached)
        found = graph.apply("And", found, graph.apply("Greater", columns[1], into(-np.pi / 2)))
        phase = graph.apply("Where", leads, into(-LEAST_LAG), columns[1])
        columns = _controller(graph, columns[0], phase, target)
    else:
        columns = [_gain(graph, *each) for each in zip(columns, parts.columns, strict=True)]
    for gain, sign in zip(columns, parts.signs, strict=True):
        least = zero if sign > 0 else into(-np.inf)
        most = zero if sign < 0 else into(np.inf)
        for bound in (graph.apply("Greater", gain, least), graph.apply("Less", gain, most)):
            found = graph.apply("And", found, bound)
    for name, gain in zip(names, columns, strict=True):
        graph.apply("Where", found, gain, into(np.nan), output=name)
    graph.apply("Where", found, reached, unreachable, output="status")


def _gain(graph: Graph, value: str, column: tuple[str, float]) -> str:
    """A gain from its coordinate; the hyperbolic sine of doubles is not in every runtime."""
    kind, scale = column
    if kind in ("linear", "gain"):
        return value
    grown = graph.apply("Exp", value)
    if kind == "log":
        return grown if scale == 1 else graph.apply("Mul", grown, graph.constant(scale))
    half = graph.apply("Sub", grown, graph.apply("Reciprocal", grown))
    return graph.apply("Mul", half, graph.constant(scale / 2))


def _controller(graph: Graph, log_magnitude: str, phase: str, target: Target) -> list[str]:
    """`yawrate_env.loop.controller.gains` in a graph, with the sine and cosine of the phase."""
    omega = graph.constant(controller.warped(target))
    magnitude, cos = graph.apply("Exp", log_magnitude), graph.apply("Cos", phase)
    tangent = graph.apply("Neg", graph.apply("Div", graph.apply("Sin", phase), cos))
    if target.controller == "pi":
        kp = graph.apply("Mul", magnitude, cos)
        return [kp, graph.apply("Reciprocal", graph.apply("Mul", tangent, omega))]
    return [graph.apply("Div", magnitude, cos), graph.apply("Div", tangent, omega)]
