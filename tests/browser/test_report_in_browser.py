"""The report in Chromium: sliders, keyboard, hover, themes, print, narrow screens."""

import re

import pytest
from browsing import barriers, needs_chromium
from command import log_of, result_of

from tuners.cli.report import write_report
from tuners.export import DigitalPID
from yawrate_env.vehicle.yaw_rate import COMMAND_LIMITS

pytestmark = [pytest.mark.slow, needs_chromium]


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, result_of("vehicle"), log_of("vehicle"), "ts-ff-lag-vx")
    return path


@pytest.fixture(params=[(1280, "light"), (768, "dark"), (390, "light")], ids=str)
def page(browser, report, request):
    """The open page; whatever it complains of, or asks the network for, fails the test."""
    width, theme = request.param
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=theme)
    opened, heard = context.new_page(), []
    opened.on("console", lambda message: heard.append(message.text))
    opened.on("pageerror", lambda error: heard.append(str(error)))
    opened.on("request", lambda sent: heard.append(sent.url))
    opened.goto(report.as_uri())
    yield opened
    assert heard == [report.as_uri()]
    assert opened.evaluate("document.documentElement.scrollWidth") <= width
    context.close()


def told(page, name):
    return page.locator(f"#live [data-{name}]").inner_text()


def test_it_opens_with_the_answer_and_sliders_move_it(page):
    kp, Ti = result_of("vehicle").gains.values()
    assert told(page, "gains") == f"kp {kp:.6g} s, Ti {Ti:.6g} s"
    before = told(page, "margins")
    page.locator("#crossover").focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    assert told(page, "margins") != before and float(told(page, "crossover-value")) > 1.5
    page.locator("#delay").focus()
    page.keyboard.press("End")
    assert told(page, "delay-value") == "100"
    assert "phase margin is given up" in told(page, "message")
    page.get_by_role("button", name="Back to the answer").click()
    assert told(page, "margins") == before


def test_buttons_copy_or_offer_the_text(page):
    page.get_by_label("Controller").select_option("PID")
    assert "Td" in told(page, "gains")
    assert not page.get_by_role("button", name="Copy command").is_visible()  # it gives a PI
    page.get_by_label("Controller").select_option("PI")
    page.evaluate(COPIED)
    page.get_by_role("button", name="Copy C", exact=True).click()
    text = page.wait_for_function("window.copied").json_value()
    kp, Ti = result_of("vehicle").gains.values()
    assert "@" not in text and number_of(text, "STEP") == pytest.approx(kp * 0.01 / Ti)
    page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(1); }")
    page.get_by_role("button", name="Copy gains").click()
    page.wait_for_function("!document.querySelector('[data-text]').hidden")
    assert page.locator("[data-text]").input_value() == told(page, "gains")


COPIED = """Object.defineProperty(navigator, "clipboard", {
    value: {writeText: async (text) => { window.copied = text; }}})"""


def number_of(text, name):
    return float(re.search(rf"\b{name} = (-?[\d.e+-]+\d)", text)[1])


def test_copied_c_has_the_numbers_of_the_export(page):
    page.evaluate(COPIED)
    for kind in ("P", "PIDF", "PI-D", "2DOF", "lead-lag"):
        page.get_by_label("Controller").select_option(kind)
        page.evaluate("window.copied = null")
        page.get_by_role("button", name="Copy C", exact=True).click()
        same_numbers(kind, page.wait_for_function("window.copied").json_value())


def same_numbers(kind, text):
    """A program's constants are those of its gains."""
    gains = (number_of(text, name) for name in ("Kp", "Ki", "Kd", "Tf", "b", "c"))
    of = DigitalPID(kind, *gains, 0.01, *COMMAND_LIMITS)
    numbers = {"KP": of.Kp, "HALF": of.half, "STEP": of.step, "DECAY": of.decay, "RATE": of.rate,
               "TRACKING": of.tracking, "REST": 1 - of.b, "LEFT": 1 - of.c, "LOW": of.low,
               "LARGEST": of.largest, "BEYOND": of.beyond}  # fmt: skip
    assert {name: number_of(text, name) for name in numbers} == pytest.approx(numbers, abs=1e-12)


def test_axe_finds_nothing_serious_at_rest_or_moved(page):
    assert barriers(page) == []
    page.locator("#delay").focus()
    page.keyboard.press("End")
    assert barriers(page) == []


def test_the_pointer_reads_values_and_bands(page):
    chart = page.locator("[data-step]")
    key = page.locator("[data-step] + .key")
    assert "this loop" in key.inner_text() and " s" not in key.inner_text().split("this")[0]
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.4 * box["height"])
    page.wait_for_function("document.querySelector('[data-step] + .key .at').textContent !== ''")
    value = float(key.locator(".this").inner_text().removeprefix("this loop"))
    low, high = map(float, key.locator(".band").inner_text().removeprefix("90 %").split(" to "))
    assert low < value < high and value == pytest.approx(1, abs=0.2)


def test_charts_are_drawn_and_paper_gets_the_still_pictures_until_something_moves(page):
    assert page.locator("#live canvas").count() == 5
    assert not page.locator(".still.loop").is_visible()
    page.emulate_media(media="print")
    assert page.locator(".still.loop").is_visible() and not page.locator("#live").is_visible()
    page.emulate_media(media="screen")
    page.get_by_label("Controller").select_option("PID")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    widths = {canvas.bounding_box()["width"] for canvas in page.locator("#live canvas").all()}
    assert widths == {310}
    page.emulate_media(media="print")
    assert page.locator("#live").is_visible() and not page.locator(".still.loop").is_visible()
    page.emulate_media(media="screen")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.wait_for_function("document.querySelector('#live canvas').clientWidth !== 310")
