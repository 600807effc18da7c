"""The scripts as a user calls them."""

import csv
import json
import os
import runpy
import subprocess
import sys

import pytest
from first_order import lone
from recordings import ROOT

import tuners
from tuners.tuner.evaluation import evaluate
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.task import Experiment, Task


def run(script, *arguments, cwd=None, timeout=120):
    return subprocess.run(
        [sys.executable, ROOT / "scripts" / f"{script}.py", *map(str, arguments)],
        cwd=cwd or ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=timeout,
    )


@pytest.fixture
def called(tmp_path, monkeypatch, capsys):
    """Run a script in this process, in an empty folder: status, stdout and stderr."""

    def call(script, *arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [f"{script}.py", *map(str, arguments)])
        status = 0
        try:
            runpy.run_path(str(ROOT / "scripts" / f"{script}.py"), run_name="__main__")
        except SystemExit as end:
            status = end.code
        return status, *capsys.readouterr()

    return call


@pytest.mark.parametrize("script", ["evaluate", "train", "reproduce_paper", "accuracy"])
def test_help_shows_an_example(script, called):
    status, out, _ = called(script, "--help")
    assert status == 0
    assert f"python scripts/{script}.py" in out and "--episodes" in out


def test_evaluate_writes_rows_and_prints_the_table(tmp_path):
    out = tmp_path / "rows.csv"
    done = run("evaluate", "--tuner", "ts-ff", "--tuner", "nominal", "--episodes", 4, "--seed", 3,
               "--out", out, "--env-kwargs", '{"snr_db": 20}', "--context", "train")  # fmt: skip
    assert done.returncode == 0, done.stderr
    lines = done.stdout.strip().splitlines()
    assert lines[0].startswith("| tuner |") and lines[2].startswith("| `ts-ff` |")
    assert len(lines) == 4 and "Traceback" not in done.stderr
    with open(out, newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["tuner"], int(r["episode"])) for r in rows] == [
        (name, k) for name in ("ts-ff", "nominal") for k in range(4)
    ]
    # What the library says in the same words.
    (found,) = evaluate(
        {"ts-ff": tuners.load("ts-ff")},
        Task(experiment=Experiment(snr_db=20)),
        CONTEXT_SETS["train"],
        episodes=4,
        seed=3,
    )
    assert [float(r["kp"]) for r in rows[:4]] == pytest.approx(found.kp.tolist(), rel=1e-9)
    assert [p.name for p in tmp_path.iterdir()] == ["rows.csv"]


def test_train_writes_a_tuner_that_evaluate_takes(tmp_path, called):
    few = ("--episodes", 60, "--calibration", 200)
    status, out, _ = called("train", "ts-ff", *few, "--seed", 1, "--out", "my.tuner")
    assert status == 0 and "my.tuner: ts-ff" in out
    tuner = tuners.load(tmp_path / "my.tuner")
    assert tuner.training["name"] == "ts-ff" and tuner.training["seed"] == 1
    status, *_ = called("evaluate", "--tuner", "my.tuner", "--episodes", 2, "--out", "r.csv")
    assert status == 0
    assert (tmp_path / "r.csv").read_text().splitlines()[1].startswith("my.tuner,0,")


def test_train_writes_an_agent_for_a_plant(tmp_path, called):
    how = ("--episodes", 64, "--algorithm", "ppo", "--calibration", 50, "--out", "my.tuner")
    status, out, _ = called("train", "rl", "--plant", "first_order:lone", *how)
    said, accuracy = out.splitlines()
    assert status == 0 and said.startswith("my.tuner: rl") and "relative error of kp" in accuracy
    assert "(bound" in accuracy and "without stable loop" in accuracy
    found = tuners.plants.load(tmp_path / "my.tuner", lone)
    assert found.training["algorithm"] == "ppo" and found.training["calibration"] == 50


GOOD = {"--tuner": "nominal", "--episodes": "2", "--out": "rows.csv"}
WRONG_EVALUATIONS = {
    "unknown tuner": ({"--tuner": "pidtune"}, "tuner = 'pidtune' is unknown"),
    "absent file": ({"--tuner": "my.tuner"}, "my.tuner: No such file"),
    "no episodes": ({"--episodes": "0"}, "not a positive whole number"),
    "endless episodes": ({"--episodes": "inf"}, "not a positive whole number"),
    "negative seed": ({"--seed": "-1"}, "-1 is negative"),
    "unknown context": ({"--context": "moon"}, "invalid choice: 'moon'"),
    "absent folder": ({"--out": "absent/rows.csv"}, "The folder absent does not exist"),
    "a folder": ({"--out": "."}, ". is no regular file"),
    "no JSON": ({"--env-kwargs": "snr=20"}, "not JSON"),
    "unknown keyword": ({"--env-kwargs": '{"snr": 20}'}, "unexpected keyword argument 'snr'"),
    "unphysical": ({"--env-kwargs": '{"Ts": -1}'}, "Ts = -1 must be finite, above 0"),
    "no memory": ({"--env-kwargs": '{"N": 100000000000000}'}, "N = 1e+14 must be finite"),
    "wrong sampling": (
        {"--tuner": "ts-ff", "--env-kwargs": '{"Ts": 0.003}'},
        "does not divide the ARMAX sampling time",
    ),
}
WRONG_TRAININGS = {
    "not trained": (["gb", "--out", "my.tuner"], "invalid choice: 'gb'"),
    "no name": (["--out", "my.tuner"], "required: name"),
    "no agent": (["ts-ff", "--plant", "a:b", "--out", "my.tuner"], "--plant goes with rl"),
    "vehicles' conditions": (
        ["rl", "--plant", "a:b", "--env-kwargs", '{"v_x": 25}', "--out", "my.tuner"],
        "without --env-kwargs",
    ),
    "no plant": (["rl", "--plant", "gone:plant", "--out", "my.tuner"], "no module 'gone'"),
    "too few": (["ts-ff", "--episodes", "20", "--out", "my.tuner"], "at least 50"),
    "absent folder": (["ts-ff", "--out", "absent/my.tuner"], "The folder absent does not exist"),
    "unreachable": (
        [
            "ts-gbm",
            "--episodes",
            "60",
            "--out",
            "my.tuner",
            "--env-kwargs",
            '{"phase_margin": 170}',
        ],
        "0 of 60 episodes are usable",
    ),
}


def is_refused(end, message):
    status, out, err = end
    assert status == 2 and out == ""
    assert message in err.splitlines()[-1]  # above it: argparse's usage, or a progress bar


@pytest.mark.parametrize("case", WRONG_EVALUATIONS)
def test_wrong_evaluations_are_refused_in_one_line(case, called, tmp_path):
    change, message = WRONG_EVALUATIONS[case]
    words = [word for pair in (GOOD | change).items() for word in pair]
    is_refused(called("evaluate", *words), message)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("case", WRONG_TRAININGS)
def test_wrong_trainings_are_refused_in_one_line(case, called, tmp_path):
    words, message = WRONG_TRAININGS[case]
    is_refused(called("train", *words), message)
    assert list(tmp_path.iterdir()) == []


def test_wrong_reproductions_are_refused_in_one_line(called, tmp_path):
    is_refused(called("reproduce_paper", "--episodes", "-5"), "not a positive whole number")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_evaluation_keeps_the_old_file(tmp_path):
    (tmp_path / "rows.csv").write_text("old")
    words = ["--tuner", "ts-ff", "--episodes", 2, "--out", "rows.csv"]
    done = run("evaluate", *words, "--env-kwargs", '{"N": 500}', cwd=tmp_path)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.splitlines()[-1].endswith("Record for longer.")
    assert "Traceback" not in done.stderr
    assert (tmp_path / "rows.csv").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.slow
def test_the_whole_paper_in_small(tmp_path):
    models = {path: path.read_bytes() for path in (ROOT / "tuners" / "models").iterdir()}
    done = run("reproduce_paper", "--episodes", 60, "--seed", 4, "--results", "new/results",
               "--figures", "new/figures", cwd=tmp_path, timeout=600)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["new"]
    results, figures = tmp_path / "new" / "results", tmp_path / "new" / "figures"
    expected = {*(f"fig{k}.png" for k in range(4, 9)), "margins.png"}
    assert {p.name for p in figures.iterdir()} == expected
    assert all(p.read_bytes().startswith(b"\x89PNG\r\n") for p in figures.iterdir())

    table = json.loads((results / "table3.json").read_text())
    names = [row["tuner"] for row in table["rows"]]
    assert names[:3] == ["gb", "ts-ff", "ts-gbm"] and names[-1] == "posterior spread"
    assert {"ts-ff-gains", "ts-gbm-gains", "nominal", "oracle"} < set(names)
    assert table["conditions"]["episodes"] == 60 and table["conditions"]["seed"] == 4
    paper = {row["tuner"]: row["paper"] for row in table["rows"][:3]}
    assert paper["gb"] == {"phase_margin": [59.98, 0.2385], "crossover": [1.5, 0.0037]}
    gb = table["rows"][0]
    assert gb["unstable"] == 0 and gb["phase_margin"]["std"] < 0.02
    markdown = (results / "table3.md").read_text()
    assert markdown.strip() == done.stdout.strip() and len(markdown.splitlines()) == 2 + len(names)
    with open(results / "episodes.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 60 * (len(names) - 2)  # the two bounds answer nothing
    # Its own tuners were trained, those of the package are what they were.
    assert models == {path: path.read_bytes() for path in (ROOT / "tuners" / "models").iterdir()}


def test_accuracy_counts_episodes_and_goes_on(tmp_path):
    for episodes in (20, 30):
        done = run("accuracy", "million", "--episodes", episodes, "--results", tmp_path)
        assert done.returncode == 0, done.stderr
        assert f"{episodes} episodes of the `test` set" in done.stdout
        assert "Unstable loops: `ts-ff-lag` 0, `ts-ff` 0" in done.stdout
    state = json.loads((tmp_path / "million.json").read_text())
    assert sum(state["tuners"]["ts-ff"]["crossover"]["histogram"].values()) == 30
    assert {p.name for p in tmp_path.iterdir()} == {"million.json", "million.md"}
