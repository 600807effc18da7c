"""The same episodes to every tuner, and what is written about them."""

import csv
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from families import FAMILIES, observed, reference, trained

from tuners.tuner.evaluation import columns, evaluate, write_csv
from tuners.tuner.method import Gains
from tuners.tuner.rivals import Nominal
from tuners.tuner.tuner import Tuner
from yawrate_env.loop.target import Target
from yawrate_env.plant.names import split
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

BRIEF = yaw_rate(Task(experiment=Experiment(Ts=0.01, N=200)))
PRINTED = yaw_rate(Task(experiment=Experiment(Ts=0.01, N=200), target=Target(controller="printed")))


def evaluated(tuners, plant, name="test", episodes=5, seed=0, **settings):
    return evaluate(tuners, plant, name, episodes=episodes, seed=seed, **settings)


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_rows_hold_the_numbers_to_twelve_digits(tuner, family, plant, tmp_path):
    chosen = {"own": tuner, "nominal": reference(family, Nominal)}
    found = evaluated(chosen, plant, episodes=3)
    write_csv(tmp_path / "rows.csv", found)
    rows = table(tmp_path / "rows.csv")
    assert [(r["tuner"], r["episode"]) for r in rows] == [
        (name, str(k)) for name in chosen for k in range(3)
    ]
    metrics = [split(name)[0] for name in plant.counted]
    assert list(rows[0]) == list(columns(plant)) == [
        "tuner", "episode", *plant.prior, *plant.gains, *metrics, "stable", "seconds",
    ]  # fmt: skip
    names = [*plant.prior, *plant.gains, *metrics]
    written = np.array([[float(r[name]) for name in names] for r in rows])
    numbers = np.concatenate([np.concatenate([e.theta, e.gains, e.metrics], 1) for e in found])
    np.testing.assert_allclose(written, numbers, rtol=1e-11, atol=1e-15)
    assert all(float(r["seconds"]) > 0 for r in rows)
    # The metrics are those of the written gains and plant.
    theta, gains = written[:, : len(plant.prior)], written[:, len(plant.prior) :][:, :2]
    np.testing.assert_allclose(
        plant.metric_values(theta, gains), written[:, -len(metrics) :], rtol=1e-8, atol=1e-9
    )


def test_evaluation_and_policy_give_the_same(tuner, plant, episodes):
    (found,) = evaluated({"own": tuner}, plant, episodes=4, batch=4)
    np.testing.assert_array_equal(found.theta, episodes.known[:4])
    actions, _ = tuner.predict(observed(plant, episodes)[:4])
    np.testing.assert_allclose(found.gains, actions, rtol=1e-9)
    errors = found.metrics - plant.targets(found.theta)
    np.testing.assert_allclose(errors, plant.errors(found.theta, actions), rtol=1e-6, atol=1e-9)


def test_seed_and_set_decide_the_episodes():
    first, again, other, train = (
        evaluated({"nominal": Tuner(BRIEF, Nominal())}, BRIEF, name, seed=seed)[0].theta
        for name, seed in (("test", 1), ("test", 1), ("test", 2), ("train", 1))
    )
    np.testing.assert_array_equal(first, again)
    assert not np.isin(first[:, 0], np.concatenate([other, train])[:, 0]).any()


def test_neither_company_nor_batches_nor_blocks_matter():
    name, calls = "vehicle", []
    plant, chosen = FAMILIES[name], {"own": trained(name), "nominal": reference(name, Nominal)}
    first, *others = (
        evaluated(chosen, plant, episodes=140, batch=b, progress=lambda *at: calls.append(at))
        for b in (140, 50)
    )
    done = [done for done, _ in calls]
    assert {of for _, of in calls} == {280} and done[-1] == 280
    alone = [evaluated({k: tuner}, plant, episodes=5, batch=1)[0] for k, tuner in chosen.items()]
    for other in (*others, alone):
        for a, b in zip(first, other, strict=True):
            np.testing.assert_array_equal(a.theta[: len(b.theta)], b.theta)
            # Matrix products of other sizes round otherwise.
            np.testing.assert_allclose(a.gains[: len(b.gains)], b.gains, rtol=1e-9)
            np.testing.assert_array_equal(a.stable[: len(b.stable)], b.stable)


class Reckless:
    """Far too much gain for every second vehicle, hardly any for the others."""

    kind, needs_excitation, any_measured, any_experiment = "reckless", False, False, True

    def gains(self, plant, recording):
        kp = np.where(np.arange(len(recording)) % 2 == 0, 10.0, 1e-3)
        everyone = np.ones(len(kp), dtype=bool)
        return Gains.of(np.stack([kp, np.full(len(kp), 100.0)], axis=1), everyone, everyone)


def test_unstable_loops_and_undefined_metrics_are_written_as_they_are(tmp_path):
    # The printed controller has no integrator: with little gain there is no crossover.
    found = evaluated({"reckless": Tuner(PRINTED, Reckless())}, PRINTED, episodes=4, batch=4)
    write_csv(tmp_path / "rows.csv", found)
    rows = table(tmp_path / "rows.csv")
    assert [r["kp"] for r in rows] == ["10", "0.001"] * 2
    for name in ("phase_margin", "crossover"):
        assert [r[name] == "nan" for r in rows] == [False, True] * 2
    assert [r["stable"] for r in rows][1::2] == ["True"] * 2
    pi = evaluated({"reckless": Tuner(BRIEF, Reckless())}, BRIEF, episodes=2, batch=2)
    assert not pi[0].stable[0] and np.isfinite(pi[0].metrics[0, 0])


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path):
    found = evaluated({"nominal": Tuner(BRIEF, Nominal())}, BRIEF, episodes=1)
    with pytest.raises(OSError):
        write_csv(tmp_path / "absent" / "rows.csv", found)
    broken = dataclasses.replace(found[0], seconds=np.array([None]))
    with pytest.raises(TypeError):
        write_csv(tmp_path / "rows.csv", [broken])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("wrong", [{"episodes": 0}, {"seed": -1}, {"batch": 1.5}, {"name": "tset"}])
def test_wrong_arguments_are_refused(wrong):
    name = "set of episodes = 'tset'" if "name" in wrong else next(iter(wrong))
    with pytest.raises(ValueError, match=name):
        evaluated({"nominal": Tuner(BRIEF, Nominal())}, BRIEF, **wrong)


def test_seconds_are_an_episodes_share_of_its_batch(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    clock.perf_counter = lambda: clock.now

    class Slow(Nominal):
        def gains(self, plant, recording):
            clock.now += 6.0
            return super().gains(plant, recording)

    monkeypatch.setattr("tuners.tuner.evaluation.time", clock)
    slow = {"slow": Tuner(BRIEF, Slow())}
    (single,) = evaluated(slow, BRIEF, episodes=4)
    (batch,) = evaluated(slow, BRIEF, episodes=4, batch=3)
    assert single.seconds.tolist() == [6.0] * 4
    assert batch.seconds.tolist() == [2.0] * 3 + [6.0]
    assert clock.now == 6.0 * (1 + 4 + 1 + 2)  # once more each, before the clock runs
