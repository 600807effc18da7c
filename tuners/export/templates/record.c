/* Random bits into first-order lags. */
static void record({{ first }}_state *state)
{
    uint32_t bits = 1u;
    double input[{{ golden_signals.inputs }}] = { 0.0 };
    double output[{{ golden_signals.outputs }}] = { 0.0 };
    long k;
    int i;
    int j;

    {{ first }}_start(state);
    for (k = 0; k < {{ golden_signals.samples }}; k++) {
        for (j = 0; j < {{ golden_signals.outputs }}; j++) {
            double command = 0.0;

            for (i = 0; i < {{ golden_signals.inputs }}; i++) {
                command += ((i == j) ? 1.0 : 0.5) * input[i];
            }
            output[j] = ({{ golden_signals.decay | number }} * output[j]) + ({{ golden_signals.rise | number }} * command);
        }
        if ((k % {{ golden_signals.hold }}) == 0) {
            for (i = 0; i < {{ golden_signals.inputs }}; i++) {
                bits = (1664525u * bits) + 1013904223u;
                input[i] = ((bits >> 31) != 0u) ? 0.02 : -0.02;
            }
        }
        {{ first }}_sample(state, {{ "input, output" if golden_signals.inputs * golden_signals.outputs > 1 else "input[0], output[0]" }});
    }
}
