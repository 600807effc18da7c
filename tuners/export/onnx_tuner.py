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

from tuners.export.graph import Graph
from tuners.export.parts import Parts
from tuners.export.trees import ensemble
from tuners.features.laguerre import Laguerre, lifted
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from tuners.learners import Learner
from tuners.learners.actor import LIMIT, Agent
from tuners.learners.feedforward import FeedForward
from tuners.learners.gbm import GBM
from tuners.learners.polynomial import Polynomial, monomials
from tuners.learners.trend import Trend
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
    _decode(graph, _learner(graph, parts.learner, X), X, parts)
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
    functions = Laguerre(stage.order, stage.pole)
    rows = functions.regressors(np.atleast_2d(plant.u), plant.Ts)
    into, phi = graph.constant, rows.reshape(-1, plant.samples)
    gram = phi @ phi.T
    if isinstance(stage, Regularised):
        matrix, offset = stage.linear(gram)
        components = graph.apply("MatMul", output, into((matrix @ phi).T))
        return graph.apply("Sub", components, into(offset))
    coefficients = graph.apply("MatMul", output, into(np.linalg.solve(lifted(gram), phi).T))
    if isinstance(stage, FrequencyResponse):
        return _response(graph, coefficients, stage.functions(plant.Ts))
    return coefficients


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


def _response(graph: Graph, coefficients: str, functions: NDArray[np.complex128]) -> str:
    """Log magnitude and unwrapped phase of Laguerre models; (episodes, 2 points)."""
    into, (points,) = graph.constant, functions.shape[1:]
    re, im = (
        graph.apply("MatMul", coefficients, into(part)) for part in (functions.real, functions.imag)
    )
    squares = (graph.apply("Mul", part, part) for part in (re, im))
    magnitude = graph.apply("Sqrt", graph.apply("Add", *squares))
    steps = graph.apply("MatMul", _angle(graph, re, im), into(np.eye(points) - np.eye(points, k=1)))
    turns = graph.apply("Round", graph.apply("Mul", steps, into(1 / (2 * np.pi))))
    wrapped = graph.apply("Sub", steps, graph.apply("Mul", turns, into(2 * np.pi)))
    phase = graph.apply("MatMul", wrapped, into(np.triu(np.ones((points, points)))))
    return graph.joined(graph.apply("Log", magnitude), phase)


def _angle(graph: Graph, re: str, im: str) -> str:
    """Angles in double precision, where the runtime's arc tangent is single.

    Turned back by that first angle, a number's own is so small that it is its tangent.
    """
    from onnx import TensorProto

    into, zero = graph.constant, graph.constant(0.0)
    half = graph.apply("Where", graph.apply("GreaterOrEqual", im, zero), into(np.pi), into(-np.pi))
    left = graph.apply("Where", graph.apply("Less", re, zero), half, zero)
    slope = graph.apply("Cast", graph.apply("Div", im, re), to=TensorProto.FLOAT)
    near = graph.apply("Cast", graph.apply("Atan", slope), to=TensorProto.DOUBLE)
    rough = graph.apply("Add", near, left)
    cos, sin = graph.apply("Cos", rough), graph.apply("Sin", rough)
    products = [graph.apply("Mul", a, b) for a, b in ((im, cos), (re, sin), (re, cos), (im, sin))]
    rest = graph.apply("Div", graph.apply("Sub", *products[:2]), graph.apply("Add", *products[2:]))
    return graph.apply("Add", rough, rest)


def _learner(graph: Graph, learner: Learner, X: str) -> str:
    match learner:
        case FeedForward():
            return _network(graph, learner, X)
        case Polynomial():
            return _polynomial(graph, learner, X)[1]
        case Trend():
            inputs, trend = _polynomial(graph, learner.polynomial, X)
            return graph.apply("Add", trend, _learner(graph, learner.rest, inputs))
        case GBM():
            return _trees(graph, learner, X)
        case Agent():
            return _agent(graph, learner, X)
    raise ValueError(
        f"the tuner's learner is a {type(learner).__name__}, which no graph is written for. Export "
        "one with a network or boosted trees, or use the tuner in Python."
    )


def _polynomial(graph: Graph, found: Polynomial, X: str) -> tuple[str, str]:
    """Decorrelated features (episodes, k), and their polynomial (episodes, targets)."""
    into, k = graph.constant, found.matrix.shape[1]
    centred = graph.apply("Sub", X, into(found.mean))
    inputs = graph.apply("MatMul", centred, into(found.matrix))
    values, done = into(found.coefficients[:1]), 1
    for degree in range(1, found.degree + 1):
        chosen = monomials(k, degree)
        factors = [graph.apply("Gather", inputs, into(i, np.int64), axis=1) for i in chosen.T]
        product = factors[0]
        for factor in factors[1:]:
            product = graph.apply("Mul", product, factor)
        part = graph.apply("MatMul", product, into(found.coefficients[done : done + len(chosen)]))
        values, done = graph.apply("Add", values, part), done + len(chosen)
    return inputs, values


def _network(graph: Graph, network: FeedForward, X: str) -> str:
    """Scaling, tanh layer, linear layer, scaling; (episodes, targets)."""
    scale, into = 1 / network.inputs.half, graph.constant
    W1 = network.W1 * scale
    b1 = network.b1 - W1 @ network.inputs.middle
    W2 = network.W2 * network.outputs.half[:, None]
    b2 = network.b2 * network.outputs.half + network.outputs.middle
    hidden = graph.apply("Tanh", graph.apply("Gemm", X, into(W1), into(b1), transB=1))
    return graph.apply("Gemm", hidden, into(W2), into(b2), transB=1)


def _agent(graph: Graph, agent: Agent, X: str) -> str:
    """Standardised features in single precision, a perceptron, the bounds; (episodes, targets)."""
    from onnx import TensorProto

    into, actor = graph.constant, agent.actor
    scaled = graph.apply("Div", graph.apply("Sub", X, into(agent.mean)), into(agent.scale))
    clipped = graph.apply("Clip", scaled, into(-LIMIT), into(LIMIT))
    x = graph.apply(
        "Cast", graph.apply("Cast", clipped, to=TensorProto.FLOAT), to=TensorProto.DOUBLE
    )
    for i, (weight, bias) in enumerate(actor.layers):
        x = graph.apply("Relu" if actor.hidden == "relu" else "Tanh", x) if i else x
        x = graph.apply("Gemm", x, into(weight), into(bias), transB=1)
    action = graph.apply("Tanh", x) if actor.squashed else graph.apply("Clip", x, into(-1), into(1))
    half = graph.apply("Mul", action, into((agent.high - agent.low) / 2))
    return graph.apply("Add", half, into((agent.high + agent.low) / 2))


def _trees(graph: Graph, gbm: GBM, X: str) -> str:
    """Boosted trees in single precision, as xgboost has them; (episodes, targets)."""
    from onnx import TensorProto

    single = graph.apply("Cast", X, to=TensorProto.FLOAT)
    sums = graph.apply("TreeEnsembleRegressor", single, domain="ai.onnx.ml", **ensemble(gbm.models))
    scaled = graph.apply(
        "Mul", graph.apply("Cast", sums, to=TensorProto.DOUBLE), graph.constant(gbm.scale)
    )
    return graph.apply("Add", scaled, graph.constant(gbm.mean))


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
