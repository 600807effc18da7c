static const double MEAN[ALL] = {
{{ trend.mean | rows }}
};

static const double MATRIX[ALL][INPUTS] = {
{{ trend.matrix | table }}
};

static const double COEFFICIENTS[{{ trend.coefficients | length }}][OUTPUTS] = {
{{ trend.coefficients | table }}
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
{% if trend.degree == 2 %}
        j = 1 + INPUTS;
        for (i = 0; i < INPUTS; i++) {
            int other;

            for (other = i; other < INPUTS; other++) {
                sum += COEFFICIENTS[j][k] * x[i] * x[other];
                j++;
            }
        }
{% endif %}
        values[k] += sum;
    }
}
