#define COUNT {{ name | upper }}_FEATURES

static const double VARIANCE = {{ stage.variance | number }}; /* of the simulated noise */

/* Mean coefficients of the simulated plants, */
static const double MEAN[ORDER] = {
{{ stage.mean | rows }}
};

/* and what one standard deviation along each of their principal components adds. */
static const double DIRECTIONS[COUNT][ORDER] = {
{{ stage.directions | table }}
};

static double gram(const {{ name }}_state *state, int i, int j)
{
    return (i < j) ? state->gram[j][i] : state->gram[i][j];
}

int {{ name }}_solve(const {{ name }}_state *state, double features[{{ name | upper }}_FEATURES])
{
    double information[COUNT * COUNT];
    double excited = 0.0;
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
            features[i] += (DIRECTIONS[i][k] * state->products[0][k]) - (weight * MEAN[k]);
            for (j = 0; j <= i; j++) {
                information[(i * COUNT) + j] += weight * DIRECTIONS[j][k];
            }
        }
        excited += information[i * (COUNT + 1)];
        information[i * (COUNT + 1)] += VARIANCE;
    }
    failed = solved(COUNT, information, features);
    for (i = 0; i < COUNT; i++) {
        if (isfinite(features[i]) == 0) {
            failed = 1;
        }
    }
    return ((excited > 0.0) && (state->samples >= LEAST)) ? failed : 1;
}
