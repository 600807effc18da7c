"""How first stages on Laguerre functions are written in C and as graphs.

A table has one record for each stage that can be written, under the name by which tuner files
know the stage (`tuners.features.FEATURES`).  Exports ask this table, and no class; a stage knows
nothing of other languages.  Whatever is not in the table, such as a stage of one's own, is not
exported: to export a further stage, add its record.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from tuners.export.graph import Graph
from tuners.features import Features, known_name
from tuners.features.laguerre import Laguerre, lifted
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse

Array = NDArray[np.float64]


class OnLaguerre(Protocol):
    """A stage that begins with the sums of Laguerre functions."""

    @property
    def order(self) -> int:
        """Number of functions."""

    @property
    def pole(self) -> float:
        """Their common pole [rad/s]."""

    @property
    def width(self) -> int:
        """Number of features."""

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, n) of recordings, and where they are usable."""


@dataclass(frozen=True, slots=True)
class FirstStage:
    """How one kind of stage is written.

    Attributes
    ----------
    solve : str
        Template that makes features of the normal equations.
    description : str
        Of the features.
    counts : callable
        ``counts(stage, n)``: numbers of equations that are solved, of constants of the template,
        and of samples that a recording must have, for n functions of all inputs.
    constants : callable
        ``constants(stage, Ts)``: what the template knows beside the stage.
    several : bool
        Whether it is written for several inputs and outputs, too.
    graph : callable
        ``graph(graph, stage, output, phi, Ts)``: name of the features (episodes, n) in a graph;
        `output` names (episodes, N) outputs, and phi (order, N) are the filtered inputs.
    """

    solve: str
    description: str
    counts: Callable[[Any, int], tuple[int, int, int]]
    constants: Callable[[Any, float], dict[str, Any]]
    graph: Callable[[Graph, Any, str, Array, float], str]
    several: bool = False


def can_be_written(stage: Features) -> TypeGuard[OnLaguerre]:
    """Whether there is a record of this stage."""
    return known_name(stage) in FIRST_STAGES


def first_stage(stage: OnLaguerre) -> FirstStage:
    """How a stage that can be written is written."""
    return FIRST_STAGES[known_name(stage)]


def _nothing(stage: OnLaguerre, Ts: float) -> dict[str, Any]:
    return {}


def _of_coefficients(stage: Laguerre, n: int) -> tuple[int, int, int]:
    return n, 0, 10 * n


def _coefficients(graph: Graph, stage: OnLaguerre, output: str, phi: Array, Ts: float) -> str:
    """Least squares; the features of `Laguerre`, and what a frequency response is made of."""
    solution = np.linalg.solve(lifted(phi @ phi.T), phi)
    return graph.apply("MatMul", output, graph.constant(solution.T))


def _of_components(stage: Regularised, n: int) -> tuple[int, int, int]:
    return stage.width, 1 + n * (1 + stage.width), 2 * n


def _components(graph: Graph, stage: Regularised, output: str, phi: Array, Ts: float) -> str:
    matrix, offset = stage.linear(phi @ phi.T)
    components = graph.apply("MatMul", output, graph.constant((matrix @ phi).T))
    return graph.apply("Sub", components, graph.constant(offset))


def _of_response(stage: FrequencyResponse, n: int) -> tuple[int, int, int]:
    return n, 1 + n * stage.width, 10 * n


def _functions(stage: FrequencyResponse, Ts: float) -> dict[str, Any]:
    return {"functions": stage.functions(Ts), "turn": 2 * np.pi}


def _response(graph: Graph, stage: FrequencyResponse, output: str, phi: Array, Ts: float) -> str:
    """Log magnitude and unwrapped phase of Laguerre models; (episodes, 2 points)."""
    coefficients, functions = _coefficients(graph, stage, output, phi, Ts), stage.functions(Ts)
    into, points = graph.constant, stage.points
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


FIRST_STAGES = {
    "laguerre": FirstStage(
        "coefficients.c", "Coefficients", _of_coefficients, _nothing, _coefficients, several=True
    ),
    "regularised": FirstStage(
        "components.c", "Principal components of coefficients", _of_components, _nothing,
        _components,
    ),
    "response": FirstStage(
        "response.c", "Log magnitude and phase [rad]", _of_response, _functions, _response
    ),
}  # fmt: skip
"""By the name of the stage in tuner files."""
