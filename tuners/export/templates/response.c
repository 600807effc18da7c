#define POINTS {{ stage.points }}

static const double TURN = {{ turn | number }};

/* Response of every function at {{ stage.points }} frequencies from {{ stage.low | digits }} to {{ stage.high | digits }} Hz. */
static const double RE[ORDER][POINTS] = {
{{ functions.real | table }}
};

static const double IM[ORDER][POINTS] = {
{{ functions.imag | table }}
};

int {{ name }}_solve(const {{ name }}_state *state, double features[{{ name | upper }}_FEATURES])
{
    double coefficients[ORDER];
    double last = 0.0;
    double phase = 0.0;
    int failed = fit(state, 0, coefficients);
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
