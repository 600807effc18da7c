"""The PI loops of a distillation column in C, against the controllers one by one."""

import json
from dataclasses import replace

import numpy as np
import pytest
from c_programs import notices, passes
from recordings import ROOT
from two_by_two import plant as other

import tuners
from tuners.export import Gains, export, plant_settings
from tuners.export.loops_program import Loop
from yawrate_env.plant.entry import find
from yawrate_env.plant.episodes import recorded

LIMITS = (-0.5, 0.5), (-0.3, 0.4)
PARTS = "yawrate_top", "yawrate_bottom", "yawrate_loops"


@pytest.fixture(scope="module")
def result():
    plant = find("wood_berry:plant", ROOT / "examples" / "plants")
    block = recorded(plant, "test", 0, 1)
    return tuners.load("gb", plant).tune(block.u[0], block.y[0])


def test_loops_are_pi_controllers_of_either_sign(result):
    top, bottom = Loop.all_of(Gains.of(result), LIMITS)
    assert (top.name, top.sign, bottom.name, bottom.sign) == ("top", 1, "bottom", -1)
    assert bottom.pi.kp == -result.gains["kp_bottom"] and top.pi.Ts == result.plant.Ts
    assert bottom.pi.units == ("lb/min", "%") and bottom.pi.low == -0.3
    small = 0.01 * np.random.default_rng(0).standard_normal(50)
    kp, Ti, Ts = result.gains["kp_bottom"], result.gains["Ti_bottom"], result.plant.Ts
    integral = Ts * (np.cumsum(small) - small / 2)  # Tustin's, after a start at rest
    np.testing.assert_allclose(bottom.pi.run(-small), kp * (small + integral / Ti), atol=1e-12)


@pytest.mark.parametrize("real", ["double", "float"])
def test_all_loops_compile_and_meet_their_golden_vectors(result, tmp_path, real):
    files = export(result, "c", tmp_path, limits=LIMITS, real=real)
    assert {path.stem for path in files} >= {*PARTS, "yawrate_loops_test"}
    assert passes(tmp_path, *PARTS)
    for part in PARTS[:2]:
        assert passes(tmp_path, part)


def test_golden_vectors_notice_a_wrong_sign_and_loops_that_are_exchanged(result, tmp_path):
    export(result, "c", tmp_path, limits=LIMITS)
    mistakes = {"-errors[1]": "errors[1]", "commands[0] = yawrate_top": "commands[1] = yawrate_top"}
    assert notices(tmp_path, "yawrate_loops.c", mistakes, *PARTS)


def test_json_has_the_gains_by_name(result, tmp_path):
    export(result, "json", tmp_path / "gains.json")
    assert json.loads((tmp_path / "gains.json").read_text())["gains"] == result.gains


@pytest.mark.parametrize("gains, limits, name", [
    (None, None, "limits"),
    (None, (-1.0, 1.0), "limits"),
    ({"kp_a": 1.0, "Ti_a": 1.0}, LIMITS, "gains"),
    ({"K": 1.0, "L": 1.0, "M": 2.0, "N": 1.0}, LIMITS, "gains"),
])  # fmt: skip
def test_what_are_no_loops_is_refused_by_name(result, gains, limits, name):
    with pytest.raises(ValueError, match=name):
        Loop.all_of(replace(Gains.of(result), values=gains or result.gains), limits)
    with pytest.raises(ValueError, match="gains"):
        values = {"kp1": 1.0, "Ti1": 1.0, "kp2": 1.0, "Ti2": 1.0}
        Loop.all_of(Gains.read_plant(values, plant_settings(other)), LIMITS)
