"""The same episodes for every tuner, and the CSV file of the results."""

import csv
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import tuners
from tuners.tuner.evaluation import columns, evaluate, write_csv
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())
SHORT = yaw_rate(Task(experiment=Experiment(N=300)))
HEADER = "tuner,episode,mu_s,M_delta,v_x,kp,Ti,phase_margin,crossover,stable,seconds"


def evaluated(names, plant=PLANT, name="test", episodes=5, seed=0, **settings):
    chosen = names if isinstance(names, dict) else {n: tuners.load(n, None) for n in names}
    return evaluate(chosen, plant, name, episodes=episodes, seed=seed, **settings)


@pytest.fixture(scope="module")
def found():
    return evaluated(["ts-ff", "ts-gbm", "gb", "nominal", "oracle"])


def table(path, evaluations):
    write_csv(path / "rows.csv", evaluations)
    with open(path / "rows.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_columns_are_the_agreed_ones(found, tmp_path):
    rows = table(tmp_path, found)
    lines = (tmp_path / "rows.csv").read_text().splitlines()
    assert lines[0] == HEADER == ",".join(columns(PLANT)) and len(lines) == 1 + 5 * 5
    assert [(r["tuner"], r["episode"]) for r in rows] == [
        (e.tuner, str(k)) for e in found for k in range(5)
    ]
    assert {r["stable"] for r in rows} == {"True"}


def test_rows_hold_twelve_digits_and_the_margins_of_their_gains(found, tmp_path):
    rows = table(tmp_path, found)
    written = np.array([[float(value) for value in list(r.values())[2:9]] for r in rows])
    exact = [np.concatenate([e.theta, e.gains, e.metrics], axis=1) for e in found]
    np.testing.assert_allclose(written, np.concatenate(exact), rtol=1e-11)
    values, _ = PLANT.evaluation(written[:, :3], written[:, 3:5])
    np.testing.assert_allclose(written[:, 5:], values[:, :2], rtol=1e-9)
    assert all(float(r["seconds"]) > 0 for r in rows)


def test_every_tuner_gets_the_same_episodes_whatever_the_others(found):
    for one in found:
        np.testing.assert_array_equal(one.theta, found[0].theta)
    (alone,) = evaluated(["ts-ff"], episodes=3)
    np.testing.assert_array_equal(alone.gains, found[0].gains[:3])


def test_seed_and_set_determine_the_episodes():
    first, again, other, train, beyond = (
        evaluated(["nominal"], SHORT, name, 50, seed, batch=50)[0].theta
        for name, seed in (
            ("test", 1), ("test", 1), ("test", 2), ("train", 1), ("extrapolation", 1)
        )
    )  # fmt: skip
    np.testing.assert_array_equal(first, again)
    assert not np.isin(first[:, 0], np.concatenate([other, train])[:, 0]).any()
    assert ((beyond >= [1.1, 300.0, 20.0]) & (beyond <= [1.3, 500.0, 20.0])).all()


@pytest.mark.parametrize("name", ["ts-ff", "ts-gbm", "gb", "nominal", "oracle"])
def test_the_batch_size_changes_nothing_but_the_seconds(name):
    single, *others = (evaluated([name], episodes=12, batch=batch)[0] for batch in (1, 5, 64))
    for other in others:
        # Matrix products of other sizes round otherwise.
        np.testing.assert_allclose(other.gains, single.gains, rtol=1e-9)
        np.testing.assert_allclose(other.metrics, single.metrics, rtol=1e-9)
        np.testing.assert_array_equal(other.stable, single.stable)


def test_blocks_join_seamlessly():
    small, large = (
        evaluated(["nominal"], SHORT, episodes=300, batch=b)[0] for b in (100, 300)
    )  # fmt: skip
    assert len(small.gains) == 300
    for name in ("theta", "gains", "metrics", "stable"):
        np.testing.assert_array_equal(getattr(small, name), getattr(large, name))


@pytest.mark.parametrize(
    "task",
    [
        Task(experiment=Experiment(N=300)),
        Task(prior=Prior(v_x=(10.0, 30.0)), experiment=Experiment(N=300, register="random")),
        Task(target=Target(phase_margin=75.0, crossover=1.2), experiment=Experiment(N=300)),
    ],
    ids=["default", "speeds", "target"],
)
def test_the_oracle_makes_no_error(task):
    plant = yaw_rate(task)
    (found,) = evaluated({"": tuners.load("oracle", plant)}, plant, episodes=50, batch=50)
    # The design rule is exact; crossings are bisected to machine precision.
    np.testing.assert_allclose(found.metrics, np.tile(plant.target, (50, 1)), rtol=1e-9)
    assert found.stable.all()


def test_speeds_reach_the_tuners():
    plant = yaw_rate(Task(prior=Prior(v_x=(10.0, 30.0))))
    (found,) = evaluated({"gb": tuners.load("gb", plant)}, plant, episodes=6)
    assert np.ptp(found.theta[:, 2]) > 3
    # Ten standard deviations of the slippery and slow.
    np.testing.assert_allclose(found.metrics[:, 0], 60, atol=0.2)


class Reckless:
    """Far too much gain for every second vehicle, nearly none for the others."""

    def act(self, recording):
        kp = np.where(np.arange(len(recording)) % 2 == 0, 10.0, 1e-3)
        return np.stack([kp, np.full(len(kp), 100.0)], axis=1)


def test_unstable_loops_and_missing_margins_are_written_as_they_are(tmp_path):
    printed = Task(experiment=Experiment(N=300), target=Target(controller="printed"))
    # The printed controller has no integrator: with little gain there is no crossover.
    rows = table(tmp_path, evaluated({"": Reckless()}, yaw_rate(printed), episodes=4, batch=4))
    assert [r["kp"] for r in rows] == ["10", "0.001"] * 2
    assert [r["phase_margin"] == "nan" for r in rows] == [False, True] * 2
    assert [r["crossover"] == "nan" for r in rows] == [False, True] * 2
    assert [r["stable"] for r in rows][1::2] == ["True"] * 2
    (pi,) = evaluated({"": Reckless()}, SHORT, episodes=2, batch=2)
    assert not pi.stable[0] and np.isfinite(pi.metrics[0]).all()


def test_a_file_that_cannot_be_written_leaves_nothing(found, tmp_path):
    with pytest.raises(OSError):
        write_csv(tmp_path / "absent" / "rows.csv", found)
    broken = dataclasses.replace(found[0], seconds=np.array([None] * 5))
    with pytest.raises(TypeError):
        write_csv(tmp_path / "rows.csv", [broken])
    assert list(tmp_path.iterdir()) == []


def test_progress_is_reported_to_the_end():
    calls = []
    evaluated(["nominal", "oracle"], SHORT, episodes=300, batch=300,
              progress=lambda done, of: calls.append((done, of)))  # fmt: skip
    assert [of for _, of in calls] == [600] * len(calls)
    done = [d for d, _ in calls]
    assert done == sorted(done) and done[-1] == 600


@pytest.mark.parametrize("wrong", [{"episodes": 0}, {"seed": -1}, {"batch": 0}, {"batch": 1.5}])
def test_wrong_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        evaluated(["nominal"], SHORT, **wrong)


def test_an_unknown_set_is_refused():
    with pytest.raises(ValueError, match="moon"):
        evaluated(["nominal"], SHORT, "moon")


def test_seconds_are_an_episodes_share_of_its_batch(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    clock.perf_counter = lambda: clock.now

    class Slow(Reckless):
        def act(self, recording):
            clock.now += 6.0
            return super().act(recording)

    monkeypatch.setattr("tuners.tuner.evaluation.time", clock)
    single, batch = (
        evaluated({"": Slow()}, SHORT, episodes=4, batch=b)[0].seconds.tolist() for b in (1, 3)
    )  # fmt: skip
    assert single == [6.0] * 4 and batch == [2.0] * 3 + [6.0]
    assert clock.now == 6.0 * (1 + 4 + 1 + 2)  # once more each, before the clock runs
