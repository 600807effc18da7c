"""Progress bars: one a stage, each to its end."""

import numpy as np
import pytest

from tuners.cli.progress import Bars
from tuners.learners.feedforward import FeedForwardSettings


def test_every_stage_has_a_bar_that_ends_even_if_the_work_fails(capsys):
    with pytest.raises(KeyboardInterrupt), Bars() as bars:
        bars("simulating", 300, 400)  # done by an earlier run
        bars("simulating", 400, 400)
        bars("training", 3, 10)
        raise KeyboardInterrupt
    bars.close()  # twice is fine
    shown = capsys.readouterr().err.replace("\r", "\n").splitlines()
    assert any("simulating" in line and "400/400" in line for line in shown)
    assert any("training" in line and "3/10" in line for line in shown)


def test_the_bar_of_a_training_that_stops_early_is_full(capsys):
    rng = np.random.default_rng(0)
    X, T = rng.standard_normal((60, 2)), rng.standard_normal((60, 2))  # nothing to be learned
    calls = []
    with Bars() as bars:

        def progress(*call):
            calls.append(call)
            bars("training", *call)

        FeedForwardSettings(epochs=100, max_fail=2).fit(
            [(X[:40], T[:40])], [(X[40:], T[40:])], 0, progress
        )
    *_, before, last = calls
    assert 0 < last[0] == last[1] == before[0] < before[1] == 100
    shown = capsys.readouterr().err.replace("\r", "\n").splitlines()
    assert "100%" in shown[-1] and f"{last[0]}/{last[0]}" in shown[-1]
