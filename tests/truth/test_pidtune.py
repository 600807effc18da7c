"""The table was made with 40 digits by `references/make_pidtune_reference.py`."""

import doctest
import json
from pathlib import Path

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tuners.pidtune import pidtune, tuning
from yawrate_env.loop.design import Status, design
from yawrate_env.loop.discretisation import zoh
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction

TABLE = json.loads(
    (Path(__file__).parents[1] / "references" / "pidtune_reference.json").read_text("utf-8")
)
ROWS = pytest.mark.parametrize(
    "row", TABLE, ids=[f"{i}-{r['name']}-{r['kind']}" for i, r in enumerate(TABLE)]
)
TRIPLE_LAG = control.tf(1, [1, 3, 3, 1])


def system(row):
    return control.tf(row["num"], row["den"], row["dt"])


def tuned(row, plant=None):
    options = {name: row[name] for name in ("wc", "pm", "delay")}
    return pidtune(plant or system(row), row["kind"], **options)


def stable(L):
    """Whether python-control's poles of the closed loop are."""
    poles = control.feedback(L, 1).poles()
    return bool((np.abs(poles) < 1).all() if L.dt else (poles.real < 0).all())


def loop_at(C, G, omega, delay=0.0):
    """Open loop by python-control alone."""
    at = np.exp(1j * omega * G.dt) if G.dt else 1j * omega
    return C(at) * G(at) * np.exp(-1j * omega * delay)


@pytest.mark.filterwarnings("ignore:stability_margins. Falling back")
@ROWS
def test_a_controller_is_the_tables_and_does_by_python_control_what_it_says(row):
    C, info = tuned(row)
    assert info.status == Status[row["status"]], info.note
    assert info.Stable == bool(row["stable"])
    if row["Kp"] is None:
        assert C is None and np.isnan([info.Kp, info.Ki, info.Kd]).all() and info.note
        return
    np.testing.assert_allclose(
        [info.Kp, info.Ki, info.Kd], [row["Kp"], row["Ki"], row["Kd"]], rtol=1e-8, atol=1e-12
    )
    if not row["delay"]:
        with np.errstate(all="ignore"):
            found = control.stability_margins(control.tf(system(row)) * C, returnall=True)[4]
        np.testing.assert_allclose(np.sort(found), info.crossings, rtol=1e-4)
        assert stable(control.tf(system(row)) * C) == info.Stable
    elif not row["dt"]:  # the Nyquist count against the poles of a Pade approximation
        lag = control.tf(*control.pade(row["delay"], 9))
        assert stable(control.tf(system(row)) * lag * C) == info.Stable
    L = loop_at(C, system(row), row["wc"], row["delay"])
    assert abs(L) == pytest.approx(1.0, rel=1e-6)
    assert np.degrees(np.angle(-L)) == pytest.approx(row["margin"], abs=1e-6)
    if row["status"] == "UNREACHABLE":  # it crosses again, and says so
        assert info.CrossoverFrequency > row["wc"] * 1.001
        assert abs(loop_at(C, system(row), info.CrossoverFrequency)) == pytest.approx(1.0, rel=1e-6)
        return
    assert info.CrossoverFrequency == pytest.approx(row["wc"], rel=1e-6)
    assert info.PhaseMargin == pytest.approx(row["margin"], abs=1e-6)
    if row["status"] == "OK" and row["kind"] not in ("P", "I"):
        assert info.PhaseMargin == pytest.approx(row["pm"], abs=1e-6)


@pytest.mark.parametrize("row", TABLE[::10])
def test_a_state_space_system_gives_the_same(row):
    C, info = tuned(row)
    C_ss, info_ss = tuned(row, control.ss(system(row)))
    assert (info_ss.status, info_ss.Stable) == (info.status, info.Stable)
    if C is not None:
        np.testing.assert_allclose([info_ss.Kp, info_ss.Ki], [info.Kp, info.Ki], rtol=1e-6)


# What MathWorks' pages print, and how far it binds us.  Default margin: 60 degrees.
COMMAND_LINE = "mathworks.com/help/control/ug/pid-controller-design-at-the-command-line.html"
CASCADE = "mathworks.com/help/control/ug/designing-cascade-control-system-with-pi-controllers.html"


def test_matlabs_pi_of_a_triple_lag():
    """COMMAND_LINE: pidtune(zpk([],[-1 -1 -1],1),'PI',1.0)."""
    _, info = pidtune(TRIPLE_LAG, "PI", wc=1.0)
    assert (round(info.Kp, 2), round(info.Ki, 4)) == (2.83, 0.0495)
    assert (info.Stable, round(info.PhaseMargin, 4)) == (True, 43.9973)
    assert info.CrossoverFrequency == pytest.approx(1.0, rel=1e-12)
    assert info.status == Status.PHASE_LIMITED


def test_matlabs_pi_without_a_wanted_crossover():
    """COMMAND_LINE: pidtune(zpk([],[-1 -1 -1],1),'PI'); our rule's one constant is from here."""
    _, info = pidtune(TRIPLE_LAG, "PI")
    assert (round(info.Kp, 2), round(info.Ki, 3)) == (1.14, 0.454)
    assert round(info.CrossoverFrequency, 4) == 0.5205
    assert round(info.PhaseMargin, 4) == 60.0


@pytest.mark.parametrize(
    ("plant", "wc", "Kp", "Ti"),
    [
        (control.tf(3, [1, 2]), 2.0, 0.244, 0.134),
        (control.tf(3, [1, 2]) * 10 * TRIPLE_LAG, 0.2, 0.0119, 0.849),
    ],
)
def test_matlabs_cascade(plant, wc, Kp, Ti):
    """CASCADE: pidtune(P2,pidstd(1,1),2) and pidtune(P1*P2,pidstd(1,1),0.2)."""
    _, info = pidtune(plant, "PI", wc=wc)
    assert (float(f"{info.Kp:.3g}"), float(f"{info.Ti:.3g}")) == (Kp, Ti)


def test_matlabs_pidf_has_another_split_but_our_filter():
    """COMMAND_LINE: pidtune(zpk([],[-1 -1 -1],1),'PIDF',1.0) gives 2.72, 0.985, 1.72, 0.00875.

    Crossover and margin fix two of the three gains: MATLAB's free choice is not published,
    ours puts the zeros in one place.
    """
    theirs = control.tf([1.72, 0], [0.00875, 1]) + control.tf([2.72, 0.985], [1, 0])
    L = loop_at(theirs, TRIPLE_LAG, 1.0)
    assert abs(L) == pytest.approx(1.0, abs=2e-3)  # as far as three printed digits carry
    assert np.degrees(np.angle(-L)) == pytest.approx(60.0, abs=0.1)
    C, info = pidtune(TRIPLE_LAG, "PIDF", wc=1.0)
    assert float(f"{info.Tf:.3g}") == 0.00875
    np.testing.assert_allclose([info.Kp, info.Ki, info.Kd], [2.72, 0.985, 1.72], rtol=0.06)
    L = loop_at(C, TRIPLE_LAG, 1.0)
    assert (abs(L), np.degrees(np.angle(-L))) == pytest.approx((1.0, 60.0), abs=1e-9)


def test_a_pi_is_the_environments():
    A = np.array([[[-1.0, 1, 0], [0, -2, 1], [0, 0, -5]]])
    B, C = np.array([[0.0, 0, 1]]), np.array([1.0, 0, 0])
    target = Target(phase_margin=50.0, crossover=0.2, Ts=0.05, delay_samples=2)
    plant = zoh(A, B, C, target.Ts)
    ours = design(TransferFunction.of(plant, 2), target)
    sys = control.ss(plant.A[0], plant.B[0][:, None], C[None], 0, target.Ts)
    _, info = pidtune(sys, "PI", wc=target.omega_c, pm=50.0, delay=0.1)
    np.testing.assert_allclose([info.Kp, info.Ti], [ours.kp[0], ours.Ti[0]], rtol=1e-9)


def random_roots(rng, count):
    """Left and right, real and in pairs, integrators."""
    roots = []
    while len(roots) < count:
        size, side = 10 ** rng.uniform(-1, 1.5), rng.choice([-1, -1, -1, -1, -1, 1])
        if rng.random() < 0.4 and len(roots) + 2 <= count:
            zeta = 10 ** rng.uniform(-2, 0)
            roots += [size * (side * zeta + j * np.sqrt(1 - zeta**2)) for j in (1j, -1j)]
        else:
            roots.append(0.0 if rng.random() < 0.15 else side * size)
    return roots


@pytest.mark.parametrize("seed", range(50))
def test_stability_of_random_loops_agrees_with_python_control(seed):
    """The delay is Pade's of order 8 there, exact here; both sides of the boundary occur."""
    rng = np.random.default_rng(seed)
    poles = random_roots(rng, rng.integers(1, 7))
    zeros = [z for z in random_roots(rng, rng.integers(0, len(poles))) if z]
    G = control.zpk(zeros, poles, rng.choice([-1, 1]) * 10 ** rng.uniform(-2, 2))
    delay = rng.choice([0.0, 0.3])
    kind, wc = rng.choice(["P", "PI", "PDF", "PIDF"]), 10 ** rng.uniform(-1, 1)
    C, info = pidtune(G, str(kind), wc=wc, pm=50.0, delay=delay)
    if C is None:
        return
    lag = control.tf(*control.pade(delay, 8)) if delay else 1
    assert info.Stable == stable(G * lag * C)
    if info.status == Status.OK and kind == "PIDF" and len(info.crossings) == 1:
        assert info.Stable  # the branch of the phase is the right one, unstable poles and all


POLES = st.floats(0.05, 20.0)


@settings(max_examples=50)
@given(
    st.lists(POLES, min_size=1, max_size=5),
    st.floats(0.1, 10.0),
    st.floats(20.0, 80.0),
    st.floats(0.0, 1.0),
    st.sampled_from(["PI", "PD", "PID", "PDF", "PIDF"]),
)
def test_met_wherever_it_says_so(poles, wc, pm, delay, kind):
    G = control.zpk([], [-p for p in poles], np.prod(poles))
    C, info = pidtune(G, kind, wc=wc, pm=pm, delay=delay)
    if info.status == Status.OK:
        L = loop_at(C, G, wc, delay)
        assert (abs(L), np.degrees(np.angle(-L))) == pytest.approx((1.0, pm), abs=1e-6)
        assert min(info.Kp, info.Ki, info.Kd) >= 0.0
        if kind in ("PI", "PIDF"):
            # Stable and large below wc, small above: the margin is what decides.
            assert info.Stable or len(info.crossings) > 1


@pytest.mark.parametrize("kind", ["P", "I", "PI", "PDF", "PID"])
@pytest.mark.parametrize(
    "plant",
    [
        TRIPLE_LAG,
        control.tf([-1, 2], [1, 3, 2]),
        control.tf(-4, [1, 3, 3, 1]),
        control.tf(1, [1, 1, 0]),
        control.sample_system(TRIPLE_LAG, 0.1),
        control.ss(TRIPLE_LAG),
    ],
)
def test_a_free_crossover_ends_in_a_stable_loop_with_the_margin(plant, kind):
    C, info = pidtune(plant, kind, pm=55.0)
    if kind == "I" and plant.dcgain() == np.inf:
        assert not info.Stable  # no integral controller stabilises 1/(s (s + 1)) at 55 degrees
        return
    assert info.Stable and info.status == Status.OK and not info.note
    assert info.PhaseMargin == pytest.approx(55.0, abs=1e-6)


def test_a_wrong_plant_is_refused():
    several = control.ss(np.eye(2) * -1, np.eye(2), np.eye(2), 0)
    improper, without_dt = control.tf([1, 0, 0], [1, 1]), control.tf(1, [1, 1], True)
    infinite = control.tf([np.nan], [1, 1]), control.ss(-np.inf, 1, 1, 0)
    degenerate = control.tf(1, [1e-300, 1, 1]), control.tf(1, [5e-324, 1e3, 1])
    for system in (1.0, several, improper, without_dt, *infinite, *degenerate):
        with pytest.raises(ValueError, match="^sys"):
            pidtune(system)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"kind": "PII"}, "kind"),
        ({"wc": np.nan}, "wc"),
        ({"wc": 32.0}, "wc"),
        ({"pm": 181.0}, "pm"),
        ({"delay": -1.0}, "delay"),
        ({"delay": 20.1}, "delay"),
        ({"delay": 0.05}, "delay"),  # no multiple of the sampling time
        ({"Tf": 0.1}, "Tf"),
        ({"Tf": -0.1}, "Tf"),
    ],
)
def test_wrong_options_are_refused(options, name):
    with pytest.raises(ValueError, match=f"^{name} = "):
        pidtune(control.sample_system(TRIPLE_LAG, 0.1), **options)


def test_a_delay_of_too_many_turns_is_refused_and_not_called_unstable():
    with pytest.raises(ValueError, match="^delay = "):
        pidtune(control.tf(1, [1, 1]), "P", wc=1.0, delay=1e6)


@pytest.mark.parametrize("kind", ["P", "I", "PI", "PD", "PID"])
def test_a_free_crossover_stays_below_nyquists_frequency(kind):
    for num, den in (([1], [1, -1]), ([1], [1, -0.01]), ([1, 1], [1, -1.5, 0.9]), ([1], [1, 0])):
        plant = control.tf(num, den, 1.0)
        _, info = pidtune(plant, kind)
        assert not info.CrossoverFrequency > np.pi


def test_a_crossover_on_a_pole_is_told():
    C, info = pidtune(control.tf(1, [1, 0, 1]), "PID", wc=1.0)
    assert C is None and info.status == Status.UNREACHABLE and "infinite" in info.note


def test_the_example_is_true():
    assert doctest.testmod(tuning).attempted == 3
    assert doctest.testmod(tuning).failed == 0


def test_a_zero_plant_and_a_plant_that_never_falls_are_told():
    C, info = pidtune(control.tf(0, [1, 1]), "PI", wc=1.0)
    assert C is None and info.status == Status.UNREACHABLE and "zero" in info.note
    C, info = pidtune(control.tf([1, 1], [1, 2]), "P", wc=1.0)  # the magnitude rises
    assert info.status == Status.UNREACHABLE and np.isnan(info.CrossoverFrequency)
    assert "stays there" in info.note and info.Stable


def test_a_dense_state_space_gives_what_its_transfer_function_gives():
    """Its zeros are at infinity, but come out between 500 and 1e15 rad/s, on either side."""
    rng = np.random.default_rng(0)
    for poles in ([-1, -2, -3], [-1, -2, -3, -4, -5, -6], [0, 0, -1], [2, -3, -4]):
        G = control.zpk([], poles, 10.0)
        system = control.ss(G)
        T = np.linalg.qr(rng.standard_normal((len(poles), len(poles))))[0]
        dense = control.ss(T.T @ system.A @ T, T.T @ system.B, system.C @ T, system.D)
        _, plain = pidtune(G, "PID", wc=1.5, pm=50.0)
        _, info = pidtune(dense, "PID", wc=1.5, pm=50.0)
        assert (info.status, info.Stable) == (plain.status, plain.Stable)
        np.testing.assert_allclose([info.Kp, info.Ki], [plain.Kp, plain.Ki], rtol=1e-6)
        free = [pidtune(sys, "PI")[1].CrossoverFrequency for sys in (G, dense)]
        assert free[1] == pytest.approx(free[0], rel=1e-4)


@pytest.mark.parametrize("wc, margin", [(0.5, 100.30484646876603), (1.2, 29.416713276795583)])
def test_a_p_is_asked_for_its_crossover_and_warns_of_no_phase(wc, margin):
    _, info = pidtune(TRIPLE_LAG, "P", wc=wc)
    assert info.note == "" and info.PhaseMargin == pytest.approx(margin, abs=1e-6)
    assert (info.status == Status.OK) == (margin >= 60.0)
