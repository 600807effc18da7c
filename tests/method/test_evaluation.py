"""The same episodes to every tuner, and what is written about them."""

import csv
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import tuners
from tuners.tuner.baselines import Nominal, Oracle
from tuners.tuner.evaluation import COLUMNS, evaluate, write_csv
from tuners.tuner.gray_box import GrayBox
from tuners.tuner.tuner import Tuner
from yawrate_env.loop.design import Design
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Experiment, Prior, Task

TEST = CONTEXT_SETS["test"]


def evaluated(names, contexts=TEST, task=None, episodes=5, seed=0, **settings):
    chosen = names if isinstance(names, dict) else {name: tuners.load(name) for name in names}
    return evaluate(chosen, task or Task(), contexts, episodes=episodes, seed=seed, **settings)


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_columns_are_the_agreed_ones(tmp_path):
    write_csv(tmp_path / "rows.csv", evaluated(["ts-ff", "nominal"], episodes=3))
    header = "tuner,episode,mu_s,M_delta,v_x,kp,Ti,phase_margin,crossover,stable,seconds"
    lines = (tmp_path / "rows.csv").read_text().splitlines()
    assert lines[0] == header == ",".join(COLUMNS)
    assert len(lines) == 1 + 2 * 3
    rows = table(tmp_path / "rows.csv")
    assert [(r["tuner"], r["episode"]) for r in rows] == [
        (name, str(k)) for name in ("ts-ff", "nominal") for k in range(3)
    ]
    assert {r["stable"] for r in rows} == {"True"}


def test_rows_hold_the_numbers_to_twelve_digits(tmp_path):
    (found,) = evaluated(["ts-ff"])
    write_csv(tmp_path / "rows.csv", [found])
    rows = table(tmp_path / "rows.csv")
    for name in ("kp", "Ti", "phase_margin", "crossover"):
        written = [float(r[name]) for r in rows]
        np.testing.assert_allclose(written, getattr(found, name), rtol=1e-11)
    for name in ("mu_s", "M_delta", "v_x"):
        written = [float(r[name]) for r in rows]
        np.testing.assert_allclose(written, getattr(found.context, name), rtol=1e-11)
    assert all(float(r["seconds"]) > 0 for r in rows)


def test_the_margins_are_those_of_the_written_gains_and_vehicle(tmp_path):
    write_csv(tmp_path / "rows.csv", evaluated(["ts-gbm"]))
    for r in table(tmp_path / "rows.csv"):
        judge = loops(Task(), Context.of(*(float(r[n]) for n in ("mu_s", "M_delta", "v_x"))))
        verdict = judge.evaluate(*(np.array([float(r[n])]) for n in ("kp", "Ti")))
        assert float(r["phase_margin"]) == pytest.approx(verdict.margins.phase_margin[0], rel=1e-9)
        assert float(r["crossover"]) == pytest.approx(verdict.margins.crossover[0], rel=1e-9)


def test_every_tuner_gets_the_same_episodes_whatever_the_company():
    together = evaluated(["nominal", "ts-ff", "gb"])
    for one in together:
        (alone,) = evaluated([one.tuner])
        for name in ("mu_s", "M_delta", "v_x"):
            values = getattr(one.context, name)
            np.testing.assert_array_equal(values, getattr(together[0].context, name))
            np.testing.assert_array_equal(values, getattr(alone.context, name))
        np.testing.assert_array_equal(one.kp, alone.kp)


def test_seed_and_context_set_decide_the_episodes():
    first, again, other, train = (
        evaluated(["nominal"], contexts=CONTEXT_SETS[name], seed=seed)[0].context.mu_s
        for name, seed in (("test", 1), ("test", 1), ("test", 2), ("train", 1))
    )
    np.testing.assert_array_equal(first, again)
    assert not np.isin(first, np.concatenate([other, train])).any()


def test_more_episodes_start_with_the_same():
    few, many = (evaluated(["ts-ff"], episodes=n)[0] for n in (3, 7))
    np.testing.assert_array_equal(few.kp, many.kp[:3])


@pytest.mark.parametrize("name", ["ts-ff", "ts-gbm", "gb", "nominal", "oracle"])
def test_the_batch_size_changes_nothing_but_the_seconds(name):
    single, *others = (evaluated([name], episodes=20, batch=batch)[0] for batch in (1, 7, 64))
    for other in others:
        for column in ("kp", "Ti", "phase_margin", "crossover"):
            # Matrix products of other sizes round otherwise.
            np.testing.assert_allclose(getattr(other, column), getattr(single, column), rtol=1e-9)
        np.testing.assert_array_equal(other.stable, single.stable)


def test_chunks_join_seamlessly():
    # 256 episodes are simulated at a time.
    (small,) = evaluated(["nominal"], task=SHORT, episodes=300, batch=100)
    (large,) = evaluated(["nominal"], task=SHORT, episodes=300, batch=300)
    assert len(small.kp) == 300
    for name in ("kp", "phase_margin", "crossover", "stable"):
        np.testing.assert_array_equal(getattr(small, name), getattr(large, name))
    np.testing.assert_array_equal(small.context.mu_s, large.context.mu_s)


SHORT = Task(experiment=Experiment(N=300))


@pytest.mark.parametrize(
    "task",
    [
        SHORT,
        Task(prior=Prior(v_x=(10.0, 30.0)), experiment=Experiment(N=300, register="random")),
        Task(target=Target(phase_margin=75.0, crossover=1.2), experiment=Experiment(N=300)),
    ],
    ids=["default", "speeds", "target"],
)
def test_the_oracle_makes_no_error(task):
    (found,) = evaluated({"oracle": Oracle(task)}, task=task, episodes=50, batch=50)
    # The design rule is exact; crossings are bisected to machine precision.
    np.testing.assert_allclose(found.phase_margin, task.target.phase_margin, rtol=1e-9)
    np.testing.assert_allclose(found.crossover, task.target.crossover, rtol=1e-9)
    assert found.stable.all()


def test_extrapolation_lies_beyond_the_prior():
    (found,) = evaluated(["oracle"], CONTEXT_SETS["extrapolation"], SHORT, episodes=100, batch=100)
    for values, low, high in ((found.context.mu_s, 1.1, 1.3), (found.context.M_delta, 300, 500)):
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < values.max() <= high
    np.testing.assert_array_equal(found.context.v_x, 20.0)


def test_speeds_reach_the_tuners():
    task = Task(prior=Prior(v_x=(10.0, 30.0)))
    (found,) = evaluated({"gb": GrayBox(task)}, task=task, episodes=6)
    assert np.ptp(found.context.v_x) > 3
    # Ten standard deviations of the slippery and slow.
    np.testing.assert_allclose(found.phase_margin, 60, atol=0.2)


class Reckless(Tuner):
    """Far too much gain for every second vehicle, none at all for the others."""

    kind = "reckless"

    def gains(self, recording):
        kp = np.where(np.arange(len(recording)) % 2 == 0, 10.0, 1e-3)
        everyone = np.zeros(len(kp), dtype=int)
        return Design(kp, np.full(len(kp), 100.0), everyone), everyone == 0


def test_unstable_loops_and_missing_margins_are_written_as_they_are(tmp_path):
    task = Task(experiment=Experiment(N=300), target=Target(controller="printed"))
    # The printed controller has no integrator: with little gain there is no crossover.
    found = evaluated({"reckless": Reckless(task)}, task=task, episodes=4, batch=4)
    write_csv(tmp_path / "rows.csv", found)
    rows = table(tmp_path / "rows.csv")
    assert [r["kp"] for r in rows] == ["10", "0.001"] * 2
    assert [r["phase_margin"] == "nan" for r in rows] == [False, True] * 2
    assert [r["crossover"] == "nan" for r in rows] == [False, True] * 2
    assert [r["stable"] for r in rows][1::2] == ["True"] * 2
    pi = evaluated({"reckless": Reckless(SHORT)}, task=SHORT, episodes=2, batch=2)
    assert not pi[0].stable[0] and np.isfinite(pi[0].phase_margin[0])


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path):
    found = evaluated(["nominal"], episodes=1)
    with pytest.raises(OSError):
        write_csv(tmp_path / "absent" / "rows.csv", found)
    broken = dataclasses.replace(found[0], seconds=np.array([None]))
    with pytest.raises(TypeError):
        write_csv(tmp_path / "rows.csv", [broken])
    assert list(tmp_path.iterdir()) == []


def test_progress_is_reported_to_the_end():
    calls = []
    evaluated(["nominal", "oracle"], task=SHORT, episodes=300, batch=300,
              progress=lambda done, of: calls.append((done, of)))  # fmt: skip
    assert [of for _, of in calls] == [600] * len(calls)
    done = [d for d, _ in calls]
    assert done == sorted(done) and done[-1] == 600


@pytest.mark.parametrize("wrong", [{"episodes": 0}, {"seed": -1}, {"batch": 0}, {"batch": 1.5}])
def test_wrong_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        evaluated({"nominal": Nominal(SHORT)}, task=SHORT, **wrong)


def test_seconds_are_an_episodes_share_of_its_batch(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    clock.perf_counter = lambda: clock.now

    class Slow(Nominal):
        def gains(self, recording):
            clock.now += 6.0
            return super().gains(recording)

    monkeypatch.setattr("tuners.tuner.evaluation.time", clock)
    (single,) = evaluated({"slow": Slow(SHORT)}, task=SHORT, episodes=4)
    (batch,) = evaluated({"slow": Slow(SHORT)}, task=SHORT, episodes=4, batch=3)
    assert single.seconds.tolist() == [6.0] * 4
    assert batch.seconds.tolist() == [2.0] * 3 + [6.0]
    assert clock.now == 6.0 * (1 + 4 + 1 + 2)  # once more each, before the clock runs
