"""Plants that are not as simulated: spreads that hold in coloured noise, parts that differ."""

import numpy as np
import pytest
from first_order import SIGMA, TS, U, described
from scipy.signal import lfilter

import tuners
from tuners.trust.discrepancy import Discrepancy
from tuners.trust.identification import drawn_to_prior
from tuners.trust.limits import MESSAGES
from tuners.trust.residuals import lag_one
from tuners.trust.verdict import Verdict
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.excitation import prbs

RNG = np.random.default_rng(0)
B, N = 400, 600
SLOPES = lfilter([0.1], [1, -0.9], RNG.standard_normal((1, 2, N)), axis=2)


def discrepancies(noise):
    """Discrepancies of linear regressions on `SLOPES` of outputs that are noise (B, N)."""
    slopes = np.repeat(SLOPES, len(noise), axis=0)
    steps = np.linalg.solve(SLOPES[0] @ SLOPES[0].T, SLOPES[0] @ noise.T).T
    error = noise - steps @ SLOPES[0]
    power = (error**2).mean(axis=1)
    inverse, white = drawn_to_prior(slopes, power)
    simulated = np.repeat(SLOPES[0, :1], len(noise), axis=0)
    return steps, white, Discrepancy.of(error, slopes, simulated, power, inverse, white)


def test_in_white_noise_little_is_added():
    steps, white, found = discrepancies(0.01 * RNG.standard_normal((B, N)))
    each = np.sqrt(np.einsum("bii->bi", found.covariance) / np.einsum("bii->bi", white))
    assert np.median(each) == pytest.approx(1.0) and each.mean() < 1.05
    # Parts differ by as much as chance says: chi-square of two degrees.
    distance = np.einsum(
        "bmi,bmij,bmj->bm", found.shifts, np.linalg.inv(found.chance), found.shifts
    )
    np.testing.assert_allclose(distance.mean(axis=0), 2.0, rtol=0.2)
    assert (found.difference(np.repeat(np.eye(2)[None], B, axis=0)) > 0).mean() < 0.03


@pytest.mark.parametrize("pole", [0.9, 0.98])
def test_the_spread_holds_in_coloured_noise(pole):
    noise = lfilter([0.01], [1, -pole], RNG.standard_normal((B, N + 500)), axis=1)[:, 500:]
    steps, white, found = discrepancies(noise)
    actual = steps.std(axis=0)
    claimed = np.sqrt(np.einsum("bii->bi", found.covariance).mean(axis=0))
    naive = np.sqrt(np.einsum("bii->bi", white).mean(axis=0))
    assert (naive < 0.5 * actual).all()
    assert (claimed > 0.8 * actual).all() and (claimed < 2.0 * actual).all()


def test_a_parameter_that_jumps_shows_in_halves_as_half_of_the_jump():
    once = SLOPES[:, :1, : N // 2]
    slopes = np.concatenate([once, once], axis=2)  # both halves hold the same
    jump = np.where(np.arange(N) < N // 2, -0.02, 0.02) * slopes[:, 0]
    power = np.full(1, 1e-12)
    inverse, white = drawn_to_prior(slopes, power)
    found = Discrepancy.of(jump, slopes, slopes[:, 0], power, inverse, white)
    assert found.shifts[0, 0, 0] == pytest.approx(0.02, rel=1e-6)


STATIC = np.repeat(np.random.default_rng(0).uniform(-1, 1, 25), 20)
TRUTH, QUIET = (1.2, 0.6), 0.005


def lag(T, signal):
    a = np.exp(-TS / T)
    return lfilter([0, 1 - a], [1, -a], signal)


@pytest.fixture(scope="module")
def square():
    """A lag behind a square: no black box reproduces it."""
    plant = Plant(
        prior={"K": (0.5, 2.0), "T": (0.2, 1.0)},
        simulate=lambda theta, u, rng: np.stack([K * lag(T, u * u) for K, T in theta]),
        design=lambda theta: np.stack([theta[:, 1] / (0.3 * theta[:, 0]), theta[:, 1]], axis=1),
        gains=("kp", "Ti"), u=STATIC, Ts=TS, noise=QUIET,
    )  # fmt: skip
    return tuners.train(plant, episodes=100, calibration=100)


FAULTS = {
    "drift": lambda y: y + np.linspace(0, 0.2, len(y)) * y.max(),
    "another valve": lambda y: TRUTH[0] * lag(TRUTH[1], np.abs(STATIC)),
    "clipped": lambda y: np.minimum(y, 0.7 * y.max()),
    "offset": lambda y: y + 0.1 * y.max(),
}


@pytest.mark.parametrize("fault", [None, *FAULTS])
def test_faults_that_no_black_box_contradicts(square, fault):
    K, T = TRUTH
    y = K * lag(T, STATIC**2)
    noise = QUIET * np.random.default_rng(1).standard_normal(len(y))
    found = square.tune(STATIC, FAULTS.get(fault, lambda y: y)(y) + noise)
    if fault is None:
        assert found.verdict == Verdict.USABLE
        assert any("cannot follow this plant" in note for note in found.notes)
    else:
        assert found.verdict == Verdict.REFUSE
        assert any(why.startswith("Parts of the recording") for why in found.reasons)


def test_louder_noise_is_told_from_a_pattern(square):
    y = TRUTH[0] * lag(TRUTH[1], STATIC**2)
    white = np.random.default_rng(2).standard_normal(len(y))
    coloured = lfilter([np.sqrt(1 - 0.6**2)], [1, -0.6], white)
    found = {
        name: {
            check.name for check in square.tune(STATIC, y + QUIET * n).checks if not check.passed
        }
        for name, n in {"1.7": 1.7 * white, "3": 3 * white, "coloured": 1.9 * coloured}.items()
    }
    assert found["1.7"] == set()
    assert "louder" in found["3"] and "pattern" not in found["3"]
    assert "pattern" in found["coloured"] and "louder" not in found["coloured"]


def test_correlation_of_neighbours_is_that_of_the_process():
    noise = lfilter([1], [1, -0.7], RNG.standard_normal((20, 20_000)), axis=1)
    np.testing.assert_allclose(lag_one(noise), 0.7, atol=0.02)
    assert lag_one(np.zeros((1, 5))) == 0


@pytest.mark.parametrize("ambient", [0.0, 20.0])
def test_a_dead_time_that_the_simulator_lacks(ambient):
    Ts = 2.0
    u = prbs(N=500, Ts=Ts, bit_time=40.0, amplitude=20.0)[0] + 40.0

    def warmed(theta, u, rng):
        K, T = theta
        a = np.exp(-Ts / T)
        return ambient + lfilter([0, K * (1 - a)], [1, -a], u)

    plant = Plant(
        prior={"K": (0.3, 1.2), "T": (40.0, 200.0)}, gains=("kp", "Ti"), u=u, Ts=Ts, noise=0.2,
        batched=False, simulate=warmed, design=lambda t: (t[1] / (30 * t[0]), t[1]),
    )  # fmt: skip
    late = np.concatenate([np.zeros(6), u[:-6]])
    noise = 0.2 * np.random.default_rng(1).standard_normal(len(u))
    gray = tuners.load("gb", plant)
    assert gray.tune(u, warmed((0.7, 100.0), u, None) + noise).verdict == Verdict.USABLE
    wrong = gray.tune(u, warmed((0.7, 100.0), late, None) + noise)
    assert wrong.verdict == Verdict.REFUSE
    misfit = next(check for check in wrong.checks if check.name == "misfit")
    assert misfit.value > misfit.refusal


def test_a_plant_without_gains_is_told_so():
    def design(theta):
        K, T = theta.T
        return np.where(K > 1.0, np.stack([T / (0.3 * K), T]), np.nan).T

    plant = described(design=design)
    theta = np.array([[0.7, 0.5], [1.5, 0.5]])
    noise = SIGMA * np.random.default_rng(3).standard_normal((2, len(U)))
    without, found = (tuners.load("gb", plant).tune(U, y) for y in plant.respond(theta) + noise)
    assert found.verdict == Verdict.USABLE
    assert without.verdict == Verdict.REFUSE
    assert without.reasons == (MESSAGES["undesigned"],)


@pytest.mark.parametrize("Ts", [TS / 2, 2 * TS])
def test_the_experiments_samples_at_another_sampling_time(Ts):
    plant = described(plausible=(2.0, 20.0))
    y = plant.respond(plant.middle)[0] + SIGMA * np.random.default_rng(4).standard_normal(len(U))
    gray = tuners.load("gb", plant)
    assert gray.tune(U, y, TS).verdict == Verdict.USABLE
    wrong = gray.tune(U, y, Ts)
    assert wrong.verdict == Verdict.REFUSE
    assert any(why.startswith("The input is the experiment's") for why in wrong.reasons)
    # The same experiment, sampled more quickly, is no other.
    held = np.repeat(U, 2)
    assert not [c for c in gray.tune(held, np.repeat(y, 2), TS / 2).checks if c.name == "stretched"]


def test_recordings_may_be_shorter_than_the_experiment():
    plant = described(linear=True, black_box=(24, 3.0))
    gray = tuners.load("gb", plant)
    order, N = gray.inspection.black_box.order, 200
    y = plant.respond(plant.middle)[0] + SIGMA * np.random.default_rng(5).standard_normal(len(U))
    found = gray.tune(U[:N], y[:N])
    assert 10 * order > N
    assert found.verdict == Verdict.USABLE
    with pytest.raises(ValueError, match="99 samples are too few"):
        gray.tune(U[:99], y[:99])


def heated(theta, u, rng=None):
    """Outputs (N,) of K/(T s + 1) with a dead time L of any length, sampled every second."""
    K, T, L = theta
    a, whole = np.exp(-1 / T), int(max(L, 0.0))
    share = np.exp(-(1 - (max(L, 0.0) - whole)) / T)
    late = np.concatenate([np.zeros(whole), u])[: len(u)]
    return K * lfilter([0, 1 - share, share - a], [1, -a], late)


def simc(theta):
    """Skogestad's rule with the closed loop as fast as the dead time."""
    K, T, L = theta
    return T / (K * 2 * L), min(T, 8 * L)


def test_a_heater_that_is_not_quite_first_order_is_usable_with_care():
    """Steps from rest, a second lag, another heater's drift: what real devices do."""
    N = 600
    u = np.repeat([0.0, 70.0, 20.0, 50.0], [10, 240, 200, 150])
    plant = Plant(
        prior={"K": (0.3, 1.5), "T": (60.0, 400.0), "L": (0.0, 30.0)}, linear=True,
        simulate=heated, design=simc, gains=("kp", "Ti"), batched=False, u=u, Ts=1.0, noise=0.1,
    )  # fmt: skip
    truth = 0.6, 180.0, 8.0
    noise = 0.1 * np.random.default_rng(2).standard_normal(N)
    slow = 21.0 + lfilter([1 / 4], [1, -3 / 4], heated(truth, u))
    tuner, right = tuners.load("gb", plant), np.array(simc((0.6, 180.0, 11.0)))  # lag and all
    for size, verdict in ((0.0, Verdict.USABLE), (0.6, Verdict.USABLE_WITH_CARE)):
        found = tuner.tune(u, slow + size * np.sin(np.arange(N) / 90) + noise)
        assert found.verdict is verdict
        assert np.abs(np.array([*found.gains.values()]) / right - 1).max() < 0.25
    moves = np.where(np.arange(N) > 300, 0.75, 1.0)  # the heater's gain at another place
    assert tuner.tune(u, 21.0 + moves * heated(truth, u) + noise).verdict is Verdict.REFUSE
