"""Build ONNX graphs: ``onnx.helper`` with automatic names and constants in double precision."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

OPSET, ML_OPSET, IR_VERSION = 17, 3, 9


class Graph:
    """Nodes and constants of an ONNX graph."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: ArrayLike, dtype: Any = np.float64) -> str:
        """Name of a new initializer."""
        from onnx import numpy_helper

        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value, dtype), name))
        return name

    def apply(self, operator: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        """Add a node; name of its output."""
        from onnx import helper

        output = output or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, list(inputs), [output], **attributes))
        return output

    def joined(self, *columns: str) -> str:
        """Tensors (episodes, n) side by side."""
        return columns[0] if len(columns) == 1 else self.apply("Concat", *columns, axis=1)

    def model(
        self,
        inputs: dict[str, list[Any]],
        outputs: Mapping[str, int],
        texts: dict[str, str],
        description: str,
    ) -> Any:
        """The checked ``onnx.ModelProto``.

        Parameters
        ----------
        inputs : dict
            Name and shape of double tensors.
        outputs : dict
            Name and element type of vectors, one number an episode.
        texts : dict
            Metadata.
        """
        from onnx import TensorProto, checker, helper

        import yawrate_env

        self._check_names(list(inputs))
        graph = helper.make_graph(
            self.nodes,
            "yawrate",
            [helper.make_tensor_value_info(n, TensorProto.DOUBLE, s) for n, s in inputs.items()],
            [helper.make_tensor_value_info(n, t, ["episodes"]) for n, t in outputs.items()],
            self.constants,
        )
        domains = {node.domain for node in self.nodes}
        opsets = [helper.make_opsetid("", OPSET)]
        if "ai.onnx.ml" in domains:
            opsets.append(helper.make_opsetid("ai.onnx.ml", ML_OPSET))
        model = helper.make_model(
            graph,
            opset_imports=opsets,
            ir_version=IR_VERSION,
            producer_name="yawrate",
            producer_version=yawrate_env.__version__,
            doc_string=description,
        )
        helper.set_model_props(model, texts)
        checker.check_model(model)
        return model

    def _check_names(self, inputs: list[str]) -> None:
        """``ValueError`` where one name would stand for two tensors."""
        made = [name for node in self.nodes for name in node.output]
        names = Counter([*inputs, *made, *(constant.name for constant in self.constants)])
        if twice := [name for name, times in names.items() if times > 1]:
            raise ValueError(
                f"{twice[0]!r} would name two tensors of the graph. Rename the plant's signal, "
                "parameter or gain."
            )
