"""``yawrate tune`` for another loop than the tuner was made for."""

import pytest
from command import EXAMPLE, UNTRUSTED, WRONG, call, refused, tuned, tuner_of
from log_files import CASES, write

FLAGS = "--crossover", 2.0, "--phase-margin", 55.0, "--delay", 0.02


@pytest.mark.parametrize("tuner, rung", [("ts-ff-lag-vx", "fitted plant"), ("bb", "black box")])
def test_gains_are_for_the_wanted_loop(tuner, rung):
    found = tuned(EXAMPLE, tuner, *FLAGS)
    wanted = {"phase_margin": 55.0, "crossover": 2.0, "delay_samples": 2}
    assert wanted.items() <= found["target"].items()
    assert found["answered_by"] == rung and found["trusted"]
    assert found["phase_margin"]["value"] == pytest.approx(55.0, abs=0.5)
    assert found["crossover"]["value"] == pytest.approx(2.0, abs=0.02)


def test_no_more_certain_than_the_tuners_own_answer():
    turned = "--flip-input", "--json"
    code, *_ = call("tune", EXAMPLE, *turned)
    assert code == UNTRUSTED
    code, *_ = call("tune", EXAMPLE, *turned, "--crossover", 1.6)
    assert code == UNTRUSTED


@pytest.mark.parametrize("crossover, status", [(0.6, "unreachable"), (3.4, "phase_limited")])
def test_a_loop_that_no_pi_gives_is_refused(crossover, status):
    code, *_ = call("tune", EXAMPLE, "--crossover", crossover)
    assert code == UNTRUSTED
    assert tuned(EXAMPLE, "ts-ff-lag-vx", "--crossover", crossover)["status"] == status


@pytest.mark.parametrize(
    "flags, named",
    [
        (("--crossover", 60), "crossover"),
        (("--phase-margin", 200), "phase_margin"),
        (("--delay", 0.015), "--delay"),
        (("--delay", -0.01), "--delay"),
    ],
)
def test_wrong_targets_are_wrong_usage(flags, named):
    assert named in refused(WRONG, "tune", EXAMPLE, *flags)


def test_a_plant_with_one_target_says_so(tmp_path):
    log = write(tmp_path / "lag.csv", CASES["lag"].columns)
    line = refused(WRONG, "tune", log, "--tuner", tuner_of("lag"), "--crossover", 1.0)
    assert "--crossover" in line
