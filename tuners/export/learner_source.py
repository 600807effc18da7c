"""The second stage in C99: a trained network or trend, and gains from what it predicts.

Functions of one file, for `tuners.export.tuner_source`: ``predict`` is the learner,
``decode`` the plant's coordinates.
"""

from string import Template
from typing import Any

import numpy as np

from tuners.export import literals
from tuners.learners import Learner
from tuners.learners.actor import Agent
from tuners.learners.feedforward import FeedForward
from tuners.learners.gbm import GBM
from tuners.learners.trend import Trend
from yawrate_env.loop import controller
from yawrate_env.loop.design import LEAST_LAG, Status
from yawrate_env.plant.parametrisation import LOG, Coordinates

_NETWORK = Template("""\
#define INPUTS $inputs
#define NEURONS $neurons
#define OUTPUTS $outputs

static const double MIDDLE[INPUTS] = {
$middle
};

static const double HALF[INPUTS] = {
$half
};

static const double W1[NEURONS][INPUTS] = {
$W1
};

static const double B1[NEURONS] = {
$b1
};

static const double W2[OUTPUTS][NEURONS] = {
$W2
};

static const double B2[OUTPUTS] = {
$b2
};

static const double OUT_MIDDLE[OUTPUTS] = {
$out_middle
};

static const double OUT_HALF[OUTPUTS] = {
$out_half
};

/* Scaling, tanh layer, linear layer, scaling. */
static void $function(const double x[INPUTS], double values[OUTPUTS])
{
    double hidden[NEURONS];
    int i;
    int j;

    for (i = 0; i < NEURONS; i++) {
        double sum = B1[i];

        for (j = 0; j < INPUTS; j++) {
            sum += W1[i][j] * ((x[j] - MIDDLE[j]) / HALF[j]);
        }
        hidden[i] = tanh(sum);
    }
    for (i = 0; i < OUTPUTS; i++) {
        double sum = B2[i];

        for (j = 0; j < NEURONS; j++) {
            sum += W2[i][j] * hidden[j];
        }
        values[i] = (sum * OUT_HALF[i]) + OUT_MIDDLE[i];
    }
}
""")

_TREND = Template("""\

static const double MEAN[ALL] = {
$mean
};

static const double MATRIX[ALL][INPUTS] = {
$matrix
};

static const double COEFFICIENTS[$rows][OUTPUTS] = {
$coefficients
};

/* Decorrelated features, their polynomial, and what the network adds. */
static void predict(const double features[ALL], double values[OUTPUTS])
{
    double x[INPUTS];
    int i;
    int j;
    int k;

    for (i = 0; i < INPUTS; i++) {
        x[i] = 0.0;
        for (j = 0; j < ALL; j++) {
            x[i] += (features[j] - MEAN[j]) * MATRIX[j][i];
        }
    }
    network(x, values);
    for (k = 0; k < OUTPUTS; k++) {
        double sum = COEFFICIENTS[0][k];

        for (i = 0; i < INPUTS; i++) {
            sum += COEFFICIENTS[1 + i][k] * x[i];
        }
$quadratic\
        values[k] += sum;
    }
}
""")

_QUADRATIC = """\
        j = 1 + INPUTS;
        for (i = 0; i < INPUTS; i++) {
            int other;

            for (other = i; other < INPUTS; other++) {
                sum += COEFFICIENTS[j][k] * x[i] * x[other];
                j++;
            }
        }
"""

_EACH = Template("""\
/* Gains $what; $ok. */
static int decode(const double values[OUTPUTS], double gains[OUTPUTS])
{
    int i;

    for (i = 0; i < OUTPUTS; i++) {
        gains[i] = $gain;
    }
    return $ok;
}
""")

_LOOP = Template("""\
static const double OMEGA = $omega; /* wanted crossover, warped [rad/s] */

/* Gains from the controller's log magnitude and phase [rad] at the crossover; $ok, $limited where a
 * PI cannot lead, $unreachable where it cannot lag so much. */
static int decode(const double values[OUTPUTS], double gains[OUTPUTS])
{
    const int leads = (values[1] >= 0.0) ? 1 : 0;
    const double tangent = -tan((leads != 0) ? $least : values[1]);
    int status = (leads != 0) ? $limited : $ok;

    gains[0] = $kp;
    gains[1] = $Ti;
    if (!(values[1] > $lowest)) {
        status = $unreachable;
    }
    return status;
}
""")

CODES = {
    "ok": Status.OK,
    "limited": Status.PHASE_LIMITED,
    "unreachable": Status.UNREACHABLE,
}
"""What programs call the status of gains."""

_FORMS = {
    "pi": {
        "kp": "exp(values[0]) / hypot(1.0, tangent)",
        "Ti": "1.0 / (tangent * OMEGA)",
    },
    "printed": {
        "kp": "exp(values[0]) * hypot(1.0, tangent)",
        "Ti": "tangent / OMEGA",
    },
}


def check_learner(learner: Learner) -> FeedForward | Trend:
    """The learner, or ``ValueError`` for what is not written in C."""
    if isinstance(learner, Agent):
        raise ValueError(
            "the tuner's agent is not written in C. Export its first stage alone with "
            "features=True (--features), or the whole tuner to target onnx."
        )
    if isinstance(learner, GBM) or not isinstance(network_of(learner), FeedForward):
        raise ValueError(
            "the tuner's boosted trees are not written in C: thousands of nodes each. Export its "
            "first stage alone with features=True (--features), the whole tuner to target onnx, or "
            "one with a network, as ts-ff-lag is."
        )
    return learner


def learner_source(learner: FeedForward | Trend) -> str:
    """``predict``, from all features to what was learned."""
    network = network_of(learner)
    if not isinstance(learner, Trend):
        return _NETWORK.substitute(_network_words(network), function="predict")
    words = {
        "mean": literals.rows(learner.mean),
        "matrix": literals.table(learner.matrix),
        "rows": str(len(learner.coefficients)),
        "coefficients": literals.table(learner.coefficients),
        "quadratic": _QUADRATIC if learner.degree == 2 else "",
    }
    first = _NETWORK.substitute(_network_words(network), function="network")
    return first + _TREND.substitute(words)


def decode_source(coordinates: Coordinates) -> str:
    """``decode``, from what was learned to gains and a status."""
    codes = {name: str(int(status)) for name, status in CODES.items()}
    target = coordinates.target
    if target is None:
        log = coordinates.decode is LOG.decode
        what, gain = ("from logarithms", "exp(values[i])") if log else ("as they are", "values[i]")
        return _EACH.substitute(codes, what=what, gain=gain)
    return _LOOP.substitute(
        codes,
        omega=literals.number(controller.warped(target)),
        least=literals.number(-LEAST_LAG),
        lowest=literals.number(-np.pi / 2),
        **_FORMS[target.controller],
    )


def learner_size(learner: FeedForward | Trend) -> int:
    """Bytes of the program's numbers."""
    return 8 * int(sum(np.size(array) for array in learner.arrays().values()))


def network_of(learner: Learner) -> Any:
    """The network of a learner, or what stands in its place."""
    return learner.rest if isinstance(learner, Trend) else learner


def _network_words(network: FeedForward) -> dict[str, str]:
    outputs, neurons = network.W2.shape
    return {
        "inputs": str(network.W1.shape[1]), "neurons": str(neurons), "outputs": str(outputs),
        "middle": literals.rows(network.inputs.middle), "half": literals.rows(network.inputs.half),
        "W1": literals.table(network.W1), "b1": literals.rows(network.b1),
        "W2": literals.table(network.W2), "b2": literals.rows(network.b2),
        "out_middle": literals.rows(network.outputs.middle),
        "out_half": literals.rows(network.outputs.half),
    }  # fmt: skip
