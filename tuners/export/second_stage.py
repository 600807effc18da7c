"""How learners are written in C and as graphs.

A table has one record for each learner that can be written, under the name by which tuner files
know the learner (`tuners.learners.LEARNERS`).  Exports ask this table, and no class; a learner
knows nothing of other languages.  A learner of one's own has no record and is refused: to export
a further learner, add its record.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from tuners.export import learner_graphs
from tuners.export.graph import Graph
from tuners.learners import known_name
from tuners.learners.polynomial import Polynomial
from tuners.learners.trend import Trend

_INSTEAD = ", the whole tuner to target onnx, or one with a network, such as ts-ff-lag"


@dataclass(frozen=True, slots=True)
class SecondStage:
    """How one kind of learner is written.

    Attributes
    ----------
    graph : callable
        ``graph(graph, learner, X)``: name of the predictions (episodes, targets) in a graph, for
        features (episodes, n) named `X`.
    program : callable
        ``program(learner)``: what the C templates know of it, ``network`` and ``trend``;
        ``ValueError`` where nothing is written in C.
    """

    graph: Callable[[Graph, Any, str], str]
    program: Callable[[Any], dict[str, Any]]


def second_stage(learner: Any) -> SecondStage:
    """How a learner is written; one that raises ``ValueError`` where there is no record of it."""
    return SECOND_STAGES.get(known_name(learner), _FOREIGN)


def _network(learner: Any) -> dict[str, Any]:
    return {"network": learner, "trend": None}


def _trend_graph(graph: Graph, learner: Trend, X: str) -> str:
    inputs, trend = learner_graphs.polynomial(graph, learner.polynomial, X)
    rest = second_stage(learner.rest).graph(graph, learner.rest, inputs)
    return graph.apply("Add", trend, rest)


def _trend(learner: Trend) -> dict[str, Any]:
    return second_stage(learner.rest).program(learner.rest) | {"trend": learner.polynomial}


def _polynomial_graph(graph: Graph, learner: Polynomial, X: str) -> str:
    return learner_graphs.polynomial(graph, learner, X)[1]


def _foreign_graph(graph: Graph, learner: Any, X: str) -> str:
    raise ValueError(
        f"the tuner's learner is a {type(learner).__name__}, which no graph is written for. Export "
        "one with a network or boosted trees, or use the tuner in Python."
    )


def _not_in_c(learner: Any, what: str = "", instead: str = _INSTEAD) -> dict[str, Any]:
    what = what or f"learner, a {type(learner).__name__},"
    raise ValueError(
        f"the tuner's {what} cannot be written in C. Export its first stage alone with "
        f"features=True (--features){instead}."
    )


_FOREIGN = SecondStage(_foreign_graph, partial(_not_in_c, instead=""))

SECOND_STAGES = {
    "feedforward": SecondStage(learner_graphs.network, _network),
    "trend": SecondStage(_trend_graph, _trend),
    "polynomial": SecondStage(_polynomial_graph, partial(_not_in_c, what="polynomial")),
    "gbm": SecondStage(
        learner_graphs.trees, partial(_not_in_c, what="boosted trees, thousands of nodes each")
    ),
    "agent": SecondStage(learner_graphs.agent, partial(_not_in_c, what="agent")),
}
"""By the name of the learner in tuner files."""
