"""Bad descriptions of a plant: the argument, and what its refusal names."""

from dataclasses import replace

import numpy as np
import pytest
from first_order import U, by_one, described, design, plant, simulate

from yawrate_env.plant.action_bounds import action_bounds
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.names import check_name
from yawrate_env.plant.noise import snr
from yawrate_env.plant.parametrisation import Parametrisation


def first_gain(theta, gains):
    return gains[:, :1] + 0 * theta[:, :1]


def undefined(theta, gains):
    return np.full((len(theta), 1), np.nan)


def raises(error):
    def function(*arguments):
        raise error

    return function


def measured(theta, u, keys, out, written):
    return simulate(theta, u, None)


def at(function):
    """A batched function of any arguments."""
    return lambda *arguments: function(simulate(*arguments))


OPTIONAL = "evaluate", "excite", "record", "loop", "action_bounds", "actuator", "remarks"
SETTINGS = [
    ("prior", {}, "at least one"),
    ("prior", {"K": (2.0, 0.5), "T": (0.2, 1.0)}, "prior K"),
    ("prior", {1: (0.5, 2.0), "T": (0.2, 1.0)}, "prior = 1"),
    ("search_limits", {"K": "a"}, "search_limits K"),
    ("search_limits", {"K": (1, 2, 3)}, "search_limits K"),
    ("search_limits", {"K": (0.6, 3.0)}, r"search_limits K .* \[0.5, 2\]"),
    ("search_limits", [("K", (0, 9))], "dict"),
    ("extrapolation", {"K": (1, 0)}, "extrapolation K"),
    ("labels", {"K": 3}, "labels K = 3"),
    ("measured", {"x": 0.1}, "'x'.*Choose one of K, T"),
    ("measured", {"K": -0.1}, "measured K = -0.1"),
    ("u", U[:15], "15 must be .* at least 16"),
    ("u", 0 * U, "zero everywhere"),
    ("u", U * np.nan, "finite"),
    ("crossover", 26.0, "= 26 must be .* below 25"),
    ("Ts", 0.0, "= 0"),
    ("Ts", 10**400, "= inf"),
    ("Ts", np.complex128(1), "not a number"),
    ("black_box", 5, "= 5"),
    ("black_box", (0, 2.0), "first of black_box = 0"),
    ("plausible", 3, "= 3"),
    ("plausible", (1.0, -1.0), "second of plausible = -1"),
    ("target", (1.0,), "shape"),
    *((name, None, "Give a function") for name in ("simulate", "design")),
    *((name, 1, "or None") for name in OPTIONAL),
    *((name, 3, "dict") for name in ("measured", "arguments", "synonyms", "cautions")),
    ("linear", "no", "True or False"),
    ("batched", 1, "True or False"),
    ("signals", ("u", "y", "z"), "pair"),
    ("signals", ("u", 3), "second of signals = 3"),
    ("entry", None, "= None"),
    ("messages", {"misfit": 3}, "misfit = 3"),
    (
        "messages",
        {"misift": "No valve."},
        "'misift' is unknown. Choose one of .*misfit, .*kp_error",
    ),
    ("messages", {"K": "Not measured."}, "'K' is unknown"),
    ("command_limits", (1.0, -1.0), "low above high"),
    ("command_limits", 3, "= 3 leaves no room"),
    ("command_limits", (2.0, 2.0), r"= \(2.0, 2.0\) leaves no room"),
    ("display", ("speed [rpm]", 9.55), "first of display"),
    ("gains", "kp", "names"),
    ("gains", {"kp", "Ti"}, "names"),
    ("gains", ("kp", " "), r"gains\[1\] = ' '"),
    ("parametrisation", np.log, "LOG"),
    ("metrics", {"margin": 1.0}, "'margin'.*Choose one of kp, Ti"),
    ("noise", -1.0, "= -1"),
]

NAMES = [
    ({"gains": ("kp", "kp")}, "'kp' is the name of a gain and of a gain"),
    ({"gains": ("kp", "oracle_kp")}, "'oracle_kp' begins with oracle_"),
    ({"labels": {"K": "a [b]", "T": "a [c]"}}, "'a .c.'"),
    ({"evaluate": first_gain}, "metrics"),
    ({"metrics": ("x",), "evaluate": first_gain}, "metrics = .*dict"),
    ({"metrics": {"x": 0.0}, "evaluate": first_gain}, "metrics x = 0"),
    ({"metrics": {"": 1.0}, "evaluate": first_gain}, "metrics = ''"),
    ({"metrics": {"kp": 1.0}, "evaluate": first_gain}, "'kp' is the name of a metric and"),
    ({"metrics": {"clipped": 1.0}, "evaluate": first_gain}, "'clipped'"),
    ({"metrics": {"a b": 1.0, "a_b": 1.0}, "evaluate": first_gain}, "'a_b'"),
    (
        {"prior": {"noise": (0.5, 2.0), "T": (0.2, 1.0)}, "measured": {"noise": 0.0}},
        "'noise' is the name of a measured parameter and",
    ),
    ({"evaluate": undefined, "metrics": {"x": 1.0}}, "evaluate's answer"),
]

ANSWERS = [
    ("simulate", raises(ZeroDivisionError("by zero")), "ZeroDivisionError: by zero"),
    ("simulate", by_one(simulate), "batched=False"),
    ("simulate", at(lambda y: y[:, 1:]), r"not \(2, 500\)"),
    ("simulate", at(lambda y: y * np.nan), "nan"),
    ("simulate", at(lambda y: np.random.default_rng().normal(size=y.shape)), "random"),
    ("simulate", at(lambda y: y + 0j), "complex128"),
    ("design", lambda t: design(t)[:, :1], r"not \(2, 2\)"),
    ("design", lambda t: np.ma.masked_less(design(t), 9e9), "4 masked"),
    ("design", lambda t: np.inf * design(t), "inf"),
    ("design", lambda t: (design(t), True), "bool"),
    ("noise", lambda y: "a", "numbers"),
    ("noise", lambda y: np.ones(3), r"\(3,\)"),
    ("noise", lambda y: -np.ones(len(y)), "= -1"),
    ("excite", lambda integers: U, "an input for each integer"),
    ("record", raises(IndexError("no")), "IndexError: no"),
    ("record", lambda *a: measured(*a)[:1], "shape"),
    ("loop", lambda theta, gains: gains, "ClosedLoop"),
    ("loop", lambda theta, gains: 1 / 0, "ZeroDivisionError"),
    ("parametrisation", Parametrisation(raises(TypeError("a\nb")), np.exp), "TypeError: a b"),
    ("parametrisation", Parametrisation(np.log, lambda x: "a"), "decode"),
    ("parametrisation", Parametrisation(np.log, lambda x: 1.0), r"\[1.\]"),
]


@pytest.mark.parametrize("name, value, words", SETTINGS + ANSWERS)
def test_a_bad_argument_is_named_in_one_line(name, value, words):
    with pytest.raises(ValueError, match=rf"\A[^\n]*\b{name}\b[^\n]*\Z") as found:
        described(**{name: value})
    assert found.match(words)


@pytest.mark.parametrize("change, words", NAMES)
def test_bad_names_and_metrics_are_refused_in_one_line(change, words):
    with pytest.raises(ValueError, match=rf"\A[^\n]*{words}[^\n]*\Z"):
        described(**change)


def test_functions_of_one_plant_are_checked_too():
    settings = {"batched": False, "simulate": by_one(simulate)}
    with pytest.raises(ValueError, match="design's answer has 2 masked"):
        described(design=by_one(lambda t: np.ma.masked_less(design(t), 9e9)), **settings)
    with pytest.raises(ValueError, match="evaluate for K = .* failed: AssertionError"):
        described(evaluate=raises(AssertionError()), metrics={"x": 1.0})


def test_gains_of_any_sign_need_their_own_parametrisation():
    own = {"design": lambda theta: -design(theta)}
    with pytest.raises(ValueError, match="parametrisation"):
        described(**own)
    same = Parametrisation(lambda gains: gains, lambda values: values)
    described(**own, parametrisation=same)


def test_what_a_function_raised_is_kept():
    error = ZeroDivisionError("by zero")
    with pytest.raises(ValueError) as found:
        described(simulate=raises(error))
    assert found.value.__cause__ is error


def test_what_is_good_is_still_described():
    good = described(
        search_limits={"K": (0.5, 2), "T": [0.1, 3]},
        gains=["kp", "Ti"],
        signals=["u", "y"],
        linear=np.True_,
        crossover=24.9,
        record=measured,
        metrics={"a [x]": Metric(1), "b [x]": 2},
        evaluate=lambda theta, gains: gains,
    )
    assert good.gains == ("kp", "Ti") and good.signals == ("u", "y") and good.linear is True
    assert good.limits[0].tolist() == [0.5, 0.1]
    assert described(metrics={"a": Metric(np.inf), "b": 1}, evaluate=good.evaluate).counted == (
        "b",
    )
    assert check_name("phase margin [deg]", "error") == "phase_margin_error"


@pytest.mark.parametrize(
    "call, name",
    [
        (lambda: Metric(0.0), "scale"),
        (lambda: Metric(1, error=None), "error"),
        (lambda: Metric(1, spread=True), "spread"),
        (lambda: snr(-7000), "snr"),
        (lambda: Parametrisation(None, np.exp), "encode"),
        (lambda: Parametrisation(np.log, np.exp, 3), "names"),
    ],
)
def test_settings_of_parts_are_checked(call, name):
    with pytest.raises(ValueError, match=name):
        call()


def test_a_description_without_evaluate_can_be_replaced():
    assert replace(plant, noise=0.1).metrics == plant.metrics
    renamed = replace(plant, gains=("a", "b"))
    assert tuple(renamed.metrics) == ("relative_error_of_a", "relative_error_of_b")
    wider = replace(plant, metrics={"kp": 0.6})
    targets = {"relative_error_of_kp": Metric(0.6), "relative_error_of_Ti": Metric(0.3)}
    assert wider.metrics == replace(wider, noise=0.1).metrics == targets
    assert replace(wider, gains=("kp", "b")).metrics["relative_error_of_kp"] == Metric(0.6)
    with pytest.raises(ValueError, match="evaluate and metrics"):
        replace(plant, evaluate=first_gain)
    own = replace(plant, evaluate=first_gain, metrics={"x": 1.0})
    assert own.metrics == {"x": Metric(1.0)}


def test_a_design_without_any_gains_is_refused_before_any_work():
    without = described(design=lambda theta: np.full((len(theta), 2), np.nan))
    with pytest.raises(ValueError, match="no gains for any of 256 plants"):
        action_bounds(without)


def test_functions_may_write_into_their_arguments():
    def rude(theta, u, rng):
        y = simulate(theta, u, rng)
        theta[:], u[:] = 0.0, 0.0
        return y

    def ruder(theta):
        gains = design(theta)
        theta /= 2
        return gains

    mine = U + 0.0
    own = described(simulate=rude, design=ruder, u=mine)
    mine[:] = 7.0
    np.testing.assert_array_equal(own.u, U)
    theta = np.array([[1.0, 0.5], [0.6, 0.3]])
    np.testing.assert_array_equal(own.respond(theta), plant.respond(theta))
    np.testing.assert_array_equal(own.oracle(theta), design(theta))


def fails_at(theta):
    """A rule that raises for one plant of the prior."""
    if (np.atleast_2d(theta)[:, 0] > 1.9).any():
        raise ZeroDivisionError("no gain")
    return design(theta)


@pytest.mark.parametrize("changes", [
    {"design": fails_at},
    {"design": lambda t: fails_at(t[None])[0], "simulate": by_one(simulate), "batched": False},
])  # fmt: skip
def test_the_plant_for_which_a_function_raises_is_named(changes):
    own = described(**changes)
    theta = np.array([[1.0, 0.5], [1.95, 0.25], [1.2, 0.3]])
    with pytest.raises(ValueError, match=r"design for K = 1\.95, T = 0\.25 failed.*no gain"):
        own.oracle(theta)


def test_functions_of_one_plant_are_told_of_one_plant():
    settings = {"batched": False, "simulate": by_one(simulate)}
    with pytest.raises(ValueError, match=r"answer for K = .* has shape \(3,\), not \(2,\)"):
        described(design=lambda t: np.ones(3), **settings)
