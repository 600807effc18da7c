"""Damage that no format tells of: channels that stand still in part, and bytes in between."""

import numpy as np
import pytest

from studies.log_files import log_files
from studies.log_writers import PLAIN
from tuners.catalogue import load
from tuners.logs import LogError, read_log
from tuners.logs.lost import alone, frozen

PLANT = load("ts-ff-lag-vx").plant
Y = PLAIN["yaw_rate"]
N = len(Y)
RNG = np.random.default_rng(3)
TURNING = int(np.abs(Y).argmax())
LOST = slice(TURNING - 5, TURNING + 45)


def lost(values, value=0.0):
    found = values.copy()
    found[LOST] = value
    return found


def test_what_was_lost_from_a_channel_that_moves():
    cut = lost(Y)
    cut[LOST.start] = 1e-318  # a number of which some bytes were lost
    for spoilt in (lost(Y), lost(Y, Y[TURNING - 5]), cut):
        assert np.array_equal(np.flatnonzero(frozen(spoilt)), np.arange(N)[LOST])


CHANNELS = {
    "as recorded": Y,
    "quantised": lost(np.round(Y, 2)),
    "held for ten samples": np.repeat(Y[::10], 10)[:N],
    "at rest, then moving": np.concatenate([np.zeros(N), Y - Y[0]]),
    "steps of a plant without noise": np.repeat(RNG.standard_normal(20), 60),
    "a limit that it comes to rest at": np.clip(Y, -0.06, 0.06),
    "constant": np.zeros(N),
    "not known in part": np.where(np.arange(N) == 7, np.nan, lost(Y)),
    "one sample": Y[:1],
}


@pytest.mark.parametrize("values", CHANNELS.values(), ids=CHANNELS)
def test_what_stands_still_for_other_reasons_is_kept(values):
    assert not frozen(values).any()


def test_what_was_lost_is_left_out_of_a_log_and_said(tmp_path):
    path, columns = tmp_path / "log.csv", PLAIN | {"yaw_rate": lost(Y)}
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    log = read_log(path, PLANT)
    assert any("yaw_rate" in note and "50 samples" in note for note in log.notes)
    assert not frozen(log.y).any()


def test_bytes_that_came_between_are_no_other_samples(tmp_path):
    pytest.importorskip("h5py")
    file = next(file for file in log_files() if file.name == "units.h5")
    file.write(tmp_path / file.name)
    content = (tmp_path / file.name).read_bytes()
    at = len(content) // 2
    (tmp_path / file.name).write_bytes(content[:at] + bytes(40) + content[at:])
    with pytest.raises(LogError, match="damaged"):
        read_log(tmp_path / file.name, PLANT)


@pytest.mark.parametrize("k", [2, 3, 600, 601, N - 3])
@pytest.mark.parametrize("value", [0.6, -0.6, np.pi * 1e-300, 1e19])
def test_single_samples_that_were_lost(k, value):
    spoilt = Y.copy()
    spoilt[k] = value if abs(value) > 1e-200 else Y[k] + 0.05
    assert np.flatnonzero(alone(spoilt)).tolist() == [k]


def test_two_lost_samples_near_each_other_are_not_taken_for_one():
    spoilt = Y.copy()
    spoilt[[400, 401, 800, 807]] += 0.3
    assert np.flatnonzero(alone(spoilt)).tolist() == [800, 807]


HEAVY = {
    **CHANNELS,
    "white noise": RNG.standard_normal(N),
    "noise of heavy tails": RNG.standard_t(3, N),
    "a plant that follows at once": np.repeat(RNG.standard_normal(N // 4), 4),
    "short": np.eye(50)[20],
}


@pytest.mark.parametrize("values", HEAVY.values(), ids=HEAVY)
def test_samples_that_are_like_others_are_kept(values):
    assert not alone(values).any()
