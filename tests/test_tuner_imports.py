"""What importing and using the tuners loads."""

import graphlib

import pytest
from imports import imported_names, modules_after
from recordings import ROOT

MODULES = sorted((ROOT / "tuners").rglob("*.py"))
ROOMS = {path.stem for path in (ROOT / "tuners").iterdir()}
LEARNING = {"torch", "xgboost", "stable_baselines3", "sb3_contrib"}
RECORDED = (
    "import numpy as np, tuners; from yawrate_env.signals.excitation import prbs; "
    "u = prbs(10000, 0.001, 0.1, 0.02)[0]; "
)


def test_imports_point_down_only():
    """Between modules, and between packages as wholes."""
    graph: dict[str, set[str]] = {}
    for path in MODULES:
        own = room(path.relative_to(ROOT).with_suffix("").parts)
        used = (room(name.split(".")) for name in imported_names(path))
        graph.setdefault(own, set()).update(name for name in used if name not in ("", own))
    assert graph["catalogue"] and graph["two_stage"]  # the parser sees the imports
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises on a cycle
    floors = "compressors", "stages", "plants", "yaw_rate", "tuner", "two_stage", "catalogue"
    assert [name for name in order if name in floors] == list(floors)


def room(parts):
    """The module or package of tuners that a dotted name lies in; nothing for others."""
    inside = len(parts) > 1 and parts[0] == "tuners" and parts[1] in ROOMS - {"__init__"}
    return parts[1] if inside else ""


@pytest.mark.parametrize(
    "path", MODULES, ids=lambda path: ".".join(path.relative_to(ROOT).with_suffix("").parts)
)
def test_the_library_knows_no_scripts_and_no_tests(path):
    roots = {name.split(".")[0] for name in imported_names(path)}
    assert not roots & {"scripts", "tests", "recordings", "systems", "pytest"}


def test_importing_the_tuners_is_light():
    loaded = modules_after("import tuners")
    assert {"tuners", "yawrate_env", "numba"} <= loaded
    # SciPy is not in the list: numba imports it to find its BLAS.
    assert not loaded & (LEARNING | {"matplotlib", "control", "tqdm", "PIL", "safetensors"})


def test_a_network_is_used_without_what_trained_it():
    loaded = modules_after(RECORDED + "tuners.load('ts-ff').tune(u, u, 0.001)")
    assert "safetensors" in loaded
    assert not loaded & (LEARNING | {"matplotlib", "control"})


def test_trees_are_used_without_the_others():
    loaded = modules_after(RECORDED + "tuners.load('ts-gbm').tune(u, u, 0.001)")
    assert "xgboost" in loaded
    assert not loaded & (LEARNING - {"xgboost"} | {"matplotlib", "control", "sklearn"})


@pytest.mark.parametrize("name", ["gb", "nominal"])
def test_the_untrained_need_no_learning(name):
    loaded = modules_after(RECORDED + f"tuners.load({name!r}).tune(u, u, 0.001)")
    assert not loaded & (LEARNING | {"matplotlib", "control", "safetensors"})
