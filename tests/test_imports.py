"""What imports what, and what is in the distribution."""

import ast
import graphlib
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import yawrate_env

ROOT = Path(yawrate_env.__file__).parents[1]
MODULES = sorted((ROOT / "yawrate_env").glob("*.py"))


def imported_names(path):
    """Dotted names of all imports of a file, those inside functions too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import in {path.name}, line {node.lineno}"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imported_modules(path):
    """Modules of the package that a file imports."""
    for name in imported_names(path):
        package, *rest = name.split(".")
        if package == "yawrate_env" and rest:
            yield rest[0]


def test_imports_point_down_only():
    names = {path.stem for path in MODULES}
    graph = {path.stem: set(imported_modules(path)) & names for path in MODULES}
    assert graph["env"] and graph["vehicle"]  # the parser sees the imports
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises on a cycle
    assert order.index("vehicle") < order.index("env") < order.index("vector_env")


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_the_environment_knows_nothing_that_learns(path):
    roots = {name.split(".")[0] for name in imported_names(path)}
    assert not roots & {"tuners", "torch", "xgboost", "stable_baselines3", "sb3_contrib", "scripts"}


def modules_after(program):
    listing = "; import sys; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run(
        [sys.executable, "-c", program + listing],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    return set(done.stdout.split())


def test_importing_the_package_is_light():
    loaded = modules_after("import yawrate_env")
    assert {"yawrate_env", "gymnasium"} <= loaded
    heavy = {"torch", "xgboost", "stable_baselines3", "matplotlib", "scipy", "control", "numba"}
    assert not loaded & heavy


def test_an_episode_needs_no_learning_and_no_plotting():
    loaded = modules_after(
        "import gymnasium, yawrate_env; e = gymnasium.make('yawrate/PITuning-v0', N=500); "
        "e.reset(seed=0); e.step(e.action_space.sample())"
    )
    assert "numba" in loaded
    learning = {"tuners", "torch", "xgboost", "stable_baselines3", "sb3_contrib"}
    assert not loaded & (learning | {"matplotlib", "control"})


def test_version_is_the_distributions():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == yawrate_env.__version__
    assert (ROOT / "yawrate_env" / "py.typed").exists()
