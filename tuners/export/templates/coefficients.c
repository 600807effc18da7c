int {{ name }}_solve(const {{ name }}_state *state, double features[{{ name | upper }}_FEATURES])
{
    return fit(state, features);
}
