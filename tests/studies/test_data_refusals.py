"""Data sets that are another's, damaged or in use are refused, and stay as they are."""

import errno
import os

import first_order
import numpy as np
import pytest
from data_sets import EPISODES, OTHER, SHARD, STAGE, cars, contents, made, refused, wandering
from filelock import FileLock
from first_order import U, described, design, plant, simulate

from tuners import data
from tuners.data import DatasetError, Folder, load_gains, shards, verify
from tuners.data.manifest import Configuration, Manifest, Shard
from tuners.features.laguerre import Laguerre
from yawrate_env import files
from yawrate_env.plant.fingerprint import changed, fingerprint
from yawrate_env.plant.parametrisation import LOG, Parametrisation


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
