"""Initial states of nonlinear plants: unknown, estimated, and no matter of the rule."""

import numpy as np
import pytest
from first_order import SIGMA, TS, U, described, design
from log_files import write

import tuners
from tuners.logs import read_log
from tuners.trust.fit import left_open

THETA = np.array([1.3, 0.45])


def squared(theta, u, rng):
    """A lag behind a valve with a quadratic characteristic, from an initial output."""
    K, T = theta.T[:2]
    a = np.exp(-TS / T)
    v = np.broadcast_to((np.asarray(u) + 1.5) ** 2, (len(theta), np.shape(u)[-1]))
    y = np.zeros(v.shape)
    y[:, 0] = theta[:, 2] if theta.shape[1] > 2 else 0.0
    for k in range(v.shape[1] - 1):
        y[:, k + 1] = a * y[:, k] + (1 - a) * K * v[:, k]
    return y


def rule(theta):
    return design(theta[:, :2])


PRIOR = {"K": (0.5, 2.0), "T": (0.2, 1.0), "begin": (0.0, 6.0)}
moving = described(prior=PRIOR, simulate=squared, design=rule, initial=("begin",))
resting = described(simulate=squared)


def recording(begin, seed=0):
    noise = SIGMA * np.random.default_rng(seed).standard_normal(len(U))
    return squared(np.array([[*THETA, begin]]), U, None)[0] + noise


@pytest.mark.parametrize("begin", [0.0, 4.2, 7.5])  # the last is outside the prior
def test_a_recording_begins_where_it_may(begin):
    y = recording(begin)
    found = tuners.load("gb", moving).tune(U, y)
    kp, Ti = rule(THETA[None])[0]
    assert found.trusted
    assert found.gains == pytest.approx({"kp": kp, "Ti": Ti}, rel=0.02)
    assert found.fit.parameters["begin"] == pytest.approx(begin, abs=3 * SIGMA)
    if begin:
        assert not tuners.load("gb", resting).tune(U, y).trusted


def test_intervals_count_what_the_start_leaves_open():
    """Repeats scatter as the intervals say, which cover the initial state's share."""
    tuner = tuners.load("gb", moving)
    y = np.stack([recording(3.0, seed) for seed in range(64)])
    gains, found = tuner.assess(tuners.Recording(U[None], y, TS))
    assert found.trusted.mean() > 0.95
    scatter = np.std(gains.values / rule(THETA[None]) - 1, axis=0)
    np.testing.assert_allclose(found.exact_spread.mean(axis=0), scatter, rtol=0.3)
    assert not left_open(found.fit).any()


def test_a_wrong_plant_is_not_excused_by_an_unknown_start():
    drift = np.linspace(0, 0.5, len(U))
    assert tuners.load("gb", moving).tune(U, recording(3.0)).trusted
    assert not tuners.load("gb", moving).tune(U, recording(3.0) + drift).verdict == "usable"


def test_a_log_is_used_wherever_it_is_whole(tmp_path):
    y, t = recording(3.0), TS * np.arange(len(U))
    kept = np.arange(len(U)) != 40
    kept[41:60] = False  # a gap soon after the beginning
    path = write(tmp_path / "log.csv", {"t": t[kept], "valve": U[kept], "flow": y[kept]})
    log = read_log(path, moving)
    assert log.t0 == pytest.approx(t[60]) and len(log.u) == len(U) - 60
    with pytest.raises(ValueError, match="too short"):
        read_log(path, resting)


@pytest.mark.parametrize("changes, name", [
    ({"initial": ("level",)}, "initial"),
    ({"initial": "begin"}, "initial"),
    ({"initial": ("begin",), "linear": True}, "initial"),
    ({"initial": ("begin",), "measured": {"begin": 0.0}}, "initial 'begin'"),
    ({"initial": ("begin",), "design": lambda theta: rule(theta) * (1 + theta[:, 2:])}, "design"),
    ({"initial": ("K",)}, "design depends on K"),
])  # fmt: skip
def test_what_is_no_initial_state_is_refused(changes, name):
    with pytest.raises(ValueError, match=name):
        described(**({"prior": PRIOR, "simulate": squared, "design": rule} | changes))
