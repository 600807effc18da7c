"""`yawrate export`, from tuners and from answers in files."""

import json

import numpy as np
import pytest
from c_programs import passes
from command import UNUSABLE, WRONG, call, refused
from exported import dc_motor, trained
from recordings import ROOT

from tuners.export import (
    Gains,
)
from yawrate_env.plant.episodes import recorded as episodes
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

ANSWER = {
    "trusted": True,
    "gains": {"kp": 1.0, "Ti": None},
    "plant": {"target": None, "Ts": 0.01, "signals": ["valve [%]", "flow [l/s]"]},
}

DAMAGE = [
    ({"trusted": "no"}, "trusted"),
    ({"gains": {}}, "gains"),
    ({"gains": {"kp": "1"}}, "kp"),
    ({"gains": {"kp": 10**400}}, "kp"),
    ({"gains": [1]}, "keys|items|list"),
    ({"plant": {}}, "target"),
    ({"plant": ANSWER["plant"] | {"Ts": -1.0}}, "Ts"),
    ({"plant": ANSWER["plant"] | {"Ts": float("nan")}}, "Ts"),
    ({"plant": ANSWER["plant"] | {"signals": [1, 2]}}, "input"),
    ({"plant": ANSWER["plant"] | {"command_limits": [1]}}, "limits"),
]


def test_damaged_answers_and_other_files_are_refused(tmp_path):
    path = tmp_path / "answer.json"
    path.write_text(json.dumps(ANSWER))
    assert np.isnan(Gains.read(path).values["Ti"])
    others = ("", "[]", "{}", 9999 * "[", '{"trusted": true}', "kp = 1")
    damaged = [(json.dumps(ANSWER | changes), name) for changes, name in DAMAGE]
    for text, name in [*damaged, *((text, "") for text in others)]:
        path.write_text(text)
        with pytest.raises(ValueError, match=f"answer.json is no answer of.*{name}"):
            Gains.read(path)


@pytest.fixture(scope="module")
def motor(tmp_path_factory):
    """A folder with the motor's tuner, a log, and the answer to it."""
    folder = tmp_path_factory.mktemp("motor")
    tuner = trained("loop")
    tuner.save(folder / "motor.tuner")
    found = episodes(tuner.plant, "test", 0, 1)
    t = tuner.plant.Ts * np.arange(found.y.shape[1])
    table = np.stack([t, found.u[0], found.y[0]], axis=1)
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,u,y", comments="")
    code, out, _ = call("tune", folder / "log.csv", "--tuner", folder / "motor.tuner", "--json")
    assert code in (0, 3)
    (folder / "answer.json").write_text(out)
    return folder


def test_a_tuner_is_exported_by_the_command(motor, tmp_path):
    tuner = ("export", "--tuner", motor / "motor.tuner")
    code, out, _ = call(*tuner, "-o", tmp_path / "c")
    assert code == 0 and len(out.split()) == 6
    code, out, _ = call(*tuner, "--features", "-o", tmp_path / "first")
    assert code == 0 and len(out.split()) == 3
    for flags in ((), ("--features",)):
        assert call(*tuner, "--target", "onnx", *flags, "-o", tmp_path / "x.onnx")[0] == 0
    assert "give gains" in refused(WRONG, *tuner, "--limits", 0, 1, "-o", tmp_path / "c")


def test_an_answer_is_exported_by_the_command(motor, tmp_path):
    answer = json.loads((motor / "answer.json").read_text())
    gains = ("export", "--result", motor / "answer.json")
    code, _, err = call(*gains, "--limits", -12, 12, "-o", tmp_path / "c")
    assert code == 0 and ("refused" in err) != answer["trusted"]
    assert passes(tmp_path / "c", "yawrate_pi")
    assert f"every {dc_motor.target.Ts:g} s" in (tmp_path / "c" / "yawrate_pi.h").read_text()
    json_ = ("--target", "json", "-o", tmp_path / "x.json")
    assert "limits of voltage" in refused(UNUSABLE, *gains, "-o", tmp_path / "d")
    assert "not both" in refused(WRONG, *gains, "--kp", 1, "--Ti", 1, *json_)
    assert "for a tuner" in refused(WRONG, *gains, "--features", *json_)
    assert "answer.json" in refused(WRONG, *gains, *json_[:2], "-o", motor / "answer.json")


def test_gains_and_answers_of_the_vehicle_are_exported_by_the_command(tmp_path):
    code, out, _ = call("tune", ROOT / "examples" / "log.csv", "--json")
    assert code == 0
    (tmp_path / "answer.json").write_text(out)
    answer, path = json.loads(out), tmp_path / "pi.json"
    gains = ("--kp", answer["kp"], "--Ti", answer["Ti"])
    for source in (("--result", tmp_path / "answer.json"), gains):
        done = call("export", *source, "--target", "json", "-o", path)
        assert done == (0, f"{path}\n", "")
        content = json.loads(path.read_text())
        assert [content[n] for n in ("kp", "Ti", "Ts")] == [answer["kp"], answer["Ti"], 0.01]
        assert content["limits"] == list(yaw_rate(Task()).command_limits)
    given = ("--limits", -0.1, 0.2, "--Ts", 0.005)
    assert call("export", *gains, *given, "--target", "json", "-o", path)[0] == 0
    content = json.loads(path.read_text())
    assert (content["Ts"], content["limits"]) == (0.005, [-0.1, 0.2])
    code, out, _ = call("export", *gains, "-o", tmp_path / "pi")
    assert code == 0 and [line.rpartition(".")[2] for line in out.split()] == ["h", "c", "c"]
