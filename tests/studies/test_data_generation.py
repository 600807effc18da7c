"""Data sets: the same bytes whoever makes them, however often they are interrupted."""

import errno
import json
import os
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import first_order
import numpy as np
import pyarrow.parquet as pq
import pytest
from data_sets import EPISODES, SHARD, STAGE, TASK, cars, contents, made, rich, wandering
from filelock import FileLock
from first_order import TAU, U, described, design, plant, simulate

from tuners import data, workers
from tuners.data import DatasetError, Folder, load_gains, shards, verify
from tuners.data.manifest import Configuration, Manifest, Shard, shard_size
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.tuner.examples import examples
from yawrate_env import files
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.fingerprint import changed, fingerprint
from yawrate_env.plant.parametrisation import LOG, Parametrisation
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

OTHER = FrequencyResponse(8, 2.0, 0.05, 2.0)


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


@pytest.fixture
def firsts(monkeypatch):
    """The first episodes of the shards that are made."""
    work, found = shards.made, []

    def counted(configuration, shard, home):
        found.append(shard.first)
        return work(configuration, shard, home)

    monkeypatch.setattr("tuners.data.shards.made", counted)
    return found


@contextmanager
def refused(folder, match):
    """A refusal that leaves every file as it was."""
    before = contents(folder)
    with pytest.raises(DatasetError, match=match):
        yield
    assert contents(folder) == before


def assert_same_rows(found, expected):
    for name in expected.__slots__:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize("of", [plant, rich, cars], ids=["simple", "rich", "cars"])
def test_rows_are_those_of_the_pipeline_whatever_the_shards(of, tmp_path):
    expected = examples(of, 160, 3, STAGE)
    for size in (128, 1000):
        found = made(tmp_path / f"{size}", 160, of=of, shard_size=size).read()
        assert_same_rows(found, expected)
    assert of is plant or 0 < found.usable.sum() < 160
    if of is plant:
        other = made(tmp_path / "other", 20, stage=OTHER, shard_size=7)
        assert_same_rows(other.read(), examples(plant, 20, 3, OTHER))
        assert "response_1" in next(other.columns())
    folder = made(tmp_path / "raw", 40, of=of, shard_size=30, raw=True)
    np.testing.assert_array_equal(folder.read().features, expected.features[:40])
    episodes, parts = recorded(of, "train", 3, 40), list(folder.columns(["u", "y"]))
    signals = np.broadcast_to(episodes.u, episodes.y.shape), episodes.y
    for name, signal in zip("uy", signals, strict=True):
        stored = np.concatenate([part[name] for part in parts])
        np.testing.assert_array_equal(stored, signal.astype(np.float32))
    assert "y" not in next(folder.columns())
    assert verify(folder.path, sample=3)


def test_what_is_finished_is_not_made_again(partial, undisturbed, firsts):
    shown = []
    for name in (".shard-000002.parquet.a1b2c3d4", "shard-000002.parquet"):
        (partial / name).write_bytes(b"what a killed run leaves")
    made(partial, progress=lambda *call: shown.append(call))
    assert firsts == [100, 150]
    assert shown == [
        *(("verifying", done, 2) for done in (1, 2)),
        *(("simulating", done, 200) for done in (100, 150, 200)),
    ]
    assert contents(partial) == undisturbed
    made(partial)
    assert firsts == [100, 150]
    with refused(partial, "Resume it, or name a new folder"):
        made(partial, resume=False)


@pytest.mark.parametrize("before, after", [(100, 130), (30, 130), (110, 130)])
def test_a_data_set_that_grew_is_the_larger_one(before, after, tmp_path, firsts):
    made(tmp_path / "data", before)
    firsts.clear()
    grown = made(tmp_path / "data", after)
    assert firsts == list(range(before - before % SHARD, after, SHARD))  # the others are kept
    assert len(grown) == after and verify(grown.path, sample=5)
    made(tmp_path / "at once", after)
    assert contents(grown.path) == contents(tmp_path / "at once")
    with pytest.raises(DatasetError, match=f"episodes is {after} there and {before} here"):
        made(tmp_path / "data", before)


def test_columns_have_the_plants_names_types_and_units(whole, tmp_path):
    path = made(tmp_path / "cars", 30, of=cars, raw=True).path / "shard-000000.parquet"
    schema = pq.read_schema(path)
    numbers = ["mu_s", "M_delta", "v_x", *(f"laguerre_{i}" for i in range(1, 5))]
    targets = ["kp", "Ti", "log_gain", "phase"]
    assert schema.names == ["episode", *numbers, "usable", *targets, "u", "y"]
    types = [str(field.type) for field in schema]
    assert types[:-2] == ["int64", *["double"] * 7, "bool", *["double"] * 4]
    assert all(kind.startswith("fixed_size_list") for kind in types[-2:])
    units = {field.name: field.metadata[b"unit"] for field in schema if field.metadata}
    assert units == {"M_delta": b"kg", "v_x": b"m/s", "u": b"rad", "y": b"rad/s"}

    values = next(whole.columns())
    features = [f"laguerre_{i}" for i in (1, 2, 3, 4)]
    assert list(values) == ["episode", "K", "T", *features, "usable", "kp", "Ti",
                            "log_kp", "log_Ti"]  # fmt: skip
    np.testing.assert_allclose(values["kp"], values["T"] / (values["K"] * TAU))
    np.testing.assert_array_equal(values["log_Ti"], np.log(values["Ti"]))
    values = next(made(tmp_path / "rich", 50, of=rich).columns())
    assert list(values)[7:] == ["laguerre_5", "usable", "kp", "Ti", "coordinate_1", "coordinate_2"]
    np.testing.assert_array_equal(values["laguerre_5"], np.log(values["K"]))  # it is measured
    np.testing.assert_array_equal(values["coordinate_2"], values["Ti"])


def test_the_manifest_holds_the_configuration(whole):
    text = json.loads((whole.path / "_manifest.json").read_text())
    assert text["seeds"] == {"entropy": [1, 3], "spawn_keys": [0, EPISODES]}
    integers = np.random.SeedSequence((1, 3), spawn_key=(7,)).generate_state(8, np.uint64)
    K = 0.5 + 1.5 * (int(integers[0]) >> 11) * 2.0**-53
    assert whole.read().theta[7, 0] == pytest.approx(K, rel=1e-15)
    assert [shard["rows"] for shard in text["shards"]] == [SHARD] * 4
    assert whole.recipe == Configuration(plant, "train", STAGE, 3.0, EPISODES, SHARD, False)
    assert text["configuration"]["plant"]["entry"] == "first_order:plant"
    assert text["configuration"]["seed"] == 3 and len(whole) == EPISODES


def test_a_plant_from_a_function_is_found_by_its_arguments(tmp_path):
    folder = made(tmp_path / "data", 20, of=cars, set="extrapolation")
    assert folder.manifest.configuration["plant"]["arguments"]["target"]["crossover"] == 2.0
    found = Folder(tmp_path / "data").recipe
    assert found.plant.arguments == cars.arguments and found.set == "extrapolation"
    assert verify(folder.path, sample=3).read().theta[:, 1].min() > 300
    other = yaw_rate(Task(experiment=TASK.experiment, target=Target(55.0, 2.1)))
    with pytest.raises(DatasetError, match="target.crossover is 2.0 there and 2.1 here"):
        Folder(tmp_path / "data", other)


def test_shards_by_default():
    assert shard_size(10**6, False) == 4096 and shard_size(10**6, True) == 512
    assert 1024 * shard_size(10**8, False) >= 10**8


# What can go wrong.  Every refusal says why, and leaves every file as it was.


@pytest.mark.parametrize(
    "change, message",
    [
        ({"stage": Laguerre(5, 2.0)}, "features.order is 4 there and 5 here"),
        ({"stage": OTHER}, "features.name is 'laguerre' there and 'response' here"),
        ({"of": cars}, "plant.entry is 'first_order:plant' there"),
        ({"set": "test"}, "set is 'train' there and 'test' here"),
        ({"episodes": 201, "raw": True}, "another data set: raw is False there and True here"),
        ({"shard_size": 51}, "shard_size is 50 there and 51 here"),
    ],
)
def test_another_configuration_is_refused(partial, change, message):
    with refused(partial, message):
        made(partial, **change)


def test_another_version_or_module_is_refused(partial, monkeypatch):
    configuration = Configuration(plant, "train", STAGE, 3, EPISODES, SHARD, False).to_json()
    monkeypatch.setattr("tuners.data.manifest.__version__", "9.9")
    with refused(partial, "versions.yawrate is '.*' there and '9.9' here"):
        made(partial)
    with pytest.raises(DatasetError, match="yawrate is '.*' there .* Install the same"):
        shards.made(configuration, Shard("", 0, 1))
    configuration["plant"]["entry"] = "gone:plant"
    with pytest.raises(DatasetError, match="A worker.*no module 'gone'.*all workers the same"):
        shards.made(configuration, Shard("", 0, 1))


@pytest.mark.parametrize("seed", range(2))
def test_one_altered_byte_is_noticed(partial, seed, undisturbed):
    rng = np.random.default_rng(seed)
    path = partial / f"shard-{rng.integers(2):06d}.parquet"
    content = bytearray(path.read_bytes())
    content[rng.integers(len(content))] ^= 1 << rng.integers(8)
    path.write_bytes(content)
    for episodes in (EPISODES, EPISODES + 10):
        with refused(partial, f"{path.name} is damaged.*Delete"):
            made(partial, episodes)
    path.unlink()  # as the message says
    made(partial)
    assert contents(partial) == undisturbed


def test_a_manifest_that_is_damaged_is_refused(partial):
    path = partial / "_manifest.json"
    good = path.read_text()
    for bad in ("", good[:-20], good.replace('"seed": 3', '"seed": 4'), "[]", '{"format": 1}'):
        path.write_text(bad)
        with refused(partial, "_manifest.json"):
            made(partial)
    path.write_text(good.replace("yawrate-dataset 1", "yawrate-dataset 2"))
    with pytest.raises(DatasetError, match="format 'yawrate-dataset 2'; this program reads"):
        made(partial)


def test_a_file_or_a_foreign_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("precious")
    for out, why in ((tmp_path / "file", "file is a file"), (tmp_path, "something else already")):
        with refused(tmp_path, why):
            made(out)


def test_files_of_others_in_a_data_set_are_refused(partial):
    shard = next(partial.glob("shard-*.parquet"))
    makers = {
        "notes.txt": lambda path: path.write_text("precious"),
        "more": lambda path: path.mkdir(),
        "link.parquet": lambda path: path.symlink_to(shard),
    }
    for name, make in makers.items():
        make(partial / name)
        with pytest.raises(DatasetError, match=name):
            made(partial)
        (partial / name).rmdir() if name == "more" else (partial / name).unlink()
    made(partial)


def test_a_folder_is_written_by_one_process(partial):
    before = set(partial.iterdir())
    with FileLock(partial / ".lock"), refused(partial, "being written by another process"):
        made(partial)
    made(partial)
    assert before <= set(partial.iterdir()) and not (partial / ".lock").exists()


@pytest.mark.parametrize("at", range(1, 6))
def test_a_full_disk_loses_nothing(at, tmp_path, undisturbed, monkeypatch):
    """Two steps a file: the manifest, the first shard, the manifest again."""
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
        ({"of": "first_order:plant"}, "plant = 'first_order:plant'"),
        ({"set": None}, "None is unknown"),
        ({"set": "extrapolation"}, "extrapolation"),
        ({"stage": None}, "features = None"),
        ({"stage": Laguerre(60, 2.0)}, "500 samples are too few for 60"),
        ({"of": described(entry="")}, 'entry="my_plant:plant"'),
        ({"of": described(entry="gone:plant")}, "no module 'gone'"),
        ({"of": described(noise=0.5)}, "not of the first_order:plant .*: the plant's noise"),
        ({"of": described(gains=("u", "Ti"))}, "'u' would be the name of two columns"),
        ({"of": described(gains=("kp", "log_kp"))}, "'log_kp' would be"),
        ({"of": described(gains=("kp", "response_1"))}, "'response_1' would be"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(arguments, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        made(tmp_path / "data", **arguments)
    assert not (tmp_path / "data").exists()


# Plants that change.


TWICE = Parametrisation(lambda g: 2 * LOG.encode(g), lambda x: LOG.decode(x / 2), LOG.names)
CHANGES = {
    "design": {"design": lambda t: 1.01 * design(t)},
    "simulate": {"simulate": lambda t, u, rng: 1.01 * simulate(t, u, rng)},
    "noise": {"noise": 0.021},
    "ranges.K": {"prior": {"K": (0.5, 2.1), "T": (0.2, 1.0)}},
    "parametrisation": {"parametrisation": TWICE},
    "u": {"u": np.roll(U, 1)},
    "recordings": {"simulate": wandering},
    "coordinates": {"parametrisation": Parametrisation(LOG.encode, LOG.decode)},
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_plant_that_changed_since_is_refused(what, partial, monkeypatch):
    now = described(**CHANGES[what])
    monkeypatch.setattr(first_order, "plant", now)
    with refused(partial, f"holds another data set: .*plant.*{what}"):
        made(partial, of=now)


def test_every_reader_refuses_a_plant_that_changed(whole, monkeypatch):
    monkeypatch.setattr(first_order, "plant", described(noise=0.021))
    for use in (Folder, verify, load_gains, data.train):
        with pytest.raises(DatasetError, match="not of the first_order:plant.*noise.*Restore"):
            use(whole.path)
    with pytest.raises(DatasetError, match="A worker.*not of the first_order:plant"):
        shards.made(whole.manifest.configuration, Shard("", 0, 1))
    assert len(Folder(whole.path, described(entry=""))) == EPISODES  # as it was


def test_what_no_row_follows_from_may_change(partial, undisturbed, monkeypatch):
    now = described(
        signals=("valve", "flow"), metrics={"gain": 1.0}, evaluate=lambda t, g: g[:, :1]
    )
    monkeypatch.setattr(first_order, "plant", now)
    made(partial, of=now)
    assert contents(partial) == undisturbed


def test_another_machines_rounding_is_no_change(partial, monkeypatch):
    now = described(simulate=lambda t, u, rng: (1 + 1e-9) * simulate(t, u, rng))
    monkeypatch.setattr(first_order, "plant", now)
    before, then = Manifest.read(partial).configuration, fingerprint(plant)
    assert then["simulate"] != fingerprint(now)["simulate"] and changed(now, then) == ""
    assert len(made(partial, of=now)) == EPISODES
    assert Manifest.read(partial).configuration == before


def test_missing_gains_count_too():
    every, some = (
        described(design=lambda t, e=e: np.where(t < e, design(t), np.nan)) for e in (9, 0.7)
    )
    assert np.isfinite(fingerprint(some)["design"]).all()
    assert changed(some, fingerprint(every)) == "design"


# Who does the work.


def test_results_do_not_pile_up(monkeypatch):
    @contextmanager
    def threads(count, scheduler):
        with ThreadPoolExecutor(count) as pool:
            yield pool, lambda: count

    monkeypatch.setattr(workers, "_executor", threads)
    started, taken = [], set()
    for job, _ in workers.results(lambda job: started.append(job) or b"", range(50), 2, None):
        taken.add(job)
        time.sleep(0.001)
        assert len(started) - len(taken) <= 4  # two a worker
    assert taken == set(range(50))


def test_a_scheduler_that_is_not_there(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "_SECONDS", 0.2)
    with pytest.raises(DatasetError, match="tcp://127.0.0.1:9' cannot be used.*dask scheduler"):
        made(tmp_path / "data", scheduler="tcp://127.0.0.1:9")
