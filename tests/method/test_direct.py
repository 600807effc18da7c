"""Virtual and fictitious reference tuning, on plants that a PI gives exactly the reference loop."""

import control
import first_order
import numpy as np
import pytest
from recordings import recorded
from scipy.linalg import logm
from scipy.signal import cont2discrete, dlsim, lfilter

import tuners
from tuners.tuner.direct import FictitiousReference, VirtualReference
from tuners.tuner.recording import Recording
from tuners.tuner.reference_loop import ReferenceLoop
from tuners.tuner.tuner import Tuner
from yawrate_env.loop.design import LEAST_LAG, Status
from yawrate_env.loop.target import Target
from yawrate_env.plant.parametrisation import loop
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

TARGETS = [
    Target(60.0, 0.8, Ts=0.02),
    Target(45.0, 0.8, Ts=0.02, delay_samples=3),
    Target(85.0, 0.8, Ts=0.02, delay_samples=3),  # hold and delay take more than is left: a lead
    Target(60.0, 0.8, Ts=0.02, controller="printed"),
    Target(70.0, 0.5, Ts=0.02, delay_samples=1, controller="printed"),
]
METHODS = [kind(q) for kind in (VirtualReference, FictitiousReference) for q in (8.0, None)]
KP, TI = np.array([0.3, 2.0, 1.0, 5.0]), np.array([0.2, 0.5, 1.5, 0.06])
U = prbs(1200, 0.02, 0.1, 1.0)[0][None]


def described(target):
    return first_order.described(parametrisation=loop(target))


def controllers(target):
    """Numerator and denominator in q of the Tustin PIs, or of eq. (13)."""
    for kp, r in zip(KP, target.Ts / (2 * TI), strict=True):
        if target.controller == "pi":
            yield kp * np.array([1 + r, r - 1]), np.array([1.0, -1.0])
        else:
            yield kp * np.array([r, r]), np.array([1 + r, r - 1])


def plant_for(target, numerator, denominator):
    """The plant that this controller gives the reference loop, without the computation delay."""
    found = ReferenceLoop.of(target)
    num = np.convolve(found.gain[target.delay_samples :], denominator)
    return num, np.convolve(np.convolve([1, -1], found.lag), numerator)


def outputs(target, u=U):
    """Answers of the plants, noise-free."""
    plants = [plant_for(target, *c) for c in controllers(target)]
    return np.concatenate([lfilter(num, den, u) for num, den in plants])


@pytest.mark.parametrize("target", TARGETS)
def test_the_reference_loop_has_exactly_the_wanted_margins(target):
    found = ReferenceLoop.of(target)
    open_loop = np.convolve([1.0, -1.0], found.lag)
    size = max(len(found.gain), len(open_loop))
    num, den = (np.pad(p, (0, size - len(p))) for p in (found.gain, open_loop))
    L = control.tf(num, den, target.Ts)
    at = L(np.exp(1j * target.omega_c * target.Ts))
    assert abs(at) == pytest.approx(1, abs=1e-12)
    assert 180 + np.degrees(np.angle(at)) == pytest.approx(target.phase_margin, abs=1e-9)
    magnitude = np.abs(L(np.exp(1j * np.linspace(0.02, 1.6, 80) * target.omega_c * target.Ts)))
    assert (np.diff(magnitude) < 0).all()  # it crosses one there only
    assert (np.abs(np.roots(found.closed)) < 1).all()


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("target", TARGETS)
def test_the_right_controller_is_found_where_there_is_one(method, target):
    y = outputs(target)
    found = method.gains(described(target), Recording(U, y, target.Ts))
    np.testing.assert_allclose(found.values, np.stack([KP, TI], axis=1), rtol=1e-6)
    assert found.converged.all() and (found.status == Status.OK).all()


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_a_recording_sampled_faster_than_the_controller(method):
    """The same plants, held at the controller's rate, and recorded ten times as fast."""
    target, fast = TARGETS[0], 10
    u, rows = np.repeat(U, fast, axis=1), []
    for num, den in (plant_for(target, *c) for c in controllers(target)):
        num, den = np.convolve(num, [1.0]) / den[0], den / den[0]
        ends = np.roots(den)
        ends = ends[np.abs(ends - 1) > 1e-6]  # the integrators of loop and controller cancel
        poles = np.poly(ends)
        gain = num[1]
        A = np.array([-poles[1:], [1.0, 0.0]])
        rate = logm(np.block([[A, np.array([[1.0], [0.0]])], [np.zeros((1, 2)), 1.0]])).real
        rate /= target.Ts
        slow = rate[:2, :2], rate[:2, 2:], np.array([[gain, 0.0]]), np.zeros((1, 1))
        system = cont2discrete(slow, target.Ts / fast)
        _, y, _ = dlsim(system, u[0])
        np.testing.assert_allclose(y[::fast, 0], lfilter(num, den, U)[0], atol=1e-8)
        rows.append(y[:, 0])
    recording = Recording(u, np.array(rows), target.Ts / fast)
    found = method.gains(described(target), recording)
    np.testing.assert_allclose(found.values, np.stack([KP, TI], axis=1), rtol=0.01)


def noisy(target, count, sigma):
    rng = np.random.default_rng(3)
    y = outputs(target)[1:2]
    return y + sigma * y.std() * rng.standard_normal((count, y.shape[1]))


def test_noise_does_not_bias_but_would_bias_least_squares():
    target = TARGETS[0]
    loop_, y = ReferenceLoop.of(target), noisy(target, 400, 0.3)
    method, truth = VirtualReference(None), outputs(target)[1:2]
    right = method.solved(loop_, U, truth, truth, 1)
    instrumented = method.controller(loop_, U, y, 1) / right - 1
    least_squares = method.solved(loop_, U, y, y, 1) / right - 1
    error = instrumented.std() / np.sqrt(len(y))
    # What is left is of second order in the noise, and small beside what one recording gives.
    assert abs(instrumented.mean()) < 4 * error + 0.1 * instrumented.std()
    assert abs(least_squares.mean()) > 5 * abs(instrumented.mean())


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_more_of_a_noisy_recording_is_better(method):
    target = TARGETS[0]
    y = noisy(target, 200, 0.1)
    gains = [
        method.gains(described(target), Recording(U[:, :n], y[:, :n], target.Ts)).values
        for n in (300, 1200)
    ]
    short, long = (np.abs(np.median(g / [KP[1], TI[1]], axis=0) - 1) for g in gains)
    narrow, wide = (np.log(g[:, 0]).std() for g in reversed(gains))
    assert narrow < 0.8 * wide and (long < 0.03).all() and (short < 0.3).all()


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_what_no_pi_supplies_is_treated_as_the_design_rule_does(method):
    target = TARGETS[0]
    lead = lfilter(*plant_for(target, np.array([2.0, -1.0]), np.ones(1)), U)
    found = method.gains(described(target), Recording(U, np.concatenate([lead, -lead]), 0.02))
    assert found.status.tolist() == [Status.PHASE_LIMITED, Status.UNREACHABLE]
    tangent = np.tan(target.omega_c * target.Ts / 2) * 2 / target.Ts
    assert np.arctan(1 / (found.values[0, 1] * tangent)) == pytest.approx(LEAST_LAG)
    assert np.isnan(found.values[1]).all()


@pytest.mark.parametrize("name, margin, crossover", [("vrft", 1.0, 0.02), ("frit", 1.0, 0.025)])
def test_every_default_vehicle_is_stable_and_near_the_target(name, margin, crossover):
    test = recorded(64)
    tuner = tuners.load(name)
    found = tuner.gains(test)
    metrics, stable = tuner.plant.evaluation(test.known, found.values)
    assert stable.all() and found.converged.all() and (found.status == Status.OK).all()
    rms = np.sqrt(np.mean((metrics[:, :2] - [60.0, 1.5]) ** 2, axis=0))
    assert (rms < [margin, crossover]).all()


@pytest.mark.parametrize("kind", [VirtualReference, FictitiousReference])
def test_the_weight_is_what_brings_the_margins_near(kind):
    """Over all frequencies one reference loop is wrong for most vehicles (docs/direct.md)."""
    test, plant = recorded(64), yaw_rate(Task())
    flat, weighed = (
        np.abs(plant.errors(test.known, kind(q).gains(plant, test).values)[:, 0])
        for q in (None, 8.0)
    )
    assert np.nanmedian(flat) > 5.0 and np.median(weighed) < 1.0


@pytest.mark.parametrize("kind", [VirtualReference, FictitiousReference])
def test_all_samples_of_a_fast_recording_count(kind):
    """Ten times as many as the controller's, against noise that every tenth alone would let in."""
    experiment = Experiment(snr_db=10.0)
    test, plant = recorded(64, experiment), yaw_rate(Task(experiment=experiment))
    tenth = Recording(test.u[:, ::10], test.y[:, ::10], 0.01)
    rms = [
        np.sqrt(np.mean(plant.errors(test.known, kind().gains(plant, r).values)[:, 0] ** 2))
        for r in (test, tenth)
    ]
    assert rms[0] < 0.6 * rms[1]


@pytest.mark.parametrize("kind", [VirtualReference, FictitiousReference])
def test_an_answer_depends_on_its_own_recording_alone(kind):
    target, plant = TARGETS[0], described(TARGETS[0])
    y = outputs(target)
    batch = kind().gains(plant, Recording(U, y, 0.02)).values
    own = kind().gains(plant, Recording(np.repeat(U, len(y), axis=0), y, 0.02)).values
    single = [kind().gains(plant, Recording(U, row[None], 0.02)).values[0] for row in y]
    np.testing.assert_allclose(own, batch, rtol=1e-7)
    np.testing.assert_allclose(single, batch, rtol=1e-7)


@pytest.mark.parametrize("kind", [VirtualReference, FictitiousReference])
def test_no_excitation_or_no_numbers_give_no_gains(kind):
    target, y = TARGETS[0], outputs(TARGETS[0])
    zero = Recording(np.zeros_like(U), y, 0.02)
    lost = Recording(U, np.where(np.arange(y.shape[1]) == 7, np.nan, y), 0.02)
    flat = Recording(U, 0 * y, 0.02)
    for recording in (zero, lost, flat):
        found = kind().gains(described(target), recording)
        assert np.isnan(found.values).all() and not found.converged.any()
        assert (found.status == Status.UNREACHABLE).all()
    tuner = Tuner(described(target), kind())
    still = tuner.gains(Recording(U * 0 + 1.0, y, 0.02))
    assert np.isnan(still.values).all()


@pytest.mark.parametrize("name", ["vrft", "frit"])
def test_what_is_needed_is_said(name):
    with pytest.raises(ValueError, match=r"vrft and frit need .* parametrisation=loop\(Target"):
        tuners.load(name, first_order.plant).gains(Recording(U, U, 0.02))
    impossible = described(Target(170.0, 0.8, Ts=0.02, delay_samples=20))
    with pytest.raises(ValueError, match="phase_margin = 170: no stable reference loop"):
        tuners.load(name, impossible).gains(Recording(U, U, 0.02))
    with pytest.raises(ValueError, match="100 samples are too few"):
        tuners.load(name, described(TARGETS[0])).gains(Recording(U[:, :100], U[:, :100], 0.02))


def test_the_weight_is_checked_and_saved(tmp_path):
    with pytest.raises(ValueError, match="quality = -1"):
        VirtualReference(-1.0)
    path = tmp_path / "flat.tuner"
    Tuner(yaw_rate(Task()), FictitiousReference(None)).save(path)
    assert tuners.load(path).method == FictitiousReference(None)
