"""The report: what stands in it, and the statistics behind its words."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from answers import answer
from recordings import recorded
from systems import control_controller, control_plant

import tuners
from tuners.cli.report import render
from tuners.cli.report.page import CHECKS
from tuners.cli.report.residuals import autocorrelation, cross_correlation
from tuners.tuner.result import Check
from yawrate_env.vehicle.single_track import Context, Vehicle
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import theta_of, yaw_rate


@pytest.fixture(scope="module")
def page():
    return render(*answer(), "ts-ff-lag")


class Checked(HTMLParser):
    """Fails on tags that do not match, counts identities, keeps what is loaded from elsewhere."""

    VOID = {"meta", "br", "img", "link", "path", "use", "rect", "stop"}

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.loaded = [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.ids += [values["id"]] if "id" in values else []
        self.loaded += [v for k, v in attrs if k in ("src", "href", "xlink:href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


def check_whole(page, pictures):
    """Well-formed, with so many pictures, and nothing that it would load or that it lacks."""
    found = Checked(page)
    assert len(found.ids) == len(set(found.ids)) > 10
    assert all(link.startswith("#") for link in found.loaded)
    assert "@import" not in page and "<script" not in page and "url(http" not in page
    assert page.count("<svg") == pictures and len(page) < 1.5e6
    assert "NaN" not in page and "None" not in page


def test_the_page_is_whole_and_loads_nothing(page):
    check_whole(page, pictures=6)


def test_figures_have_text_and_not_outlines(page):
    words = set(re.findall(r"<text[^>]*>([^<]*)</text>", page))
    assert {"frequency [Hz]", "1.50 Hz", "60.0°", "fitted model", "Residual with itself"} <= words


def test_the_same_answer_gives_the_same_page(page):
    assert render(*answer(), "ts-ff-lag") == page


def test_the_verdict_and_what_was_assumed_are_said(page):
    for words in ("Trusted", "60.02°", "between 59.81 and 60.22", "0.1506", "u[k] = u[k-1] +",
                  "Modulus margin", "Delay margin", "offset 0.573 deg/s", "1895 kg", "5 Hz",
                  "Column u_deg is taken to be in deg.", "correlation with\nitself"):  # fmt: skip
        assert words in page, words


def test_reasons_against_are_said():
    page = render(*answer(trusted=False), "ts-ff-lag")
    assert "Not trusted" in page and "The residual is not white" in page
    assert "kp 0.2 s" in page and "class=failed" in page


def test_every_check_has_a_name_and_a_unit_for_people():
    _, found = tuners.load("gb").assess(recorded(1))
    assert set(CHECKS) == set(found.findings)
    result, log, task = answer()
    checks = (Check("crossover_spread", 2.5e-05, 0.025, ""),)
    page = render(replace(result, checks=checks), log, task, "ts-ff-lag")
    assert "<th>Standard deviation of the crossover [Hz]</th>" in page and "2.5e−05" in page


def test_without_a_fit_there_are_words_and_no_figures():
    page = render(*answer(trusted=False, fitted=False), "ts-ff-lag")
    assert "<svg" not in page and "Not trusted" in page
    Checked(page)


def test_an_unstable_loop_is_drawn_and_said():
    page = render(*answer(trusted=False, gains=(5.0, 0.05)), "ts-ff-lag")
    assert "the loop is unstable" in page
    Checked(page)


def test_names_cannot_break_the_page():
    page = render(*answer(source="<script>alert(1)</script>.csv"), "ts & co")
    assert "<script" not in page and "&lt;script&gt;" in page and "ts &amp; co" in page


def test_the_loop_is_the_one_that_python_control_builds():
    import control

    task, context, kp, Ti = Task(), Context.of(0.8, 120.0, 18.0), 0.15, 0.104
    loop = yaw_rate(task).closed(theta_of(context)[0], np.array([kp, Ti]))
    G = control_plant(Vehicle(), context, 0, task.target.Ts)
    C = control_controller(kp, Ti, task.target)
    L = control.frequency_response(G * C, 2 * np.pi * loop.open.frequency)
    np.testing.assert_allclose(loop.open.magnitude, 20 * np.log10(L.magnitude), atol=1e-6)
    np.testing.assert_allclose(np.cos(np.radians(loop.open.phase)), np.cos(L.phase), atol=1e-6)
    assert -180 < loop.open.phase[0] < 0
    for found, system in zip(
        loop.responses, (control.feedback(G * C, 1), control.feedback(G, C)), strict=True
    ):
        expected = control.forced_response(system, inputs=np.ones(len(found.time))).outputs
        np.testing.assert_allclose(found.value, expected, atol=1e-9)


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


def test_coloured_noise_is_found():
    e = np.convolve(np.random.default_rng(2).standard_normal(4000), np.ones(4), "valid")
    found = autocorrelation(e, 0.01, 0.2)
    assert found.value[0] == pytest.approx(1) and found.value[1] == pytest.approx(0.75, abs=0.05)
    assert found.outside > 0.1


def test_constant_residuals_have_no_correlation():
    found = autocorrelation(np.zeros(100), 0.01, 0.2)
    assert (found.value == 0).all() and found.outside == 0
