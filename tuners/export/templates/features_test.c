/* Golden features for {{ name }}.c: exit status 0 if they agree. */
#include "{{ name }}.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>

#define TOLERANCE {{ tolerance | digits }}

static const double FEATURES[{{ name | upper }}_FEATURES] = {
{{ golden | rows }}
};

{% set first = name %}
{% include "record.c" %}

int main(void)
{
    {{ name }}_state state;
    double features[{{ name | upper }}_FEATURES];
    int failures = (sizeof state == {{ state_size }}u) ? 0 : 1;
    int i;

    {{ name }}_start(&state);
    failures += 1 - {{ name }}_solve(&state, features); /* without excitation it must say so */
    record(&state);
    failures += {{ name }}_solve(&state, features);
    for (i = 0; i < {{ name | upper }}_FEATURES; i++) {
        if (!(fabs(features[i] - FEATURES[i]) <= TOLERANCE)) {
            (void)printf("%d: %.17g, expected %.17g\n", i, features[i], FEATURES[i]);
            failures++;
        }
    }
    return (failures == 0) ? 0 : 1;
}
