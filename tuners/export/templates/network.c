#define INPUTS {{ network.W1.shape[1] }}
#define NEURONS {{ network.W1.shape[0] }}
#define OUTPUTS {{ network.W2.shape[0] }}

static const double MIDDLE[INPUTS] = {
{{ network.inputs.middle | rows }}
};

static const double HALF[INPUTS] = {
{{ network.inputs.half | rows }}
};

static const double W1[NEURONS][INPUTS] = {
{{ network.W1 | table }}
};

static const double B1[NEURONS] = {
{{ network.b1 | rows }}
};

static const double W2[OUTPUTS][NEURONS] = {
{{ network.W2 | table }}
};

static const double B2[OUTPUTS] = {
{{ network.b2 | rows }}
};

static const double OUT_MIDDLE[OUTPUTS] = {
{{ network.outputs.middle | rows }}
};

static const double OUT_HALF[OUTPUTS] = {
{{ network.outputs.half | rows }}
};

/* Scaling, tanh layer, linear layer, scaling. */
static void {{ "network" if trend else "predict" }}(const double x[INPUTS], double values[OUTPUTS])
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
