"""The scoreboard: its scale, its intervals, its protocol and its page."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

import tuners
from studies import draws, results_page, scoreboard
from studies.scoreboard import PROTOCOL, Estimate
from tuners.tuner.evaluation import Evaluation
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())
THETA = draws.draw(PLANT, "test", 0, 0, 100).theta
TRUTH = PLANT.oracle(THETA)


def evaluation(name, gains):
    """Gains for the first test vehicles, evaluated."""
    values, stable = PLANT.evaluation(THETA, gains)
    return Evaluation(name, PLANT, THETA, gains, values[:, :2], stable, np.zeros(len(gains)))


def scaled(name, size):
    """The oracle's gains with errors of kp's logarithm, (standard deviation)."""
    noise = np.random.default_rng(0).standard_normal(len(THETA))
    return evaluation(name, TRUTH * np.stack([np.exp(size * noise), 0 * noise + 1], axis=1))


def board(*others, **errors):
    """Rows of the two ends, others, and oracles whose log gain is off by so much (std)."""
    middle = np.repeat(PLANT.oracle(PLANT.middle), len(THETA), axis=0)
    found = [
        evaluation("nominal", middle),
        evaluation("oracle", TRUTH),
        *others,
        *(scaled(name, size) for name, size in errors.items()),
    ]
    rows = scoreboard.rows(found, "test", {e.tuner: "" for e in found})
    return {row.tuner: row for row in rows}


@pytest.fixture(scope="module")
def rows():
    """Oracles that are off by more and more."""
    return board(**{"0.01": 0.01, "0.03": 0.03, "0.1": 0.1, "0.3": 0.3, "1": 1.0})


def test_the_scale_runs_from_nominal_to_oracle(rows):
    assert asdict(rows["nominal"].score) == {"value": 0, "low": 0, "high": 0}
    assert asdict(rows["oracle"].score) == {"value": 1, "low": 1, "high": 1}
    assert asdict(rows["oracle"].regret) == {"value": 0, "low": 0, "high": 0}


def test_worse_gains_score_less_and_regret_more(rows):
    assert list(rows) == ["oracle", "0.01", "0.03", "0.1", "nominal", "0.3", "1"]  # best first
    off = [row for name, row in rows.items() if name != "nominal"]
    for name, sign in (("score", -1), ("reward", -1), ("regret", 1), ("crossover", 1)):
        values = [getattr(row, name).value for row in off]
        assert (np.diff(values) * sign > 0).all(), name
    assert off[1].score.value > 0.8
    assert off[-1].score.value < 0  # worse than not looking
    assert off[-1].unstable > 0 == off[1].unstable


def test_intervals_contain_their_values(rows):
    for row in rows.values():
        for name in ("reward", "regret", "score", "phase_margin", "crossover"):
            estimate = getattr(row, name)
            slack = 1e-12 * abs(estimate.value)  # means of equal values round
            assert estimate.low - slack <= estimate.value <= estimate.high + slack, (row, name)
    score = rows["0.1"].score
    assert score.low < score.value < score.high < 1


def test_scores_are_what_their_definitions_say(rows):
    row, e = rows["0.1"], scaled("0.1", 0.1)
    earned = PLANT.reward(THETA, e.gains)
    assert row.reward.value == pytest.approx(earned.mean())
    floor, top = rows["nominal"].reward.value, rows["oracle"].reward.value
    assert row.score.value == pytest.approx((earned.mean() - floor) / (top - floor))
    assert row.regret.value == pytest.approx(top - earned.mean())
    assert row.phase_margin.value == pytest.approx(np.sqrt(np.mean((e.metrics[:, 0] - 60) ** 2)))
    assert row.crossover.value == pytest.approx(np.sqrt(np.mean((e.metrics[:, 1] - 1.5) ** 2)))
    # The spread of a mean, 1.96 of it to either side; 2000 resamples give it to some 5 %.
    width = row.reward.high - row.reward.low
    assert width == pytest.approx(2 * 1.96 * earned.std() / len(earned) ** 0.5, rel=0.15)


def test_the_scores_interval_is_that_of_paired_episodes():
    rng = np.random.default_rng(0)
    shared = rng.normal(size=1000)
    nominal, oracle = shared - 1.0, shared + 0.0
    table = np.stack([shared - 0.5, nominal, oracle], axis=1)
    found = Estimate.of(table, scoreboard.score)
    # What is common to all cancels, however large.
    assert found.value == pytest.approx(0.5) and found.high - found.low < 1e-9


def test_undefined_margins_are_counted_and_left_out_of_the_rmse():
    row = board(evaluation("lost", TRUTH * [np.nan, 1.0]))["lost"]
    assert row.undefined == row.unstable == row.episodes and row.reward.value == -5
    assert np.isnan(row.phase_margin.value)
    saved = json.loads(scoreboard.to_json([row], PROTOCOL))["rows"][0]
    assert saved["phase_margin"] == {"value": None, "low": None, "high": None}


def test_the_protocol_is_version_1():
    """Whoever changes one of these makes it protocol 2."""
    saved = json.loads(scoreboard.to_json([], PROTOCOL))
    assert saved["protocol"] == {
        "version": 1, "context_sets": ["test", "extrapolation"], "episodes": 1500, "seed": 0
    }  # fmt: skip
    task = saved["task"]
    assert task["prior"] == {"mu_s": [0.3, 1.1], "M_delta": [0, 300], "v_x": [20, 20]}
    assert task["experiment"] == {"Ts": 0.001, "N": 10_000, "amplitude": pytest.approx(np.pi / 180),
                                  "bit_time": 0.1, "register": "same", "snr_db": 30.0}  # fmt: skip
    assert task["target"] == {"phase_margin": 60.0, "crossover": 1.5, "Ts": 0.01,
                              "delay_samples": 0, "controller": "pi"}  # fmt: skip
    assert PLANT.extrapolation == {"mu_s": (1.1, 1.3), "M_delta": (300.0, 500.0)}
    # The reward: 2 deg and 0.05 Hz off, and unstable.
    graded = PLANT.reward_of(np.array([[2.0, 0.05], [np.nan, np.nan]]))
    e = np.hypot(0.2, 0.2)
    np.testing.assert_allclose(graded, [-e / (1 + e / 4), -5.0])


@pytest.mark.parametrize(
    "name, first, last",
    [
        ("test", (0.4687297129008733, 122.07892633232345), (1.063175702919312, 19.603144931629323)),
        ("extrapolation", (1.2566602489534198, 380.3949170617085),
         (1.1422859216469392, 400.79130497140125)),
    ],
)  # fmt: skip
def test_the_protocols_vehicles_stay_the_same(name, first, last):
    # From numpy.random.SeedSequence((tag, seed), spawn_key=(episode,)) by hand.
    theta = draws.draw(PLANT, name, PROTOCOL.seed, 0, PROTOCOL.episodes).theta
    assert tuple(theta[0, :2]) == pytest.approx(first, rel=1e-12)
    assert tuple(theta[-1, :2]) == pytest.approx(last, rel=1e-12)


def test_both_ends_must_be_there():
    with pytest.raises(ValueError, match="nominal must be evaluated too"):
        scoreboard.run({"oracle": tuners.load("oracle")})


def test_what_tuners_learned_from_is_told():
    assert scoreboard.learned_from(tuners.load("nominal")) == ""
    assert scoreboard.learned_from(tuners.load("ts-ff")) == "1500 vehicles, seed 0"

    class Agent:
        training = {"algorithm": "sac", "episodes": 20_000, "num_envs": 16, "seed": 2}

    assert scoreboard.learned_from(Agent()) == "20000 rewards, sac, seed 2"


def test_a_runs_page_shows_the_rows_and_what_is_missing(tmp_path):
    calls, few = [], replace(PROTOCOL, episodes=12)
    ends = {name: tuners.load(name) for name in ("nominal", "oracle")}
    rows = scoreboard.run(ends, few, lambda *call: calls.append(call))
    assert [(r.tuner, r.context_set) for r in rows] == [
        (tuner, name) for name in ("test", "extrapolation") for tuner in ("oracle", "nominal")
    ]
    assert {r.episodes for r in rows} == {12}
    assert calls[-1] == ("evaluating, extrapolation", 24, 24)

    results_page.write(rows, few, tmp_path)
    text = (tmp_path / "README.md").read_text()
    assert "A trial: evaluation protocol 1 cut to 12 episodes" in text
    assert "## Also here" not in text and "`ts-ff`" in text.split("Not here")[1].splitlines()[0]
    lines = [line for line in text.splitlines() if line.startswith("| `nominal`")]
    assert len(lines) == 2 and all(line.count("|") == 10 for line in lines)
    assert f"{rows[1].reward.value:#.3g} ({rows[1].reward.low:#.3g} to" in lines[0]
    assert "| 0.0000 (0.0000 to 0.0000) |" in lines[0]
    assert "{" not in text.replace("```", "")  # every field was filled
    saved = json.loads((tmp_path / "scoreboard.json").read_text())
    assert [r["tuner"] for r in saved["rows"]] == [r.tuner for r in rows]
    assert saved["rows"][1]["score"] == {"value": 0, "low": 0, "high": 0}

    (tmp_path / "rl.md").write_text("")
    results_page.write(rows, PROTOCOL, tmp_path)
    text = (tmp_path / "README.md").read_text()
    assert "## Evaluation protocol 1\n" in text and "\n- [rl.md](rl.md): " in text
