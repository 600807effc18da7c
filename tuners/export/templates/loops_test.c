/* Golden vectors for {{ name }}.c: exit status 0 if every command agrees. */
#include "{{ name }}.h"

#include <math.h>
#include <stdio.h>

#define COUNT {{ errors | length }}
#define TOLERANCE {{ tolerance | digits }}

static const {{ name }}_real ERRORS[COUNT * {{ name | upper }}_COUNT] = {
{{ errors.ravel() | rows(real) }}
};

static const {{ name }}_real COMMANDS[COUNT * {{ name | upper }}_COUNT] = {
{{ commands.ravel() | rows(real) }}
};

static const {{ name }}_real FIRST[{{ name | upper }}_COUNT] = { {% for start in starts %}{{ start[0] | number(real) }}{{ ", " if not loop.last }}{% endfor %} };
static const {{ name }}_real GIVEN[{{ name | upper }}_COUNT] = { {% for start in starts %}{{ start[1] | number(real) }}{{ ", " if not loop.last }}{% endfor %} };

int main(void)
{
    {{ name }}_state state;
    {{ name }}_real commands[{{ name | upper }}_COUNT];
    int failures = 0;
    int k;
    int i;

    {{ name }}_start(&state, FIRST, GIVEN);
    for (k = 0; k < COUNT; k++) {
        {{ name }}_step(&state, &ERRORS[k * {{ name | upper }}_COUNT], commands);
        for (i = 0; i < {{ name | upper }}_COUNT; i++) {
            const double expected = (double)COMMANDS[(k * {{ name | upper }}_COUNT) + i];

            if (!(fabs((double)commands[i] - expected) <= TOLERANCE)) {
                (void)printf("%d, %d: %.17g, expected %.17g\n", k, i, (double)commands[i], expected);
                failures++;
            }
        }
    }
    return (failures == 0) ? 0 : 1;
}
