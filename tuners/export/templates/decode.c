{% if target %}
static const double OMEGA = {{ omega | number }}; /* target crossover, warped [rad/s] */

/* Gains from the controller's log magnitude and phase [rad] at the crossover; {{ status.ok }}, {{ status.limited }} where a
 * PI cannot lead, {{ status.unreachable }} where it cannot lag so much. */
static int decode(const double values[OUTPUTS], double gains[OUTPUTS])
{
    const int leads = (values[1] >= 0.0) ? 1 : 0;
    const double tangent = -tan((leads != 0) ? {{ least_lag | number }} : values[1]);
    int status = (leads != 0) ? {{ status.limited }} : {{ status.ok }};

{% if target.controller == "pi" %}
    gains[0] = exp(values[0]) / hypot(1.0, tangent);
    gains[1] = 1.0 / (tangent * OMEGA);
{% else %}
    gains[0] = exp(values[0]) * hypot(1.0, tangent);
    gains[1] = tangent / OMEGA;
{% endif %}
    if (!(values[1] > {{ quarter_turn | number }})) {
        status = {{ status.unreachable }};
    }
    return status;
}
{% else %}
/* Gains from their coordinates; {{ status.ok }}. */
static int decode(const double values[OUTPUTS], double gains[OUTPUTS])
{
{% for kind, scale in columns %}
{% set i = loop.index0 %}
{% set factor = "" if scale == 1 else (scale | number) ~ " * " %}
    gains[{{ i }}] = {{ factor }}{{ {"log": "exp(values[%d])", "signed": "sinh(values[%d])"}.get(kind, "values[%d]") | replace("%d", i) }};
{% endfor %}
    return {{ status.ok }};
}
{% endif %}
