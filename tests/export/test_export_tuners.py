"""Any plant's tuner as a graph and in C, any plant's gains as a controller: equal to Python's."""

import json
import sys
from dataclasses import dataclass
from functools import cache

import numpy as np
import onnxruntime
import pytest
from c_programs import answers, passes
from first_order import TS, described
from recordings import ROOT, recorded
from command import UNUSABLE, WRONG, call, refused
from test_plant_kinds import registers, simulate

import tuners
from tuners import plants
from tuners.export import Gains, export, tuner_source
from tuners.export.onnx_tuner import onnx_model
from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.learners.actor import Actor, Agent
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.learners.trend import TrendSettings
from tuners.trust.black_box import suited_to_any_input
from tuners.tuner.baselines import Nominal
from tuners.tuner.coordinates import decode
from tuners.tuner.stages import Recipe, Stages
from tuners.tuner.two_stage import TwoStage
from yawrate_env.loop.design import Status
from yawrate_env.loop.target import CONTROLLERS, Target
from yawrate_env.plant import episodes as data
from yawrate_env.plant.parametrisation import PLAIN
from yawrate_env.vehicle.task import Task

sys.path.append(str(ROOT / "examples" / "plants"))
import dc_motor  # noqa: E402

RTOL = 1e-9  # 1e-10 for inputs of their own, else 5e-13: what is summed in another order differs
SMALL = FeedForwardSettings(neurons=6, epochs=8)
LAGUERRE, TREES = Laguerre(8, 2.0), GBMSettings(n_estimators=20)


def drifting(theta, u, rng):
    """The first-order plant on a slope."""
    return simulate(theta[:, :2], u, rng) + theta[:, 2:] * np.arange(u.shape[-1]) * TS


def three(theta):
    """Gains of a controller with three."""
    K, T, slope = theta.T
    return np.stack([T / K, T, 2 + slope], axis=1)


def sloped(**changes):
    prior = {"K": (0.5, 2.0), "T": (0.2, 1.0), "slope": (-0.1, 0.1)}
    beside = {"slope": 0.0, "T": 0.1}
    return described(
        prior=prior, simulate=drifting, design=three, gains=("Kc", "Ti", "Td"), measured=beside,
        signals=("u", "y"), **changes,
    )  # fmt: skip


@dataclass(frozen=True)
class Acting:
    """Agents that learned nothing."""

    hidden: str
    squashed: bool

    def fit(self, X, T, X_val, T_val, random_state, progress=None):
        widths, rng = (X.shape[1], 7, 7, T.shape[1]), np.random.default_rng(random_state)
        pairs = zip(widths[1:], widths, strict=False)
        layers = [(rng.normal(size=(a, b)) / 2, rng.normal(size=a) / 2) for a, b in pairs]
        actor = Actor(layers, self.hidden, self.squashed)
        return Agent(actor, X.mean(axis=0), X.std(axis=0), T.min(axis=0), T.max(axis=0))


VARIOUS = described(simulate=simulate, excite=registers)
PRIOR = suited_to_any_input(VARIOUS, 24)
RESPONSE = FrequencyResponse(order=8, pole=40.0, low=2.0, high=30.0, points=5)
CASES = {
    "logarithms": (described(), LAGUERRE, SMALL),
    "measured": (sloped(), LAGUERRE, TrendSettings(SMALL, degree=2)),
    "the gains themselves": (described(parametrisation=PLAIN), LAGUERRE, SMALL),
    "loop": (dc_motor.plant, Laguerre(6, 40.0), TrendSettings(SMALL)),
    "frequency response": (dc_motor.plant, RESPONSE, SMALL),
    "trees": (sloped(), LAGUERRE, TrendSettings(TREES)),
    "agent": (sloped(), LAGUERRE, Acting("relu", True)),
    "agent, clipped": (dc_motor.plant, Laguerre(6, 40.0), Acting("tanh", False)),
    "regularised": (described(simulate=simulate), PRIOR, SMALL),
    "inputs": (VARIOUS, LAGUERRE, SMALL),
    "regularised inputs": (VARIOUS, PRIOR, TrendSettings(SMALL)),
}
OWN_INPUTS = [name for name, (plant, *_) in CASES.items() if plant.excite]
SINGLE = "trees", "agent", "agent, clipped"
"""In single precision."""
NETWORKS = [name for name in CASES if name not in SINGLE]


@cache
def trained(case):
    """A tuner that was hardly trained: what it answers is to be equal, not good."""
    plant, compressor, learner = CASES[case]
    recipe = Recipe(compressor, learner, noise_draws=2)
    return plants.train(plant, recipe, count=80, calibration=0)


@cache
def faulty(case):
    """Recordings of plants, some of them of nothing that there is."""
    plant = trained(case).plant
    found = data.recorded(plant, "test", 0, 200)
    y = found.y.copy()
    y[1] = 0.0
    y[2] *= 1e7
    y[3, 50], y[4, -1] = np.nan, np.inf
    u = np.array(np.broadcast_to(found.u, y.shape))
    if len(found.u) > 1:
        u[5] = 0.0
    theta = found.theta.copy()
    theta[6, [i for i, name in enumerate(plant.prior) if name in plant.measured]] = np.nan
    return (u if len(found.u) > 1 else found.u), y, theta


def beside(plant, theta):
    return {name: theta[:, list(plant.prior).index(name)] for name in plant.measured_names}


def ran(model, plant, **inputs):
    """Gains (B, k) and status of a graph."""
    options = {"providers": ["CPUExecutionProvider"]}
    session = onnxruntime.InferenceSession(model.SerializeToString(), **options)
    *gains, status = session.run([*plant.gains, "status"], inputs)
    return np.stack(gains, axis=1), status


def assert_equal(found, expected, status, rtol=RTOL):
    np.testing.assert_allclose(found, expected, rtol=rtol)
    none = np.isnan(expected).any(axis=1)
    assert none.any() and not none.all()
    np.testing.assert_array_equal(status == Status.UNREACHABLE, none)


# Tuners


@pytest.mark.parametrize("case", [name for name in CASES if name not in OWN_INPUTS])
def test_a_tuner_as_a_graph_gives_pythons_gains(case):
    tuner, (u, y, theta) = trained(case), faulty(case)
    plant, expected = tuner.plant, tuner.gains(u, y, theta)
    output = plant.signals[1].partition(" [")[0]
    rtol = 1e-5 if case in SINGLE else RTOL
    found = ran(onnx_model(tuner), plant, **{output: y}, **beside(plant, theta))
    assert_equal(found[0], expected, found[1], rtol)
    one = ran(onnx_model(tuner), plant, **{output: y[:1]}, **beside(plant, theta[:1]))
    np.testing.assert_allclose(one[0], expected[:1], rtol=rtol)


@pytest.mark.parametrize("case", CASES)
def test_a_graph_from_features_does_so_for_any_input(case):
    tuner, (u, y, theta) = trained(case), faulty(case)
    features, _ = tuner.stages.compressor(u, y, tuner.plant.Ts)
    model, rows = onnx_model(tuner, features=True), beside(tuner.plant, theta)
    gains, status = ran(model, tuner.plant, features=features, **rows)
    expected = tuner.gains(u, y, theta)
    if case in OWN_INPUTS:  # that of zeros has features, and only the first stage knows
        expected[5] = gains[5]
    assert_equal(gains, expected, status, 1e-5 if case in SINGLE else RTOL)


@pytest.mark.parametrize("case", NETWORKS)
def test_a_tuner_in_c_gives_pythons_gains(case, tmp_path):
    tuner, (u, y, theta) = trained(case), faulty(case)
    written = export(tuner, "c", tmp_path)
    assert len(written) == 6
    assert passes(tmp_path, "yawrate_laguerre")
    assert passes(tmp_path, "yawrate_laguerre", "yawrate_tuner")
    shown = np.stack([np.empty(len(y)), *beside(tuner.plant, theta).values()], axis=1)[:, 1:]
    rows = ([[len(y[i])], shown[i], np.stack([row, y[i]], axis=1).ravel()]
            for i, row in enumerate(np.broadcast_to(u, y.shape)))  # fmt: skip
    gains, status = answers(tmp_path, rows)
    assert_equal(gains, tuner.gains(u, y, theta), status)


@pytest.mark.parametrize("name", ["ts-ff-lag", "ts-ff-lag-vx"])
def test_vehicles_are_tuned_in_c_too(name, tmp_path):
    tuner, recording = tuners.load(name), recorded(40)
    export(tuner, "c", tmp_path)
    assert passes(tmp_path, "yawrate_laguerre", "yawrate_tuner")
    speed = [recording.v_x[0]] if tuner.plant.measured_names else []
    u = recording.u[0]
    rows = ([[len(u)], speed, np.stack([u, y], axis=1).ravel()] for y in recording.y)
    gains, status = answers(tmp_path, rows)
    expected, _ = tuner.gains(recording)
    np.testing.assert_allclose(gains.T, [expected.kp, expected.Ti], rtol=RTOL)
    np.testing.assert_array_equal(status, expected.status)


@pytest.mark.parametrize("features", [True, False])
def test_the_tuner_of_every_speed_takes_it_as_an_input(features):
    tuner = tuners.load("ts-ff-lag-vx")
    found = data.recorded(tuner.plant, "test", 0, 200)
    own, _ = tuner.stages.compressor(found.u, found.y, tuner.plant.Ts)
    rows = {"features": own} if features else {"yaw_rate": found.y}
    gains, status = ran(onnx_model(tuner, features=features), tuner.plant, v_x=found.theta[:, 2],
                        **rows)  # fmt: skip
    values, _ = tuner.stages(
        found.u, found.y, tuner.plant.Ts, tuner.plant.measured_features(found.theta)
    )
    expected = decode(values, tuner.task.target, "loop")
    np.testing.assert_allclose(gains.T, [expected.kp, expected.Ti], rtol=RTOL)
    np.testing.assert_array_equal(status, expected.status)


@pytest.mark.parametrize("form", CONTROLLERS)
@pytest.mark.parametrize("coordinates", ["loop", "gains"])
def test_every_status_is_decoded_in_c(form, coordinates, tmp_path):
    from test_export import Echo

    task = Task(target=Target(controller=form))
    tuner = TwoStage(task, Stages(Laguerre(order=2), Echo(2)), coordinates, {})
    for name, text in tuner_source(tuner).items():
        (tmp_path / name).write_text(text)
    assert passes(tmp_path, "yawrate_laguerre", "yawrate_tuner")
    values = np.array([[-1.0, -0.4], [-1.0, 0.0], [0.5, 0.3], [0.5, -1.6], [0.2, 0.3], [800, -1]])
    gains, status = answers(tmp_path, ([[0.0], row] for row in values))
    expected = decode(values, task.target, coordinates)
    np.testing.assert_allclose(gains.T, [expected.kp, expected.Ti], rtol=1e-7)
    assert status.tolist() == expected.status.tolist()


def test_golden_vectors_see_a_wrong_tuner(tmp_path):
    files = tuner_source(trained("measured"))
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    mistakes = {"tanh(sum)": "sum", "log(measured[0])": "measured[0]", "* x[other]": "* x[i]",
                "exp(values[i])": "values[i]", "MEAN[j])": "MEAN[i])"}  # fmt: skip
    for right, wrong in mistakes.items():
        text = files["yawrate_tuner.c"].replace(right, wrong)
        assert text != files["yawrate_tuner.c"]
        (tmp_path / "yawrate_tuner.c").write_text(text)
        assert not passes(tmp_path, "yawrate_laguerre", "yawrate_tuner")


def test_a_header_says_what_memory_it_takes(tmp_path):
    text = tuner_source(trained("measured"))["yawrate_tuner.h"]
    assert f"a state of {8 * 9**2} bytes" in text and "bytes of constants" in text
    assert "T, slope" in text and "YAWRATE_TUNER_GAINS 3" in text


def test_what_is_called_strangely_stays_in_its_comment(tmp_path):
    plant = described(signals=("a */ int x;\n#error", 'b "/* \u202e\x00\ud800 [l]'))
    recipe = Recipe(LAGUERRE, SMALL)
    export(plants.train(plant, recipe, count=60, calibration=0), "c", tmp_path)
    assert passes(tmp_path, "yawrate_laguerre", "yawrate_tuner")


def test_what_cannot_be_exported_says_why_and_what_can(tmp_path):
    def of(compressor=LAGUERRE, learner=SMALL, **changes):
        recipe = Recipe(compressor, learner)
        return plants.train(described(**changes), recipe, count=60, calibration=0)

    own = plants.Coordinates(np.sqrt, np.square)
    for tuner, target, message in [
        (of(parametrisation=own), "onnx", r"decode is Python.* plants\.LOG or plants\.loop"),
        (of(parametrisation=own), "c", r"decode is Python.* plants\.LOG or plants\.loop"),
        (of(Armax(0.08)), "onnx", "its first stage is Armax, .*Laguerre.*Export"),
        (of(learner=TREES), "c", r"trees are not written in C.*features=True \(--features\)"),
        (trained("trees"), "c", "trees are not written in C"),
        (trained("agent"), "c", "agent is not written in C.*target onnx"),
        (trained("regularised inputs"), "onnx", r"input of its own.*features=True \(--features\)"),
        (of(signals=("u", "kp")), "onnx", "'kp' would be the name of two tensors.*Rename"),
        (Nominal(Task()), "c", "it is no two-stage tuner.*Export"),
    ]:
        with pytest.raises(ValueError, match=message):
            export(tuner, target, tmp_path / "x")
    assert not list(tmp_path.iterdir())
    export(trained("trees"), "c", tmp_path, features=True)
    assert passes(tmp_path, "yawrate_laguerre")


# Gains


@cache
def result(case):
    tuner = trained(case)
    found = data.recorded(tuner.plant, "test", 0, 1)
    measured = {name: row[0] for name, row in beside(tuner.plant, found.theta).items()}
    return tuner.tune(found.u[0], found.y[0], measured=measured)


def test_gains_of_a_pi_are_a_controller_in_the_plants_units(tmp_path):
    motor = result("loop")
    (path,) = export(motor, "json", tmp_path / "pi.json", limits=(-12.0, 12.0))
    content = json.loads(path.read_text())
    assert (content["Ts"], content["limits"]) == (dc_motor.target.Ts, [-12.0, 12.0])
    assert content["units"] | {"Ti": "s"} == content["units"]
    assert [content["units"][x] for x in ("u", "e", "kp")] == ["V", "rad/s", "(V)/(rad/s)"]
    assert {name: content[name] for name in motor.gains} == motor.gains
    export(motor, "c", tmp_path / "pi", limits=(0.0, 12.0))  # a command need not change its sign
    assert passes(tmp_path / "pi", "yawrate_pi")
    header = (tmp_path / "pi" / "yawrate_pi.h").read_text()
    assert "last command [V]" in header and "wanted minus measured speed [rad/s]" in header
    export(motor, "matlab", tmp_path / "pi.m", limits=(-12.0, 12.0))
    script = (tmp_path / "pi.m").read_text()
    assert "Out: voltage [V]." in script and "limits = [-12.0, 12.0];  % [V]" in script
    assert Gains.of(result("logarithms")).pi(limits=(0.0, 100.0)).Ts == TS


def test_json_is_always_possible(tmp_path):
    (path,) = export(result("measured"), "json", tmp_path / "gains.json")
    content = json.loads(path.read_text())
    assert (content["format"], content["version"]) == ("yawrate-gains", 1)
    assert content["gains"] == result("measured").gains and content["trusted"] is True
    assert content["signals"] == {"input": "u", "output": "y"} and content["target"] is None
    export(Gains({"kp": np.nan, "Ti": np.nan}, limits=None), "json", path)
    assert json.loads(path.read_text())["gains"] == {"kp": None, "Ti": None}
    export(Gains({"kp": 1.0, "Ti": 1.0}, target=Target(controller="printed")), "json", path)
    assert json.loads(path.read_text())["target"]["controller"] == "printed"
    export(result("loop"), "json", path)
    assert json.loads(path.read_text())["target"]["crossover"] == dc_motor.target.crossover


def test_controllers_that_cannot_be_written_are_refused(tmp_path):
    printed = Gains({"kp": 1.0, "Ti": 1.0}, target=Target(controller="printed"))
    for source, limits, message in [
        (result("measured"), (-1.0, 1.0), "gains Kc, Ti, Td are not a PI's kp and Ti.*target json"),
        (result("loop"), None, r"needs the limits of voltage \[V\]: .*--limits.*target json"),
        (result("loop"), (2.0, 1.0), r"low below high.* in V\."),
        (result("loop"), (1.0,), "must be two numbers"),
        (result("loop"), ("a", 1.0), "low = 'a' is not a number"),
        (printed, (-1.0, 1.0), "'printed' is no PI.*target json"),
    ]:
        for target in ("c", "matlab"):
            with pytest.raises(ValueError, match=message):
                export(source, target, tmp_path / "x", limits=limits)
    assert not list(tmp_path.iterdir())


# The command


@pytest.fixture(scope="module")
def motor(tmp_path_factory):
    """A folder with the motor's tuner, a log, and the answer to it."""
    folder = tmp_path_factory.mktemp("motor")
    tuner = trained("loop")
    tuner.save(folder / "motor.tuner")
    found = data.recorded(tuner.plant, "test", 0, 1)
    t = tuner.plant.Ts * np.arange(found.y.shape[1])
    table = np.stack([t, found.u[0], found.y[0]], axis=1)
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,u,y", comments="")
    code, out, _ = call("tune", folder / "log.csv", "--tuner", folder / "motor.tuner", "--json")
    assert code in (0, 3)
    (folder / "answer.json").write_text(out)
    return folder


def test_a_plants_tuner_is_exported_by_the_command(motor, tmp_path):
    tuner = ("export", "--tuner", motor / "motor.tuner")
    code, out, _ = call(*tuner, "-o", tmp_path / "c")
    assert code == 0 and len(out.split()) == 6
    code, out, _ = call(*tuner, "--features", "-o", tmp_path / "first")
    assert code == 0 and len(out.split()) == 3
    for flags in ((), ("--features",)):
        assert call(*tuner, "--target", "onnx", *flags, "-o", tmp_path / "x.onnx")[0] == 0
    assert "give gains" in refused(WRONG, *tuner, "--limits", 0, 1, "-o", tmp_path / "c")


def test_an_answer_is_exported_by_the_command(motor, tmp_path):
    answer = json.loads((motor / "answer.json").read_text())
    gains = ("export", "--result", motor / "answer.json")
    code, _, err = call(*gains, "--limits", -12, 12, "-o", tmp_path / "c")
    assert code == 0 and ("not to be trusted" in err) != answer["trusted"]
    assert passes(tmp_path / "c", "yawrate_pi")
    assert f"every {dc_motor.target.Ts:g} s" in (tmp_path / "c" / "yawrate_pi.h").read_text()
    json_ = ("--target", "json", "-o", tmp_path / "x.json")
    assert call(*gains, *json_)[0] == 0
    assert json.loads((tmp_path / "x.json").read_text())["gains"] == answer["gains"]
    assert "limits of voltage" in refused(UNUSABLE, *gains, "-o", tmp_path / "d")
    assert "not both" in refused(WRONG, *gains, "--kp", 1, "--Ti", 1, *json_)
    assert "for a tuner" in refused(WRONG, *gains, "--features", *json_)
    assert "is read" in refused(WRONG, *gains, *json_[:2], "-o", motor / "answer.json")


def test_a_vehicles_answer_is_exported_with_its_own_sampling_time(tmp_path):
    code, out, _ = call("tune", ROOT / "examples" / "log.csv", "--json")
    assert code == 0
    (tmp_path / "answer.json").write_text(out)
    path = tmp_path / "pi.json"
    assert (
        call("export", "--result", tmp_path / "answer.json", "--target", "json", "-o", path)[0] == 0
    )
    content, answer = json.loads(path.read_text()), json.loads(out)
    assert [content[n] for n in ("kp", "Ti", "Ts")] == [answer["kp"], answer["Ti"], 0.01]


ANSWER = {
    "trusted": True,
    "gains": {"kp": 1.0, "Ti": None},
    "plant": {"target": None, "Ts": 0.01, "signals": ["valve [%]", "flow [l/s]"]},
}


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"trusted": "no"}, "trusted = 'no' must be True or False"),
        ({"gains": {}}, "gains = {} must be names with values"),
        ({"gains": {"kp": "1"}}, "kp = '1' is not a number"),
        ({"gains": {"kp": 10**400}}, "kp = inf must be finite"),
        ({"plant": ANSWER["plant"] | {"Ts": -1.0}}, "Ts = -1 must be finite, above 0"),
        ({"plant": ANSWER["plant"] | {"Ts": float("nan")}}, "Ts = nan must be finite"),
        ({"plant": ANSWER["plant"] | {"signals": [1, 2]}}, "signals' input = 1 must be a text"),
    ],
)
def test_damaged_answers_are_refused_whatever_the_target(changes, words, tmp_path):
    path = tmp_path / "answer.json"
    path.write_text(json.dumps(ANSWER))
    assert np.isnan(Gains.read(path).values["Ti"])
    path.write_text(json.dumps(ANSWER | changes))
    with pytest.raises(ValueError, match=f"is no answer of .*{words}"):
        Gains.read(path)


@pytest.mark.parametrize("Ts", [-1.0, np.nan, "fast"])
def test_a_sampling_time_that_is_none_is_refused_whatever_the_target(Ts, tmp_path):
    with pytest.raises(ValueError, match="Ts = .* in seconds"):
        export(Gains({"K": 1.0}, limits=None), "json", tmp_path / "x.json", Ts=Ts)
    assert not list(tmp_path.iterdir())


def test_nothing_is_written_where_a_folder_is_in_the_way(tmp_path):
    (tmp_path / "yawrate_pi_test.c").mkdir()
    with pytest.raises(ValueError, match="yawrate_pi_test.c is no regular file"):
        export((0.4, 0.3), "c", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["yawrate_pi_test.c"]


@pytest.mark.parametrize("text", ["", "[]", "{}", 9999 * "[", '{"trusted": true}', "kp = 1",
                                  '{"trusted": true, "gains": {"kp": 1}}',
                                  '{"trusted": true, "gains": [1], "plant": {}}'])  # fmt: skip
def test_other_files_are_no_answers(text, tmp_path):
    path = tmp_path / "answer.json"
    path.write_text(text)
    line = refused(UNUSABLE, "export", "--result", path, "-o", tmp_path / "x")
    assert "is no answer of `yawrate tune --json`" in line and line.count("\n") == 1
