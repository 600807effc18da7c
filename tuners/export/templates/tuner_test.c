/* Golden gains for {{ name }}.c: exit status 0 if they agree. */
#include "{{ name }}.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>

#define COUNT {{ golden.features | length }}
#define GAINS {{ name | upper }}_GAINS
#define TOLERANCE {{ golden.tolerance | digits }}

static const double FEATURES[COUNT][{{ first | upper }}_FEATURES] = {
{{ golden.features | table }}
};

{% if measured %}
static const double MEASURED[COUNT + 1][{{ measured | length }}] = {
{{ golden.measured | table }}
};

{% endif %}
static const double EXPECTED[COUNT + 1][GAINS] = {
{{ golden.gains | table }}
};

static const int STATUS[COUNT + 1] = { {{ golden.status | join(", ") }} };

static int differs(int row, int status, const double gains[GAINS])
{
    int result = (status == STATUS[row]) ? 0 : 1;
    int i;

    for (i = 0; i < GAINS; i++) {
        const double expected = EXPECTED[row][i];
        const int none = isnan(expected) && isnan(gains[i]);

        if ((none == 0) && !(fabs(gains[i] - expected) <= (TOLERANCE * fabs(expected)))) {
            result = 1;
        }
    }
    if (result != 0) {
        (void)printf("%d: status %d, first gain %.17g\n", row, status, gains[0]);
    }
    return result;
}

{% include "record.c" %}

int main(void)
{
    {{ first }}_state state;
    double gains[GAINS];
    int failures = 0;
    int row;
    int status;

    for (row = 0; row < COUNT; row++) {
        status = {{ name }}_gains(FEATURES[row], {{ "MEASURED[row], " if measured }}gains);
        failures += differs(row, status, gains);
    }
    {{ first }}_start(&state);
    status = {{ name }}_solve(&state, {{ "MEASURED[COUNT], " if measured }}gains); /* no input */
    failures += (status == {{ status.unreachable }}) ? 0 : 1;
    record(&state);
    status = {{ name }}_solve(&state, {{ "MEASURED[COUNT], " if measured }}gains);
    failures += differs(COUNT, status, gains);
    return (failures == 0) ? 0 : 1;
}
