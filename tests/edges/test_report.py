"""The report's page, for every plant, and the statistics of its residuals."""

import re
from dataclasses import replace

import numpy as np
import pytest
from command import log_of, result_of
from matplotlib.figure import Figure
from pages import Checked, check_whole

from tuners.cli.report import render
from tuners.cli.report.figures import HALF, Traces, recording, svg
from tuners.cli.report.residuals import autocorrelation, cross_correlation
from yawrate_env.plant.responses import ClosedLoop, Response

NAMES = "vehicle", "lag"


@pytest.fixture(scope="module", params=NAMES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def page(name):
    return render(result_of(name), log_of(name), "my.tuner")


def text_of(page):
    return set(re.findall(r"<text[^>]*>([^<]*)</text>", page))


def test_the_page_is_whole_and_loads_nothing(page, name):
    check_whole(page, pictures={"vehicle": 6, "lag": 4}[name])


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e6])
def test_pictures_are_drawn_once_with_all_labels_inside_and_aligned(monkeypatch, scale):
    draw, drawn = Figure.draw, []
    monkeypatch.setattr(Figure, "draw", lambda self, to: (drawn.append(self), draw(self, to)))
    u, y = np.sin(np.arange(200.0))[None], scale * np.cos([[1.0], [1e-3]] * np.arange(200.0))
    labels = ("valve [%]",), ("a long name of an output [m]", "level [m]")
    picture = recording(Traces(3.0, 0.01, u, y, 0.98 * y, labels), HALF)
    svg(picture, "recording")
    assert drawn == [picture]
    box, size = picture.get_tightbbox(), picture.get_size_inches()
    assert (box.min >= 0).all() and (box.max <= size).all()
    ends = [axes.yaxis.label.get_window_extent().x1 for axes in picture.axes]
    assert np.ptp(ends) < 0.01


def test_the_same_result_gives_the_same_page_and_names_cannot_break_it():
    log = log_of("lag", source="<script>alert(1)</script>.csv")
    page = render(result_of("lag"), log, "ts & co")
    assert "<script>alert" not in page and "&lt;script&gt;" in page and "ts &amp; co" in page
    assert render(result_of("lag"), log, "ts & co") == page


SAID = {
    "vehicle": ["Yaw-rate controller from log.csv", "speed 18 m/s", "u[k] = u[k-1] +", "°",
                "Modulus margin", "friction", "M_0 1895", "Delay margin", "steering ±1 deg"],
    "lag": ["Flow controller from log.csv", "K 1.25", "first_order:gauged", "Relative error of Ti",
            "valve [%] to flow [l/s]", "measured; the tuner was made for 0.5 to 2"],
}  # fmt: skip
LABELS = {
    "vehicle": {"steering", "[deg]", "[deg/s]", "frequency [Hz]", "1.50 Hz", "fitted model"},
    "lag": {"valve", "[%]", "flow", "[l/s]", "fitted model", "Residual with the valve"},
}


def test_the_page_names_result_signals_parameters_and_setup(page, name):
    for words in (*SAID[name], ">Usable<", "my.tuner", "between ", "passed, limit 0.01"):
        assert words in page, words
    assert LABELS[name] <= text_of(page)


def test_every_check_has_a_name_for_people(page, name):
    table = page.partition("<h2>Checks</h2>")[2].partition("<h2>")[0]
    checks = result_of(name).checks
    assert table.count("passed, limit") == len(checks)
    for check in checks:
        assert f"<th>{check.name.replace('_', ' ')}<" not in table, check.name


def test_reasons_fallback_and_failed_checks_are_shown_and_no_controller_without_gains(name):
    result = result_of(name, sign=-1)
    none = dict.fromkeys(result.gains, np.nan)
    page = render(replace(result, gains=none, open_loop=None), log_of(name), "my.tuner")
    assert ">Refused<" in page and "class=failed" in page
    assert f"kp {result.fallback['kp']:.4g}" in page
    assert "<h2>Controller</h2>" not in page and ">none<" in page
    check_whole(page, pictures=4)


def test_an_unstable_loop_is_drawn_and_said():
    result = result_of("vehicle")
    gains = {"kp": 5.0, "Ti": 0.05}
    page = render(replace(result, gains=gains), log_of("vehicle"), "my.tuner")
    assert "the loop is unstable" in page
    Checked(page)


def test_responses_alone_are_drawn_for_wide_and_narrow_pages():
    asked = []

    def loop(theta, gains):
        asked.append((theta, gains))
        time = np.linspace(0.0, 3.0, 50)
        return ClosedLoop((Response("Step of the flow", time, 1 - np.exp(-time)),))

    result = result_of("lag")
    page = render(replace(result, plant=replace(result.plant, loop=loop)), log_of("lag"), "t")
    check_whole(page, pictures=6)
    assert "Step of the flow" in text_of(page)
    theta, gains = asked[-1]
    assert list(theta) == list(result.fit.parameters.values())
    assert list(gains) == list(result.gains.values())


# Residuals


def test_white_noise_stays_in_its_bands():
    """99 % bands, 400 lags of 20 realisations: the share outside has a std of about 0.1 %."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], 200), 25)
    shares = []
    for _ in range(20):
        e = rng.standard_normal(5000)
        shares.append((autocorrelation(e, 0.01, 4.0).outside,
                       cross_correlation(e, u, 0.01, 2.0).outside))  # fmt: skip
    auto, cross = np.mean(shares, axis=0)
    assert auto == pytest.approx(0.01, abs=0.004)
    assert cross == pytest.approx(0.01, abs=0.01)  # neighbours are correlated, as the input is


def test_what_the_input_explains_is_found_at_its_lag():
    rng = np.random.default_rng(1)
    u = rng.standard_normal(4000)
    e = 0.2 * np.roll(u, 7) + rng.standard_normal(4000)
    found = cross_correlation(e, u, 0.01, 0.2)
    assert found.lag[np.argmax(np.abs(found.value))] == pytest.approx(0.07)
    assert found.value.max() > 3 * found.band


def test_coloured_noise_is_found_and_constants_have_no_correlation():
    e = np.convolve(np.random.default_rng(2).standard_normal(4000), np.ones(4), "valid")
    found = autocorrelation(e, 0.01, 0.2)
    assert found.value[0] == pytest.approx(1) and found.value[1] == pytest.approx(0.75, abs=0.05)
    assert found.outside > 0.1
    found = autocorrelation(np.zeros(100), 0.01, 0.2)
    assert (found.value == 0).all() and found.outside == 0
