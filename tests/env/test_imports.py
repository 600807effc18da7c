"""What `yawrate_env` imports, registers and loads."""

import graphlib
import subprocess
import sys
import tomllib

import pytest
from imports import imported_names, modules_after
from recordings import ROOT

import yawrate_env

MODULES = sorted((ROOT / "yawrate_env").rglob("*.py"))
LEARNING = {"tuners", "torch", "xgboost", "stable_baselines3", "sb3_contrib"}
HEAVY = {"matplotlib", "scipy", "control", "numba", "pandas", "pint", "msgspec"}


def dotted(path):
    """Name of a module within the package, such as ``vehicle.nonlinear.tyre``."""
    parts = path.relative_to(ROOT / "yawrate_env").with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


def imported_modules(path):
    """Modules of the package that a file imports: the longest name that is one."""
    names = {dotted(module) for module in MODULES}
    for name in imported_names(path):
        package, *rest = name.split(".")
        while package == "yawrate_env" and rest:
            if (module := ".".join(rest)) in names:
                yield module
                break
            rest.pop()


def test_imports_point_down_only():
    graph = {dotted(path): set(imported_modules(path)) for path in MODULES}
    assert "vehicle.nonlinear.tyre" in graph["vehicle.nonlinear.vehicle"]  # the parser sees them
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises on a cycle
    stairs = ["loop.margins", "plant.plant", "env.interface", "env.vector_env", "env.yaw_rate_env"]
    assert sorted(stairs, key=order.index) == stairs


def test_rooms_import_those_below_only():
    """Signals, loops, plants, vehicles, environments: none imports one that comes after it."""
    rooms = ["signals", "loop", "plant", "vehicle", "env"]
    for path in MODULES:
        room = dotted(path).split(".")[0]
        if room in rooms:
            above = rooms[rooms.index(room) + 1 :]
            found = {module.split(".")[0] for module in imported_modules(path)}
            assert not found & set(above), path


@pytest.mark.parametrize("path", MODULES, ids=dotted)
def test_the_environment_knows_nothing_that_learns(path):
    roots = {name.split(".")[0] for name in imported_names(path)}
    assert not roots & (LEARNING | {"scripts"})


def test_importing_the_package_is_light():
    loaded = modules_after("import yawrate_env")
    assert {"yawrate_env", "gymnasium"} <= loaded and not loaded & (HEAVY | LEARNING)


@pytest.mark.parametrize(
    ("name", "kwargs"),
    [
        (yawrate_env.ENV_ID, "N=500"),
        (yawrate_env.NONLINEAR_ID, "N=500"),
        (yawrate_env.PLANT_ID, "plant='first_order:plant'"),
    ],
)
def test_an_episode_needs_no_learning_and_no_plotting(name, kwargs):
    loaded = modules_after(
        "import sys; sys.path.insert(0, 'tests'); import gymnasium, yawrate_env; "
        f"e = gymnasium.make({name!r}, {kwargs}); e.reset(seed=0); e.step(e.action_space.sample())"
    )
    assert "numba" in loaded and not loaded & (LEARNING | {"matplotlib", "control"})


def test_import_registers_every_environment_once():
    program = (
        "import importlib, gymnasium; gymnasium.make('yawrate_env:yawrate/PITuning-v0'); "
        "import yawrate_env; importlib.reload(yawrate_env); "
        "gymnasium.make('yawrate/PITuningNonlinear-v0')"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=ROOT, check=True)
    ids = {name for name in vars(yawrate_env) if name.endswith("_ID")}
    assert {getattr(yawrate_env, name) for name in ids} == {
        "yawrate/PITuning-v0",
        "yawrate/PITuningNonlinear-v0",
        "yawrate/PITuningFeatures-v0",
        "yawrate/Plant-v0",
        "yawrate/PlantFeatures-v0",
    }


def test_importing_the_tuners_registers_them_too():
    program = "import gymnasium, tuners; gymnasium.spec('yawrate/PITuningFeatures-v0')"
    subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=ROOT, check=True)


def test_version_is_the_distributions():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == yawrate_env.__version__
    assert (ROOT / "yawrate_env" / "py.typed").exists()
