"""Trained learners as parts of ONNX graphs; each returns the name of its (episodes, targets)."""

import numpy as np

from tuners.export.graph import Graph
from tuners.export.trees import ensemble
from tuners.learners.actor import LIMIT, Agent
from tuners.learners.feedforward import FeedForward
from tuners.learners.gbm import GBM
from tuners.learners.polynomial import Polynomial, monomials


def polynomial(graph: Graph, found: Polynomial, X: str) -> tuple[str, str]:
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


def network(graph: Graph, network: FeedForward, X: str) -> str:
    """Scaling, tanh layer, linear layer, scaling; (episodes, targets)."""
    scale, into = 1 / network.inputs.half, graph.constant
    W1 = network.W1 * scale
    b1 = network.b1 - W1 @ network.inputs.middle
    W2 = network.W2 * network.outputs.half[:, None]
    b2 = network.b2 * network.outputs.half + network.outputs.middle
    hidden = graph.apply("Tanh", graph.apply("Gemm", X, into(W1), into(b1), transB=1))
    return graph.apply("Gemm", hidden, into(W2), into(b2), transB=1)


def agent(graph: Graph, agent: Agent, X: str) -> str:
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


def trees(graph: Graph, gbm: GBM, X: str) -> str:
    """Boosted trees in single precision, as xgboost has them; (episodes, targets)."""
    from onnx import TensorProto

    single = graph.apply("Cast", X, to=TensorProto.FLOAT)
    sums = graph.apply("TreeEnsembleRegressor", single, domain="ai.onnx.ml", **ensemble(gbm.models))
    scaled = graph.apply(
        "Mul", graph.apply("Cast", sums, to=TensorProto.DOUBLE), graph.constant(gbm.scale)
    )
    return graph.apply("Add", scaled, graph.constant(gbm.mean))
