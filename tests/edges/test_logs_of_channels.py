"""Logs with a column for each of several inputs and outputs, in any order and unit."""

import json

import numpy as np
import pytest
from command import call
from pages import check_whole
from recordings import ROOT
from two_by_two import TS, N, plant

import tuners
from tuners.logs import LogError, SelectionError, read_log
from yawrate_env.plant.episodes import recorded

HEAD = "bottom [mK],time [s],steam [kg/s],top [K],reflux [g/s]"


@pytest.fixture(scope="module")
def recording():
    block = recorded(plant, "test", 2, 1)
    return block.u[0], block.y[0]


def written(path, recording, head=HEAD, **changes):
    (reflux, steam), (top, bottom) = recording
    columns = {"b": 1000 * bottom, "t": TS * np.arange(N), "s": steam, "o": top, "r": 1000 * reflux}
    table = np.stack(list({**columns, **changes}.values()), axis=1)
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.17g")
    return path


def test_each_channel_is_read_from_its_column(tmp_path, recording):
    log = read_log(written(tmp_path / "log.csv", recording), plant)
    np.testing.assert_allclose(log.u, recording[0], rtol=1e-12)
    np.testing.assert_allclose(log.y, recording[1], rtol=1e-12)
    assert log.duration == N * TS and len(log.time) == N
    assert sum("was converted" in note for note in log.notes) == 2


@pytest.mark.parametrize("head, changes, name", [
    (HEAD.replace("top [K]", "other [K]"), {}, "top"),
    (HEAD.replace("steam [kg/s]", "valve [kg/s]"), {}, "steam"),
    (HEAD, {"s": np.zeros(N)}, "steam"),
    (HEAD, {"o": np.full(N, 2.0)}, "top"),
])  # fmt: skip
def test_channels_that_are_missing_or_still_are_named(tmp_path, recording, head, changes, name):
    with pytest.raises((LogError, SelectionError), match=name):
        read_log(written(tmp_path / "log.csv", recording, head, **changes), plant)


def test_a_column_of_another_name_is_named_by_its_channel(tmp_path, recording):
    (tmp_path / "two.toml").write_text('[plant]\nentry = "two_by_two:plant"\n')
    log = written(tmp_path / "log.csv", recording, HEAD.replace("steam", "valve"))
    given = "tune", log, "--plant", tmp_path / "two.toml", "--json"
    status, _, err = call(*given)
    assert status == 1 and "steam" in err and "--column steam=" in err and err.count("\n") == 1
    status, out, _ = call(*given, "--column", "steam=valve")
    assert status == 0 and json.loads(out)["trusted"]
    for wrong in ("steam=vent", "steel=valve", "steam"):
        status, _, err = call(*given, "--column", wrong)
        assert status == 2 and wrong.partition("=")[0] in err
    status, _, err = call(*given[:4], "--tuner", "ts-ff-lag")
    assert status == 2 and "--plant" in err


def test_of_a_long_log_the_stretch_is_used_that_moves_all_inputs(tmp_path):
    """In the first third one input stands still, then both move."""
    u = np.concatenate([plant.u, plant.u, plant.u], axis=1)
    u[1, :N] = 0.0
    y = plant.respond(plant.middle, u)[0]
    columns = [TS * np.arange(3 * N), *u, *y]
    path = tmp_path / "long.csv"
    head = "t,reflux,steam,top,bottom"
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", header=head, comments="")
    log = read_log(path, plant)
    assert log.u.shape == (2, 2 * N) and log.t0 > 0.8 * N * TS
    assert log.whole.inputs.shape[0] == 2


def test_the_command_writes_the_inputs_and_answers_a_log(tmp_path, recording):
    (tmp_path / "two.toml").write_text('[plant]\nentry = "two_by_two:plant"\n')
    status, out, _ = call("excite", "--vehicle", tmp_path / "two.toml", "-o", tmp_path / "u.csv")
    assert status == 0 and "reflux" in out and "steam" in out
    table = np.genfromtxt(tmp_path / "u.csv", delimiter=",", names=True)
    np.testing.assert_allclose(np.stack([table[n] for n in table.dtype.names[1:]]), plant.u)
    tuners.load("gb", plant).save(tmp_path / "two.tuner")
    log = written(tmp_path / "log.csv", recording)
    given = "tune", log, "--tuner", tmp_path / "two.tuner"
    status, out, _ = call(*given, "--json")
    answer, right = json.loads(out), tuners.load("gb", plant).tune(*recording)
    assert status == 0 and answer["trusted"]
    assert answer["gains"] == pytest.approx(right.gains, rel=1e-6)
    status, out, _ = call(*given, "--report", tmp_path / "r.html")
    assert status == 0 and "reflux" in out and "steam" in out
    for plant_file in (tmp_path / "two.toml", ROOT / "tests" / "two_by_two.py"):
        fitted = json.loads(call("tune", log, "--plant", plant_file, "--json")[1])
        assert fitted | {"tuner": answer["tuner"]} == answer
    status, _, err = call("check", log, "--plant", plant_file, "--kp", 1, "--Ti", 2)
    assert status == 2 and "--plant" in err
    check_whole((tmp_path / "r.html").read_text(), pictures=2 + 2 * 3)
