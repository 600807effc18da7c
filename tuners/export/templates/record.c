/* Random bits into a first-order lag. */
static void record({{ first }}_state *state)
{
    uint32_t bits = 1u;
    double input = 0.0;
    double output = 0.0;
    long k;

    {{ first }}_start(state);
    for (k = 0; k < {{ golden_signals.samples }}; k++) {
        output = ({{ golden_signals.decay | number }} * output) + ({{ golden_signals.rise | number }} * input);
        if ((k % {{ golden_signals.hold }}) == 0) {
            bits = (1664525u * bits) + 1013904223u;
            input = ((bits >> 31) != 0u) ? 0.02 : -0.02;
        }
        {{ first }}_sample(state, input, output);
    }
}
