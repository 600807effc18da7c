int {{ name }}_solve(const {{ name }}_state *state, double features[{{ name | upper }}_FEATURES])
{
    int failed = 0;
    int k;

    for (k = 0; k < OUTPUTS; k++) {
        if (fit(state, k, &features[k * FUNCTIONS]) != 0) {
            failed = 1;
        }
    }
    return failed;
}
