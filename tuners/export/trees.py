"""Boosted trees as an ONNX ``TreeEnsembleRegressor``, read from xgboost's own JSON.

xgboost compares in single precision, ``feature < threshold`` to the left; so does the
operator with ``BRANCH_LT`` and the same thresholds.
"""

import json
from typing import Any

import numpy as np

Attributes = dict[str, Any]


def ensemble(boosters: list[Any]) -> Attributes:
    """Attributes of one operator with an output for every booster."""
    parts: list[dict[str, Any]] = []
    base: list[float] = []
    for target, booster in enumerate(boosters):
        learner = json.loads(bytes(booster.save_raw("json")))["learner"]
        base.append(float(learner["learner_model_param"]["base_score"].strip("[]")))
        trees = learner["gradient_booster"]["model"]["trees"]
        parts += [_tree(tree, len(parts) + i, target) for i, tree in enumerate(trees)]
    joined = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    modes = np.where(joined.pop("leaf"), "LEAF", "BRANCH_LT")
    return {
        **{key: values.tolist() for key, values in joined.items()},
        "nodes_modes": modes.tolist(),
        "n_targets": len(boosters),
        "base_values": base,
        "post_transform": "NONE",
    }


def _tree(tree: dict[str, Any], number: int, target: int) -> dict[str, Any]:
    left = np.asarray(tree["left_children"], dtype=np.int64)
    right = np.asarray(tree["right_children"], dtype=np.int64)
    values = np.asarray(tree["split_conditions"], dtype=np.float32)
    leaf = left < 0
    leaves = np.flatnonzero(leaf)
    return {
        "leaf": leaf,
        "nodes_treeids": np.full(len(left), number),
        "nodes_nodeids": np.arange(len(left)),
        "nodes_featureids": np.where(leaf, 0, np.asarray(tree["split_indices"], dtype=np.int64)),
        "nodes_values": np.where(leaf, np.float32(0), values),
        "nodes_truenodeids": np.where(leaf, 0, left),
        "nodes_falsenodeids": np.where(leaf, 0, right),
        "target_treeids": np.full(len(leaves), number),
        "target_nodeids": leaves,
        "target_ids": np.full(len(leaves), target),
        "target_weights": values[leaves],
    }
