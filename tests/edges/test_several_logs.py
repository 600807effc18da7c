"""Commands on several logs: pooled, validated, each by itself, and as a schedule over speed."""

import csv
import json
import re
import shutil

import numpy as np
import pyarrow.parquet
import pytest
from command import TRUSTED, UNTRUSTED, UNUSABLE, WRONG, call, refused
from drives import drive
from log_files import CASES, write

DRIVES = {"a": (0.8, 18.0, 101), "b": (0.8, 18.0, 102), "slow": (0.8, 12.0, 103),
          "wet": (0.5, 18.0, 104)}  # fmt: skip


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for name, (mu_s, v_x, seed) in DRIVES.items():
        u, _, r = drive(mu_s, 120.0, v_x, seed=seed)
        t = 0.01 * np.arange(len(u))
        write(folder / f"{name}.csv", {"t": t, "steer": u, "yaw_rate": r, "speed": 0 * t + v_x})
    return folder


def answered(*arguments):
    code, out, err = call("tune", *arguments, "--json")
    assert err == ""
    return code, json.loads(out)


def test_logs_are_pooled(logs):
    one = answered(logs / "a.csv")[1]
    code, found = answered(logs / "a.csv", logs / "b.csv", logs / "slow.csv", "--speed", 18)
    assert code == TRUSTED and one["logs"] == [] and found["log"] is None
    assert [log["file"] for log in found["logs"]] == ["a.csv", "b.csv", "slow.csv"]
    assert sum(log["share"] for log in found["logs"]) == pytest.approx(1.0, abs=0.05)
    assert {"agrees", "chi_square", "chance", "difference", "parameters"} <= set(found["logs"][0])

    def width(answer):
        return answer["phase_margin"]["high"] - answer["phase_margin"]["low"]

    assert width(found) < 0.75 * width(one)


@pytest.mark.slow
def test_speed_is_what_gains_are_for_and_not_what_logs_had(logs):
    files = logs / "a.csv", logs / "slow.csv"
    slow, fast = (answered(*files, "--speed", v)[1] for v in (12, 18))
    assert [log["speed"] for log in slow["logs"]] == [18.0, 12.0]
    assert slow["kp"] > 1.05 * fast["kp"]
    km_h = answered(*files, "--speed", 43.2, "--speed-unit", "km/h")
    assert km_h[1]["kp"] == pytest.approx(slow["kp"]) or km_h[0] != TRUSTED


def test_a_log_that_disagrees_is_named_in_text_and_report(logs, tmp_path):
    files = [logs / f"{name}.csv" for name in ("a", "b", "wet")]
    more = "--validate", logs / "slow.csv", "--report", tmp_path / "r.html"
    code, out, _ = call("tune", *files, *more)
    assert code == UNTRUSTED and "\nValidation\n" in out
    lines = out.splitlines()
    assert [line.endswith("DISAGREES") for line in lines[:3]] == [False, False, True]
    page = (tmp_path / "r.html").read_text()
    assert all(name.name in page for name in files) and "slow.csv" in page
    assert "Fitted alone it has friction" in page


@pytest.mark.parametrize("further, agrees", [("b", True), ("slow", True), ("wet", False)])
def test_a_log_validates(logs, further, agrees):
    code, found = answered(logs / "a.csv", "--validate", logs / f"{further}.csv")
    held = found["validation"]
    assert code == (TRUSTED if agrees else UNTRUSTED)
    assert held["agrees"] is agrees and held["contradicts"] is not agrees
    assert held["fit_percent"] <= held["attainable_percent"] + 0.1
    assert (held["attainable_percent"] - held["fit_percent"] < 1) is agrees


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_each_log_has_a_row(logs, tmp_path, ending):
    folder, out = tmp_path / "folder", tmp_path / f"table.{ending}"
    shutil.copytree(logs, folder)
    (folder / "broken.csv").write_text("t,steer\n0,nonsense\n")
    (folder / "readme.md").write_text("not a log")
    code, _, _ = call("tune", folder, "--each", "--out", out)
    assert code == UNUSABLE
    if ending == "csv":
        with open(out, newline="") as file:
            rows = list(csv.DictReader(file))
    else:
        rows = pyarrow.parquet.read_table(out).to_pylist()
    by_name = {row["file"].rpartition("/")[2]: row for row in rows}
    assert set(by_name) == {f"{name}.csv" for name in (*DRIVES, "broken")}
    assert by_name["broken.csv"]["error"] and not by_name["broken.csv"]["kp"]
    alone = answered(logs / "a.csv")[1]
    assert float(by_name["a.csv"]["kp"]) == pytest.approx(alone["kp"])
    assert not by_name["a.csv"]["error"] and by_name["a.csv"]["verdict"] == "usable"


def test_each_without_a_file_prints_the_table(logs):
    code, out, _ = call("tune", logs / "a.csv", logs / "b.csv", "--each")
    assert code == TRUSTED and len(list(csv.DictReader(out.splitlines()))) == 2


def test_a_schedule_over_speed(logs, tmp_path):
    files = [logs / f"{name}.csv" for name in ("a", "b", "slow")]
    outs = [tmp_path / f"s.{ending}" for ending in ("csv", "json", "svg")]
    flags = [flag for out in outs for flag in ("-o", out)]
    code, text, err = call("schedule", *files, "--grid", "12:18:3", *flags, "--c", tmp_path / "c")
    assert (code, err) == (TRUSTED, "")
    found = json.loads(outs[1].read_text())
    assert found["values"] == [12.0, 15.0, 18.0] and found["from_plant_fitted_to_all"]
    for point in found["points"]:
        kp = point["gains"]["kp"]
        assert kp["low"] < kp["value"] < kp["high"]
    rows = list(csv.DictReader(outs[0].read_text().splitlines()))
    assert [float(row["kp"]) for row in rows] == pytest.approx(found["gains"]["kp"])
    assert re.search(r"^15 .*±", text, re.M) and outs[2].read_text().startswith("<?xml")
    assert sorted(path.suffix for path in (tmp_path / "c").iterdir()) == [".c", ".c", ".h"]
    pooled = answered(*files, "--speed", 15)[1]
    assert pooled["kp"] == pytest.approx(found["gains"]["kp"][1])


def test_wrong_use_is_refused_in_one_line(logs, tmp_path):
    a, b, empty = logs / "a.csv", logs / "b.csv", tmp_path / "empty"
    empty.mkdir()
    (tmp_path / "copy.csv").write_bytes(a.read_bytes())
    (tmp_path / "link.csv").symlink_to(a)
    assert "a.csv" in refused(WRONG, "tune", a, a)
    assert "link.csv" in refused(WRONG, "tune", a, tmp_path / "link.csv")
    assert "recordings[1]" in refused(UNUSABLE, "tune", a, tmp_path / "copy.csv")
    assert "empty" in refused(WRONG, "tune", empty)
    assert "--validate" in refused(WRONG, "tune", a, "--each", "--validate", b)
    assert "--validate" in refused(WRONG, "tune", a, "--validate", a)
    assert "--out" in refused(WRONG, "tune", a, "--out", tmp_path / "t.csv")
    assert "--out" in refused(WRONG, "tune", a, "--each", "--out", tmp_path / "t.txt")
    assert "none" in refused(WRONG, "tune", a, "--each", "--out", tmp_path / "none" / "t.csv")
    assert "schedule" in refused(UNUSABLE, "tune", a, logs / "slow.csv")
    assert "--grid" in refused(WRONG, "schedule", a, "--grid", "30:10:1")
    assert "v_x" in refused(UNUSABLE, "schedule", a, "--grid", "1:20:1")
    assert "--out" in refused(WRONG, "schedule", a, "-o", tmp_path / "t.xls")
    assert "--speed" in refused(WRONG, "schedule", a, "--speed", 20)


def test_a_log_of_another_plant_is_named(logs, tmp_path):
    other = write(tmp_path / "motor.csv", CASES["lag"].columns)
    assert "motor.csv" in refused(UNUSABLE, "tune", logs / "a.csv", other)
