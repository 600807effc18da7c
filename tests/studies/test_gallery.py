"""The distillation column and the reactor against published settings and SciPy; their gallery."""

import sys

import numpy as np
import pytest
from recordings import ROOT
from scipy.integrate import solve_ivp

from studies import gallery
from studies.process_recordings import output
from yawrate_env.plant.entry import find
from yawrate_env.plant.episodes import sample

FOLDER = ROOT / "examples" / "plants"
COLUMN = np.array([[12.8, -18.9, 6.6, -19.4, *(60 * np.array([16.7, 21.0, 10.9, 14.4]))]])
MINUTES = np.array([1.0, 60.0, 1.0, 60.0])


@pytest.fixture(scope="module")
def column():
    plant = find("wood_berry:plant", FOLDER)
    return plant, sys.modules["wood_berry"]


@pytest.fixture(scope="module")
def reactor():
    plant = find("cstr:plant", FOLDER)
    return plant, sys.modules["cstr"]


def test_the_columns_gains_are_luybens(column, monkeypatch):
    """Table IV of his paper: F = 2.55; the controller here is sampled every second."""
    monkeypatch.setattr(column[1], "TS", 1.0)
    found = column[1].design(COLUMN)[0] / MINUTES
    np.testing.assert_allclose(found, [0.375, 8.29, -0.075, 23.6], rtol=0.01)


def test_the_columns_outputs_are_sums_of_scipys(column):
    plant, module = column
    late = module.LATE
    y = plant.respond(COLUMN)[0]
    for i in range(2):
        right = sum(
            output(
                {"K": COLUMN[0, 2 * i + j], "T": COLUMN[0, 4 + 2 * i + j], "L": late[i, j]},
                plant.u[j], module.TS, 0.0,
            )[:-1]
            for j in range(2)
        )  # fmt: skip
        np.testing.assert_allclose(y[i], right, atol=1e-9)


def test_the_columns_metrics_are_those_of_its_simulated_loops(column):
    """Integrated errors, and on which side of stability gains are that grow until it is lost."""
    plant, module = column
    gains = plant.oracle(COLUMN)
    (metrics,), _ = plant.evaluation(COLUMN, gains)
    assert metrics[0] == pytest.approx(4.0, abs=1e-6)
    for k, setpoints in enumerate(((1.0, 0.0), (0.0, 1.0))):
        y, _ = module.stepped(COLUMN[0], gains[0], setpoints, 3000)
        error = (1 - y[k]).sum() * module.TS / 60
        assert metrics[1 + k] == pytest.approx(error, rel=1e-6)
    for factor, expected in ((1.0, True), (2.5, True), (3.0, False), (4.0, False)):
        louder = gains * np.array([factor, 1.0, factor, 1.0])
        y, _ = module.stepped(COLUMN[0], louder[0], (1.0, 0.0), 3000)
        assert (np.abs(y[:, -1]).max() < 2) == expected
        assert module.stable(COLUMN, louder)[0] == expected


def test_the_reactor_rests_and_moves_as_scipy_says(reactor):
    plant, module = reactor
    theta = np.array([[0.9, 1.1]])
    np.testing.assert_allclose(plant.respond(theta, np.zeros(200)), 0.0, atol=1e-9)
    c, jacket = module.held(*theta[0])
    u, T, right = plant.u[:120], module.POINT, []
    for value in u:
        right.append(T - module.POINT)

        def rates(_, x, given=jacket + value):
            k = 0.9 * module.RATE * np.exp(-module.ENERGY / x[1]) * x[0]
            return (
                module.FLOW * (module.FEED - x[0]) - k,
                module.FLOW * (module.IN - x[1]) + module.HEAT * k
                + 1.1 * module.JACKET * (given - x[1]),
            )  # fmt: skip

        c, T = solve_ivp(rates, (0, module.TS), (c, T), rtol=1e-9, atol=1e-9).y[:, -1]
    np.testing.assert_allclose(plant.respond(theta, u)[0], right, atol=2e-3)


def test_the_reactors_rule_reaches_its_target_around_small_signals(reactor):
    """The response that it designs for is that of the simulator to a small sine, to 1 %."""
    plant, module = reactor
    theta, omega, k = sample(plant, 3), module.TARGET.omega_c, np.arange(4000)
    y = plant.respond(theta, 1e-3 * np.sin(omega * k * module.TS))[:, 2000:]
    turned = np.exp(-1j * omega * k[2000:] * module.TS)
    period = 2 * np.pi / (omega * module.TS)
    used = round(int(2000 / period) * period)
    G = 2j * (y[:, :used] * turned[:used]).mean(axis=1) / 1e-3
    np.testing.assert_allclose(module.response(theta, omega), G, rtol=0.02)


def test_a_page_is_made_of_recordings_and_pictures(tmp_path):
    page = tmp_path / "gallery.md"
    page.write_text("# Plants\n\n<!-- gallery:start -->\n<!-- gallery:end -->\n")
    exhibits = tuple(e for e in gallery.EXHIBITS if e.name in ("fopdt", "wood_berry"))
    gallery.run(exhibits, FOLDER, page, tmp_path)
    text = page.read_text()
    for exhibit in exhibits:
        assert (tmp_path / f"gallery_{exhibit.name}.png").stat().st_size > 10_000
        assert f"## {exhibit.title}" in text and f"gallery_{exhibit.name}.png)" in text
    assert "| `kp_bottom` | -0.0" in text and "Verdict: usable." in text
    kept = (ROOT / "docs" / "gallery.md").read_text()
    for exhibit in gallery.EXHIBITS:
        assert f"gallery_{exhibit.name}.png)" in kept
        assert (ROOT / "figures" / f"gallery_{exhibit.name}.png").exists()
