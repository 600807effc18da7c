"""Reading and verifying data sets."""

import hashlib
import json
import os
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from data_sets import STAGE, contents, damage, made
from first_order import described, plant

from tuners import data
from tuners.data import DatasetError, Folder, shards, verify
from tuners.data.folder import deviation
from tuners.data.manifest import Configuration, Manifest, Shard
from yawrate_env.plant.entry import find


@pytest.fixture
def folder(tmp_path):
    return made(tmp_path / "data", 120)


def again(path):
    return made(path, 120)


def refused(match, path, *uses):
    for use in uses:
        with pytest.raises(DatasetError, match=match):
            use(path)


def test_an_intact_data_set_is_verified(folder):
    before, times, calls = contents(folder.path), os.stat(folder.path).st_mtime_ns, []
    found = verify(folder.path, sample=7, progress=lambda *call: calls.append(call))
    assert len(found) == 120 and found.recipe == folder.recipe
    assert calls == [("verifying", k, 3) for k in (1, 2, 3)]
    assert deviation(found, 30) == 0
    folder.read()
    assert contents(folder.path) == before and os.stat(folder.path).st_mtime_ns == times
    table = pq.read_table(folder.path)  # the manifest is no part of the table
    assert table["episode"].to_pylist() == list(range(120))


def test_everything_that_is_wrong_is_named(folder):
    first, second, third = (folder.path / shard.file for shard in folder.manifest.shards)
    first.unlink()
    damage(second)
    third.unlink()
    third.mkdir()
    refused(f"{third.name} is a folder. Move", folder.path, again)
    with pytest.raises(DatasetError) as refusal:
        verify(folder.path)
    text = str(refusal.value)
    assert f"{first} is missing" in text
    assert f"{second} is damaged" in text and f"{third} is damaged" in text
    assert "Delete what is damaged and generate again" in text


def test_rows_that_their_seed_does_not_give_are_noticed(folder):
    """Shards that are valid, with their checksums."""
    manifest = json.loads((folder.path / "_manifest.json").read_text())
    path = folder.path / manifest["shards"][0]["file"]
    (values,) = shards.read(path)
    for name in ("laguerre_2", "kp", "K"):
        path.write_bytes(shards.written(values | {name: 1.001 * values[name]}, {}))
        manifest["shards"][0]["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
        (folder.path / "_manifest.json").write_text(json.dumps(manifest))
        assert verify(folder.path)
        with pytest.raises(DatasetError, match="not what its seed gives here.*1.0e-03 of"):
            verify(folder.path, sample=1)


def test_an_unfinished_data_set_is_not_read(folder):
    Manifest(folder.manifest.configuration, folder.manifest.shards[:1]).write(folder.path)
    refused("lacks 2 of its shards.*goes on from there", folder.path, Folder, verify)


@pytest.mark.parametrize(
    "change",
    [
        lambda shards: [shards[0], shards[0], shards[2]],
        lambda shards: [shards[1], shards[0], shards[2]],
        lambda shards: [*shards, shards[2]],
        lambda shards: [shards[0] | {"file": "../elsewhere.parquet"}, *shards[1:]],
        lambda shards: [shards[0] | {"rows": shards[0]["rows"] - 1}, *shards[1:]],
        lambda shards: [shards[0] | {"first": None}, *shards[1:]],
    ],
)
def test_a_manifest_lists_the_shards_of_its_configuration(folder, change):
    path = folder.path / "_manifest.json"
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"shards": change(content["shards"])}))
    refused("has no such shard", folder.path, Folder, again)


def test_a_folder_without_a_data_set(tmp_path):
    for path in (tmp_path, tmp_path / "missing"):
        refused("manifest.json: No such file.*Name a data set", path, Folder)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"episodes": 10**15}, "lacks [0-9]+ of its shards|has no such shard"),
        ({"episodes": "120"}, "episodes = '120' is not a number. Read"),
        ({"shard_size": 0}, "shard_size = 0 must be finite, at least 1. Read"),
        ({"raw": "no"}, "raw = 'no' must be True or False. Read"),
        ({"features": {"name": "wavelets"}}, "another version's.*wavelets"),
    ],
)
def test_configurations_that_cannot_be_are_refused_at_once(folder, change, words):
    strange = folder.manifest.configuration | change
    Manifest(strange, folder.manifest.shards).write(folder.path)
    refused(words, folder.path, Folder)
    with pytest.raises(DatasetError, match=f"another data set: .*{next(iter(change))}"):
        made(folder.path, 60 if "episodes" in change else 120)


def test_manifests_that_hold_something_else_are_damaged(folder):
    other = '{"format": 1, "configuration": [1], "configuration_sha256": "", "shards": []}'
    for content in (9999 * "[", other):
        (folder.path / "_manifest.json").write_text(content)
        refused("_manifest.json is damaged", folder.path, Folder, again)


def test_pages_are_checked_as_they_are_read(folder):
    path = folder.path / folder.manifest.shards[0].file
    content = bytearray(path.read_bytes())
    content[200] ^= 1  # within the first page, of episode numbers
    path.write_bytes(content)
    with pytest.raises(DatasetError, match="cannot be read.*Verify"):
        folder.read()


def test_large_shards_are_read_in_parts(monkeypatch):
    monkeypatch.setattr(shards, "ROWS", 32)
    recipe = Configuration(plant, "train", STAGE, 3, 100, 100, False)
    values = shards.columns(recipe, Shard("", 0, 100))
    parts = list(shards.read(pa.BufferReader(shards.written(values, {}))))
    assert [len(part["kp"]) for part in parts] == [32, 32, 32, 4]
    for name, column in values.items():
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), column)


def test_a_missing_module_is_refused(tmp_path):
    (tmp_path / "my_plant.py").write_text("from first_order import described as plant")
    own = find("my_plant:plant", tmp_path)
    made(tmp_path / "data", 60, of=own)
    del sys.modules["my_plant"]
    assert len(Folder(tmp_path / "data")) == 60  # found beside the folder
    del sys.modules["my_plant"]
    (tmp_path / "my_plant.py").unlink()
    missing = "no module 'my_plant'.*PYTHONPATH"
    refused(missing, tmp_path / "data", Folder, verify, data.train)
    assert verify(tmp_path / "data", plant=own)
    with pytest.raises(DatasetError, match="is of my_plant:plant, not of first_order:plant"):
        Folder(tmp_path / "data", described())
    sys.path.remove(str(tmp_path))
