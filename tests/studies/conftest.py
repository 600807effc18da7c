"""A data set, whole and begun, that its tests read."""

import pytest
from data_sets import contents, made

from tuners.data import shards
from tuners.data.manifest import Manifest


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
