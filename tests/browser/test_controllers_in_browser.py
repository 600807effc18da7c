"""Reports of controllers beyond a PI in Chromium: their sliders, narrow screens, barriers."""

from functools import cache

import control
import numpy as np
import pytest
from browsing import barriers, needs_chromium

from tuners.cli.report import render
from tuners.logs import Log
from tuners.logs.excitation import check
from tuners.tuner.rivals import GrayBox
from tuners.tuner.tuner import Tuner
from yawrate_env.loop.state_feedback import StateFeedback
from yawrate_env.loop.target import Target
from yawrate_env.plant import episodes
from yawrate_env.plant.control_loop import ControlLoop
from yawrate_env.plants import sopdt
from yawrate_env.signals.excitation import prbs

pytestmark = [pytest.mark.slow, needs_chromium]
SIGNALS = {"signals": ["heater [%]", "temperature [degC]"], "N": 300}


def heater(controller, rule):
    """A process with any controller."""
    aim = {"target": {"phase_margin": 60, "crossover": 0.008}} if rule == "loop-shaping" else {}
    return sopdt(controller=controller, rule=rule, experiment=SIGNALS, **aim)


def servo():
    """A state feedback."""
    loop = ControlLoop.of(
        lambda theta: control.ss([[-0.1, 1], [0, -theta[0]]], [[0], [-theta[1]]], [[1, 0]], 0),
        0.01, Target(60, 1, 0.01), ("force [N]", "position [m]"), weight=0.02, rule="lqr",
        controller=StateFeedback(("k1", "k2")), metrics=("phase_margin [deg]", "Ms"),
    )  # fmt: skip
    u = prbs(600, 0.01, 0.5, 1.0)[0]
    return loop.plant(prior={"d": (0.5, 3.0), "g": (0.5, 2.0)}, u=u, noise=0.01)


PLANTS = {
    "2DOF": lambda: heater("2DOF", "simc"),
    "PI-D": lambda: heater("PI-D", "loop-shaping"),
    "state feedback": servo,
}


@cache
def report(kind):
    """The page for one of the plant's recordings."""
    plant = PLANTS[kind]()
    u, y = plant.u, np.asarray(episodes.recorded(plant, "test", 0, 1).y[0])
    result = Tuner(plant, GrayBox(), {"name": "gray-box"}).tune(u, y, plant.Ts)
    log = Log(source="log.csv", t0=0.0, u=u, y=y, Ts=plant.Ts, measured={}, notes=(),
              excitation=check(plant, u, y, {}, plant.Ts), recorded_Ts=plant.Ts)  # fmt: skip
    return render(result, log, "my.tuner")


@pytest.fixture(params=[(1280, "dark"), (390, "light")], ids=str)
def context(browser, request):
    width, theme = request.param
    opened = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=theme)
    yield opened
    opened.close()


@pytest.mark.parametrize("kind", PLANTS)
def test_every_slider_of_the_kind_moves_the_loop(context, kind, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(report(kind), "utf-8")
    page, heard = context.new_page(), []
    page.on("console", lambda message: heard.append(message.text))
    page.on("pageerror", lambda error: heard.append(str(error)))
    page.goto(file.as_uri())
    assert page.get_by_label("Controller").input_value() == kind
    shown = page.locator("#live .sliders input:visible")
    names = [shown.nth(i).get_attribute("id") for i in range(shown.count())]
    assert names == {"2DOF": ["asked", "b", "delay"], "PI-D": ["crossover", "margin", "delay"],
                     "state feedback": ["asked", "delay"]}[kind]  # fmt: skip
    states = [page.locator("#live .found").inner_text()]
    for name, key in zip(names, ("ArrowLeft", "ArrowLeft", "ArrowRight"), strict=False):
        page.locator(f"#{name}").focus()
        page.keyboard.press("ArrowRight" if name == "delay" else key)
        states.append(page.locator("#live .found").inner_text())
    assert len(set(states)) == len(states)
    page.get_by_role("button", name="Back to the answer").click()
    assert page.locator("#live .found").inner_text() == states[0]
    assert heard == [] and barriers(page) == []
    width = context.pages[0].viewport_size["width"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
