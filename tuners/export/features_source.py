"""From a recording's sums to its features in C99: how the first stage ends.

All stages on Laguerre functions solve the normal equations by Cholesky's method.  The features
are the solution itself, a frequency response that is computed from it, or components of it in
which it has only to say how much noise there is.
"""

from string import Template

import numpy as np

from tuners.compressors.laguerre import Laguerre
from tuners.compressors.regularised import Regularised
from tuners.compressors.response import FrequencyResponse
from tuners.export import literals
from tuners.export.parts import OnLaguerre, feature_count

UNEXCITED = 1e-5
"""Relative error of what follows where a prior alone holds what the input left singular.

The noise is told from equations that determine not all of it; rounding is then seen at 1e-7.
"""

_FIT = Template("""\

static const double RIDGE = 1e-14; /* of the trace */

/* Solve n equations in place, of whose symmetric matrix the lower half is used; 1 if they depend
 * on each other. */
static int solved(int n, double *matrix, double *x)
{
    int failed = 0;
    int i;
    int j;
    int k;

    for (i = 0; i < n; i++) {
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

/* The whole Gram matrix, with a little on the diagonal that keeps it regular. */
static void lift(const ${name}_state *state, double gram[ORDER * ORDER])
{
    double ridge = 0.0;
    int i;
    int j;

    for (i = 0; i < ORDER; i++) {
        ridge += RIDGE * state->gram[i][i];
    }
    for (i = 0; i < ORDER; i++) {
        for (j = 0; j < i; j++) {
            gram[(i * ORDER) + j] = state->gram[i][j];
            gram[(j * ORDER) + i] = state->gram[i][j];
        }
        gram[i * (ORDER + 1)] = state->gram[i][i] + ridge;
    }
}

/* Least-squares coefficients, which use the matrix up; 1 if the input did not excite them all. */
static int fit(const ${name}_state *state, double gram[ORDER * ORDER], double coefficients[ORDER])
{
    int i;

    for (i = 0; i < ORDER; i++) {
        coefficients[i] = state->products[i];
    }
    return solved(ORDER, gram, coefficients);
}
""")

_COEFFICIENTS = Template("""
int ${name}_solve(const ${name}_state *state, double features[${guard}_FEATURES])
{
    double gram[ORDER * ORDER];

    lift(state, gram);
    return fit(state, gram, features);
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
    double gram[ORDER * ORDER];
    double coefficients[ORDER];
    double last = 0.0;
    double phase = 0.0;
    int failed;
    int i;
    int k;

    lift(state, gram);
    failed = fit(state, gram, coefficients);
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

/* Coefficients of the simulated plants: their mean, */
static const double MEAN[ORDER] = {
$mean
};

/* and what one standard deviation along each of their principal components adds. */
static const double DIRECTIONS[COUNT][ORDER] = {
$directions
};

/* The components' equations, of the symmetric matrix the lower half; what noise adds is missing. */
static void project(const ${name}_state *state, const double gram[ORDER * ORDER],
                    double information[COUNT * COUNT], double right[COUNT])
{
    int i;
    int j;
    int k;

    for (i = 0; i < COUNT; i++) {
        right[i] = 0.0;
        for (j = 0; j <= i; j++) {
            information[(i * COUNT) + j] = 0.0;
        }
        for (k = 0; k < ORDER; k++) {
            double weight = 0.0;

            for (j = 0; j < ORDER; j++) {
                weight += DIRECTIONS[i][j] * gram[(j * ORDER) + k];
            }
            right[i] += (DIRECTIONS[i][k] * state->products[k]) - (weight * MEAN[k]);
            for (j = 0; j <= i; j++) {
                information[(i * COUNT) + j] += weight * DIRECTIONS[j][k];
            }
        }
    }
}

/* Variance of what least squares leave over. */
static double variance(const ${name}_state *state, const double coefficients[ORDER])
{
    double explained = 0.0;
    double left;
    int i;

    for (i = 0; i < ORDER; i++) {
        explained += state->products[i] * coefficients[i];
    }
    left = state->energy - explained;
    return ((left < 0.0) ? 0.0 : left) / (state->samples - (double)ORDER);
}

int ${name}_solve(const ${name}_state *state, double features[${guard}_FEATURES])
{
    double gram[ORDER * ORDER];
    double coefficients[ORDER];
    double information[COUNT * COUNT];
    double noise;
    int failed;
    int i;

    lift(state, gram);
    project(state, gram, information, features);
    failed = fit(state, gram, coefficients);
    noise = variance(state, coefficients);
    for (i = 0; i < COUNT; i++) {
        information[i * (COUNT + 1)] += noise;
    }
    if ((solved(COUNT, information, features) != 0) || $unfit) {
        failed = 1;
    }
    for (i = 0; i < COUNT; i++) {
        if (isfinite(features[i]) == 0) {
            failed = 1;
        }
    }
    return failed;
}
""")


def features_source(compressor: OnLaguerre, Ts: float, name: str, longest: int | None) -> str:
    """``solve`` of a first stage that is called so, and what it needs."""
    words = {"name": name, "guard": name.upper()}
    fit = _FIT.substitute(words)
    match compressor:
        case Laguerre():
            return fit + _COEFFICIENTS.substitute(words)
        case Regularised():
            bounds = [f"< {least_samples(compressor)}.0"]
            if longest is not None:
                bounds.append(f"> {longest}.0")
            return fit + _REGULARISED.substitute(
                words,
                unfit=" || ".join(f"(state->samples {bound})" for bound in bounds),
                mean=literals.rows(compressor.mean),
                directions=literals.table(np.array(compressor.directions)),
            )
        case FrequencyResponse():
            functions = compressor.functions(Ts)
            return fit + _RESPONSE.substitute(
                words,
                points=compressor.points, turn=literals.number(2 * np.pi),
                low=f"{compressor.low:g}", high=f"{compressor.high:g}",
                re=literals.table(functions.real), im=literals.table(functions.imag),
            )  # fmt: skip


def least_samples(compressor: OnLaguerre) -> int:
    """Samples that a recording must have."""
    return (2 if isinstance(compressor, Regularised) else 10) * compressor.order


def samples_taken(compressor: OnLaguerre, longest: int | None) -> str:
    """The same in words, with the most that it may have."""
    least = least_samples(compressor)
    if longest is None:
        return f"{least} samples or more, and however many"
    return f"{least} to {longest} samples, as many as it was trained on"


def stack_size(compressor: OnLaguerre) -> int:
    """Bytes that the solution takes, roughly."""
    own = feature_count(compressor) ** 2 if isinstance(compressor, Regularised) else 0
    return 8 * (compressor.order * (compressor.order + 4) + own)


def constant_size(compressor: OnLaguerre) -> int:
    """Bytes of the first stage's numbers."""
    match compressor:
        case Laguerre():
            own = 0
        case Regularised():
            own = compressor.order * (1 + feature_count(compressor))
        case FrequencyResponse():
            own = 1 + compressor.order * feature_count(compressor)
    return 8 * (3 + own)
