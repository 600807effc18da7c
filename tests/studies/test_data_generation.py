"""Data sets: the same bytes whoever makes them, however often they are interrupted."""

import json
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pyarrow.parquet as pq
import pytest
from data_sets import EPISODES, OTHER, SHARD, STAGE, TASK, cars, contents, made, refused, rich
from first_order import TAU, described, design, plant

from tuners import workers
from tuners.data import DatasetError, Folder, verify
from tuners.data.manifest import Configuration, shard_size
from tuners.tuner.examples import examples
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.fingerprint import changed, fingerprint
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate


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
