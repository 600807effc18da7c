/* Golden vectors for {{ name }}.c: exit status 0 if every command agrees. */
#include "{{ name }}.h"

#include <math.h>
#include <stdio.h>

#define COUNT {{ commands | length }}
#define TOLERANCE {{ tolerance | digits }}

static const {{ name }}_real REFERENCES[COUNT] = {
{{ references | rows(real) }}
};

static const {{ name }}_real STATES[COUNT * {{ name | upper }}_STATES] = {
{{ states | rows(real) }}
};

static const {{ name }}_real COMMANDS[COUNT] = {
{{ commands | rows(real) }}
};

int main(void)
{
    {{ name }}_state state;
    int failures = 0;
    int k;

    {{ name }}_start(&state, {{ start | number(real) }});
    for (k = 0; k < COUNT; k++) {
        const double command =
            (double){{ name }}_step(&state, REFERENCES[k], &STATES[k * {{ name | upper }}_STATES]);

        if (!(fabs(command - (double)COMMANDS[k]) <= TOLERANCE)) {
            (void)printf("%d: %.17g, expected %.17g\n", k, command, (double)COMMANDS[k]);
            failures++;
        }
    }
    return (failures == 0) ? 0 : 1;
}
