"""Data sets: the same bytes whoever makes them, however often they are interrupted."""

import errno
import json
import os
import resource
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest

from tuners.data import DatasetError, generate, shards, verify, workers
from tuners.data.manifest import Configuration, Manifest, Shard, shard_size
from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from yawrate_env import files
from yawrate_env.loop.design import Status
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import examples
from yawrate_env.plant.parametrisation import loop
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops, record
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

TRAIN = CONTEXT_SETS["train"]
# Short episodes, and a target that some of the vehicles cannot reach.
TASK = Task(experiment=Experiment(Ts=0.01, N=1000), target=Target(55.0, 2.0))
STAGE = Laguerre(order=4)
EPISODES, SHARD = 300, 50


def made(out, episodes=EPISODES, *, task=TASK, stage=STAGE, shard_size=SHARD, count=1, **kwargs):
    sizes = {"shard_size": shard_size, "workers": count}
    return generate(task, TRAIN, stage, episodes, 3, out, **sizes, **kwargs)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return made(tmp_path_factory.mktemp("undisturbed") / "data")


@pytest.fixture(scope="module")
def undisturbed(whole):
    return contents(whole.path)


@pytest.fixture
def partial(tmp_path, undisturbed):
    """The same data set before its last two shards were made."""
    folder = tmp_path / "data"
    folder.mkdir()
    for name, content in undisturbed.items():
        (folder / name).write_bytes(content)
    begun = Manifest.read(folder)
    for shard in begun.shards[-2:]:
        (folder / shard.file).unlink()
    Manifest(begun.configuration, begun.shards[:-2]).write(folder)
    return folder


def assert_same_rows(found, expected):
    for name in expected.__slots__:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize("stage", [Laguerre(), Armax()])
@pytest.mark.parametrize("shard_size", [37, 128, 1000])
def test_rows_are_those_of_the_pipeline_whatever_the_shards(stage, shard_size, tmp_path):
    folder = made(tmp_path / "d", 200, task=Task(), stage=stage, shard_size=shard_size)
    assert_same_rows(folder.read(), examples(yaw_rate(Task()), 200, 3, stage))


def test_a_larger_data_set_begins_with_the_smaller_one(whole):
    smaller = examples(yaw_rate(TASK), 20, 3, STAGE)
    np.testing.assert_array_equal(whole.read().features[:20], smaller.features)
    assert 0 < np.isfinite(whole.read().gains[:, 0]).sum() < EPISODES


@pytest.mark.slow
def test_processes_make_the_same_bytes(tmp_path, undisturbed):
    made(tmp_path / "data", count=2)
    assert contents(tmp_path / "data") == undisturbed


def test_the_order_of_the_work_does_not_matter(tmp_path, undisturbed, monkeypatch):
    def backwards(work, jobs, count, scheduler):
        return ((job, work(job)) for job in jobs[::-1])

    monkeypatch.setattr("tuners.data.workers.results", backwards)
    made(tmp_path / "data")
    assert contents(tmp_path / "data") == undisturbed


def test_what_is_finished_is_not_made_again(partial, undisturbed, monkeypatch):
    calls, shown = [], []
    work = shards.made

    def counted(configuration, shard, home):
        calls.append(shard.first)
        return work(configuration, shard, home)

    monkeypatch.setattr("tuners.data.shards.made", counted)
    made(partial, progress=lambda *call: shown.append(call))
    assert calls == [200, 250]
    assert shown[:4] == [("verifying", done, 4) for done in (1, 2, 3, 4)]
    assert shown[4:] == [("simulating", done, 300) for done in (200, 250, 300)]
    assert contents(partial) == undisturbed
    made(partial)
    assert calls == [200, 250]


def test_a_shard_that_was_deleted_is_made_again(partial, undisturbed):
    (partial / "shard-000001.parquet").unlink()
    made(partial)
    assert contents(partial) == undisturbed


def test_leftovers_of_a_killed_run_disappear(partial, undisturbed):
    for name in (".shard-000004.parquet.a1b2c3d4", "._manifest.json.a1b2c3d4"):
        (partial / name).write_bytes(b"half of it")
    (partial / "shard-000004.parquet").write_bytes(b"finished, but not in the manifest yet")
    made(partial)
    assert contents(partial) == undisturbed


def test_killed_before_the_first_manifest(tmp_path, undisturbed):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "._manifest.json.a1b2c3d4").write_bytes(b"{")
    made(tmp_path / "data")
    assert contents(tmp_path / "data") == undisturbed


@pytest.mark.parametrize("before, after", [(100, 130), (30, 130), (110, 130), (110, 220)])
def test_a_data_set_that_grew_is_the_larger_one(before, after, tmp_path, monkeypatch):
    made(tmp_path / "data", before)
    work, firsts = shards.made, []

    def counted(configuration, shard, home):
        firsts.append(shard.first)
        return work(configuration, shard, home)

    monkeypatch.setattr("tuners.data.shards.made", counted)
    grown = made(tmp_path / "data", after)
    assert firsts == list(range(before - before % SHARD, after, SHARD))  # the others are kept
    assert len(grown) == after and verify(grown.path, sample=5)
    made(tmp_path / "at once", after)
    assert contents(grown.path) == contents(tmp_path / "at once")
    with pytest.raises(DatasetError, match=f"episodes is {after} there and {before} here"):
        made(tmp_path / "data", before)


def test_an_unfinished_data_set_may_grow(partial, tmp_path):
    made(partial, 310)
    made(tmp_path / "at once", 310)
    assert contents(partial) == contents(tmp_path / "at once")


def test_what_is_damaged_does_not_grow(partial):
    path = partial / "shard-000001.parquet"
    path.write_bytes(path.read_bytes()[:-1] + b"!")
    before = contents(partial)
    with pytest.raises(DatasetError, match=f"{path.name} is damaged.*Delete"):
        made(partial, 310)
    assert contents(partial) == before


def test_recordings_are_kept_on_request(tmp_path):
    task = Task(experiment=Experiment(Ts=0.01, N=1000, register="random"))
    folder = made(tmp_path / "data", 40, task=task, shard_size=30, raw=True)
    u, y = record(task, TRAIN.draw(task.prior, 3, 0, 40))
    parts = list(folder.columns(["episode", "steer", "yaw_rate"]))
    for name, expected in (("steer", u), ("yaw_rate", y)):
        stored = np.concatenate([part[name] for part in parts])
        np.testing.assert_array_equal(stored, expected.astype(np.float32))
    assert "yaw_rate" not in next(folder.columns())
    assert_same_rows(folder.read(), examples(yaw_rate(task), 40, 3, STAGE))
    assert verify(folder.path, sample=5)


def test_columns_have_plain_types_and_units(whole):
    schema = pq.read_schema(whole.path / "shard-000000.parquet")
    described = {f.name: (str(f.type), (f.metadata or {}).get(b"unit")) for f in schema}
    assert described == {
        "episode": ("int64", None),
        "mu_s": ("double", b"1"),
        "M_delta": ("double", b"kg"),
        "v_x": ("double", b"m/s"),
        **{f"laguerre_{i}": ("double", None) for i in range(1, 5)},
        "usable": ("bool", None),
        "status": ("int8", None),
        "kp": ("double", b"s"),
        "Ti": ("double", b"s"),
        "log_gain": ("double", b"1"),
        "phase": ("double", b"rad"),
    }
    values = next(whole.columns())
    draw = TRAIN.draw(TASK.prior, 3, 0, len(values["episode"]))
    oracle = loops(TASK, draw.context).design()
    assert set(oracle.status) == {Status.OK, Status.PHASE_LIMITED}
    for name in ("kp", "Ti", "status"):
        np.testing.assert_array_equal(values[name], getattr(oracle, name))
    gains = np.stack([oracle.kp, oracle.Ti], axis=1)
    as_loop = np.stack([values[n] for n in ("log_gain", "phase")], axis=1)
    np.testing.assert_array_equal(as_loop, loop(TASK.target).encode(gains))
    usable = shards.examples(values, whole.recipe).gains[values["usable"]]
    np.testing.assert_array_equal(usable, gains[values["usable"]])


def test_the_manifest_says_what_it_is(whole):
    text = json.loads((whole.path / "_manifest.json").read_text())
    assert text["seeds"] == {"entropy": [TRAIN.tag, 3], "spawn_keys": [0, EPISODES]}
    words = np.random.SeedSequence((TRAIN.tag, 3), spawn_key=(7,)).generate_state(8, np.uint64)
    mu_s = 0.3 + 0.8 * (int(words[0]) >> 11) * 2.0**-53
    assert whole.read().theta[7, 0] == pytest.approx(mu_s, rel=1e-15)
    assert [shard["rows"] for shard in text["shards"]] == [SHARD] * 6
    assert whole.recipe == Configuration(TASK, TRAIN, STAGE, 3, EPISODES, SHARD, False)
    assert len(whole) == EPISODES


def test_a_context_set_of_its_own_prior_is_remembered(tmp_path):
    beyond = CONTEXT_SETS["extrapolation"]
    folder = generate(TASK, beyond, STAGE, 20, 0, tmp_path / "data")
    assert folder.recipe.contexts == beyond
    assert verify(folder.path, sample=3).read().theta[:, 1].min() > 300


@pytest.mark.parametrize(
    "episodes, raw, size", [(1e6, False, 4096), (1e6, True, 512), (1e8, False, 97_657)]
)
def test_shards_by_default(episodes, raw, size):
    assert shard_size(int(episodes), raw) == size
    assert raw or size * 1024 >= episodes


def test_whole_numbers_may_be_written_as_floats(tmp_path):
    assert len(generate(TASK, TRAIN, STAGE, 2e1, 3.0, tmp_path / "data")) == 20
    assert '"episodes": 20,' in (tmp_path / "data" / "_manifest.json").read_text()


# What can go wrong.  Every refusal says why, and leaves every file as it was.


@pytest.mark.parametrize(
    "change, message",
    [
        ({"stage": Laguerre(order=5)}, "compressor.order is 4 there and 5 here"),
        ({"task": Task(prior=Prior(v_x=25.0))}, "task.prior.v_x is"),
        ({"episodes": 299}, "episodes is 300 there and 299 here"),
        (
            {"episodes": 301, "raw": True},
            "holds another data set: raw is False there and True here",
        ),
        ({"shard_size": 51}, "shard_size is 50 there and 51 here"),
        ({"raw": True}, "raw is False there and True here"),
        ({"stage": Armax()}, "compressor.name is 'laguerre' there and 'armax' here"),
    ],
)
def test_another_configuration_is_refused(partial, change, message):
    before = contents(partial)
    with pytest.raises(DatasetError, match=message):
        made(partial, **change)
    assert contents(partial) == before


def test_another_version_is_refused(partial, monkeypatch):
    monkeypatch.setattr("tuners.data.manifest.__version__", "9.9")
    with pytest.raises(DatasetError, match="versions.yawrate is '.*' there and '9.9' here"):
        made(partial)


def test_a_worker_of_another_version_is_refused():
    configuration = Configuration(TASK, TRAIN, STAGE, 3, EPISODES, SHARD, False).to_json()
    configuration["versions"]["numpy"] = "1.0"
    with pytest.raises(DatasetError, match="numpy is '1.0' there .* Install the same"):
        shards.made(configuration, Shard("", 0, 1))


@pytest.mark.parametrize("seed", range(5))
def test_one_altered_byte_is_noticed(partial, seed, undisturbed):
    rng = np.random.default_rng(seed)
    path = partial / f"shard-{rng.integers(4):06d}.parquet"
    content = bytearray(path.read_bytes())
    content[rng.integers(len(content))] ^= 1 << rng.integers(8)
    path.write_bytes(content)
    before = contents(partial)
    with pytest.raises(DatasetError, match=f"{path.name} is damaged.*Delete"):
        made(partial)
    assert contents(partial) == before
    path.unlink()  # as the message says
    made(partial)
    assert contents(partial) == undisturbed


def test_a_manifest_that_is_damaged_is_refused(partial):
    path = partial / "_manifest.json"
    good = path.read_text()
    for bad in ("", good[:-20], good.replace('"seed": 3', '"seed": 4'), "[]", '{"format": 1}'):
        path.write_text(bad)
        with pytest.raises(DatasetError, match="_manifest.json"):
            made(partial)
        assert path.read_text() == bad
    path.write_text(good.replace("yawrate-dataset 1", "yawrate-dataset 2"))
    with pytest.raises(DatasetError, match="format 'yawrate-dataset 2'; this program reads"):
        made(partial)


def test_a_file_or_a_foreign_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("precious")
    with pytest.raises(DatasetError, match="file is a file. Name a folder"):
        made(tmp_path / "file")
    with pytest.raises(DatasetError, match="something else already. Name a new folder"):
        made(tmp_path)
    assert contents(tmp_path) == {"file": b"precious"}


def test_going_on_can_be_refused(partial):
    with pytest.raises(DatasetError, match="holds a data set already"):
        made(partial, resume=False)


def test_a_folder_is_written_by_one_process(partial):
    program = (
        "import fcntl, os, sys; f = os.open(sys.argv[1], os.O_RDONLY); "
        "fcntl.flock(f, fcntl.LOCK_EX); print('locked', flush=True); sys.stdin.read()"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", program, partial], **pipes) as other:
        other.stdout.readline()
        with pytest.raises(DatasetError, match="being written by another process"):
            made(partial)
        other.stdin.close()
    made(partial)


@contextmanager
def largest_file(size):
    """The operating system refuses larger files, as a full disk would."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_what_cannot_be_written_leaves_nothing_half_written(partial, undisturbed):
    before = contents(partial)
    largest = max(len(content) for content in undisturbed.values())
    with (
        largest_file(largest // 2),
        pytest.raises(DatasetError, match="too large.*stay valid"),
    ):
        made(partial)
    assert contents(partial) == before
    made(partial)
    assert contents(partial) == undisturbed


@pytest.mark.parametrize("at", range(1, 9))
def test_a_full_disk_loses_nothing(at, tmp_path, undisturbed, monkeypatch):
    calls, fsync = [], os.fsync

    def full(handle):
        calls.append(handle)
        if len(calls) == at:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(handle)

    with monkeypatch.context() as patch:
        patch.setattr(files.os, "fsync", full)
        with pytest.raises(DatasetError, match="No space left.*Free some.*goes on"):
            made(tmp_path / "data")
    # What finished no shard leaves no folder either.
    assert (tmp_path / "data").exists() or at < 4
    assert not list(tmp_path.glob("data/.*"))
    made(tmp_path / "data")
    assert contents(tmp_path / "data") == undisturbed


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(tmp_path, monkeypatch):
    def denied(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("tuners.data.shards.made", None)
    with pytest.raises(DatasetError, match="No such file or directory"):
        made("/proc/yawrate")
    monkeypatch.setattr("tempfile.mkstemp", denied)
    with pytest.raises(DatasetError, match="Permission denied.*may write to"):
        made(tmp_path / "data")


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"episodes": 0}, "episodes = 0"),
        ({"shard_size": 0.5}, "shard_size"),
        ({"count": 0}, "workers = 0"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(arguments, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        made(tmp_path / "data", **arguments)
    assert not (tmp_path / "data").exists()


# Who does the work.


def test_results_do_not_pile_up(monkeypatch):
    @contextmanager
    def threads(count, scheduler):
        with ThreadPoolExecutor(count) as pool:
            yield pool, lambda: count

    monkeypatch.setattr(workers, "_executor", threads)
    started = []
    found = workers.results(lambda job: started.append(job) or b"", range(100), 2, None)
    taken = set()
    for job, _ in found:
        taken.add(job)
        time.sleep(0.001)
        assert len(started) - len(taken) <= 4  # two a worker
    assert taken == set(range(100))


def test_a_scheduler_that_is_not_there(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "_SECONDS", 0.2)
    with pytest.raises(DatasetError, match="tcp://127.0.0.1:9' cannot be used.*dask scheduler"):
        made(tmp_path / "data", scheduler="tcp://127.0.0.1:9")


KILLED = """
import os, signal, sys, time
import numpy as np
from test_data_generation import made

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


def environment():
    paths = [os.path.dirname(__file__), os.getcwd(), *sys.path]
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}


@pytest.mark.slow
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
from test_data_generation import contents, made
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


@pytest.mark.slow
def test_killed_at_every_step_of_growing(tmp_path):
    program = [sys.executable, "-c", GROWN, *(tmp_path / name for name in ("old", "fresh", "out"))]
    done = subprocess.run(
        program, env=environment(), check=True, capture_output=True, text=True, timeout=120
    )
    found = done.stdout.split()
    # Five files, each fsynced, renamed and its folder fsynced; after the first it is another's.
    assert found == ["110"] * 2 + ["unfinished"] * 12 + ["170"]


@pytest.mark.slow
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


@pytest.mark.slow
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
