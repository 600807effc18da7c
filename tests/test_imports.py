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
MODULES = sorted((ROOT / "yawrate_env").rglob("*.py"))


def dotted(path):
    """Name of a module within the package, such as ``nonlinear.tyre``."""
    parts = path.relative_to(ROOT / "yawrate_env").with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


def imported_names(path):
    """Dotted names of all imports of a file, those inside functions too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import in {path.name}, line {node.lineno}"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


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
    assert (
        graph["env"] and graph["vehicle"] and "nonlinear.tyre" in graph["nonlinear.vehicle"]
    )  # the parser sees the imports
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises on a cycle
    assert order.index("vehicle") < order.index("env") < order.index("vector_env")


@pytest.mark.parametrize("path", MODULES, ids=dotted)
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


@pytest.mark.parametrize("name", [yawrate_env.ENV_ID, yawrate_env.NONLINEAR_ID])
def test_an_episode_needs_no_learning_and_no_plotting(name):
    loaded = modules_after(
        f"import gymnasium, yawrate_env; e = gymnasium.make({name!r}, N=500); "
        "e.reset(seed=0); e.step(e.action_space.sample())"
    )
    assert "numba" in loaded
    learning = {"tuners", "torch", "xgboost", "stable_baselines3", "sb3_contrib"}
    assert not loaded & (learning | {"matplotlib", "control"})


def test_version_is_the_distributions():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == yawrate_env.__version__
    assert (ROOT / "yawrate_env" / "py.typed").exists()
