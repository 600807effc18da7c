"""A two-stage tuner on Laguerre features as one ONNX graph, in double precision.

===========  ========================  ================================================
tensor       shape                     meaning
===========  ========================  ================================================
yaw_rate     (episodes, N)             input, measured yaw rate [rad/s]
features     (episodes, order)         input instead of it, if asked for
kp, Ti       (episodes,)               gains [s], [s]; ``nan`` where no PI does it
status       (episodes,) int64         of `yawrate_env.design.Status`
===========  ========================  ================================================

For a known command the first stage is linear in the yaw rate: the graph holds its matrix for
the tuner's own excitation.  For any other, `tuners.export.compressor_source` does it in C, and
the graph begins at the features.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.compressors.laguerre import Laguerre
from tuners.compressors.response import FrequencyResponse
from tuners.export.graph import Graph
from tuners.export.trees import ensemble
from tuners.learners.feedforward import FeedForward
from tuners.learners.gbm import GBM
from tuners.learners.trend import Trend
from tuners.tuner import Tuner
from yawrate_env.design import LEAST_LAG, Status
from yawrate_env.excitation import prbs
from yawrate_env.task import Task

Array = NDArray[np.float64]

_EXPORTED = "Export ts-ff-lag or ts-gbm-lag, or one trained with Laguerre features."
_REASONS = {
    type(None): "it is no two-stage tuner",
    FrequencyResponse: "its features are a frequency response, not linear in the yaw rate",
}


def onnx_model(tuner: Any, *, features: bool = False) -> Any:
    """The tuner as an ``onnx.ModelProto``.

    Parameters
    ----------
    tuner : TwoStage
        With Laguerre features: ``ts-ff-lag``, ``ts-gbm-lag``, or trained like these.
    features : bool
        Begin at the features instead of the yaw rate.

    Raises
    ------
    ValueError
        The tuner cannot be a graph; the message says which can.
    """
    check(tuner)
    graph = Graph()
    task, order = tuner.task, tuner.stages.compressor.order
    if features:
        inputs: dict[str, list[Any]] = {"features": ["episodes", order]}
        X = "features"
    else:
        inputs = {"yaw_rate": ["episodes", task.experiment.N]}
        X = graph.apply("MatMul", "yaw_rate", graph.constant(compression(tuner).T))
    values = _learner(graph, tuner.stages.learner, X)
    _decode(graph, values, task, tuner.coordinates)
    from onnx import TensorProto

    outputs = {"kp": TensorProto.DOUBLE, "Ti": TensorProto.DOUBLE, "status": TensorProto.INT64}
    target = task.target
    texts = {
        "Ts": repr(task.experiment.Ts),
        "Ts_control": repr(target.Ts),
        "phase_margin": repr(target.phase_margin),
        "crossover": repr(target.crossover),
        "laguerre_pole": repr(tuner.stages.compressor.pole),
    }
    return graph.model(inputs, outputs, texts, "PI gains from one identification episode.")


def check(tuner: Any) -> Any:
    """The tuner, or ``ValueError`` where it cannot be exported."""
    if not isinstance(tuner, Tuner):
        raise ValueError(
            f"a {type(tuner).__name__} is not exported as a graph: target onnx needs a tuner "
            f"(--tuner). {_EXPORTED}"
        )
    own = getattr(tuner, "stages", None)
    stages = getattr(own, "compressor", None), getattr(own, "learner", None)
    if not isinstance(stages[0], Laguerre) or not isinstance(stages[1], FeedForward | GBM | Trend):
        kind = getattr(tuner, "kind", type(tuner).__name__)
        reason = _REASONS.get(type(stages[0]), "its first stage is not linear in the yaw rate")
        raise ValueError(f"a tuner of kind {kind!r} is not exported: {reason}. {_EXPORTED}")
    trained = _trained_features(stages[1])
    if trained != stages[0].order:
        raise ValueError(
            f"the tuner has {trained} features, {stages[0].order} of them from the recording. "
            "Export one that needs the recording alone."
        )
    return tuner


def _trained_features(learner: FeedForward | GBM | Trend) -> int:
    if isinstance(learner, Trend):
        return len(learner.mean)
    if isinstance(learner, FeedForward):
        return int(learner.W1.shape[1])
    return int(learner.models[0].num_features())


def compression(tuner: Any) -> Array:
    """(order, N) that turns the yaw rate of the tuner's own experiment into features."""
    experiment = tuner.task.experiment
    if experiment.register != "same":
        raise ValueError(
            f"register = {experiment.register!r}: every episode has its own command, and the first "
            "stage is no constant matrix. Export with features=True and the compressor's C source."
        )
    u = prbs(experiment.N, experiment.Ts, experiment.bit_time, experiment.amplitude)
    phi = tuner.stages.compressor.regressors(u, experiment.Ts)[0]
    return np.asarray(np.linalg.solve(phi @ phi.T, phi))


def _learner(graph: Graph, learner: FeedForward | GBM | Trend, X: str) -> str:
    if isinstance(learner, Trend):
        return _trend(graph, learner, X)
    return (
        _network(graph, learner, X)
        if isinstance(learner, FeedForward)
        else _trees(graph, learner, X)
    )


def _trend(graph: Graph, trend: Trend, X: str) -> str:
    """Decorrelated features, their polynomial, and what the rest adds; (episodes, 2)."""
    into, k = graph.constant, trend.matrix.shape[1]
    centred = graph.apply("Sub", X, into(trend.mean))
    inputs = graph.apply("MatMul", centred, into(trend.matrix))
    constant, linear, quadratic = np.split(trend.coefficients, [1, 1 + k])
    values = graph.apply("Gemm", inputs, into(linear), into(constant[0]))
    if trend.degree == 2:
        factors = (
            graph.apply("Gather", inputs, into(i, np.int64), axis=1) for i in np.triu_indices(k)
        )
        products = graph.apply("MatMul", graph.apply("Mul", *factors), into(quadratic))
        values = graph.apply("Add", values, products)
    return graph.apply("Add", values, _learner(graph, trend.rest, inputs))


def _network(graph: Graph, network: FeedForward, X: str) -> str:
    """Scaling, tanh layer, linear layer, scaling; (episodes, 2)."""
    scale, into = 1 / network.inputs.half, graph.constant
    W1 = network.W1 * scale
    b1 = network.b1 - W1 @ network.inputs.middle
    W2 = network.W2 * network.outputs.half[:, None]
    b2 = network.b2 * network.outputs.half + network.outputs.middle
    hidden = graph.apply("Tanh", graph.apply("Gemm", X, into(W1), into(b1), transB=1))
    return graph.apply("Gemm", hidden, into(W2), into(b2), transB=1)


def _trees(graph: Graph, gbm: GBM, X: str) -> str:
    """Boosted trees in single precision, as xgboost has them; (episodes, 2)."""
    from onnx import TensorProto

    single = graph.apply("Cast", X, to=TensorProto.FLOAT)
    sums = graph.apply("TreeEnsembleRegressor", single, domain="ai.onnx.ml", **ensemble(gbm.models))
    scaled = graph.apply(
        "Mul", graph.apply("Cast", sums, to=TensorProto.DOUBLE), graph.constant(gbm.scale)
    )
    return graph.apply("Add", scaled, graph.constant(gbm.mean))


def _decode(graph: Graph, values: str, task: Task, coordinates: str) -> None:
    """Gains and status from predicted targets, as `tuners.coordinates.decode` does it."""
    first, second = (
        graph.apply("Gather", values, graph.constant(i, np.int64), axis=1) for i in (0, 1)
    )
    nan = graph.constant(np.nan)
    ok, limited, unreachable = (graph.constant(int(s), np.int64) for s in Status)
    if coordinates == "gains":
        zero = graph.constant(0.0)
        found = graph.apply("And", *(graph.apply("Greater", v, zero) for v in (first, second)))
        kp, Ti, status = first, second, graph.apply("Where", found, ok, unreachable)
    else:
        found = graph.apply("Greater", second, graph.constant(-np.pi / 2))
        leads = graph.apply("GreaterOrEqual", second, graph.constant(0.0))
        phase = graph.apply("Where", leads, graph.constant(-LEAST_LAG), second)
        kp, Ti = _controller(graph, first, phase, task)
        status = graph.apply("Where", found, graph.apply("Where", leads, limited, ok), unreachable)
    graph.apply("Where", found, kp, nan, output="kp")
    graph.apply("Where", found, Ti, nan, output="Ti")
    graph.apply("Identity", status, output="status")


def _controller(graph: Graph, log_magnitude: str, phase: str, task: Task) -> tuple[str, str]:
    """`yawrate_env.controller.gains` in a graph, with the sine and cosine of the phase."""
    target = task.target
    omega = graph.constant(2 / target.Ts * np.tan(target.omega_c * target.Ts / 2))
    magnitude, cos = graph.apply("Exp", log_magnitude), graph.apply("Cos", phase)
    tangent = graph.apply("Neg", graph.apply("Div", graph.apply("Sin", phase), cos))
    if target.controller == "pi":
        kp = graph.apply("Mul", magnitude, cos)
        return kp, graph.apply("Reciprocal", graph.apply("Mul", tangent, omega))
    return graph.apply("Div", magnitude, cos), graph.apply("Div", tangent, omega)
