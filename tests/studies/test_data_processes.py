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


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    return contents(made(tmp_path_factory.mktemp("undisturbed") / "data").path)


@pytest.fixture
def own_module(tmp_path):
    """A plant in a module that only its folder has; the TOML file beside it."""
    folder = tmp_path / "mine"
    folder.mkdir()
    lines = "from first_order import described", 'plant = described(entry="my_plant:plant")'
    (folder / "my_plant.py").write_text("\n".join(lines))
    (folder / "my.toml").write_text('[plant]\nentry = "my_plant:plant"\n')
    before = list(sys.path)
    yield folder
    sys.modules.pop("my_plant", None)
    sys.path[:] = before


def another(folder):
    """A folder with a module of the same name, of another plant."""
    other = folder / "other"
    other.mkdir()
    prior = '{"K": (2.0, 3.0), "T": (0.2, 1.0)}'
    plant = f'plant = described(prior={prior}, entry="my_plant:plant")'
    (other / "my_plant.py").write_text(f"from first_order import described\n{plant}")
    return other


def test_processes_make_the_same_bytes(tmp_path, undisturbed):
    made(tmp_path / "data", count=2)
    assert contents(tmp_path / "data") == undisturbed


KILLED = """
import os, signal, sys, time
import numpy as np
from data_sets import made

out, seed = sys.argv[1], int(sys.argv[2])
made(out + "-first")  # compiles
start = time.perf_counter()
made(out + "-timed")
seconds = time.perf_counter() - start
for moment in np.random.default_rng(seed).uniform(0, seconds / 2, 10):
    child = os.fork()
    if child == 0:
        made(out)
        os._exit(0)
    time.sleep(moment)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    print(sum(name.startswith("shard") for name in os.listdir(out)))
"""


def test_killed_ten_times_at_random(tmp_path, undisturbed):
    program = [sys.executable, "-c", KILLED, tmp_path / "data", "0"]
    done = subprocess.run(
        program, env=environment(), check=True, capture_output=True, text=True, timeout=120
    )
    finished = [int(count) for count in done.stdout.split()]
    assert len(finished) == 10 and finished[-1] > finished[0]  # some were killed half-way
    made(tmp_path / "data")
    assert contents(tmp_path / "data") == undisturbed


GROWN = """
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


old, fresh, out = map(Path, sys.argv[1:])
made(old, 110)
made(fresh, 170)
kills = 0
while True:
    shutil.copytree(old, out)
    child = os.fork()
    if child == 0:
        until(iter(range(kills)))
        made(out, 170)
        os._exit(0)
    if os.waitpid(child, 0)[1] != signal.SIGKILL:
        break
    kills += 1
    try:
        print(len(verify(out)))
    except DatasetError as error:
        assert "lacks" in str(error) and "it goes on from there" in str(error), error
        print("unfinished")
    made(out, 170)
    assert contents(out) == contents(fresh)
    shutil.rmtree(out)
assert contents(out) == contents(fresh)
"""


def test_killed_at_every_step_of_growing(tmp_path):
    program = [sys.executable, "-c", GROWN, *(tmp_path / name for name in ("old", "fresh", "out"))]
    done = subprocess.run(
        program, env=environment(), check=True, capture_output=True, text=True, timeout=120
    )
    found = done.stdout.split()
    # Five files, each fsynced, renamed and its folder fsynced; after the first it is another's.
    assert found == ["110"] * 2 + ["unfinished"] * 12 + ["170"]


def test_a_worker_that_is_killed_ends_the_run_and_loses_nothing(tmp_path, undisturbed):
    def kill(what, done, of):
        if done:
            for process in psutil.Process().children():
                with suppress(psutil.NoSuchProcess):  # it was killed before
                    if any("LokyProcess" in word for word in process.cmdline()):
                        process.kill()

    with pytest.raises(DatasetError, match="A worker died.*what is finished stays"):
        made(tmp_path / "data", count=2, progress=kill)
    assert 0 < len(Manifest.read(tmp_path / "data").shards) < 6
    made(tmp_path / "data")
    assert contents(tmp_path / "data") == undisturbed


@contextmanager
def cluster(folder, **where):
    """A scheduler and two workers as processes of their own: its address, and the workers."""
    address = folder / "scheduler.json"
    python = [sys.executable, "-m"]
    options = {"env": environment(), "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    options |= where
    program = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    program += ["--no-dashboard", "--scheduler-file", address]
    started = [subprocess.Popen([*python, *program], **options)]
    try:
        while not address.exists():
            time.sleep(0.05)
        program = ["distributed.cli.dask_worker", "--scheduler-file", address, "--no-dashboard"]
        program += ["--nthreads", "1", "--no-nanny", "--local-directory", folder]
        started += [subprocess.Popen([*python, *program], **options) for _ in range(2)]
        yield json.loads(address.read_text())["address"], started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


def test_a_cluster_makes_the_same_bytes_even_when_a_worker_is_killed(tmp_path):
    progress = []

    def kill(what, done, of):
        progress.append(done)
        if len(progress) == 4:
            processes[0].send_signal(signal.SIGKILL)

    with cluster(tmp_path) as (scheduler, processes):
        made(tmp_path / "cluster", 3000, scheduler=scheduler, progress=kill)
        assert [process.poll() for process in processes] == [-signal.SIGKILL, None]
    assert progress[-1] == 3000 and len(progress) == 61
    made(tmp_path / "here", 3000)
    assert contents(tmp_path / "cluster") == contents(tmp_path / "here")


def test_processes_find_the_module_where_it_is(own_module):
    folder = own_module / "elsewhere" / "data"
    options = {"--episodes": 100, "--seed": 3, "--shard-size": SHARD, "--workers": 2}
    options |= {"--out": folder, "--vehicle": own_module / "my.toml", "--scheduler": "local"}
    words = [str(word) for option in options.items() for word in option]
    program = "from tuners.cli import main; main()"
    subprocess.run(
        [sys.executable, "-c", program, "dataset", *words],
        cwd=own_module.parent, env=environment(), check=True, capture_output=True, timeout=100,
    )  # fmt: skip
    found = Folder(folder, find("my_plant:plant", own_module))
    expected = examples(plant, 100, 3, found.recipe.features)
    np.testing.assert_array_equal(found.read().features, expected.features)


def test_a_cluster_that_was_started_elsewhere(own_module, tmp_path):
    """Its workers find the module by its folder; on another machine, their own or none."""
    own, apart = find("my_plant:plant", own_module), tmp_path / "apart"
    apart.mkdir()
    with cluster(apart, cwd=apart) as (scheduler, _):
        made(tmp_path / "data", 100, of=own, scheduler=scheduler)
    made(tmp_path / "here", 100, of=own)
    assert contents(tmp_path / "data") == contents(tmp_path / "here")
    own_module.rename(tmp_path / "not here")
    apart = another(tmp_path)
    for at, why in ((tmp_path / "apart", "no module 'my_plant'"), (apart, "not of the my_plant")):
        (at / "scheduler.json").unlink(missing_ok=True)
        with cluster(at, cwd=at) as (scheduler, _):
            with pytest.raises(DatasetError, match=f"A worker: .*{why}.*the same module"):
                made(tmp_path / "refused", 100, of=own, scheduler=scheduler)
            assert not (tmp_path / "refused").exists()


def test_a_cluster_without_this_package_is_refused(tmp_path):
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['tuners'] = None")
    hidden = environment()
    hidden["PYTHONPATH"] = f"{tmp_path}:{hidden['PYTHONPATH']}"
    with (
        cluster(tmp_path, env=hidden) as (scheduler, _),
        pytest.raises(DatasetError, match="not installed where the scheduler, tcp://.* runs"),
    ):
        made(tmp_path / "data", 100, scheduler=scheduler)
    assert not (tmp_path / "data").exists()
