"""What imports what, what importing loads, and what is in the distribution."""

import graphlib
import subprocess
import sys
import tomllib

import pytest
from imports import imported_names, modules_after
from recordings import ROOT

import yawrate_env
from tuners.cli import COMMANDS, main

FILES = sorted(p for name in ("yawrate_env", "tuners") for p in (ROOT / name).rglob("*.py"))
FLOORS = {
    "yawrate_env": ("signals", "loop", "plant", "plants", "vehicle", "env"),
    "tuners": (
        "features",
        "learners",
        "trust",
        "tuner",
        "recalibration",
        "agents",
        "data",
        "logs",
        "export",
        "cli",
        "app",
    ),
}
METHOD = "features", "learners", "trust", "tuner"
HEAVY = {"matplotlib", "control", "pandas", "pint", "msgspec"}
LEARNING = {"torch", "xgboost", "stable_baselines3", "sb3_contrib"}
RECORDED = (
    "import numpy as np, tuners; from yawrate_env.signals.excitation import prbs; "
    "u = prbs(10000, 0.001, 0.1, 0.02)[0]; "
)


def dotted(path):
    """Name of a module, such as ``yawrate_env.vehicle.task``."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


NAMES = {dotted(path) for path in FILES}


def imported_modules(path):
    """Modules of both packages that a file imports: the longest name that is one."""
    for name in imported_names(path):
        while name:
            if name in NAMES:
                yield name
                break
            name = name.rpartition(".")[0]


GRAPH = {dotted(path): set(imported_modules(path)) for path in FILES}


def floor(name):
    """Package and folder (or module) in it that a dotted name lies in."""
    return ".".join(name.split(".")[:2])


def test_no_module_imports_itself_round_a_corner():
    assert GRAPH["yawrate_env.env.yaw_rate_env"] and GRAPH["tuners.tuner.tuner"]  # they are seen
    list(graphlib.TopologicalSorter(GRAPH).static_order())  # raises on a cycle


@pytest.mark.parametrize("package", FLOORS)
def test_imports_of_folders_point_down(package):
    order = [f"{package}.{name}" for name in FLOORS[package]]
    for name, used in GRAPH.items():
        if floor(name) in order:
            above = order[order.index(floor(name)) + 1 :]
            assert not {floor(u) for u in used} & set(above), name


def test_folders_make_no_cycle():
    graph = {}
    for name, used in GRAPH.items():
        graph.setdefault(floor(name), set()).update(floor(u) for u in used)
    # The packages' own `__init__` gathers names from everywhere.
    for name, used in graph.items():
        used -= {name, "tuners", "yawrate_env"}
    list(graphlib.TopologicalSorter(graph).static_order())


def test_the_method_knows_no_vehicle_and_no_environment():
    for name, used in GRAPH.items():
        if name.split(".")[:1] == ["tuners"] and floor(name).partition(".")[2] in METHOD:
            for other in used:
                assert not other.startswith(("yawrate_env.vehicle", "yawrate_env.env")), name
                assert "vehicle" not in other and "yaw_rate." not in other.partition(".")[2], name


@pytest.mark.parametrize("package, never", [
    ("yawrate_env", {"tuners", "scripts", "tests", "pytest", *LEARNING}),
    ("tuners", {"scripts", "studies", "benchmarks", "tests", "recordings", "systems", "pytest"}),
])  # fmt: skip
def test_packages_know_nothing_above_them(package, never):
    for path in FILES:
        if dotted(path).split(".")[0] == package:
            assert not {name.split(".")[0] for name in imported_names(path)} & never, path


def test_importing_the_environment_is_light():
    loaded = modules_after("import yawrate_env")
    assert {"yawrate_env", "gymnasium"} <= loaded
    assert not loaded & (LEARNING | HEAVY | {"tuners", "scipy", "numba"})


def test_importing_the_tuners_is_light():
    heavy = LEARNING | HEAVY | {"tqdm", "PIL", "safetensors"}
    assert not modules_after("import tuners") & (heavy | {"numba", "numpy", "gymnasium"})
    loaded = modules_after("import tuners; tuners.load")
    assert {"tuners", "yawrate_env", "numba"} <= loaded
    # SciPy is not in the list: numba imports it to find its BLAS.
    assert not loaded & heavy


def test_the_commands_help_imports_no_arrays():
    program = "from tuners.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass"
    silent = "import sys, io; sys.stdout = io.StringIO()"
    loaded = modules_after(f"{silent}; exec({program!r}); sys.stdout = sys.__stdout__")
    assert "click" in loaded and not loaded & {"numpy", "numba", "gymnasium", "scipy"}


def test_the_list_of_commands_says_what_each_one_says():
    listed = {name: main.get_command(None, name).get_short_help_str(200) for name in COMMANDS}
    for name, words in COMMANDS.items():
        assert listed[name].startswith(words.rstrip(".")), name


def test_an_episode_needs_no_learning_and_no_plotting():
    loaded = modules_after(
        "import sys; sys.path.insert(0, 'tests'); import gymnasium, yawrate_env as y\n"
        "for id, settings in ((y.ENV_ID, {'N': 500}), (y.NONLINEAR_ID, {'N': 500}), "
        "(y.PLANT_ID, {'plant': 'first_order:plant'})):\n"
        "    e = gymnasium.make(id, **settings)\n    e.reset(seed=0)\n"
        "    e.step(e.action_space.sample())\n"
        "pass"
    )
    assert "numba" in loaded
    assert not loaded & (LEARNING | {"tuners", "matplotlib", "control"})


def test_import_registers_every_environment_once():
    program = (
        "import importlib, gymnasium; gymnasium.make('yawrate_env:yawrate/PITuning-v0'); "
        "import yawrate_env; importlib.reload(yawrate_env); "
        "gymnasium.make('yawrate/PITuningNonlinear-v0'); "
        "import tuners; gymnasium.spec('yawrate/PITuningFeatures-v0')"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=ROOT, check=True)
    ids = {name for name in vars(yawrate_env) if name.endswith("_ID")}
    assert {getattr(yawrate_env, name) for name in ids} == {
        "yawrate/PITuning-v0",
        "yawrate/PITuningNonlinear-v0",
        "yawrate/PITuningFeatures-v0",
        "yawrate/Plant-v0",
        "yawrate/PlantFeatures-v0",
        "yawrate/PIRecalibration-v0",
    }


@pytest.mark.parametrize(
    "names, needs, never",
    [
        (("gb",), set(), {"safetensors", "xgboost"}),
        (("ts-ff", "rl"), {"safetensors"}, {"xgboost", "cloudpickle"}),
        (("ts-gbm",), {"xgboost"}, set()),
    ],
)
def test_a_tuner_is_used_without_what_trained_it(names, needs, never):
    missing = "import sys; sys.modules['sklearn'] = None; "  # xgboost imports it where it is there
    tuned = f"[tuners.load(n).tune(u, u, 0.001) for n in {names!r}]"
    loaded = modules_after(missing + RECORDED + tuned)
    assert needs <= loaded
    assert not loaded & (never | LEARNING - {"xgboost"} | {"matplotlib", "control"})


POSIX = {
    *("crypt", "curses", "fcntl", "grp", "nis", "posix", "pty", "pwd", "readline", "resource"),
    *("spwd", "syslog", "termios", "tty"),
}


@pytest.mark.parametrize("path", FILES, ids=dotted)
def test_no_module_imports_what_windows_lacks(path):
    assert not {name.partition(".")[0] for name in imported_names(path)} & POSIX


def test_a_log_is_tuned_where_modules_of_posix_are_missing():
    """The standard library's own imports of them come first: they ask which system it is."""
    program = (
        "import asyncio, multiprocessing, shutil, subprocess, sys, tempfile\n"
        f"sys.modules.update(dict.fromkeys({sorted(POSIX)}))\n"
        "from tuners.cli import main\n"
        "main(['tune', 'examples/log.csv'], standalone_mode=False)"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert "USABLE" in done.stdout, done.stderr


def test_version_has_one_place():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["dynamic"] == ["version"]
    place = project["tool"]["setuptools"]["dynamic"]["version"]["attr"]
    assert place == "yawrate_env.__version__"
    assert "version:" not in (ROOT / "CITATION.cff").read_text().replace("cff-version:", "")


def test_both_packages_are_typed():
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    for package in FLOORS:
        assert "py.typed" in data["package-data"][package]
        assert (ROOT / package / "py.typed").exists()
