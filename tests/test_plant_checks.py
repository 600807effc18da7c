"""What is wrong with a plant, or with what is asked of it, is said in one line before any work."""

import sys
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from first_order import U, by_one, described, design, plant, simulate
from command import UNUSABLE, refused

import yawrate_env
from tuners import data, plants
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.plants import Metric, snr
from tuners.trust.checks import MESSAGES, _of_figures
from tuners.tuner.stages import Recipe
from yawrate_env.plant.names import CHECKS, check_name
from yawrate_env.vehicle.task import Task

QUICK = Recipe(Laguerre(6, 2.0), FeedForwardSettings(neurons=4, epochs=5))


def judge(theta, gains):
    return gains[:, :1] + 0 * theta[:, :1]


def raises(error):
    def function(*arguments):
        raise error

    return function


def measured(theta, u, keys):
    return simulate(theta, u, None)


def search(u, y, theta):
    return theta, np.ones(len(theta), np.bool_)


def one_line(words):
    """A pattern for a message of one line that holds `words`."""
    return rf"\A[^\n]*{words}[^\n]*\Z"


SETTINGS = [
    ({"search_limits": {"K": "a"}}, "search_limits K = 'a'"),
    ({"search_limits": {"K": (3, 1)}}, "search_limits K.*low above high"),
    ({"search_limits": {"K": (1, 2, 3)}}, "search_limits K.*a pair"),
    ({"search_limits": {"K": np.nan}}, "search_limits K = nan"),
    ({"search_limits": {"K": np.array(1.0)}}, "search_limits K.*a pair"),
    ({"search_limits": {"K": (0.6, 3.0)}}, r"K = \[0.6, 3\] must contain the prior's \[0.5, 2\]"),
    ({"search_limits": [("K", (0, 9))]}, "search_limits.*names with values"),
    ({"u": U[:15]}, "number of samples of u = 15 must be .* at least 16"),
    ({"u": 0 * U}, "u is zero everywhere"),
    ({"crossover": 25.0}, "crossover = 25 must be .* below 25.*below half"),
    ({"Ts": 10**400}, "Ts = inf"),
    ({"Ts": np.complex128(1)}, "Ts = .*not a number"),
    ({"black_box": 5}, "black_box = 5 .*Laguerre"),
    ({"simulate": None}, "simulate = None cannot be called"),
    ({"design": 1}, "design = 1 cannot be called. Give a function."),
    ({"evaluate": 1, "metrics": {"x": 1.0}}, "evaluate = 1 cannot be called.*or None"),
    ({"excite": 1}, "excite = 1"),
    ({"excite": lambda words: U}, "excite gave shape .500,.* an input for each word"),
    ({"record": "a"}, "record = 'a'"),
    ({"gray_box": 1}, "gray_box = 1"),
    ({"linear": "no"}, "linear = 'no' must be True or False"),
    ({"batched": 1}, "batched = 1 must be"),
    ({"signals": "uy"}, "signals = 'uy' must be two texts"),
    ({"signals": ("u", "y", "z")}, "must be two texts"),
    ({"signals": ("u", 3)}, "signals' output = 3"),
    ({"entry": None}, "entry = None"),
    ({"gains": ("kp", 1)}, r"gains\[1\] = 1"),
    ({"gains": ("kp", " ")}, r"gains\[1\] = ' '"),
    ({"gains": {"kp", "Ti"}}, "must be names"),
    ({"prior": {1: (0.5, 2.0), "T": (0.2, 1.0)}}, "prior's parameter = 1"),
    ({"coordinates": np.log}, "coordinates = .*plants.LOG"),
    ({"coordinates": plants.Coordinates(None, np.exp)}, "coordinates.encode = None"),
    ({"measured": ("K",)}, "measured = .*names with values"),
    ({"measured": {"K": "a"}}, "measured K = 'a' is not a number"),
    ({"metrics": ("x",), "evaluate": judge}, "metrics = .*names with values"),
    ({"metrics": {"x": "a"}, "evaluate": judge}, "metric x = 'a' is not a number"),
    ({"metrics": {"": 1.0}, "evaluate": judge}, "metrics' name = ''"),
    ({"metrics": {"margin": 1.0}}, "metrics' name = 'margin': without a judge .* one of kp, Ti"),
    ({"noise": lambda y: -np.ones(len(y))}, "noise's least answer = -1"),
    ({"noise": None}, "noise = None"),
]

NAMES = [
    ({"gains": ("kp", "kp")}, "'kp' is the name of a gain and of a gain"),
    ({"gains": ("kp", "K")}, "'K' is the name of a gain and of a parameter"),
    ({"gains": ("kp", "stable")}, "'stable' is the name of a gain and of a word"),
    ({"gains": ("kp", "oracle_kp")}, "begin with oracle_"),
    ({"metrics": {"kp": 1.0}, "evaluate": judge}, "'kp' is the name of a figure and of a gain"),
    ({"metrics": {"clipped": 1.0}, "evaluate": judge}, "'clipped' is the name"),
    (
        {"metrics": {"a [x]": 1.0, "a [y]": 1.0}, "evaluate": judge},
        "check 'a_error', as has 'a \\[x",
    ),
    ({"metrics": {"a b": 1.0, "a_b": 1.0}, "evaluate": judge}, "check 'a_b_error'"),
    (
        {"prior": {"noise": (0.5, 2.0), "T": (0.2, 1.0)}, "measured": {"noise": 0.0}},
        "measured 'noise' is the name of a check too",
    ),
]

ANSWERS = [
    ({"simulate": raises(ZeroDivisionError("by zero"))}, "simulate .*ZeroDivisionError: by zero"),
    ({"design": raises(KeyError("J"))}, "design failed in the middle of the prior: KeyError: 'J'"),
    ({"noise": raises(TypeError("no"))}, "noise failed in the middle .*TypeError: no"),
    ({"excite": raises(OSError("no"))}, "excite failed in the middle .*OSError: no"),
    ({"record": raises(IndexError("no"))}, "record failed in the middle .*IndexError: no"),
    ({"gray_box": raises(ValueError("no"))}, "gray_box failed in the middle .*ValueError: no"),
    ({"coordinates": plants.Coordinates(raises(TypeError("a\nb")), np.exp)}, "TypeError: a b"),
    (
        {"evaluate": raises(AssertionError()), "metrics": {"x": 1.0}},
        "evaluate failed in the middle of the prior: AssertionError",
    ),
    ({"simulate": lambda *a: simulate(*a) + 0j}, "simulate's answer .*of complex128"),
    ({"simulate": lambda *a: simulate(*a) > 0}, "simulate's answer .*of bool"),
    ({"design": lambda t: design(t).astype(str)}, "design's answer .*of <U"),
    ({"design": lambda t: np.ma.masked_less(design(t), 9e9)}, "design's answer has 4 masked"),
    (
        {
            "batched": False,
            "design": by_one(lambda t: np.ma.masked_less(design(t), 9e9)),
            "simulate": by_one(simulate),
        },
        "design's answer has 2 masked",
    ),
    ({"noise": lambda y: "a"}, "noise's answer"),
    ({"noise": lambda y: np.ones(3)}, r"noise gave shape \(3,\), wanted \(2,\)\. For functions"),
    ({"design": lambda t: np.inf * design(t)}, "design in the prior's middle has inf"),
    ({"coordinates": plants.Coordinates(np.log, lambda x: "a")}, "coordinates.decode's answer"),
    ({"coordinates": plants.Coordinates(np.log, lambda x: 1.0)}, r"give \[1.\]"),
    ({"record": lambda t, u, keys: simulate(t, u, None)[:1]}, "record in the prior's middle has"),
    ({"record": lambda *a: measured(*a) * np.nan}, "record in the prior's middle has nan"),
    ({"record": lambda *a: measured(*a) + 0j}, "record in the prior's middle .*complex"),
    ({"gray_box": lambda u, y, theta: theta}, "gray_box gave a ndarray"),
    ({"gray_box": lambda u, y, theta: (theta[:1], True)}, "gray_box in the prior's middle"),
    ({"gray_box": lambda u, y, theta: (theta * np.inf, True)}, "gray_box in the prior's middle"),
    ({"gray_box": lambda u, y, theta: (theta, True)}, r"convergence of shape \(\) and bool"),
]


@pytest.mark.parametrize("change, words", SETTINGS + NAMES + ANSWERS)
def test_a_bad_description_is_refused_in_one_line(change, words):
    with pytest.raises(ValueError, match=one_line(words)):
        described(**change)


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
        search=search,
        metrics={"a [x]": Metric(1), "b [x]": 2},
        evaluate=lambda theta, gains: gains,
    )
    assert good.gains == ("kp", "Ti") and good.signals == ("u", "y") and good.linear is True
    assert good.limits[0].tolist() == [0.5, 0.1]


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: Metric("a"), "scale = 'a' is not a number"),
        (lambda: Metric(1, error=None), "error = None is not a number"),
        (lambda: Metric(1, spread=True), "spread = True is not a number"),
        (lambda: snr(-7000), "snr = -7000 must be .* at least -400"),
    ],
)
def test_numbers_that_are_none(call, words):
    with pytest.raises(ValueError, match=one_line(words)):
        call()


def test_checks_are_called_as_trust_calls_them():
    assert set(CHECKS) == {*MESSAGES, "between"}  # that one only where a log is slow
    names = list(_of_figures(plant, "error", np.zeros((1, 2)), ""))
    assert names == [check_name(name, "error") for name in plant.metrics]


def test_a_description_without_a_judge_can_be_replaced():
    assert replace(plant, noise=0.1).metrics == plant.metrics
    renamed = replace(plant, gains=("a", "b"))
    assert tuple(renamed.metrics) == ("relative error of a", "relative error of b")
    wider = replace(plant, metrics={"kp": 0.6})
    wanted = {"relative error of kp": Metric(0.6), "relative error of Ti": Metric(0.3)}
    assert wider.metrics == replace(wider, noise=0.1).metrics == wanted
    assert replace(wider, gains=("kp", "b")).metrics["relative error of kp"] == Metric(0.6)
    with pytest.raises(ValueError, match="belong together"):
        replace(plant, evaluate=judge)
    assert replace(plant, evaluate=judge, metrics={"x": 1.0}).metrics == {"x": Metric(1.0)}


def nothing(theta):
    return np.full((len(theta), 2), np.nan)


@pytest.mark.parametrize(
    "use",
    [
        lambda plant: gymnasium.make(yawrate_env.PLANT_ID, plant=plant),
        lambda plant: plants.train(plant),
    ],
    ids=["environment", "training"],
)
def test_a_design_without_any_gains_is_said_before_any_work(use):
    with pytest.raises(ValueError, match=one_line("no gains for any of 256 plants")):
        use(described(design=nothing))


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: plants.train(Task()), "Use tuners.train"),
        (lambda: plants.train(5), "plant = 5 is neither"),
        (lambda: plants.train("nowhere:plant"), "no module 'nowhere'"),
        (lambda: plants.train(plant, "ts-ff"), "recipe = 'ts-ff' is not of type Recipe"),
        (lambda: plants.train(plant, 0), "recipe = 0 is not of type Recipe"),
        (lambda: data.train_plant("no-folder", "ts-ff"), "recipe = 'ts-ff'"),
        (lambda: data.train_plant("no-folder", plant=Task()), "plant is a Task"),
        (lambda: replace(QUICK, noise_draws=0), "noise_draws = 0 must be .* at least 1"),
        (lambda: replace(QUICK, vehicles=0.5), "vehicles = 0.5"),
        (lambda: replace(QUICK, compressor=None), "compressor = None is no first stage"),
    ],
)
def test_what_cannot_be_trained_is_refused(call, words):
    with pytest.raises(ValueError, match=one_line(words)):
        call()


def test_a_plant_is_trained_by_its_entry_and_predicts_nothing_for_nothing():
    tuner = plants.train("first_order:plant", QUICK, count=50, calibration=0)
    assert tuner.plant is plant
    actions, state = tuner.predict(np.empty((0, 2, len(U))), 1)
    assert actions.shape == (0, 2) and state == 1


@pytest.mark.parametrize(
    "change, words",
    [
        ({"contexts": "nowhere"}, "context = 'nowhere' is unknown"),
        ({"contexts": None}, "contexts = None is not of type ContextSet"),
        ({"compressor": None}, "compressor = None is no first stage"),
        ({"compressor": Laguerre(60, 2.0)}, "500 samples are too few for 60"),
        ({"scheduler": "tcp://127.0.0.1:9", "workers": 2}, "scheduler 'tcp://127.0.0.1:9'"),
    ],
)
def test_a_data_set_that_cannot_be_begun_leaves_nothing(change, words, tmp_path, monkeypatch):
    monkeypatch.setattr("tuners.data.workers._SECONDS", 1)
    settings = {"contexts": "train", "compressor": QUICK.compressor} | change
    with pytest.raises(ValueError, match=words):
        data.generate(plant, episodes=20, seed=0, out=tmp_path / "a" / "b", **settings)
    assert not list(tmp_path.iterdir())


def test_a_start_that_fails_leaves_what_was_there(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    monkeypatch.setattr("tuners.data.workers.results", raises(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        data.generate(plant, "train", QUICK.compressor, 20, 0, tmp_path / "mine")
    assert (tmp_path / "mine").is_dir() and not list((tmp_path / "mine").iterdir())
    monkeypatch.undo()
    folder = data.generate(plant, "train", QUICK.compressor, 20, 0, tmp_path / "mine", workers=1)
    before = sorted(path.name for path in folder.path.iterdir())
    monkeypatch.setattr("tuners.data.generation._begun", raises(OSError("no")))
    with pytest.raises(data.DatasetError):
        data.generate(plant, "train", QUICK.compressor, 20, 0, tmp_path / "mine")
    assert sorted(path.name for path in folder.path.iterdir()) == before


@pytest.mark.parametrize(
    "code, words",
    [
        ("plant = (", "SyntaxError"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("import sys\nsys.exit(3)", "SystemExit: 3"),
        ("import nowhere_at_all", "ModuleNotFoundError: No module named 'nowhere_at_all'"),
        ("from first_order import described\nplant = described(Ts=0.0)", "ValueError: Ts = 0"),
        ("raise ValueError('a\\nb')", "ValueError: a b"),
    ],
)
@pytest.mark.parametrize("command", ["train -o a.tuner", "dataset --out data --episodes 20"])
def test_a_module_that_cannot_be_imported_is_one_line(code, words, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sys.modules.pop("my_plant", None)
    (tmp_path / "my_plant.py").write_text(code)
    (tmp_path / "my.toml").write_text('[plant]\nentry = "my_plant:plant"\n')
    line = refused(UNUSABLE, *command.split(), "--vehicle", "my.toml")
    assert line.startswith("error: my.toml: importing my_plant failed: ") and words in line
    assert not line.strip().endswith("..")
    assert "my_plant" not in sys.modules


FAILING = """
import first_order

def simulate(theta, u, rng):
    if len(theta) > 2:
        raise RuntimeError("valve stuck")
    return first_order.simulate(theta, u, rng)

plant = first_order.described(simulate=simulate, entry="failing_plant:plant")
"""


@pytest.mark.parametrize(
    "command", ["train -o a.tuner", "dataset --out data --episodes 20 --workers 1"]
)
def test_a_simulator_that_fails_in_the_end_is_one_line(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "failing_plant.py").write_text(FAILING)
    (tmp_path / "my.toml").write_text('[plant]\nentry = "failing_plant:plant"\n')
    line = refused(UNUSABLE, *command.split(), "--vehicle", "my.toml")
    assert line == "error: simulate failed: RuntimeError: valve stuck\n"
    sys.modules.pop("failing_plant")
