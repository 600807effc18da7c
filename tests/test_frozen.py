"""What users of the outside names get does not move unless it is meant to."""

import json
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent / "references"))
from make_frozen_answers import PATH, answers  # noqa: E402

RTOL = 1e-9  # another processor's rounding; gains of the search amplify it
RTOL_OF_TRUST = 1e-6  # so do eigenvalues of nearly singular matrices


def leaves(tree, path=()):
    """Values with the path to each."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in pairs:
        if isinstance(value, dict | list):
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key), value


def test_observations_rewards_gains_and_intervals_are_the_frozen_ones():
    frozen, now = dict(leaves(json.loads(PATH.read_text()))), dict(leaves(answers()))
    assert list(frozen) == list(now)
    for path, value in frozen.items():
        if isinstance(value, bool | str):
            assert now[path] == value, path
        else:
            rtol = RTOL_OF_TRUST if path[0] == "tune" else RTOL
            assert now[path] == pytest.approx(value, rel=rtol, abs=1e-12, nan_ok=True), path
