"""`yawrate watch` and `yawrate check`: logs of one car's drives in closed loop."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command import TRUSTED, UNTRUSTED, WRONG, call, refused
from log_files import write

from tuners.cli.text import VERDICTS
from tuners.recalibration.watch import Watch
from tuners.trust.verdict import Verdict
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.drive_conditions import START_INTEGERS, WINDOW_INTEGERS, Conditions
from yawrate_env.vehicle.drives import Drives
from yawrate_env.vehicle.single_track import Vehicle

GRIP, LOAD, SPEED = 0.9, 120.0, 20.0


def driven(mu_s=GRIP, gains=None, *, windows=6, seed=0, vehicle=None, **conditions):
    """Reference, command and yaw rate (N,) of a drive; by default with the rule's gains."""
    drives = Drives.of(vehicle, Conditions(**conditions))
    theta = np.array([[mu_s, LOAD, SPEED]])
    course = drives.begin(stream(seed, 0, 1, START_INTEGERS))
    gains = drives.designed(theta) if gains is None else np.array([gains])
    parts = []
    for t in range(windows):
        coming = drives.coming(course, stream((seed, t), 0, 1, WINDOW_INTEGERS))
        course, found = drives.window(course, replace(coming, theta=theta), gains)
        parts.append((found.reference[0], found.u[0], found.y[0]))
    return [np.concatenate(signal) for signal in zip(*parts, strict=True)]


def rule(mu_s):
    return tuple(Drives.of().designed(np.array([[mu_s, LOAD, SPEED]]))[0])


def log(path, **drive):
    reference, u, y = driven(**drive)
    t = 0.01 * np.arange(len(u))
    return write(path, {"t": t, "steer": u, "yaw_rate": y, "speed": 0 * t + SPEED,
                        "wanted": reference})  # fmt: skip


def watched(*arguments):
    code, out, err = call("watch", *arguments, "--json")
    assert code == 0 and err == "", err
    return [json.loads(line) for line in out.splitlines()]


def allowed(margin, crossover):
    """The verdict on half widths: care beyond 3 deg or 0.15 Hz, and none beyond twice that."""
    worst = max(margin / 3, crossover / 0.15)
    return "usable" if worst <= 1 else "usable_with_care" if worst <= 2 else "refuse"


def test_a_jump_of_friction_changes_the_gains_and_nothing_else_does(tmp_path):
    kp, Ti = rule(GRIP)
    for day, mu_s in enumerate((GRIP, GRIP, 0.4, 0.4)):
        suits = rule(0.4 if day == 3 else GRIP)
        log(tmp_path / f"day{day}.csv", mu_s=mu_s, gains=suits, seed=day)
    found = watched(tmp_path, "--kp", kp, "--Ti", Ti)
    assert [each["log"] for each in found] == [f"day{day}.csv" for day in range(4)]
    assert [each["change"] for each in found] == [False, False, True, False]
    assert [each["jumped"] for each in found] == [False, False, True, False]
    for each, mu_s in zip(found, (GRIP, GRIP, 0.4, 0.4), strict=True):
        value, deviation = each["mu_s"]
        assert abs(value - mu_s) < 4 * deviation < 0.4 and each["left"] == ""
    wanted = rule(0.4)
    assert found[3]["kp"] == pytest.approx(wanted[0], rel=0.1)
    code, out, _ = call("watch", tmp_path, "--kp", kp, "--Ti", Ti)
    lines = out.splitlines()
    assert code == 0 and "CHANGE gains to kp = " in lines[2] and "keep gains" in lines[3]
    for each, line in zip(found, lines, strict=True):
        margin, crossover = each["half_widths"]
        assert each["verdict"] == allowed(margin, crossover)
        said = VERDICTS[Verdict(each["verdict"])].lower()
        assert f"{said}: ± {margin:.1f} deg, ± {crossover:.2f} Hz" in line


def test_noise_is_learned_from_the_first_recording():
    loud = {"noise": float(np.radians(0.3)), "disturbance": float(np.radians(0.1))}
    watch = Watch()
    _, u, y = driven(windows=20, **loud)
    advice = watch.add(u, y, 0.01, SPEED)
    assert watch.noise.gyro == pytest.approx(loud["noise"], rel=0.1)
    assert watch.noise.disturbance == pytest.approx(loud["disturbance"], rel=0.4)
    assert abs(advice.mu_s[0] - GRIP) < 4 * advice.mu_s[1] and not advice.left
    _, u, y = driven(windows=10, seed=1, **loud)
    assert not watch.add(u, y, 0.01, SPEED).left


def test_a_car_that_is_another_one_has_left_what_is_known():
    watch = Watch()
    for seed in range(2):
        _, u, y = driven(seed=seed)
        assert not watch.add(u, y, 0.01, SPEED).left
    softer = Vehicle(omega_n=0.5 * Vehicle().omega_n)  # a steering actuator that has grown slow
    _, u, y = driven(vehicle=softer, gains=rule(GRIP), seed=2, windows=12)
    assert watch.add(u, y, 0.01, SPEED).left


def test_wrong_data_are_named_and_gains_suit_the_car_as_it_is():
    softer = Vehicle(C_f=0.85 * Vehicle().C_f)
    watch = Watch()
    for seed in range(4):
        _, u, y = driven(vehicle=softer, seed=seed, windows=12)
        advice = watch.add(u, y, 0.01, SPEED, loaded=False)
    assert "front stiffness" in advice.left
    theta = np.array([[GRIP, LOAD, SPEED]])
    loops = Drives.of(softer).loops(theta)
    margins = loops.evaluate(np.array([advice.kp]), np.array([advice.Ti])).margins
    exact = Watch(suspects={})
    for seed in range(4):
        _, u, y = driven(vehicle=softer, seed=seed, windows=12)
        other = exact.add(u, y, 0.01, SPEED, loaded=False)
    without = loops.evaluate(np.array([other.kp]), np.array([other.Ti])).margins
    assert abs(margins.phase_margin[0] - 60) < 0.5 * abs(without.phase_margin[0] - 60)


def test_bad_logs_cost_their_line_only(tmp_path):
    log(tmp_path / "a.csv")
    write(tmp_path / "b.csv", {"t": 0.01 * np.arange(900.0), "steer": np.zeros(900),
                               "yaw_rate": np.zeros(900), "speed": np.full(900, 20.0)})  # fmt: skip
    found = watched(tmp_path)
    assert "error" in found[1] and "change" in found[0]
    refused(WRONG, "watch", tmp_path, "--kp", 0.1)
    (tmp_path / "empty").mkdir()
    refused(WRONG, "watch", tmp_path / "empty")


@pytest.mark.parametrize("reference", [(), ("--reference", "wanted")])
def test_margins_as_promised_are_confirmed(tmp_path, reference):
    kp, Ti = rule(GRIP)
    path = log(tmp_path / "loop.csv", windows=6)
    code, out, _ = call("check", path, "--kp", kp, "--Ti", Ti, "--json", *reference)
    found = json.loads(out)
    margin, crossover = (found["metrics"][name] for name in ("phase_margin", "crossover"))
    assert code == TRUSTED and found["agreement"] == "as_promised"
    assert margin["low"] < 60 < margin["high"] and margin["high"] - margin["low"] < 10
    assert abs(crossover["value"] - 1.5) < 0.1


def test_margins_not_as_promised_are_called_out(tmp_path):
    kp, Ti = rule(0.45)  # tuned on ice, driven on asphalt
    path = log(tmp_path / "loop.csv", gains=(kp, Ti))
    theta = np.array([[GRIP, LOAD, SPEED]])
    truth = Drives.of().loops(theta).evaluate(np.array([kp]), np.array([Ti])).margins
    flags = "--kp", kp, "--Ti", Ti, "--reference", "wanted"
    code, out, _ = call("check", path, *flags, "--json")
    found = json.loads(out)["metrics"]
    assert code == UNTRUSTED
    assert abs(found["phase_margin"]["value"] - truth.phase_margin[0]) < 4
    assert abs(found["crossover"]["value"] - truth.crossover[0]) < 0.2
    promised = truth.phase_margin[0], truth.crossover[0]
    flags += "--phase-margin", promised[0], "--crossover", promised[1]
    kept = 0  # intervals are 90 %: of four drives one may miss
    for seed in range(4):
        path = log(tmp_path / f"loop{seed}.csv", gains=(kp, Ti), seed=seed)
        code, out, _ = call("check", path, *flags)
        kept += code == TRUSTED and "As promised." in out
    assert kept >= 3
    refused(WRONG, "check", path, "--kp", kp)
