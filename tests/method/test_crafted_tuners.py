"""Tuner files with checksums that agree and contents that no tuner has are refused by name."""

import copy
import struct

import numpy as np
import pytest

import tuners
from tuners.catalogue import shipped
from tuners.learners.trees import check_booster
from tuners.learners.ubjson import decoded
from tuners.tuner import tuner_file
from tuners.tuner.tuner_file import TunerFileError, read, write

STAGES = "ts-ff", "ts-ff-lag-vx", "ts-gbm-lag", "rl"


def refuses(path, settings, arrays):
    write(path, settings, arrays)
    with pytest.raises(TunerFileError) as caught:
        tuners.load(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "crafted.tuner"


def damages(array):
    """What an array is not."""
    yield array[..., None]
    yield np.concatenate([array, array])
    yield array[:0]
    if array.dtype.kind == "f":
        for value in (np.nan, np.inf):
            spoilt = array.copy()
            spoilt.flat[-1] = value
            yield spoilt
        yield array.astype("float16")


@pytest.mark.parametrize("name", STAGES)
def test_arrays_of_wrong_shapes_and_numbers(name, booster, path):
    settings, arrays = read(shipped(name))
    small = np.frombuffer(encoded(booster), np.uint8)
    arrays = {k: small if k.endswith(".ubj") else v for k, v in arrays.items()}
    for key, array in arrays.items():
        refuses(path, settings, {k: v for k, v in arrays.items() if k != key})
        for spoilt in damages(array) if array.size > 1 else ():
            refuses(path, settings, {**arrays, key: spoilt})


@pytest.mark.parametrize(
    "change",
    [
        {"features": {"name": "laguerre", "order": 10**9, "pole": 12.0}},
        {"features": {"name": "response", "points": 10**9}},
        {"features": {"name": "armax", "Ts": float("nan")}},
        {"features": {"name": "armax"}, "learner": "gbm"},
        {"features": []},
        {"learner": "pickle"},
        {"parametrisation": None},
        {"calibration": [1.0]},
        {"exact_calibration": [float("nan"), 1.0]},
        {"training": {"hides": 5}},
        {"training": []},
        {"method": "none"},
        {"plant": {}},
    ],
    ids=str,
)
def test_settings_of_other_tuners(change, path):
    settings, arrays = read(shipped("ts-ff-lag"))
    refuses(path, settings | change, arrays)


def test_what_unpacks_to_more_than_any_tuner(path, monkeypatch):
    monkeypatch.setattr(tuner_file, "_LARGEST", 1000)
    refuses(path, {}, {"zeros": np.zeros(1000)})


def encoded(value):
    """Universal binary JSON."""
    match value:
        case dict():
            parts = [_length(key.encode()) + encoded(inner) for key, inner in value.items()]
            return b"{" + b"".join(parts) + b"}"
        case np.ndarray():
            kind = {"f4": b"d", "i4": b"l", "i8": b"L", "u1": b"U"}[value.dtype.str[1:]]
            big = value.astype(value.dtype.newbyteorder(">"))
            return b"[$" + kind + b"#L" + struct.pack(">q", len(value)) + big.tobytes()
        case list():
            return b"[" + b"".join(map(encoded, value)) + b"]"
        case str():
            return b"S" + _length(value.encode())
        case int():
            return b"L" + struct.pack(">q", value)
    raise AssertionError(value)


def _length(text):
    return b"L" + struct.pack(">q", len(text)) + text


@pytest.fixture(scope="module")
def booster():
    """The smallest booster of the package's, five trees of it, and its name."""
    arrays = read(shipped("ts-gbm-lag"))[1]
    found = decoded(arrays["rest.gbm.model0.ubj"].tobytes())
    forest = found["learner"]["gradient_booster"]["model"]
    forest["trees"] = forest["trees"][:5]
    forest["gbtree_model_param"]["num_trees"] = "5"
    forest["tree_info"], forest["iteration_indptr"] = [0] * 5, list(range(6))
    return found


def test_a_booster_is_read_as_xgboost_wrote_it(booster):
    import xgboost

    content = encoded(booster)
    assert check_booster("booster", content) == 8
    model = xgboost.Booster()
    model.load_model(bytearray(content))
    (own,), X = model.get_dump(with_stats=False)[:1], np.linspace(-1, 1, 16).reshape(2, 8)
    assert own.count("leaf") == (booster_tree(booster)["left_children"] == -1).sum()
    assert np.isfinite(model.inplace_predict(X)).all()


def booster_tree(booster, number=0):
    return booster["learner"]["gradient_booster"]["model"]["trees"][number]


def node(name, value, at=-1):
    """Another value of one node of the last tree."""

    def change(booster):
        values = booster_tree(booster, -1)[name] = booster_tree(booster, -1)[name].copy()
        inner = np.flatnonzero(booster_tree(booster, -1)["left_children"] >= 0)
        values[inner[at] if at < 0 else at] = value

    return change


def entry(*keys, value):
    """Another value somewhere in the booster."""

    def change(booster):
        for key in keys[:-1]:
            booster = booster[key]
        booster[keys[-1]] = value

    return change


FOREST = "learner", "gradient_booster", "model"
CRAFTED = {
    "a child beyond the tree": node("left_children", 10**6),
    "a child before the tree": node("right_children", -(10**6)),
    "a cycle": node("left_children", 0),
    "a node that is its own child": node("right_children", 1, at=1),
    "one child": node("right_children", -1),
    "a parent that is another's": node("parents", 3, at=1),
    "a feature beyond the last": node("split_indices", 8),
    "a feature before the first": node("split_indices", -1),
    "a threshold that is no number": node("split_conditions", np.nan),
    "an infinite leaf": node("base_weights", np.inf, at=0),
    "categories": node("split_type", 1),
    "fewer weights than nodes": entry(*FOREST, "trees", 0, "base_weights", value=np.zeros(1, "f4")),
    "a list of texts": entry(*FOREST, "trees", 0, "base_weights", value=["x"]),
    "more trees than there are": entry(*FOREST, "gbtree_model_param", "num_trees", value="6"),
    "another group's tree": entry(*FOREST, "tree_info", value=[7] * 5),
    "other rounds": entry(*FOREST, "iteration_indptr", value=[0, 9, 18, 27, 36, 45]),
    "a linear booster": entry("learner", "gradient_booster", "name", value="gblinear"),
    "another objective": entry("learner", "objective", "name", value="rank:map"),
    "classes": entry("learner", "learner_model_param", "num_class", value="3"),
    "features without end": entry("learner", "learner_model_param", "num_feature", value="1e99"),
    "no features": entry("learner", "learner_model_param", "num_feature", value="0"),
    "a base that is no number": entry("learner", "learner_model_param", "base_score", value="nan"),
    "no learner": entry("learner", value=[]),
    "no trees": entry(*FOREST, "trees", value={}),
}


@pytest.mark.parametrize("change", CRAFTED.values(), ids=CRAFTED)
def test_crafted_boosters_never_reach_xgboost(change, booster, path):
    spoilt = copy.deepcopy(booster)
    change(spoilt)
    settings, arrays = read(shipped("ts-gbm-lag"))
    content = np.frombuffer(encoded(spoilt), np.uint8)
    arrays["rest.gbm.model0.ubj"] = np.frombuffer(encoded(booster), np.uint8)
    with pytest.raises(ValueError, match="booster"):
        check_booster("booster", content.tobytes())
    refuses(path, settings, {**arrays, "rest.gbm.model1.ubj": content})


@pytest.mark.parametrize(
    "content", [b"", b"[", b"{", b"[" * 99, b"[$d#L" + b"\x7f" * 8, b"Zx", b"S"]
)
def test_no_universal_binary_json(content):
    with pytest.raises(ValueError, match="byte"):
        decoded(content)


@pytest.mark.parametrize("seed", range(40))
def test_flipped_bits_are_refused_or_harmless(seed, booster):
    rng, content = np.random.default_rng(seed), bytearray(encoded(booster))
    for at in rng.integers(len(content), size=8):
        content[at] ^= 1 << int(rng.integers(8))
    try:
        check_booster("booster", bytes(content))
    except ValueError as error:
        assert str(error).startswith("booster")
