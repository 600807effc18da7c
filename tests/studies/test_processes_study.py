"""The study of ready plants: SciPy's recordings, and what is counted in them."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from recordings import ROOT

from studies import processes
from yawrate_env import plants


@pytest.mark.parametrize("name", plants.NAMES)
def test_scipys_recordings_are_the_plants_own_without_noise(name):
    plant = getattr(plants, name)(experiment={"noise": 0.0, "N": 200})
    theta, y = processes.recordings(plant, name, 4, 3)
    expected = plant.respond(theta)
    np.testing.assert_allclose(y, expected, atol=1e-8 * np.abs(expected).max())
    low, high = plant.ranges
    assert ((theta >= low) & (theta <= high)).all()


def test_a_plants_figures_are_added_to_those_stored(tmp_path):
    stored = json.loads((ROOT / "results" / "processes.json").read_text())
    found = processes.Found(**stored["sopdt PIDF simc"])
    assert found.recordings >= 500 and found.unstable == 0
    assert processes.write(found, tmp_path) == processes.tabulated([asdict(found)])
    assert json.loads((tmp_path / "processes.json").read_text()) == stored
