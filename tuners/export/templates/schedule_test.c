/* Golden vectors for {{ name }}.c: exit status 0 if all gains and statuses agree. */
#include "{{ name }}.h"

#include <math.h>
#include <stdio.h>

#define COUNT {{ asked | length }}
#define TOLERANCE {{ tolerance | digits }}

static const {{ name }}_real ASKED[COUNT] = {
{{ asked | rows(real) }}
};

static const int STATUS[COUNT] = { {{ statuses | join(", ") }} };

static const {{ name }}_real EXPECTED[COUNT][{{ name | upper }}_GAINS] = {
{% for row in expected %}
    { {% for gain in row %}{{ gain | number(real) }}{{ ", " if not loop.last }}{% endfor %} }{{ "," if not loop.last }}
{% endfor %}
};

int main(void)
{
    int failures = 0;
    int k;
    int i;

    for (k = 0; k < COUNT; k++) {
        {{ name }}_real gains[{{ name | upper }}_GAINS];

        for (i = 0; i < {{ name | upper }}_GAINS; i++) {
            gains[i] = {{ -1 | number(real) }};
        }
        if ((int){{ name }}_lookup(ASKED[k], gains) != STATUS[k]) {
            (void)printf("%d: another status than %d\n", k, STATUS[k]);
            failures++;
        }
        for (i = 0; i < {{ name | upper }}_GAINS; i++) {
            const double off = fabs((double)gains[i] - (double)EXPECTED[k][i]);

            if (!(off <= (TOLERANCE * fabs((double)EXPECTED[k][i])))) {
                (void)printf("%d: %.17g, expected %.17g\n", k, (double)gains[i], (double)EXPECTED[k][i]);
                failures++;
            }
        }
    }
    return (failures == 0) ? 0 : 1;
}
