"""Progress bars: one a stage, each to its end."""

from tuners.progress import Bars


def test_every_stage_has_a_bar_that_ends(capsys):
    with Bars() as bars:
        for done in (1, 4):
            bars("simulating", done, 4)
        bars("training", 3, 10)
    shown = capsys.readouterr().err.replace("\r", "\n").splitlines()
    assert any("simulating" in line and "4/4" in line for line in shown)
    assert any("training" in line and "3/10" in line for line in shown)


def test_bars_close_when_the_work_fails(capsys):
    try:
        with Bars() as bars:
            bars("simulating", 1, 4)
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        pass
    assert bars._bar is None
    bars.close()  # twice is fine
    assert "simulating" in capsys.readouterr().err


def test_a_stage_may_begin_half_way(capsys):
    with Bars() as bars:
        bars("simulating", 300, 400)  # done by an earlier run: no part of the rate
        assert bars._bar.initial == 300
        bars("simulating", 400, 400)
    assert "400/400" in capsys.readouterr().err
