"""From a recording's sums to its features in C99: how the first stage ends.

All stages on Laguerre functions solve symmetric equations by Cholesky's method: the normal
equations themselves, whose solution are the features or gives a frequency response, or those of
their components.
"""

from string import Template

import numpy as np

from tuners.export import literals
from tuners.export.parts import OnLaguerre, feature_count
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse

_SOLVED = Template("""\

static const double RIDGE = 1e-14; /* of the trace */

/* Solve n equations in place, of whose symmetric matrix the lower half is used and a little added
 * to the diagonal; 1 if they depend on each other. */
static int solved(int n, double *matrix, double *x)
{
    double ridge = 0.0;
    int failed = 0;
    int i;
    int j;
    int k;

    for (i = 0; i < n; i++) {
        ridge += RIDGE * matrix[i * (n + 1)];
    }
    for (i = 0; i < n; i++) {
        matrix[i * (n + 1)] += ridge;
        for (j = 0; j <= i; j++) {
            double rest = matrix[(i * n) + j];

            for (k = 0; k < j; k++) {
                rest -= matrix[(i * n) + k] * matrix[(j * n) + k];
            }
            if (i > j) {
                matrix[(i * n) + j] = rest / matrix[j * (n + 1)];
            } else if (rest > 0.0) {
                matrix[i * (n + 1)] = sqrt(rest);
            } else {
                matrix[i * (n + 1)] = 1.0;
                failed = 1;
            }
        }
        for (k = 0; k < i; k++) {
            x[i] -= matrix[(i * n) + k] * x[k];
        }
        x[i] /= matrix[i * (n + 1)];
    }
    for (i = n - 1; i >= 0; i--) {
        for (k = i + 1; k < n; k++) {
            x[i] -= matrix[(k * n) + i] * x[k];
        }
        x[i] /= matrix[i * (n + 1)];
    }
    return failed;
}
""")

_FIT = Template("""
/* Least-squares coefficients; 1 if the input did not excite them all. */
static int fit(const ${name}_state *state, double coefficients[ORDER])
{
    double gram[ORDER * ORDER];
    int i;
    int j;

    for (i = 0; i < ORDER; i++) {
        coefficients[i] = state->products[i];
        for (j = 0; j <= i; j++) {
            gram[(i * ORDER) + j] = state->gram[i][j];
        }
    }
    return solved(ORDER, gram, coefficients);
}
""")

_COEFFICIENTS = Template("""
int ${name}_solve(const ${name}_state *state, double features[${guard}_FEATURES])
{
    return fit(state, features);
}
""")

_RESPONSE = Template("""
#define POINTS $points

static const double TURN = $turn;

/* What every function answers at $points frequencies from $low to $high Hz. */
static const double RE[ORDER][POINTS] = {
$re
};

static const double IM[ORDER][POINTS] = {
$im
};

int ${name}_solve(const ${name}_state *state, double features[${guard}_FEATURES])
{
    double coefficients[ORDER];
    double last = 0.0;
    double phase = 0.0;
    int failed = fit(state, coefficients);
    int i;
    int k;

    for (k = 0; k < POINTS; k++) {
        double re = 0.0;
        double im = 0.0;
        double angle;

        for (i = 0; i < ORDER; i++) {
            re += coefficients[i] * RE[i][k];
            im += coefficients[i] * IM[i][k];
        }
        angle = atan2(im, re);
        phase += remainder(angle - last, TURN);
        last = angle;
        features[k] = log(hypot(re, im));
        features[POINTS + k] = phase;
        if (isfinite(features[k]) == 0) {
            failed = 1;
        }
    }
    return failed;
}
""")

_REGULARISED = Template("""
#define COUNT ${guard}_FEATURES

static const double VARIANCE = $variance; /* of the simulated noise */

/* Coefficients of the simulated plants: their mean, */
static const double MEAN[ORDER] = {
$mean
};

/* and what one standard deviation along each of their principal components adds. */
static const double DIRECTIONS[COUNT][ORDER] = {
$directions
};

static double gram(const ${name}_state *state, int i, int j)
{
    return (i < j) ? state->gram[j][i] : state->gram[i][j];
}

int ${name}_solve(const ${name}_state *state, double features[${guard}_FEATURES])
{
    double information[COUNT * COUNT];
    double told = 0.0;
    int failed;
    int i;
    int j;
    int k;

    for (i = 0; i < COUNT; i++) {
        features[i] = 0.0;
        for (j = 0; j <= i; j++) {
            information[(i * COUNT) + j] = 0.0;
        }
        for (k = 0; k < ORDER; k++) {
            double weight = 0.0;

            for (j = 0; j < ORDER; j++) {
                weight += DIRECTIONS[i][j] * gram(state, j, k);
            }
            features[i] += (DIRECTIONS[i][k] * state->products[k]) - (weight * MEAN[k]);
            for (j = 0; j <= i; j++) {
                information[(i * COUNT) + j] += weight * DIRECTIONS[j][k];
            }
        }
        told += information[i * (COUNT + 1)];
        information[i * (COUNT + 1)] += VARIANCE;
    }
    failed = solved(COUNT, information, features);
    for (i = 0; i < COUNT; i++) {
        if (isfinite(features[i]) == 0) {
            failed = 1;
        }
    }
    return (told > 0.0) ? failed : 1;
}
""")


def features_source(compressor: OnLaguerre, Ts: float, name: str) -> str:
    """``solve`` of a first stage that is called so, and what it needs."""
    words = {"name": name, "guard": name.upper()}
    solved, fit = _SOLVED.substitute(words), _FIT.substitute(words)
    match compressor:
        case Laguerre():
            return solved + fit + _COEFFICIENTS.substitute(words)
        case Regularised():
            return solved + _REGULARISED.substitute(
                words,
                variance=literals.number(compressor.variance),
                mean=literals.rows(compressor.mean),
                directions=literals.table(np.array(compressor.directions)),
            )
        case FrequencyResponse():
            functions = compressor.functions(Ts)
            return solved + fit + _RESPONSE.substitute(
                words,
                points=compressor.points, turn=literals.number(2 * np.pi),
                low=f"{compressor.low:g}", high=f"{compressor.high:g}",
                re=literals.table(functions.real), im=literals.table(functions.imag),
            )  # fmt: skip


def least_samples(compressor: OnLaguerre) -> int:
    """Samples that a recording must have."""
    return (2 if isinstance(compressor, Regularised) else 10) * compressor.order


def stack_size(compressor: OnLaguerre) -> int:
    """Bytes that the solution takes, roughly."""
    if isinstance(compressor, Regularised):
        return 8 * feature_count(compressor) * (feature_count(compressor) + 4)
    return 8 * compressor.order * (compressor.order + 4)


def constant_size(compressor: OnLaguerre) -> int:
    """Bytes of the first stage's numbers."""
    match compressor:
        case Laguerre():
            own = 0
        case Regularised():
            own = 1 + compressor.order * (1 + feature_count(compressor))
        case FrequencyResponse():
            own = 1 + compressor.order * feature_count(compressor)
    return 8 * (3 + own)
