"""Data sets of any plant: as vehicles', and never of a plant other than the one they name."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace

import first_order
import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from first_order import TAU, U, described, design, plant, simulate
from recordings import ROOT
from command import call, refused
from test_data_generation import TASK, cluster, contents, environment
from test_data_generation import made as of_vehicles

from tuners import data, plants
from tuners.data import DatasetError, Folder, generate, load_gains, shards, verify
from tuners.data.manifest import Configuration, Shard
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.tuner.stages import Recipe
from yawrate_env.plant import fingerprint
from yawrate_env.plant.episodes import examples, recorded
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.vehicle_file import example as paper

torch.set_num_threads(1)

TRAIN = CONTEXT_SETS["train"]
STAGE = Laguerre(4, 2.0)
EPISODES, SHARD = 300, 70
QUICK = {
    "network": FeedForwardSettings(neurons=4, epochs=10),
    "trees": GBMSettings(n_estimators=30, min_child_weight=5.0),
}


def wandering(theta, u, rng):
    """An input for every episode, and a level that is random in the plant itself."""
    y = simulate(theta, u, None)
    return y if rng is None else y + 0.1 * rng.standard_normal((len(theta), 1))


def for_some(theta):
    """Gains of both signs, for plants that are not too slow."""
    return np.where(theta[:, 1:] < 0.9, [1.0, -1.0] * design(theta), np.nan)


rich = described(
    simulate=wandering,
    design=for_some,
    measured={"K": 0.1},
    excite=lambda words: prbs(500, 0.02, 0.5, 1.0, order=7, start=words),
    parametrisation=plants.Coordinates(lambda g: g, lambda x: x),
    noise=plants.snr(20.0),
    entry="test_data_plants:rich",
)
KINDS = pytest.mark.parametrize("of", [plant, rich], ids=["simple", "rich"])


def made(out, of=plant, *, episodes=EPISODES, shard_size=SHARD, count=1, **kwargs):
    sizes = {"shard_size": shard_size, "workers": count}
    return generate(of, TRAIN, STAGE, episodes, 3, out, **sizes, **kwargs)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return made(tmp_path_factory.mktemp("undisturbed") / "data")


@pytest.fixture(scope="module")
def undisturbed(whole):
    return contents(whole.path)


@pytest.fixture
def begun(tmp_path, whole):
    """The same data set before the last shard was made."""
    folder = tmp_path / "begun"
    folder.mkdir()
    for name, content in contents(whole.path).items():
        (folder / name).write_bytes(content)
    (folder / whole.manifest.shards[-1].file).unlink()
    return folder


@pytest.fixture
def own_module(tmp_path):
    """A plant in a module that only its folder has; the TOML file beside it."""
    folder = tmp_path / "mine"
    folder.mkdir()
    lines = "from first_order import described", 'plant = described(entry="my_plant:plant")'
    (folder / "my_plant.py").write_text("\n".join(lines))
    (folder / "my.toml").write_text('[plant]\nentry = "my_plant:plant"\n')
    yield folder
    sys.modules.pop("my_plant", None)


def another(folder):
    """A folder with a module of the same name, of another plant."""
    other = folder / "other"
    other.mkdir()
    prior = '{"K": (2.0, 3.0), "T": (0.2, 1.0)}'
    plant = f'plant = described(prior={prior}, entry="my_plant:plant")'
    (other / "my_plant.py").write_text(f"from first_order import described\n{plant}")
    return other


@KINDS
@pytest.mark.parametrize("shard_size", [37, 128, 1000])
def test_rows_are_those_of_the_pipeline_whatever_the_shards(of, shard_size, tmp_path):
    found = made(tmp_path / "data", of, episodes=200, shard_size=shard_size).read()
    expected = examples(of, 200, 3, STAGE)
    for name in expected.__slots__:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert of is plant or 0 < found.usable.sum() < 200


@KINDS
def test_recordings_are_kept_on_request(of, tmp_path):
    folder = made(tmp_path / "data", of, episodes=40, shard_size=30, raw=True)
    asked = recorded(of, "train", 3, 40)
    parts = list(folder.columns(["u", "y"]))
    for name, expected in (("u", np.broadcast_to(asked.u, asked.y.shape)), ("y", asked.y)):
        stored = np.concatenate([part[name] for part in parts])
        np.testing.assert_array_equal(stored, expected.astype(np.float32))
    assert "y" not in next(folder.columns())
    assert verify(folder.path, sample=3)


def test_columns_are_called_as_the_plant_calls_them(whole, tmp_path):
    names = pq.read_schema(whole.path / "shard-000000.parquet").names
    features = [f"laguerre_{i}" for i in (1, 2, 3, 4)]
    assert names == ["episode", "K", "T", *features, "usable", "kp", "Ti", "log_kp", "log_Ti"]
    values = next(whole.columns())
    np.testing.assert_allclose(values["kp"], values["T"] / (values["K"] * TAU))
    np.testing.assert_array_equal(values["log_Ti"], np.log(values["Ti"]))
    values = next(made(tmp_path / "data", rich, episodes=50).columns())
    assert list(values)[7:] == ["laguerre_5", "usable", "kp", "Ti", "coordinate_1", "coordinate_2"]
    np.testing.assert_array_equal(values["laguerre_5"], np.log(values["K"]))  # it is measured
    np.testing.assert_array_equal(values["coordinate_2"], values["Ti"])


def test_gains_as_a_table(whole):
    expected = examples(plant, EPISODES, 3, STAGE)
    X, y = load_gains(whole.path, return_X_y=True)
    np.testing.assert_array_equal(X, expected.features)
    np.testing.assert_array_equal(y, expected.gains)
    table = load_gains(whole.path, coordinates="own")
    np.testing.assert_array_equal(table.target, np.log(expected.gains))
    assert table.target_names == ["log_kp", "log_Ti"] and "first_order:plant" in table.DESCR
    with pytest.raises(ValueError, match="coordinates = 'loop'.*gains, own"):
        load_gains(whole.path, coordinates="loop")


@pytest.mark.parametrize("learner", QUICK.values(), ids=QUICK)
def test_a_tuner_is_that_of_the_same_data_in_memory(learner, tmp_path):
    folder = made(tmp_path / "data", rich)
    recipe = Recipe(STAGE, learner)
    expected = plants.train(rich, recipe, count=EPISODES, seed=3, calibration=60)
    found = data.train_plant(folder.path, recipe, seed=3, calibration=60)
    asked = recorded(rich, "test", 0, 50)
    # Sums in another order, and a dozen steps that amplify them.
    np.testing.assert_allclose(
        found.gains(asked.u, asked.y, asked.theta),
        expected.gains(asked.u, asked.y, asked.theta),
        rtol=1e-6,
    )
    np.testing.assert_allclose(found.calibration, expected.calibration, rtol=1e-4)
    assert found.training == expected.training


def test_a_tuner_learns_what_suits_the_plant_by_default(whole, tmp_path):
    tuner = data.train_plant(whole.path)
    tuner.save(tmp_path / "first.tuner")
    asked = recorded(plant, "test", 0, 100)
    error = plant.metric_values(
        asked.theta, plants.load(tmp_path / "first.tuner").gains(U, asked.y)
    )
    assert np.sqrt((error**2).mean()) < 0.05
    assert len(tuner.calibration) == 2 and tuner.training["vehicles"] == EPISODES


# Who does the work.


@pytest.mark.slow
@pytest.mark.parametrize("scheduler", [None, "local"])
def test_processes_find_the_module_where_it_is(scheduler, own_module):
    folder = own_module / "elsewhere" / "data"
    options = {"--episodes": EPISODES, "--seed": 3, "--shard-size": SHARD, "--workers": 2}
    options |= {"--out": folder, "--vehicle": own_module / "my.toml"}
    options |= {"--scheduler": scheduler} if scheduler else {}
    words = [str(word) for option in options.items() for word in option]
    program = "from tuners.cli import main; main()"
    subprocess.run(
        [sys.executable, "-c", program, "dataset", *words],
        cwd=own_module.parent, env=environment(), check=True, capture_output=True, timeout=100,
    )  # fmt: skip
    found = Folder(folder, plants.find("my_plant:plant", own_module))
    expected = examples(plant, EPISODES, 3, found.recipe.compressor)
    np.testing.assert_array_equal(found.read().features, expected.features)


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_of_two_modules_of_one_name_workers_import_the_right_one(count, own_module, tmp_path):
    first, second = (plants.find("my_plant:plant", at) for at in (own_module, another(tmp_path)))
    assert sys.modules["my_plant"].plant is first
    found = made(tmp_path / "data", second, count=count)
    np.testing.assert_array_equal(found.read().theta, examples(second, EPISODES, 3, STAGE).theta)
    assert len(Folder(tmp_path / "data", second)) == EPISODES
    with pytest.raises(DatasetError, match="not of the my_plant:plant that is found here: .*prior"):
        Folder(tmp_path / "data")  # here that is the first


@pytest.mark.slow
def test_a_cluster_that_was_started_elsewhere(own_module, tmp_path):
    """Its workers find the module by its folder; on another machine, their own or none."""
    own, apart = plants.find("my_plant:plant", own_module), tmp_path / "apart"
    apart.mkdir()
    with cluster(apart, cwd=apart) as (scheduler, _):
        made(tmp_path / "data", own, scheduler=scheduler)
    own_module.rename(tmp_path / "not here")
    apart = another(tmp_path)
    for at, why in ((tmp_path / "apart", "no module 'my_plant'"), (apart, "not of the my_plant")):
        (at / "scheduler.json").unlink(missing_ok=True)
        with cluster(at, cwd=at) as (scheduler, _):
            with pytest.raises(DatasetError, match=f"A worker: .*{why}.*the same module"):
                made(tmp_path / "refused", own, scheduler=scheduler)
            assert not (tmp_path / "refused").exists()
    made(tmp_path / "here", own)
    assert contents(tmp_path / "data") == contents(tmp_path / "here")


@pytest.mark.slow
def test_a_cluster_without_this_package_is_refused(tmp_path):
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['tuners'] = None")
    hidden = environment()
    hidden["PYTHONPATH"] = f"{tmp_path}:{hidden['PYTHONPATH']}"
    with (
        cluster(tmp_path, env=hidden) as (scheduler, _),
        pytest.raises(DatasetError, match="not installed where the scheduler, tcp://.* runs"),
    ):
        made(tmp_path / "data", scheduler=scheduler)
    assert not (tmp_path / "data").exists()


@pytest.mark.slow
def test_processes_make_the_same_bytes(tmp_path, undisturbed):
    made(tmp_path / "data", count=2)
    assert contents(tmp_path / "data") == undisturbed


@pytest.mark.slow
def test_a_cluster_makes_the_same_bytes(tmp_path, undisturbed):
    with cluster(tmp_path) as (scheduler, _):
        made(tmp_path / "data", scheduler=scheduler)
    assert contents(tmp_path / "data") == undisturbed


@pytest.mark.slow
def test_killed_and_resumed(tmp_path, undisturbed):
    program = "import sys; from test_data_plants import made; made(sys.argv[1])"
    folder = tmp_path / "data"
    with subprocess.Popen([sys.executable, "-c", program, folder], env=environment()) as child:
        while not list(folder.glob("shard-*")) and child.poll() is None:
            time.sleep(0.001)
        child.send_signal(signal.SIGKILL)
    assert child.returncode == -signal.SIGKILL
    made(folder)
    assert contents(folder) == undisturbed


def test_a_worker_without_the_module_says_so():
    configuration = Configuration(plant, TRAIN, STAGE, 3, 100, 50, False).to_json()
    configuration["plant"]["entry"] = "gone:plant"
    with pytest.raises(DatasetError, match="A worker.*no module 'gone'.*all workers the same"):
        shards.made(configuration, Shard("", 0, 1))


# What can go wrong.


CHANGES = {
    "design": {"design": lambda t: 1.01 * design(t)},
    "simulate": {"simulate": lambda t, u, rng: 1.01 * simulate(t, u, rng)},
    "noise": {"noise": 0.021},
    "prior": {"prior": {"K": (0.5, 2.1), "T": (0.2, 1.0)}},
    "coordinates": {"coordinates": plants.Coordinates(lambda g: g, lambda x: x)},
    "u": {"u": np.roll(U, 1)},
    "recordings": {"simulate": wandering},
    "targets": {"coordinates": replace(plants.LOG, names=None)},
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_plant_that_changed_since_is_refused(what, begun, whole, monkeypatch):
    now = described(**CHANGES[what])
    monkeypatch.setattr(first_order, "plant", now)
    before = contents(begun)
    with pytest.raises(DatasetError, match=f"holds another data set: .*plant.*{what}"):
        made(begun, now)
    assert contents(begun) == before
    for use in (Folder, verify, load_gains, data.train_plant):
        with pytest.raises(DatasetError, match=f"not of the first_order:plant.*{what}.*Restore"):
            use(whole.path)
    with pytest.raises(DatasetError, match="A worker.*not of the first_order:plant"):
        shards.made(whole.manifest.configuration, Shard("", 0, 1))
    assert len(Folder(whole.path, described(entry=""))) == EPISODES  # as it was


def test_what_no_row_follows_from_may_change(begun, undisturbed, monkeypatch):
    now = described(
        signals=("valve", "flow"), metrics={"gain": 1.0}, evaluate=lambda t, g: g[:, :1]
    )
    monkeypatch.setattr(first_order, "plant", now)
    made(begun, now)
    assert contents(begun) == undisturbed


def test_another_machines_rounding_is_no_change(begun, undisturbed, monkeypatch):
    def rounded(theta, u, rng):
        return (1 + 1e-9) * simulate(theta, u, rng)

    monkeypatch.setattr(first_order, "plant", described(simulate=rounded))
    then, now = (fingerprint.of_episodes(p)["answers"] for p in (plant, first_order.plant))
    assert then["simulate"] != now["simulate"]
    assert fingerprint.alike(then["simulate"], now["simulate"])
    assert len(made(begun, first_order.plant)) == EPISODES
    assert (
        json.loads((begun / "_manifest.json").read_bytes())["configuration"]
        == (json.loads(undisturbed["_manifest.json"])["configuration"])
    )


def test_where_there_are_no_gains_counts_too():
    ends = [described(design=lambda t, e=e: np.where(t < e, design(t), np.nan)) for e in (9, 0.7)]
    every, some = (fingerprint.of_episodes(p)["answers"]["design"] for p in ends)
    assert np.isfinite(some).all() and not fingerprint.alike(every, some)


def test_a_missing_module_is_refused(own_module):
    own = plants.find("my_plant:plant", own_module)
    made(own_module / "data", own, episodes=60)
    del sys.modules["my_plant"]
    assert len(Folder(own_module / "data")) == 60  # found beside the folder
    del sys.modules["my_plant"]
    (own_module / "my_plant.py").unlink()
    for use in (Folder, verify, data.train_plant):
        with pytest.raises(DatasetError, match="no module 'my_plant'.*PYTHONPATH"):
            use(own_module / "data")
    assert verify(own_module / "data", plant=own)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"entry": ""}, 'A data set must find its plant again.*entry="my_plant:plant"'),
        ({"entry": "gone:plant"}, "no module 'gone'"),
        ({"noise": 0.5}, "not of the first_order:plant that is found here: the plant's noise"),
        ({"gains": ("u", "Ti")}, "'u' would be the name of two columns"),
        ({"gains": ("kp", "response_1")}, "'response_1' would be the name"),
        ({"prior": {"K": (0.5, 2.0), "y": (0.2, 1.0)}}, "'y' would be"),
    ],
)
def test_what_cannot_be_a_data_set_is_refused_before_any_work(change, words, tmp_path):
    with pytest.raises(ValueError, match=words):
        made(tmp_path / "data", described(**change))
    assert not (tmp_path / "data").exists()


def test_sets_and_folders_that_are_the_vehicles_own(whole, tmp_path):
    beyond = CONTEXT_SETS["extrapolation"]
    with pytest.raises(ValueError, match="contexts = 'extrapolation'.*train, test or calibration"):
        generate(plant, beyond, STAGE, 20, 0, tmp_path / "data")
    with pytest.raises(ValueError, match="'first_order:plant' is neither a Task nor a"):
        generate("first_order:plant", TRAIN, STAGE, 20, 0, tmp_path / "data")
    assert not (tmp_path / "data").exists()
    with pytest.raises(DatasetError, match="holds no vehicles. Use tuners.data.train_plant"):
        data.train("ts-ff-lag", whole.path)
    with pytest.raises(DatasetError, match="holds vehicles. Use tuners.data.train."):
        data.train_plant(of_vehicles(tmp_path / "cars", 20, task=TASK).path)
    with pytest.raises(DatasetError, match="features of Laguerre.*Generate"):
        data.train_plant(whole.path, Recipe(Laguerre(5, 2.0), QUICK["network"]))


def test_from_the_command_line(own_module):
    options = "--vehicle", own_module / "my.toml", "--out", own_module.parent / "data"
    code, out, _ = call("dataset", *options, "--episodes", "1e2", "--workers", 1)
    assert code == 0 and out.endswith("data: 100 episodes\n")
    assert call("dataset", *options, "--verify")[1].endswith("100 episodes, intact\n")
    suited = plants.training.recipe_for(plant).compressor
    assert Folder(own_module.parent / "data").recipe.compressor == suited
    response = (*options[:3], own_module / "r", "--episodes", 20, "--compressor", "response")
    assert "are a vehicle's" in refused(2, "dataset", *response)
    assert "'extrapolation'" in refused(
        1, "dataset", *options[:3], own_module / "other", "--episodes", 20,
        "--context", "extrapolation",
    )  # fmt: skip


def test_a_tuner_is_trained_from_the_command_line(own_module, tmp_path, monkeypatch):
    small = Recipe(STAGE, QUICK["network"])
    monkeypatch.setattr("tuners.data.training.recipe_for", lambda _: small)
    monkeypatch.setattr("tuners.cli.plant.VALIDATION", 64)
    file, out = own_module / "my.toml", tmp_path / "my.tuner"
    own = plants.find("my_plant:plant", own_module)
    folder = made(own_module / "data", own, raw=True).path
    saved = []
    for vehicle in ((), ("--vehicle", file)):  # the folder says what it is of
        code, words, err = call("train", "--data", folder, "-o", out, *vehicle)
        assert code == 0 and "training two-stage" in err and "calibrating" in err, err
        assert "of 64 without stable loop" in words and "of Ti" in words
        saved.append(out.read_bytes())
    assert saved[0] == saved[1] and plants.load(out, own).training["vehicles"] == EPISODES
    (own_module / "car.toml").write_text(paper())
    train = "train", "-o", tmp_path / "no.tuner", "--data"
    line = refused(2, *train, folder, "--vehicle", own_module / "car.toml")
    assert "holds plants, and the --vehicle is a vehicle's file. Leave it out" in line
    cars = of_vehicles(tmp_path / "cars", 20, task=TASK).path
    assert "holds vehicles, and the --vehicle is a plant's" in refused(
        2, *train, cars, "--vehicle", file
    )
    (another(tmp_path) / "my.toml").write_text(file.read_text())
    other = refused(1, *train, folder, "--vehicle", tmp_path / "other" / "my.toml")
    assert "not of the my_plant:plant" in other and "prior" in other
    (own_module / "motor.toml").write_text('[plant]\nentry = "dc_motor:plant"\n')
    (own_module / "dc_motor.py").write_text((ROOT / "examples/plants/dc_motor.py").read_text())
    line = refused(1, *train, folder, "--vehicle", own_module / "motor.toml")
    assert "is of my_plant:plant, not of dc_motor:plant. Give the plant that it is of" in line
