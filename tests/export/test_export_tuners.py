"""Every kind of tuner as a graph and in C: equal to Python's, for any plant."""

import numpy as np
import onnx
import onnxruntime
import pytest
from c_programs import answers, notices, passes, written
from exported import (
    CASES,
    LAGUERRE,
    NETWORKS,
    OWN_INPUTS,
    SINGLE,
    SMALL,
    TREES,
    echoing,
    expected,
    faulty,
    hardly_trained,
    measured,
    trained,
)
from first_order import described

import tuners
from tuners.export import export, features_program, first_stage_program, onnx_model, tuner_program
from tuners.export.first_stage import FIRST_STAGES
from tuners.export.second_stage import SECOND_STAGES
from tuners.features import FEATURES
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from tuners.learners import LEARNERS
from tuners.tuner.recording import Recording
from yawrate_env.loop.design import Status, design_from_response
from yawrate_env.loop.target import Target
from yawrate_env.plant import episodes
from yawrate_env.plant.names import split
from yawrate_env.plant.parametrisation import GAINS, Parametrisation
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

RTOL = 1e-9  # 1e-10 for inputs of their own, else 5e-13: sums are in another order
PARTS = "yawrate_laguerre", "yawrate_tuner"
COMPONENTS = Regularised(3, 5.0, (1.0, 0.5, 0.1), ((0.3, 0.0, 0.0), (0.0, 0.2, -0.1)), 1e-6)
SHIPPED = {"ts-ff-lag": RTOL, "ts-ff-lag-vx": RTOL, "ts-gbm-lag": 1e-4, "rl": 1e-4}
VALUES = np.array([[-1.0, -0.4], [-1.0, 0.0], [0.5, 0.3], [0.5, -1.6], [0.2, 0.3], [800, -1]])


def test_what_can_be_written_goes_by_the_names_of_tuner_files():
    assert FIRST_STAGES.keys() <= FEATURES.keys()
    assert SECOND_STAGES.keys() <= LEARNERS.keys()


def precision(case):
    return 1e-5 if case in SINGLE else RTOL


def ran(model, plant, **inputs):
    """Gains (B, k) and status of a graph."""
    options = {"providers": ["CPUExecutionProvider"]}
    session = onnxruntime.InferenceSession(model.SerializeToString(), **options)
    *gains, status = session.run([*plant.gains, "status"], inputs)
    return np.stack(gains, axis=1), status


def ran_c(folder, plant, u, y, theta):
    """Gains (B, k) and status of C programs."""
    known = theta[:, plant.indices(plant.measured_names)]
    inputs = np.broadcast_to(u, y.shape)
    rows = ([[len(output)], values, np.stack([input, output], axis=1).ravel()]
            for input, output, values in zip(inputs, y, known, strict=True))  # fmt: skip
    return answers(folder, rows)


def assert_equal(found, expected, status, rtol=RTOL):
    np.testing.assert_allclose(found, expected, rtol=rtol)
    none = np.isnan(expected).any(axis=1)
    assert none.any() and not none.all()
    np.testing.assert_array_equal(status == Status.UNREACHABLE, none)


# Graphs


@pytest.mark.parametrize("case", [name for name in CASES if name not in OWN_INPUTS])
def test_a_graph_from_recordings_gives_pythons_gains(case):
    tuner, (u, y, theta) = trained(case), faulty(case)
    plant, right, model = tuner.plant, expected(tuner, u, y, theta), onnx_model(tuner)
    output = split(plant.signals[1])[0]
    gains, status = ran(model, plant, **{output: y}, **measured(plant, theta))
    assert_equal(gains, right, status, precision(case))
    one, _ = ran(model, plant, **{output: y[:1]}, **measured(plant, theta[:1]))
    np.testing.assert_allclose(one, right[:1], rtol=precision(case))


@pytest.mark.parametrize("case", CASES)
def test_a_graph_from_features_gives_pythons_gains_for_any_input(case):
    tuner, (u, y, theta) = trained(case), faulty(case)
    plant, right = tuner.plant, expected(tuner, u, y, theta)
    features, _ = tuner.method.features(u, y, plant.Ts)
    model = onnx_model(tuner, features=True)
    gains, status = ran(model, plant, features=features, **measured(plant, theta))
    if case in OWN_INPUTS:  # an input of zeros has features, and only the first stage knows
        right[5] = gains[5]
    assert_equal(gains, right, status, precision(case))


@pytest.mark.parametrize(
    "name, features",
    [("ts-ff-lag", False), ("ts-ff-lag-vx", True), ("ts-gbm-lag", True), ("rl", False)],
)
def test_the_shipped_tuners_as_graphs(name, features, tmp_path):
    tuner = tuners.load(name)
    plant, rtol = tuner.plant, max(SHIPPED[name], 1e-6)
    found = episodes.recorded(plant, "test", 0, 40)
    right = tuner.gains(Recording(found.u, found.y, plant.Ts, found.theta))
    (path,) = export(tuner, "onnx", tmp_path / "tuner.onnx", features=features)
    own, _ = tuner.method.features(found.u, found.y, plant.Ts)
    inputs = {"features": own} if features else {"yaw_rate": found.y}
    gains, status = ran(onnx.load(path), plant, **inputs, **measured(plant, found.theta))
    np.testing.assert_allclose(gains, right.values, rtol=rtol)
    np.testing.assert_array_equal(status, right.status)


# C


@pytest.mark.parametrize("case", NETWORKS)
def test_a_tuner_in_c_gives_pythons_gains(case, tmp_path):
    tuner, recordings = trained(case), faulty(case)
    assert len(export(tuner, "c", tmp_path)) == 6
    assert passes(tmp_path, *PARTS)
    gains, status = ran_c(tmp_path, tuner.plant, *recordings)
    assert_equal(gains, expected(tuner, *recordings), status)


def test_a_shipped_network_in_c(tmp_path):
    tuner = tuners.load("ts-ff-lag-vx")
    found = episodes.recorded(tuner.plant, "test", 0, 20)
    export(tuner, "c", tmp_path)
    assert passes(tmp_path, *PARTS)
    gains, status = ran_c(tmp_path, tuner.plant, found.u, found.y, found.theta)
    right = tuner.gains(Recording(found.u, found.y, tuner.plant.Ts, found.theta))
    np.testing.assert_allclose(gains, right.values, rtol=RTOL)
    np.testing.assert_array_equal(status, right.status)


@pytest.mark.parametrize(
    "stage, Ts",
    [(FrequencyResponse(6, 9.0, points=4), 0.004), (COMPONENTS, 0.001)],
)
def test_the_first_stage_in_c_computes_pythons_features(tmp_path, stage, Ts):
    assert passes(written(tmp_path, features_program(stage, Ts, name="lag")), "lag")


def test_the_first_stage_takes_recordings_of_any_length(tmp_path):
    tuner, (u, y, _) = trained("regularised inputs"), faulty("regularised inputs")
    export(tuner, "c", tmp_path)
    for part in ("tuner", "laguerre"):
        header = (tmp_path / f"yawrate_{part}.h").read_text()
        assert "48 samples or more" in header and f"a state of {8 * 25**2 + 8} bytes" in header
    inputs, outputs = (np.tile(signals[7], 4) for signals in (u, y))
    counts = (48, 500, 2000)
    gains, _ = answers(tmp_path, ([[n], np.stack([inputs, outputs], axis=1)[:n].ravel()]
                                  for n in counts))  # fmt: skip
    nothing = np.empty((1, 0))
    for n, found in zip(counts, gains, strict=True):
        values, _ = tuner.method.predict(
            inputs[None, :n], outputs[None, :n], tuner.plant.Ts, nothing
        )
        np.testing.assert_allclose(found, tuner.plant.parametrisation.decode(values)[0], rtol=RTOL)
    short = [[47], np.stack([inputs, outputs], axis=1)[:47].ravel()]
    none, status = answers(tmp_path, [short])
    assert np.isnan(none).all() and status[0] == Status.UNREACHABLE
    with pytest.raises(ValueError, match="47 samples"):
        tuner.method.features(u[7:8, :47], y[7:8, :47], tuner.plant.Ts)


def test_golden_vectors_notice_a_wrong_tuner(tmp_path):
    program = tuner_program(trained("measured"))
    header = program["yawrate_tuner.h"]
    assert f"a state of {8 * 9**2 + 8} bytes" in header and "bytes of constants" in header
    assert "T, slope" in header and "YAWRATE_TUNER_GAINS 3" in header
    written(tmp_path, program)
    mistakes = {"tanh(sum)": "sum", "log(measured[0])": "measured[0]", "* x[other]": "* x[i]",
                "exp(values[0])": "values[0]", "MEAN[j])": "MEAN[i])"}  # fmt: skip
    assert notices(tmp_path, "yawrate_tuner.c", mistakes, *PARTS)


def test_golden_vectors_notice_a_wrong_first_stage(tmp_path):
    written(tmp_path, first_stage_program(trained("regularised inputs")))
    mistakes = {"+= VARIANCE": "+= 0.0", "- (weight * MEAN[k])": "+ weight", "j <= i": "j < i",
                "gram(state, j, k)": "state->gram[j][k]"}  # fmt: skip
    assert notices(tmp_path, "yawrate_laguerre.c", mistakes, "yawrate_laguerre")


def test_strange_names_stay_in_their_comments(tmp_path):
    plant = described(signals=("a */ int x;\n#error", 'b "/* \u202e\x00\ud800 [l]'))
    export(hardly_trained(plant, LAGUERRE, SMALL), "c", tmp_path)
    assert passes(tmp_path, *PARTS)


# Both


@pytest.mark.parametrize(
    "form, parametrisation", [("pi", "plant"), ("printed", "plant"), ("pi", "gains")]
)
def test_every_status_is_decoded(form, parametrisation, tmp_path):
    plant = yaw_rate(Task(target=Target(controller=form)))
    tuner = echoing(plant, parametrisation=parametrisation)
    chosen = plant.parametrisation if parametrisation == "plant" else GAINS
    right, status = chosen.decode(VALUES), np.zeros(len(VALUES))
    if parametrisation == "plant":
        with np.errstate(over="ignore"):
            status = design_from_response(*VALUES.T, chosen.target).status
    status = np.where(np.isnan(right).any(axis=1), Status.UNREACHABLE, status)
    written(tmp_path, tuner_program(tuner))
    assert passes(tmp_path, *PARTS)
    graph = ran(onnx_model(tuner, features=True), plant, features=VALUES)
    for gains, found in (answers(tmp_path, ([[0.0], row] for row in VALUES)), graph):
        np.testing.assert_allclose(gains, right, rtol=1e-7)
        assert found.tolist() == status.tolist()
    assert {Status.OK, Status.UNREACHABLE} <= set(status.tolist())


# Refusals


def refusals():
    """Tuners, targets that refuse them, and what the message names."""
    own, taken = described(parametrisation=Parametrisation(np.sqrt, np.square)), ("u", "kp")
    vehicle = yaw_rate(Task())
    random = yaw_rate(Task(experiment=Experiment(register="random")))
    stages = trained("logarithms").method
    return [
        (tuners.Tuner(own, stages), ("onnx", "c"), "parametrisation"),
        (tuners.Tuner(described(signals=taken), stages), ("onnx",), "'kp'.*Rename"),
        (hardly_trained(described(), LAGUERRE, TREES), ("c",), "features=True .--features."),
        (echoing(vehicle, 3), ("onnx", "c"), "has 3 features"),
        (echoing(random), ("onnx",), "features=True"),
        (trained("regularised inputs"), ("onnx",), "features=True"),
        *((trained(case), ("c",), "features=True") for case in ("trees", "agent", "cubic")),
        *((tuners.load(name), ("onnx", "c"), "Export ts-ff-lag")
          for name in ("ts-ff", "ts-gbm", "gb", "nominal")),
    ]  # fmt: skip


def test_tuners_that_cannot_be_exported_are_refused(tmp_path):
    for tuner, targets, message in refusals():
        for target in targets:
            with pytest.raises(ValueError, match=message):
                export(tuner, target, tmp_path / "x")
    assert not list(tmp_path.iterdir())
    export(trained("trees"), "c", tmp_path, features=True)
    assert passes(tmp_path, "yawrate_laguerre")
