/* A controller as text: gains, difference equation, MATLAB and C; and numbers for people. */
"use strict";

const Texts = ({kinds, seen, Ts, texts}) => {
  const fixed = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits).replace("-", "−") : "none");
  const plain = (value, n = 6) => (Number.isFinite(value) ? String(Number(value.toPrecision(n))) : "none");
  const kindOf = (C) => kinds[C.kind];

  /* The signals of a controller and their coefficients: the error where reference and output share
     theirs, else both. */
  function terms(C) {
    const {reference, seen: outputs, command} = Loop.differences(C, Ts);
    const minus = outputs.map((b) => b.map((x) => -x));
    if (outputs.length === 1 && outputs[0].every((x, i) => x === reference[i])) return {signals: ["e"], b: [reference], command};
    return {signals: ["r", ...seen.map(({name}) => name)], b: [reference, ...minus], command};
  }

  function equation(C) {
    const {signals, b, command} = terms(C), of = (name, i) => `${name}[k${i ? `-${i}` : ""}]`;
    const past = command.slice(1).map((x, i) => [-x, of("u", i + 1)]);
    const inputs = signals.flatMap((name, j) => b[j].map((x, i) => [x, of(name, i)]));
    const all = [...past, ...inputs], least = 1e-12 * Math.max(...all.map(([x]) => Math.abs(x)));
    const parts = all.filter(([x]) => Math.abs(x) > least).map(([x, name]) => `${x < 0 ? "-" : "+"} ${Math.abs(x) === 1 ? "" : `${plain(Math.abs(x))} `}${name}`);
    return `u[k] = ${parts.join(" ")}`.replace("= + ", "= ").replace("= - ", "= -");
  }

  function gainText(C, n) {
    return kindOf(C).gains.map(([name, unit]) => `${name} ${plain(C.gains[name], n)}${unit && ` ${unit}`}`).join(", ");
  }

  function matlab(C) {
    const {signals, b, command} = terms(C), list = (p) => `[${p.map((x) => x.toPrecision(15)).join(", ")}]`;
    const parts = b.map((top) => `tf(${list(top)}, ${list(command)}, ${Ts})`);
    return signals.length === 1 ? `C = ${parts[0]};` : `C = [${parts.join(", ...\n     ")}];  % u from [${signals.join("; ")}]`;
  }

  /* The constants of the C programs of yawrate export, by their names in these. */
  function constants(C) {
    const {Kp, Ki, Kd, Tf, b, c} = Loop.parallel(C.gains, kindOf(C).c, Ts), [low, high] = texts.c.limits;
    const half = Ki * Ts / 2, step = Ki * Ts, rate = 2 * Kd / (2 * Tf + Ts), Ti = Kp / Ki, Td = Kd / Kp;
    const largest = 1e3 * (high - low) / Math.max(Kp + half + Math.abs(rate), step);
    return {
      ...C.gains, Kp, Ki, Kd, Tf, b, c, KP: Kp, HALF: half, STEP: step, GAIN: Kp + half, RATE: rate,
      DECAY: Math.max((2 * Tf - Ts) / (2 * Tf + Ts), 0), REST: 1 - b, LEFT: 1 - c, LARGEST: largest,
      TRACKING: Ki ? Ts / Math.max(Td > 0 ? Math.sqrt(Ti * Td) : Ti, Ts) : 0, BEYOND: Math.min(1e6 * largest, 3.4028234e38),
    };
  }

  function program(C) {
    const text = texts.c && texts.c.texts[C.kind];
    if (!text) return null;
    const values = constants(C);
    return text.replace(/@(\w+)@/g, (_, name) => { const v = values[name].toPrecision(17); return /[.e]/.test(v) ? v : `${v}.0`; });
  }

  return {equation, fixed, gainText, matlab, plain, program};
};

if (typeof module !== "undefined") module.exports = Texts;
