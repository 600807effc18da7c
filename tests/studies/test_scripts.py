"""The scripts as a user calls them."""

import csv
import json
import os
import re
import runpy
import sys
from functools import partial

import numpy as np
import pytest
from first_order import lone
from recordings import ROOT

import tuners
from studies import dataset_scale, off_design, plots, results_page, robustness, robustness_kinds
from studies.conditions import SWEEPS
from studies.program import Json, environment
from tuners.tuner.evaluation import evaluate
from yawrate_env.vehicle.nonlinear import NonlinearTwin, Tyre
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

MODELS = ROOT / "tuners" / "models"


@pytest.fixture
def called(tmp_path, monkeypatch, capsys):
    """Run a script in this process, in an empty folder: status, stdout and stderr."""

    monkeypatch.setattr(plots, "DPI", 20)  # faster

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


def test_evaluate_writes_rows_and_prints_the_table(called, tmp_path):
    status, out, _ = called(
        "evaluate", "--tuner", "ts-ff", "--tuner", "nominal", "--episodes", 4, "--seed", 3,
        "--out", "rows.csv", "--env-kwargs", '{"snr_db": 20}', "--context", "train",
    )  # fmt: skip
    lines = out.strip().splitlines()
    assert status == 0 and len(lines) == 4
    assert lines[0].startswith("| tuner |") and lines[2].startswith("| `ts-ff` |")
    with open(tmp_path / "rows.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["tuner"], int(r["episode"])) for r in rows] == [
        (name, k) for name in ("ts-ff", "nominal") for k in range(4)
    ]
    plant = yaw_rate(Task(experiment=Experiment(snr_db=20)))
    (found,) = evaluate({"": tuners.load("ts-ff")}, plant, "train", episodes=4, seed=3)
    assert [float(r["kp"]) for r in rows[:4]] == pytest.approx(found.gains[:, 0].tolist(), rel=1e-9)
    assert [p.name for p in tmp_path.iterdir()] == ["rows.csv"]


@pytest.mark.slow
def test_train_writes_a_tuner_that_evaluate_takes(tmp_path, called):
    few = ("--episodes", 60, "--calibration", 60)
    status, out, _ = called("train", "ts-ff", *few, "--seed", 1, "--out", "my.tuner")
    assert status == 0 and "my.tuner: ts-ff" in out
    tuner = tuners.load(tmp_path / "my.tuner")
    assert tuner.training["name"] == "ts-ff" and tuner.training["seed"] == 1
    status, *_ = called("evaluate", "--tuner", "my.tuner", "--episodes", 2, "--out", "r.csv")
    assert status == 0
    assert (tmp_path / "r.csv").read_text().splitlines()[1].startswith("my.tuner,0,")


@pytest.mark.slow
def test_train_writes_an_agent_for_a_plant(tmp_path, called):
    how = ("--episodes", 64, "--algorithm", "ppo", "--calibration", 50, "--out", "my.tuner")
    status, out, _ = called("train", "rl", "--plant", "first_order:lone", *how)
    record, accuracy = out.splitlines()
    assert status == 0 and record.startswith("my.tuner: rl") and "(bound" in accuracy
    found = tuners.load(tmp_path / "my.tuner", lone)
    assert found.training["algorithm"] == "ppo"
    assert found.training["calibration"] == {"episodes": 50, "seed": 0}


def evaluation(**changes):
    good = {"tuner": "nominal", "episodes": "2", "out": "rows.csv"}
    return ["evaluate", *(part for k, v in (good | changes).items() for part in (f"--{k}", v))]


def conditions(text):
    return evaluation(**{"env-kwargs": text})


def training(name, *options, out="my.tuner"):
    return ["train", name, *options, "--out", out]


WRONG = {
    "unknown tuner": (evaluation(tuner="pidtune"), "pidtune"),
    "absent file": (evaluation(tuner="my.tuner"), "my.tuner"),
    "half an episode": (evaluation(episodes="1.5"), "--episodes"),
    "endless episodes": (evaluation(episodes="inf"), "--episodes"),
    "too many episodes": (evaluation(episodes="1e10"), "--episodes"),
    "unknown context": (evaluation(context="moon"), "--context"),
    "absent folder": (evaluation(out="absent/rows.csv"), "--out"),
    "a folder": (evaluation(out="."), "--out"),
    "no JSON": (conditions("snr=20"), "--env-kwargs"),
    "no object": (conditions("[1]"), "--env-kwargs"),
    "linear tyres": (conditions('{"tyre": {}}'), "--env-kwargs: unexpected .* 'tyre'"),
    "unphysical": (conditions('{"Ts": -1}'), "Ts = -1"),
    "no memory": (conditions('{"N": 100000000000000}'), r"N = 1e\+14"),
    "wrong sampling": ([*conditions('{"Ts": 0.003}'), "--tuner", "ts-ff"], "ARMAX"),
    "no algorithm": (evaluation(sb3="model.zip"), "--algo"),
    "nothing to evaluate": (["evaluate", "--out", "rows.csv"], "--tuner, --policy or --sb3"),
    "not trained": (training("gb"), "NAME"),
    "no name": (["train", "--out", "my.tuner"], "NAME"),
    "no file": (["train", "ts-ff"], "--out"),
    "no agent": (training("ts-ff", "--plant", "a:b"), "--plant"),
    "vehicles' conditions": (
        training("rl", "--plant", "a:b", "--env-kwargs", '{"v_x": 25}'), "--plant"
    ),
    "no plant": (training("rl", "--plant", "gone:plant"), "gone"),
    "too few": (training("ts-ff", "--episodes", "20"), "episodes"),
    "another suffix": (training("ts-ff", out="my.zip"), "--out"),
    "unreachable": (
        training("ts-gbm", "--episodes", "60", "--env-kwargs", '{"phase_margin": 170}'), "target"
    ),
    "reproduction": (["reproduce_paper", "--episodes", "-5"], "--episodes"),
    "policy": (["make_results", "--policy", "absent:make", "--results", "r"], "absent"),
    "scored tuner": (["make_results", "--tuner", "pidtune", "--results", "r"], "pidtune"),
    "study": (["accuracy", "everything"], "STUDY"),
    "one number of vehicles": (["accuracy", "budget", "--vehicles", "100"], "--vehicles"),
    "agent": (["compare_rl", "--agent", "dqn"], "--agent"),
    "plant": (["compare_plant", "gone:plant"], "gone"),
    "plant's file": (["compare_plant", "gone.py"], "gone.py"),
}  # fmt: skip


def is_refused(end, message):
    status, out, err = end
    last = err.splitlines()[-1]  # above it at most a progress bar
    assert status == 2 and out == "" and last.startswith("error: ")
    assert re.search(message, last)


@pytest.mark.parametrize("case", WRONG)
def test_wrong_use_is_refused_in_one_line(case, called, tmp_path):
    arguments, message = WRONG[case]
    (tmp_path / "rows.csv").write_text("old")
    is_refused(called(*arguments), message)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_a_pipe_is_no_output(called, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    is_refused(called("evaluate", "--tuner", "gb", "--out", "pipe"), "--out")


def test_the_environments_arguments_make_its_task():
    assert environment(Json().convert("{}", None, None)).task == Task()
    task = environment({"snr_db": 20, "v_x": [10, 30], "crossover": 1.2}).task
    assert (task.experiment.snr_db, task.prior.v_x, task.target.crossover) == (20, (10, 30), 1.2)
    nonlinear = environment({"nonlinear": True, "tyre": {"friction": 0.8}}).task
    assert nonlinear.twin == NonlinearTwin(tyre=Tyre(friction=0.8))


def test_help_shows_the_modules_examples(called):
    status, out, _ = called("evaluate", "--help")
    assert status == 0 and "python scripts/evaluate.py" in out and "--help" in out


def test_programming_errors_keep_their_traceback(called, monkeypatch):
    monkeypatch.setattr(tuners, "load", None)
    with pytest.raises(TypeError):
        called("evaluate", "--tuner", "gb", "--out", "rows.csv")


@pytest.mark.slow
def test_the_whole_paper_in_small(called, tmp_path):
    models = {path: path.read_bytes() for path in MODELS.iterdir()}
    places = ("--results", "new/results", "--figures", "new/figures", "--times", "new/times")
    status, out, _ = called("reproduce_paper", "--episodes", 60, "--seed", 4, *places)
    assert status == 0 and [p.name for p in tmp_path.iterdir()] == ["new"]
    results, figures = tmp_path / "new" / "results", tmp_path / "new" / "figures"
    pictures = {path.name: path.read_bytes() for path in figures.iterdir()}
    assert set(pictures) == {*(f"fig{k}.png" for k in (4, 5, 6, 8)), "margins.png"}
    times = tmp_path / "new" / "times"
    assert {path.name for path in times.iterdir()} == {"fig7.png", "times.json"}
    assert all(content.startswith(b"\x89PNG\r\n") for content in pictures.values())

    table = json.loads((results / "table3.json").read_text())
    names = [row["tuner"] for row in table["rows"]]
    printed = ["ts-ff-1khz", "ts-ff-100hz", "ts-gbm-1khz", "ts-gbm-100hz"]
    assert names[:7] == ["gb", *printed, "ts-ff", "ts-gbm"] and names[-1] == "posterior spread"
    assert [row["tuner"] for row in table["rows"] if row.get("paper")] == ["gb", *printed]
    assert {"ts-ff-gains", "ts-gbm-gains", "ladder", "bb", "vrft", "frit", "nominal"} < set(names)
    assert table["rows"][0]["unstable"] == 0 and table["rows"][0]["phase_margin"]["std"] < 0.02
    assert (results / "table3.md").read_text().strip() == out.strip()
    rows = (results / "episodes.csv").read_text().splitlines()
    assert len(rows) == 1 + 60 * (len(names) - 2)  # two are bounds
    # Its own tuners were trained, those of the package are what they were.
    assert models == {path: path.read_bytes() for path in MODELS.iterdir()}


def test_accuracy_counts_episodes_and_goes_on(called, tmp_path):
    for episodes in (10, 20):
        status, out, _ = called("accuracy", "million", "--episodes", episodes, "--results", "r")
        assert status == 0 and f"{episodes} episodes of the `test` set" in out
        assert "Unstable loops: `ts-ff-lag` 0, `ts-ff` 0" in out
    state = json.loads((tmp_path / "r" / "million.json").read_text())
    assert sum(state["tuners"]["ts-ff"]["crossover"]["histogram"].values()) == 20
    assert {p.name for p in (tmp_path / "r").iterdir()} == {"million.json", "million.md"}


@pytest.mark.slow
def test_accuracy_asks_about_trust(called, tmp_path):
    few = ("--tuner", "gb", "--episodes", 2, "--results", "r")
    status, out, _ = called("accuracy", "trust", *few)
    assert status == 0 and "## `gb`" in out and "| wrong unit | 2 |" in out
    found = json.loads((tmp_path / "r" / "trust.json").read_text())["gb"]
    assert found["usual"]["recordings"] == 10 and found["usual"]["trusted"] == 10
    assert sum(row["trusted_misses"] for row in found["faulty"]) == 0
    assert [row["recordings"] for row in found["unusual"]] == [2] * 5
    assert found["coverage"][0]["episodes"] == 50 and found["coverage"][0]["crossover"] > 0.7


@pytest.mark.slow
def test_off_design_measures_the_design_point_once_and_writes_everything(
    called, tmp_path, monkeypatch
):
    asked = []

    def measured(tuners_, task, sweep, level, episodes, seed):
        asked.append(level == sweep.design)
        which = sweep.name, level, "gb", episodes
        return [off_design.cell(which, np.ones((2, 4)), (60.0, 1.5), np.ones(2))]

    monkeypatch.setattr(off_design, "measure", measured)
    places = ("--results", ".", "--figures", ".", "--every-speed", "nominal")
    status, out, _ = called("off_design", "--episodes", 2, "--tuner", "gb", *places)
    cells = json.loads((tmp_path / "off_design.json").read_text())["cells"]
    assert sum(asked) == 1 and len(asked) == len(cells) - len(SWEEPS) + 1
    names = {
        f"{page}.{kind}" for page in ("off_design", "schedule") for kind in ("json", "md", "png")
    }
    assert status == 0 and {path.name for path in tmp_path.iterdir()} == names
    assert "# Off the design point" in out and "# One tuner for every speed" in out


def test_make_results_with_the_pages_own_example(called, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "my_agent.py").write_text(results_page.EXAMPLE)
    few = ("--episodes", 2, "--policy", "my_agent:Fixed", "--results", "mine")
    status, out, _ = called("make_results", *few)
    assert status == 0 and out.startswith("| tuner |") and "`my_agent:Fixed`" in out
    assert {p.name for p in (tmp_path / "mine").iterdir()} == {"README.md", "scoreboard.json"}
    saved = json.loads((tmp_path / "mine" / "scoreboard.json").read_text())
    shipped = {path.stem for path in MODELS.glob("*.tuner")}
    names = {row["tuner"] for row in saved["rows"]}
    assert names == shipped | {
        "gb",
        "bb",
        "ladder",
        "vrft",
        "frit",
        "oracle",
        "nominal",
        "my_agent:Fixed",
    }
    assert len(saved["rows"]) == 2 * len(names)


def test_robustness_writes_page_and_pictures(called, tmp_path, monkeypatch):
    kinds = {"nothing wrong": {"nothing": robustness_kinds.GROUPS["nothing wrong"]["nothing"]}}
    monkeypatch.setattr(robustness, "study", partial(robustness.study, groups=kinds))
    places = ("--results", "r", "--figures", "f")
    status, out, _ = called("robustness", "--recordings", 2, *places)
    assert status == 0 and "| nothing | 6 | 100 % | 0 % |" in out
    assert {p.name for p in (tmp_path / "r").iterdir()} == {"robustness.json", "robustness.md"}
    names = {p.name for p in (tmp_path / "f").iterdir()}
    assert names == {"robustness.png", "robustness_degree.png"}


def test_dataset_scale_measures_what_is_missing(called, tmp_path, monkeypatch):
    measured = []

    def measure(episodes, folder):
        measured.append(episodes)
        return dataset_scale.Size(episodes, 1.0 + 1e-4 * episodes, 400.0, 120.0, 0.0)

    monkeypatch.setattr(dataset_scale, "measure", measure)
    places = ("--results", "r", "--figures", "f")
    for sizes in (["1e3", "1e4"], ["1e4", "1e5"], []):
        options = [option for size in sizes for option in ("--episodes", size)]
        status, out, _ = called("dataset_scale", *options, *places)
        assert status == 0
    assert measured == [1000, 10_000, 100_000, 1_000_000]
    stored = json.loads((tmp_path / "r" / "datasets.json").read_text())
    assert [size["episodes"] for size in stored["sizes"]] == measured
    assert (tmp_path / "f" / "datasets.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "r" / "datasets.md").read_text() in out


@pytest.mark.slow
def test_compare_plant_gives_table_and_picture(called, tmp_path):
    file = ROOT / "tests" / "first_order.py"
    page = tmp_path / "page.md"
    page.write_text(f"Before\n<!-- {file.stem}:start -->\nold\n<!-- {file.stem}:end -->\nafter\n")
    status, out, _ = called("compare_plant", file, "--plants", 60, "--test", 20, "--page", page)
    assert status == 0 and "two-stage" in out and "Cramér–Rao" in out
    part = json.loads((tmp_path / "results" / "plants.json").read_text())["first_order"]
    assert part["episodes"] == 20 and part["training"]["episodes"] == 60
    assert (tmp_path / "results" / "plants.md").read_text().count("## ") == 1
    assert (tmp_path / "figures" / "first_order.png").read_bytes()[:4] == b"\x89PNG"
    shown = page.read_text()
    assert shown.startswith("Before\n") and shown.endswith("after\n") and "old" not in shown
    assert shown.count("| two-stage |") == 1
