"""Plants whose simulator takes long: how often it is called, by whom, and what comes of it."""

import signal
import sqlite3
import subprocess
import sys

import numpy as np
import pytest
import slow_plant
from data_sets import environment
from first_order import TS, described
from slow_plant import calls, linear, plant, recording, slowly

import tuners
from tuners.trust.emulator import OutputEmulator
from tuners.tuner.emulator_check import emulator_shift
from tuners.tuner.recording import Recording
from tuners.tuner.simulations import STAGE, simulating, slowness
from yawrate_env.plant.episodes import drawn, recorded
from yawrate_env.signals.excitation import multilevel, prbs

QUIET = {"progress": lambda *_: None, "workers": 1}
FEW = {"episodes": 200, "calibration": 60}


@pytest.fixture(scope="module")
def trained():
    calls.clear()
    return tuners.train(linear, **FEW, **QUIET), len(calls)


def test_a_small_training_counts_what_it_simulates(trained):
    tuner, count = trained
    # 256 to train with, 640 of steps, 256 to judge with at up to 5 each, 128 to check with.
    assert count < 2400
    assert tuner.training["emulator"]["shift"] < 0.05
    assert max(tuner.training["ratio"].values()) < 1.1


@pytest.mark.parametrize("theta", [(1.3, 0.45), (0.55, 0.25), (1.9, 0.9), (2.6, 1.3)])
def test_a_recording_takes_few_simulations_and_gets_the_answer_of_many(trained, theta, tmp_path):
    tuner, _ = trained
    tuner.save(tmp_path / "slow.tuner")
    again = tuners.load(tmp_path / "slow.tuner")
    calls.clear()
    result, then = (each.tune(plant.u, recording(theta)) for each in (tuner, again))
    assert len(calls) <= 2 * 20
    assert then.gains == result.gains and then.intervals == result.intervals
    quick = described(linear=True)
    exact = tuners.load("gb", quick).tune(plant.u, recording(theta))
    found, right = (each.fit.parameters for each in (result, exact))
    for name in quick.prior:
        assert found[name] == pytest.approx(right[name], rel=1e-3)
    assert result.trusted == (theta[0] < 2)


def test_another_input_of_a_linear_plant_is_known_and_that_of_another_is_not():
    theta = drawn(linear, "train", 0, 256)
    other = np.concatenate([np.zeros(20), 0.3 * np.ones(700), -0.5 * np.ones(80)])
    emulator = OutputEmulator.of(linear, theta)
    assert emulator.knows(other[None])
    test = drawn(linear, "test", 0, 50)
    error = emulator(test, other) - linear.respond(test, other)
    assert np.sqrt((error**2).mean(axis=1)).max() < 0.05 * linear.noise
    bent = slowly(simulate=slow_plant.steepened, entry="")
    emulator = OutputEmulator.of(bent, theta)
    assert emulator.knows(bent.u[None]) and emulator.knows(bent.u[None, :300])
    assert not emulator.knows(other[None]) and not emulator.knows(1.1 * bent.u[None])
    error = emulator(test, bent.u) - bent.respond(test)
    assert np.sqrt((error**2).mean(axis=1)).max() < 0.05 * bent.noise


BENT = slowly(simulate=slow_plant.bent, entry="")
INPUTS = {
    "sequence": prbs(500, TS, 0.3, 0.8, order=9)[0],
    "levels": multilevel(600, TS, 0.5, 1.0, 4)[0],
    "steps": np.repeat([0.0, 0.5, 1.0, -0.5, 0.3], 120),
}


@pytest.fixture(scope="module")
def bent():
    return tuners.train(BENT, **FEW, **QUIET)


@pytest.mark.parametrize("name", INPUTS)
def test_another_input_of_a_nonlinear_plant_takes_few_simulations_too(bent, name):
    u, quick = INPUTS[name], described(simulate=slow_plant.steep)
    for theta in ((0.6, 0.9), (1.3, 0.45), (1.9, 0.25)):
        y = slow_plant.steep(np.array([theta]), u, None)[0]
        y = y + quick.noise * np.random.default_rng(1).standard_normal(len(u))
        calls.clear()
        result = bent.tune(u, y)
        assert len(calls) <= 20
        right = tuners.load("gb", quick).tune(u, y)
        for parameter, value in right.fit.parameters.items():
            assert result.fit.parameters[parameter] == pytest.approx(value, rel=1e-3)
        assert result.verdict == right.verdict
    assert emulator_shift(bent, u=u, plants=4) < 0.05


def test_what_was_simulated_is_not_simulated_again():
    theta = drawn(plant, "train", 0, 5)
    with simulating(plant, workers=1) as ready:
        calls.clear()
        first, again = ready.respond(theta), ready.respond(theta[::-1])
        ready.respond(theta, 2 * plant.u)
    assert len(calls) == 10
    np.testing.assert_array_equal(again[::-1], first)
    np.testing.assert_array_equal(first, plant.respond(theta))


@pytest.mark.slow
def test_random_plants_get_their_own_random_numbers_whoever_simulates():
    random = slowly(simulate=slow_plant.noisy)
    blocks = []
    for workers in (1, 2):
        with simulating(random, workers=workers) as ready:
            quiet = ready.respond(recorded(ready, "train", 0, 4).theta)
            blocks.append(recorded(ready, "train", 0, 4).y)
            fresh = recorded(ready, "train", 0, 4, 1).y
    np.testing.assert_array_equal(*blocks)
    offsets = (blocks[0] - quiet).mean(axis=1)
    assert len(np.unique(offsets)) == 4 and np.abs(offsets).max() > 0.02
    assert not np.isclose(offsets, (fresh - quiet).mean(axis=1)).any()


def test_a_simulation_that_fails_is_named_by_its_plant():
    failing = slowly(simulate=slow_plant.failing)
    theta = np.array([[1.0, 0.5], [1.25, 0.95]])
    with simulating(failing, workers=1) as ready:
        with pytest.raises(ValueError, match=r"simulate for K = 1.25, T = 0.95.*no such lag"):
            ready.respond(theta)


def test_a_file_of_another_plant_is_refused(tmp_path):
    with simulating(plant, workers=1, checkpoint=tmp_path / "kept"):
        pass
    other = slowly(noise=0.03)
    with pytest.raises(ValueError, match="checkpoint.*noise"):
        with simulating(other, workers=1, checkpoint=tmp_path / "kept"):
            pass
    (tmp_path / "text").write_text("not a database, but long enough to be read as one" * 9)
    with pytest.raises(ValueError, match="checkpoint.*text"):
        with simulating(plant, workers=1, checkpoint=tmp_path / "text"):
            pass
    with simulating(plant, workers=1, checkpoint=tmp_path / "kept") as ready:
        ready.respond(plant.middle)
        with pytest.raises(ValueError, match="checkpoint.*locked"):
            with simulating(plant, workers=1, checkpoint=tmp_path / "kept"):
                pass


@pytest.mark.parametrize(
    "argument", [{"workers": 2}, {"scheduler": "local"}, {"checkpoint": "kept"}]
)
def test_other_plants_take_no_processes(argument):
    (name,) = argument
    with pytest.raises(ValueError, match=f"{name}.*slow=True"):
        tuners.train(described(), episodes=60, **argument)


def test_a_plant_that_should_be_called_slow_is_told():
    class Clock:
        def __call__(self, theta, u, rng):
            slow_plant.time.sleep(0.04)
            return slow_plant.by_one(slow_plant.simulate)(theta, u, rng)

    late = slowly(simulate=Clock(), slow=False)
    assert "slow=True" in slowness(late)
    assert not slowness(plant) and not slowness(described())
    with pytest.raises(ValueError, match="slow"):
        described(slow=True, record=lambda *_: None)


def test_bars_of_a_slow_plant_are_shown_by_default(capsys):
    tuners.train(linear, episodes=60, calibration=0, workers=1)
    shown = capsys.readouterr().err
    assert f"{STAGE}: 100%" in shown.replace("\r", "\n") and "training" in shown


KILLED = """
import hashlib, os, signal, sys
import tuners
from slow_plant import plant
from tuners.tuner.simulation_store import Store

put, left = Store.put, int(sys.argv[1])

def counted(self, key, y):
    global left
    left -= 1
    if not left:
        os.kill(os.getpid(), signal.SIGKILL)
    put(self, key, y)

Store.put = counted
tuner = tuners.train(plant, episodes=60, calibration=0, progress=lambda *_: None,
                     workers=int(sys.argv[3]), checkpoint=sys.argv[2] + ".kept")
tuner.save(sys.argv[2])
"""


@pytest.mark.slow
def test_killed_three_times_it_is_the_same_tuner(tmp_path):
    def run(name, kill_at, workers):
        program = [sys.executable, "-c", KILLED, str(kill_at), str(tmp_path / name), str(workers)]
        return subprocess.run(program, env=environment(), timeout=120).returncode

    assert run("whole.tuner", 0, 1) == 0
    for kill_at in (60, 70, 80):
        assert run("killed.tuner", kill_at, 2) == -signal.SIGKILL
    kept = sqlite3.connect(tmp_path / "killed.tuner.kept")
    assert kept.execute("SELECT COUNT(*) FROM outputs").fetchone()[0] >= 200
    kept.close()
    assert run("killed.tuner", 0, 2) == 0
    whole, killed = ((tmp_path / f"{n}.tuner").read_bytes() for n in ("whole", "killed"))
    assert killed == whole


@pytest.mark.slow
def test_a_cluster_gives_the_same_outputs_and_names_what_fails():
    pytest.importorskip("distributed")
    theta = np.array([[1.0, 0.5]])
    failing = slowly(simulate=slow_plant.failing)
    with simulating(failing, workers=1, scheduler="local") as ready:
        np.testing.assert_array_equal(ready.respond(theta), plant.respond(theta))
        with pytest.raises(ValueError, match=r"simulate for K = 1, T = 0.95.*no such lag"):
            ready.respond(np.array([[1.0, 0.95]]))


@pytest.mark.slow
def test_the_default_training_takes_at_most_8000_simulations():
    calls.clear()
    tuner = tuners.train(plant, **QUIET)
    assert len(calls) <= 8000
    block = recorded(plant, "test", 0, 300)
    calls.clear()
    gains, found = tuner.assess(Recording(block.u, block.y, plant.Ts, block.theta))
    assert len(calls) <= 20 * 300
    assert found.trusted.mean() >= 0.98
    actual = plant.metric_values(block.theta, gains.values)
    half = np.array(tuner.calibration) * found.spread
    covered = (np.abs(actual - found.metrics) <= half).mean(axis=0)
    assert (covered > 0.85).all() and (covered < 0.95).all()
