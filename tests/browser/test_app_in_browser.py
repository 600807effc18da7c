"""``yawrate app`` in Chromium: drop a log, change a unit, answer, a wrong file, narrow screens."""

import base64
import subprocess
import sys

import pytest
from browsing import barriers, needs_chromium
from command import EXAMPLE, tuned

pytest.importorskip("starlette", reason="needs starlette")

pytestmark = [pytest.mark.slow, needs_chromium]

DROP = """([name, content]) => {
    const data = new DataTransfer();
    const bytes = Uint8Array.from(atob(content), (c) => c.charCodeAt(0));
    data.items.add(new File([bytes], name));
    const event = new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true });
    document.querySelector("#drop").dispatchEvent(event);
}"""


@pytest.fixture(scope="module")
def address():
    program = [sys.executable, "-m", "tuners.cli", "app", "--no-browser"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        yield process.stdout.readline().strip()
        process.terminate()


@pytest.fixture(params=[(1280, "light"), (390, "dark")], ids=str)
def page(browser, address, request):
    """The open page; what it complains of, and what it asks of others, fails the test."""
    width, theme = request.param
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=theme)
    opened, heard, sent = context.new_page(), [], []
    opened.on("console", lambda message: heard.append(message.text))
    opened.on("pageerror", lambda error: heard.append(str(error)))
    opened.on("request", lambda request: sent.append(request.url))
    opened.goto(address)
    yield opened
    assert heard == []
    assert sent and all(url.startswith((address, "blob:", "data:")) for url in sent)
    assert opened.evaluate("document.documentElement.scrollWidth") <= width
    context.close()


def drop(page, name, content):
    page.evaluate(DROP, [name, base64.b64encode(content).decode()])


def answered(page):
    """The gains that the report in the frame shows, once it does."""
    page.get_by_role("button", name="Tune").click()
    page.locator("iframe:visible").wait_for(timeout=60_000)
    shown = page.frame_locator("iframe:visible").locator(".numbers dd")
    return [float(shown.nth(i).inner_text().split()[0]) for i in (0, 1)]


def gains(found):
    return pytest.approx([found["kp"], found["Ti"]], rel=1e-3)


def test_a_dropped_log_is_shown_changed_and_answered(page):
    drop(page, "log.csv", EXAMPLE.read_bytes())
    page.locator(".u-over").nth(1).wait_for(timeout=60_000)
    unit = page.get_by_label("Unit of the output")
    assert unit.get_attribute("placeholder") == "rad/s"
    assert answered(page) == gains(tuned(EXAMPLE, "ts-ff-lag-vx"))
    unit.fill("deg/s")
    unit.press("Tab")
    page.get_by_text("Column yaw_rate was converted").wait_for()
    assert "--output-unit=deg/s" in page.locator("[data-command]").inner_text()
    unit.fill("parsec")
    unit.press("Tab")
    page.get_by_role("alert").filter(has_text="parsec").wait_for()
    unit.fill("")
    unit.press("Tab")
    page.get_by_role("alert").wait_for(state="hidden")
    with page.expect_download() as saved:
        page.get_by_role("link", name="Controller in MATLAB").click()
    assert saved.value.suggested_filename == "log.m"


def test_a_stretch_is_dragged_on_the_plot(page):
    drop(page, "log.csv", EXAMPLE.read_bytes())
    plot = page.locator(".u-over").nth(1)
    plot.wait_for(timeout=60_000)
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + 30, steps=4)
    page.mouse.up()
    begin, end = (float(page.get_by_label(f"{name} [s]").input_value()) for name in ("from", "to"))
    assert begin == pytest.approx(6.0, abs=0.1) and end == pytest.approx(12.0, abs=0.1)
    found = tuned(EXAMPLE, "ts-ff-lag-vx", "--from", begin, "--to", end)
    assert answered(page) == gains(found)


def test_a_wrong_file_is_told_and_other_logs_stay(page):
    drop(page, "log.csv", EXAMPLE.read_bytes())
    drop(page, "bad <b>.json", b'{"a": 1}')
    page.get_by_role("alert").filter(has_text="bad <b>.json: This is JSON").wait_for(timeout=60_000)
    page.get_by_role("tab", name="log.csv").click()
    page.locator(".u-over:visible").nth(1).wait_for()
    page.get_by_role("tab", name="bad <b>.json").click()
    page.get_by_role("button", name="Forget this log").click()
    assert page.get_by_role("heading", name="log.csv").is_visible()


def test_axe_finds_nothing_serious_on_any_screen(page):
    assert barriers(page) == []
    drop(page, "log.csv", EXAMPLE.read_bytes())
    page.locator(".u-over").nth(1).wait_for(timeout=60_000)
    assert barriers(page) == []
    answered(page)
    drop(page, "bad.json", b'{"a": 1}')
    page.get_by_role("alert").filter(has_text="bad.json").wait_for(timeout=60_000)
    assert barriers(page) == []
