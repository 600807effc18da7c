"""What a report draws of the loop around a plant: numbers, margins, and the pictures made of it."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import control
import numpy as np
import pytest
from first_order import TAU, plant

from tuners.cli.report import figures, loops
from yawrate_env.loop.margins import Margins
from yawrate_env.loop.target import Target
from yawrate_env.plant.pi_loop import PILoop
from yawrate_env.plant.responses import ClosedLoop, OpenLoop, Response
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

TARGET = Target(phase_margin=50.0, crossover=1.0, Ts=0.02, delay_samples=1)
LOOP = PILoop.of(
    lambda theta: control.tf([theta[0]], [theta[1], 1]), 0.01, TARGET, ("valve [%]", "flow [l/s]")
)
THETA = np.array([2.0, 0.5])
F = np.geomspace(0.01, 10.0, 2000)
T = np.linspace(0.0, 3.0, 50)


def integrator(theta, gains):
    """The first-order plant's loop, 1/(TAU s), and the step of it."""
    step = Response("Step of the flow by 1 l/s", T, 1 - np.exp(-T / TAU), setpoint=1.0)
    return ClosedLoop((step,), OpenLoop(F, 1 / (2j * np.pi * F * TAU)))


def words(picture):
    return set(re.findall(r"<text[^>]*>([^<]*)</text>", figures.svg(picture, "picture")))


# Numbers


def test_a_pi_loop_is_the_one_that_python_control_builds():
    gains = LOOP.design(THETA[None])[0][0]
    found, (kp, Ti) = LOOP.around(THETA, gains), gains
    late = control.tf([1], [1, 0], TARGET.Ts)
    G = control.tf([THETA[0]], [THETA[1], 1]).sample(TARGET.Ts) * late
    C = kp * (1 + TARGET.Ts / (2 * Ti) * control.tf([1, 1], [1, -1], TARGET.Ts))
    expected = control.frequency_response(C * G, 2 * np.pi * found.open.frequency).complex
    np.testing.assert_allclose(found.open.response, expected, rtol=1e-9)
    for response, system in zip(
        found.responses, (control.feedback(C * G, 1), control.feedback(G / late, C * late)),
        strict=True,
    ):  # fmt: skip
        y = control.forced_response(system, inputs=np.ones(len(response.time))).outputs
        np.testing.assert_allclose(response.value, y, atol=1e-9)
        assert response.label == "flow [l/s]"
    assert [r.title for r in found.responses] == [
        "Step of the reference by 1 l/s", "Disturbance of the valve by 1 %",
    ]  # fmt: skip
    assert found.stable and found.open.marked.phase_margin[0] == pytest.approx(50.0)


def test_margins_are_read_off_where_none_are_given():
    found = LOOP.around(THETA, LOOP.design(THETA[None])[0][0]).open
    fine = np.geomspace(0.02, 24.0, 5000)
    real, imaginary = (
        np.interp(fine, found.frequency, part)
        for part in (found.response.real, found.response.imag)
    )
    read = OpenLoop(fine, real + 1j * imaginary).marked
    for name in Margins.__slots__:
        exact, (value,) = getattr(found.marked, name)[0], getattr(read, name)
        assert value == pytest.approx(exact, rel=2e-3), name


def test_margins_that_do_not_exist_are_none():
    open_loop = integrator(None, None).open
    margins = open_loop.marked
    assert margins.phase_margin[0] == pytest.approx(90.0)
    assert margins.crossover[0] == pytest.approx(1 / (2 * np.pi * TAU), rel=1e-5)
    assert margins.delay_margin[0] == pytest.approx(np.pi / 2 * TAU, rel=1e-5)
    table = dict(row[:2] for row in loops.margins(ClosedLoop(open=open_loop)))
    assert table == {
        "Phase margin": "90.0°", "Crossover": "0.53 Hz", "Gain margin": "none",
        "Modulus margin": "none", "Delay margin": "471 ms",
    }  # fmt: skip
    small = OpenLoop(F, 0.1 / (1 + 1j * F))
    assert {shown for _, shown, _ in loops.margins(ClosedLoop(open=small))} == {"none"}


def test_an_unstable_loop_ends_where_it_has_run_away():
    found = LOOP.around(THETA, np.array([400.0, 0.01]))
    assert not found.stable
    for response in found.responses:
        seen = response.value[np.isfinite(response.value)]
        assert 2 < len(seen) < len(response.value)
        assert 100 < np.abs(seen).max() < 1000
    scaled = replace(LOOP, discrete=lambda theta, Ts: LOOP.discrete(theta * [1e6, 1], Ts))
    found = scaled.around(THETA, np.array([400e-6, 0.01]))
    assert np.nanmax(np.abs(found.responses[1].value)) > 1e6  # flow per valve is a large number


def test_nothing_is_drawn_without_gains_or_without_a_loop():
    theta, none = plant.middle[0], np.array([np.nan, 1.0])
    assert plant.closed_loop(theta, np.ones(2)) is None
    assert replace(plant, loop=integrator).closed_loop(theta, none) is None
    assert loops.pictured(None, "y") == {} and loops.margins(None) == []


# Pictures


def test_pictures_say_what_they_show():
    both = integrator(None, None)
    drawn = loops.pictured(both, "flow [l/s]")
    assert {"frequency [Hz]", "0.53 Hz", "90.0°"} <= words(drawn["bode"])
    said = {"Step of the flow by 1 l/s", "flow [l/s]", "time [s]"}
    assert said <= words(drawn["responses"]) and set(drawn) == {"bode", "responses"}
    alone = loops.pictured(replace(both, open=None), "flow [l/s]")
    assert set(alone) == {"responses_wide", "responses_narrow"}
    assert said <= words(alone["responses_wide"])
    assert set(loops.pictured(replace(both, responses=()), "")) == {"bode"}


def test_a_loop_that_has_run_away_at_once_is_drawn():
    lost = Response("Step", T, np.full(50, np.nan))
    ElementTree.fromstring(figures.svg(figures.responses((lost,), "y"), "lost"))


def test_a_vehicles_loop_is_in_degrees():
    vehicles = yaw_rate(Task())
    found = vehicles.closed_loop(vehicles.middle[0], vehicles.oracle(vehicles.middle)[0])
    drawn = words(loops.pictured(found, vehicles.signals[1])["responses"])
    assert {"Step of the reference by 1 deg/s", "Disturbance of the steering by 1 deg",
            "yaw rate [deg/s]"} <= drawn  # fmt: skip
