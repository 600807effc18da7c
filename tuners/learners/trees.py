"""Check boosted trees before xgboost reads them: it follows children and features blindly."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.learners.ubjson import decoded
from yawrate_env import validation

Array = NDArray[np.float64]

_FLOATS = "base_weights", "loss_changes", "split_conditions", "sum_hessian"
_OTHERS = "default_left", "left_children", "parents", "right_children", "split_indices"
_CATEGORIES = "categories", "categories_nodes", "categories_segments", "categories_sizes"
_LEAF = -1


def check_booster(name: str, content: bytes) -> int:
    """Number of features of a model in xgboost's universal binary JSON.

    ``ValueError`` that begins with `name` for other than trees for one target, each of numbers
    only, whose every node but the root is the child of one that comes before it.
    """
    try:
        model = decoded(content)
        learner = model["learner"]
        booster, about = learner["gradient_booster"], learner["learner_model_param"]
        _same("name", booster["name"], "gbtree")
        _same("objective", learner["objective"]["name"], "reg:squarederror")
        _same("num_class", int(about["num_class"]), 0)
        _same("num_target", int(about["num_target"]), 1)
        features = validation.count("num_feature", int(about["num_feature"]))
        validation.number("base_score", float(about["base_score"].strip("[]")))
        _check_trees(booster["model"], features)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{name} is no model of xgboost: {error}.") from None
    return features


def _check_trees(forest: dict[str, Any], features: int) -> None:
    trees, about = forest["trees"], forest["gbtree_model_param"]
    count = len(trees)
    _same("num_trees", int(about["num_trees"]), count)
    _same("num_parallel_tree", int(about["num_parallel_tree"]), 1)
    _same("tree_info", _values(forest, "tree_info", count), [0] * count)
    steps = _values(forest, "iteration_indptr", count + 1)
    _same("iteration_indptr", steps, list(range(count + 1)))
    categories = forest.get("cats", {})
    _same("cats", [name for name, values in categories.items() if len(values)], [])
    sizes = np.array([validation.count("num_nodes", _about(t, "num_nodes")) for t in trees])
    for name, expected in (("num_feature", features), ("num_deleted", 0), ("size_leaf_vector", 1)):
        _same(name, {_about(tree, name) for tree in trees}, {expected})
    for name in _CATEGORIES:
        _same(name, sum(len(tree[name]) for tree in trees), 0)
    for name in _FLOATS:
        _joined(trees, name, sizes)
    _same("split_type", bool(_joined(trees, "split_type", sizes).any()), False)
    _check_nodes({name: _joined(trees, name, sizes) for name in _OTHERS}, sizes, features)


def _check_nodes(nodes: dict[str, Array], sizes: NDArray[np.int64], features: int) -> None:
    """``ValueError`` unless the nodes of trees of these sizes, one after the other, are trees."""
    ends = sizes.cumsum()
    first = np.repeat(ends - sizes, sizes)
    left, right = nodes["left_children"], nodes["right_children"]
    leaf = left == _LEAF
    if (right[leaf] != _LEAF).any():
        raise ValueError("a node has one child.")
    inner = np.flatnonzero(~leaf)
    above = np.tile(inner, 2)
    children = np.concatenate([left[inner], right[inner]]) + first[above]
    root = np.zeros(len(first), dtype=np.bool_)
    root[ends - sizes] = True
    if not np.array_equal(np.sort(children), np.flatnonzero(~root)):
        raise ValueError("the nodes are not each the child of one other.")
    later = (children > above) & (children < np.repeat(ends, sizes)[above])
    children = children.astype(np.int64)
    if not later.all() or (nodes["parents"][children] + first[children] != above).any():
        raise ValueError("a node comes before its parent, or names another.")
    split = nodes["split_indices"][inner]
    if not np.isin(split, np.arange(features)).all():
        raise ValueError(f"a split is by a feature that is none of {features}.")


def _about(tree: dict[str, Any], name: str) -> int:
    return int(tree["tree_param"][name])


def _joined(trees: list[dict[str, Any]], name: str, sizes: NDArray[np.int64]) -> Array:
    """Values of all nodes, one tree after the other."""
    values = [tree[name] for tree in trees]
    if [len(part) for part in values] != sizes.tolist():
        raise ValueError(f"{name} has not a value for every node.")
    return validation.finite_array(name, np.concatenate(values), shape=(None,))


def _values(of: dict[str, Any], name: str, count: int) -> list[float]:
    found: list[float] = validation.finite_array(name, of[name], shape=(count,)).tolist()
    return found


def _same(name: str, value: Any, expected: Any) -> None:
    if value != expected:
        raise ValueError(f"{name} = {str(value)[:40]} is not {str(expected)[:40]}.")
