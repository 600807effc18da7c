"""Data sets made by several processes and machines, and killed at every moment."""

import json
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import numpy as np
import psutil
import pytest
from data_sets import SHARD, contents, environment, made
from first_order import plant

from tuners.data import DatasetError, Folder
from tuners.data.manifest import Manifest
from tuners.tuner.examples import examples
from yawrate_env.plant.entry import find

pytestmark = pytest.mark.slow

PLANT = """
from first_order import described
plant = described({}entry="my_plant:plant")
"""


@pytest.fixture
def own_module(tmp_path):
    """A plant in a module that only its folder has; the TOML file beside it."""
    folder, before = tmp_path / "mine", list(sys.path)
    folder.mkdir()
    (folder / "my_plant.py").write_text(PLANT.format(""))
    (folder / "my.toml").write_text('[plant]\nentry = "my_plant:plant"\n')
    yield folder
    sys.modules.pop("my_plant", None)
    sys.path[:] = before


KILLED = """
import os, shutil, signal, sys
from pathlib import Path
from data_sets import contents, made
from tuners.data import DatasetError, verify


def until(steps):
    "Let this process be killed instead of changing the disk once more."
    def counted(function):
        def step(*arguments):
            if next(steps, None) is None:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments)
        return step
    os.fsync, os.replace = counted(os.fsync), counted(os.replace)


def killed_everywhere(old, fresh, episodes):
    "Kill a run before each of its steps; what is left goes on to the same end."
    kills, expected = 0, contents(fresh)
    while True:
        out = fresh.parent / f"{fresh.name}-{kills}"
        if old:
            shutil.copytree(old, out)
        child = os.fork()
        if child == 0:
            until(iter(range(kills)))
            made(out, episodes)
            os._exit(0)
        if os.waitpid(child, 0)[1] != signal.SIGKILL:
            break
        kills += 1
        try:
            print(len(verify(out)))
        except DatasetError as error:
            print("unfinished" if "it goes on from there" in str(error) else "nothing")
        made(out, episodes)
        assert contents(out) == expected
    assert contents(out) == expected


small, large = map(Path, sys.argv[1:])
made(small, 60)
made(large, 110)
killed_everywhere(None, small, 60)
killed_everywhere(small, large, 110)
"""


@pytest.mark.slow
def test_killed_at_every_step_of_starting_and_of_growing(tmp_path):
    program = [sys.executable, "-c", KILLED, tmp_path / "small", tmp_path / "large"]
    done = subprocess.run(
        program, env=environment(), check=True, capture_output=True, text=True, timeout=120
    )
    # Five files each time, each fsynced, renamed and its folder fsynced.
    begun = ["nothing"] * 2 + ["unfinished"] * 12 + ["60"]
    grown = ["60"] * 2 + ["unfinished"] * 12 + ["110"]  # after the first file it is another's
    assert done.stdout.split() == begun + grown


def test_processes_make_the_same_bytes_even_when_one_is_killed(tmp_path):
    def kill(what, done, of):
        if done:
            for process in psutil.Process().children():
                with suppress(psutil.NoSuchProcess):  # it was killed before
                    if any("LokyProcess" in word for word in process.cmdline()):
                        process.kill()

    made(tmp_path / "here", 400)
    with pytest.raises(DatasetError, match="A worker died.*what is finished stays"):
        made(tmp_path / "data", 400, count=2, progress=kill)
    assert 0 < len(Manifest.read(tmp_path / "data").shards) < 8
    made(tmp_path / "data", 400)
    assert contents(tmp_path / "data") == contents(tmp_path / "here")


@contextmanager
def python(count, module, *options, **where):
    """Processes that run a module until they are no longer needed."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    program = [sys.executable, "-m", f"distributed.cli.{module}", "--no-dashboard", *options]
    settings = {"env": environment()} | quiet | where
    started = [subprocess.Popen(program, **settings) for _ in range(count)]
    try:
        yield started
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """The file that tells workers where it is."""
    file = tmp_path_factory.mktemp("scheduler") / "scheduler.json"
    with python(1, "dask_scheduler", "--host", "127.0.0.1", "--port", "0",
                "--scheduler-file", file):  # fmt: skip
        while not file.exists():
            time.sleep(0.05)
        yield file


def dask_workers(count, scheduler, folder, **where):
    options = "--nthreads", "1", "--no-nanny", "--local-directory", folder
    return python(count, "dask_worker", "--scheduler-file", scheduler, *options, **where)


def address(scheduler):
    return json.loads(scheduler.read_text())["address"]


@pytest.mark.slow
def test_a_cluster_makes_the_same_bytes_even_when_a_worker_is_killed(scheduler, tmp_path):
    progress = []

    def kill(what, done, of):
        progress.append(done)
        if len(progress) == 4:
            processes[0].send_signal(signal.SIGKILL)

    with dask_workers(2, scheduler, tmp_path) as processes:
        made(tmp_path / "cluster", 1500, scheduler=address(scheduler), progress=kill)
        assert [process.poll() for process in processes] == [-signal.SIGKILL, None]
    assert progress[-1] == 1500 and len(progress) == 31
    made(tmp_path / "here", 1500)
    assert contents(tmp_path / "cluster") == contents(tmp_path / "here")


@pytest.mark.slow
def test_processes_find_the_module_where_it_is(own_module):
    folder = own_module / "elsewhere" / "data"
    options = {"--episodes": 100, "--seed": 3, "--shard-size": SHARD, "--workers": 1}
    options |= {"--out": folder, "--vehicle": own_module / "my.toml", "--scheduler": "local"}
    arguments = [str(part) for option in options.items() for part in option]
    subprocess.run(
        [sys.executable, "-c", "from tuners.cli import main; main()", "dataset", *arguments],
        cwd=own_module.parent, env=environment(), check=True, capture_output=True, timeout=100,
    )  # fmt: skip
    found = Folder(folder, find("my_plant:plant", own_module))
    expected = examples(plant, 100, 3, found.recipe.features)
    np.testing.assert_array_equal(found.read().features, expected.features)


def test_a_cluster_that_was_started_elsewhere(scheduler, own_module, tmp_path):
    """A worker finds the module by its folder, also where another of that name comes first."""
    own, apart = find("my_plant:plant", own_module), tmp_path / "apart"
    apart.mkdir()
    (apart / "my_plant.py").write_text(PLANT.format('prior={"K": (2.0, 3.0), "T": (0.2, 1.0)}, '))
    with dask_workers(1, scheduler, apart, cwd=apart):
        made(tmp_path / "data", 100, of=own, scheduler=address(scheduler))
    made(tmp_path / "here", 100, of=own)
    assert contents(tmp_path / "data") == contents(tmp_path / "here")
    own_module.rename(tmp_path / "not here")
    with (
        dask_workers(1, scheduler, apart, cwd=apart),
        pytest.raises(DatasetError, match="A worker: .*not of the my_plant.*the same module"),
    ):
        made(tmp_path / "refused", 100, of=own, scheduler=address(scheduler))
    assert not (tmp_path / "refused").exists()


def test_a_worker_without_this_package_is_refused(scheduler, tmp_path):
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['tuners'] = None")
    hidden = environment()
    hidden["PYTHONPATH"] = f"{tmp_path}:{hidden['PYTHONPATH']}"
    with (
        dask_workers(1, scheduler, tmp_path, env=hidden),
        pytest.raises(DatasetError, match="not installed where tcp://.* runs"),
    ):
        made(tmp_path / "data", 100, scheduler=address(scheduler))
    assert not (tmp_path / "data").exists()
