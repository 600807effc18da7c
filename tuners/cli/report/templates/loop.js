/* The loop around a plant whose response is known: design rule, margins and responses.

   Pure functions of the report's numbers, which are described in live.py; page.js shows what they
   find.  Frequencies are in rad/s, phases in rad, complex numbers are [re, im]. */
"use strict";

const Loop = (() => {
  const LEAST_LAG = 1.0027 * Math.PI / 180;  // as yawrate_env.loop.design keeps it

  /* C(s) = rho (1 + T s)^zeros / (s^integrators (1 + Tf s)^filters), by Tustin's rule. */
  const KINDS = {
    P: {zeros: 0, integrators: 0, filters: 0},
    PI: {zeros: 1, integrators: 1, filters: 0},
    PID: {zeros: 2, integrators: 1, filters: 1},
  };

  const times = (a, b) => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
  const polar = (log, phase) => [Math.exp(log) * Math.cos(phase), Math.exp(log) * Math.sin(phase)];
  const distance = ([re, im]) => Math.hypot(1 + re, im);
  const turned = (angle) => angle - 2 * Math.PI * Math.ceil((angle - Math.PI) / (2 * Math.PI));

  /* A spline given by values and slopes at rising places. */
  function interpolated(places, spline, at) {
    let low = 0, high = places.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (places[middle] <= at) low = middle; else high = middle;
    }
    const h = places[high] - places[low], t = (at - places[low]) / h, s = 1 - t;
    const {value, slope} = spline;
    return s * s * ((1 + 2 * t) * value[low] + t * h * slope[low])
      + t * t * ((1 + 2 * s) * value[high] - s * h * slope[high]);
  }

  const logs = new WeakMap();
  function logOmega(model) {
    if (!logs.has(model)) logs.set(model, model.omega.map(Math.log));
    return logs.get(model);
  }

  /* Log magnitude and phase of the plant, the computation delay (in samples) in it. */
  function plant(model, omega, delay) {
    const places = logOmega(model), at = Math.log(omega);
    return [
      interpolated(places, model.log_magnitude, at),
      interpolated(places, model.phase, at) - omega * delay * model.Ts,
    ];
  }

  /* Tustin's rule takes omega to this. */
  const warped = (omega, Ts) => 2 / Ts * Math.tan(omega * Ts / 2);

  /* Log magnitude and phase of a controller. */
  function controller({kind, rho, T, Tf}, omega, Ts) {
    const {zeros, integrators, filters} = KINDS[kind], w = warped(omega, Ts);
    return [
      Math.log(rho) + zeros / 2 * Math.log1p((w * T) ** 2) - integrators * Math.log(w)
        - filters / 2 * Math.log1p((w * Tf) ** 2),
      zeros * Math.atan(w * T) - integrators * Math.PI / 2 - filters * Math.atan(w * Tf),
    ];
  }

  /* Rule R: the controller with which the loop crosses 1 where asked, with the margin asked for.
     `limited` where the kind cannot supply the phase and margin is given up; null where no
     controller of the kind has the phase. */
  function design(model, kind, crossover, phaseMargin, delay) {
    const {Ts} = model, {zeros, integrators, filters} = KINDS[kind];
    const omega = 2 * Math.PI * crossover, v = warped(omega, Ts);
    const [magnitude, angle] = plant(model, omega, delay);
    const needed = phaseMargin * Math.PI / 180 - Math.PI - angle;
    const Tf = filters ? Math.max(Math.tan(LEAST_LAG / 2) / v, Ts / 2) : 0;
    const alpha = Math.atan(v * Tf);
    if (!zeros) {
      const limited = needed > 1e-9 || needed <= phaseMargin * Math.PI / 180 - Math.PI;
      return {kind, rho: Math.exp(-magnitude), T: 0, Tf, limited};
    }
    const low = alpha * (zeros > integrators ? zeros - 1 : 0) - integrators * Math.PI / 2;
    const high = (zeros - integrators) * Math.PI / 2 - alpha;
    if (!(needed > low)) return null;
    const limited = needed >= high, phase = limited ? high - LEAST_LAG : needed;
    const theta = (phase + integrators * Math.PI / 2 + alpha) / zeros;
    const lead = Math.log(Math.cos(alpha)) - (zeros - integrators) * Math.log(Math.cos(theta));
    const kp = Math.exp(-magnitude - lead) * Math.sin(theta), T = Math.tan(theta) / v;
    return {kind, rho: kp / T, T, Tf, limited};
  }

  /* The PI with gains that a tuner found. */
  const pi = (kp, Ti) => ({kind: "PI", rho: kp / Ti, T: Ti, Tf: 0, limited: false});

  /* Kp + Ki/s + Kd s/(1 + Tf s), and Ti = Kp/Ki. */
  function gains({kind, rho, T, Tf}) {
    const {zeros, integrators} = KINDS[kind];
    const [a0, a1, a2] = [[1, 0, 0], [1, T, 0], [1, 2 * T, T * T]][zeros].map((a) => rho * a);
    if (!integrators) return {Kp: a0, Ki: 0, Kd: a1 - a0 * Tf, Ti: Infinity, Tf};
    const Kp = a1 - a0 * Tf;
    return {Kp, Ki: a0, Kd: a2 - Kp * Tf, Ti: Kp / a0, Tf};
  }

  const product = (p, q) => {
    const out = new Array(p.length + q.length - 1).fill(0);
    p.forEach((a, i) => q.forEach((b, j) => { out[i + j] += a * b; }));
    return out;
  };
  const power = (p, n) => (n ? product(p, power(p, n - 1)) : [1]);

  /* u[k] = sum b[i] e[k - i] - sum a[i] u[k - i], with a[0] = 1. */
  function difference({kind, rho, T, Tf}, Ts) {
    const {zeros, integrators, filters} = KINDS[kind], c = 2 / Ts;
    const lead = power([1 + c * T, 1 - c * T], zeros), lag = power([1 + c * Tf, 1 - c * Tf], filters);
    const b = product(lead, power([1, 1], integrators + filters - zeros));
    const a = product(power([c, -c], integrators), lag);
    return {b: b.map((x) => rho * x / a[0]), a: a.map((x) => x / a[0])};
  }

  /* The loop, L = C G, as log magnitude and phase. */
  function loop(model, C, omega, delay) {
    const [m, p] = plant(model, omega, delay), [n, q] = controller(C, omega, model.Ts);
    return [m + n, p + q];
  }

  /* Where a function changes sign between two frequencies. */
  function root(f, low, high) {
    let a = low, b = high, fa = f(a), fb = f(b);
    for (let i = 0; i < 80 && Math.abs(b - a) > 1e-15 * Math.abs(b); i++) {
      let c = (a * fb - b * fa) / (fb - fa);
      if (!(c > Math.min(a, b) && c < Math.max(a, b)) || i % 3 === 2) c = (a + b) / 2;
      const fc = f(c);
      if (fc === 0) return c;
      if ((fc < 0) === (fa < 0)) { a = c; fa = fc; } else { b = c; fb = fc; }
    }
    return Math.abs(fa) < Math.abs(fb) ? a : b;
  }

  /* Margins as yawrate_env.loop.margins defines them; NaN where there is no crossing. */
  function margins(model, C, delay) {
    const {omega} = model, grid = omega.map((w) => loop(model, C, w, delay));
    const L = (w) => loop(model, C, w, delay);
    let crossover = NaN, turn = NaN, gain = Infinity;
    for (let i = omega.length - 2; i >= 0 && Number.isNaN(crossover); i--) {
      if (grid[i][0] >= 0 && grid[i + 1][0] < 0) crossover = root((w) => L(w)[0], omega[i], omega[i + 1]);
    }
    const half = (phase) => Math.floor((phase + Math.PI) / (2 * Math.PI));  // which side of -180
    for (let i = 0; i < omega.length - 1; i++) {
      if (half(grid[i][1]) === half(grid[i + 1][1])) continue;
      const line = 2 * Math.PI * Math.max(half(grid[i][1]), half(grid[i + 1][1])) - Math.PI;
      const at = root((w) => L(w)[1] - line, omega[i], omega[i + 1]), found = -L(at)[0];
      if (Math.abs(found) < Math.abs(gain)) { gain = found; turn = at; }
    }
    let nearest = 0;
    const far = (w) => distance(polar(...L(w)));
    const all = grid.map((value) => distance(polar(...value)));
    all.forEach((d, i) => { if (d < all[nearest]) nearest = i; });
    let low = omega[Math.max(nearest - 1, 0)], high = omega[Math.min(nearest + 1, omega.length - 1)];
    for (let i = 0; i < 60; i++) {
      const left = high - 0.6180339887498949 * (high - low), right = low + 0.6180339887498949 * (high - low);
      if (far(left) < far(right)) high = right; else low = left;
    }
    const phase = Number.isNaN(crossover) ? NaN : turned(L(crossover)[1] + Math.PI);
    return {
      phaseMargin: phase * 180 / Math.PI,
      crossover: crossover / (2 * Math.PI),
      gainMargin: gain * 20 / Math.LN10,
      phaseCrossover: turn / (2 * Math.PI),
      modulusMargin: Math.min(far((low + high) / 2), all[nearest]),
      delayMargin: ((phase + 2 * Math.PI) % (2 * Math.PI)) / crossover,
    };
  }

  /* Variance of log magnitude, covariance, and variance of phase: what the recording leaves open at
     a frequency [Hz]; NaN where it was not computed. */
  function variances({known}, hertz) {
    if (!known) return [NaN, NaN, NaN];
    const last = known.crossover.length - 1;
    const place = last * Math.log(hertz / known.crossover[0]) / Math.log(known.crossover[last] / known.crossover[0]);
    if (!(place >= -1e-6 && place <= last + 1e-6)) return [NaN, NaN, NaN];
    const k = Math.min(Math.max(Math.floor(place), 0), last - 1), t = place - k;
    return ["magnitude", "both", "phase"].map((name) => known[name][k] * (1 - t) + known[name][k + 1] * t);
  }

  /* Standard deviations of log magnitude and phase at a frequency [Hz]. */
  function deviations(model, hertz) {
    const [magnitude, , phase] = variances(model, hertz);
    return [Math.sqrt(magnitude), Math.sqrt(phase)];
  }

  /* Standard deviations of phase margin [deg] and crossover [Hz]. */
  function spread(model, C, delay, {crossover}) {
    const [magnitude, both, phase] = variances(model, crossover);
    const omega = 2 * Math.PI * crossover, step = 1e-4;
    const ends = [1 - step, 1 + step].map((times) => loop(model, C, omega * times, delay));
    const [falls, turns] = [0, 1].map((i) => (ends[1][i] - ends[0][i]) / (2 * step));
    const slope = turns / falls;  // what is required is minus the plant's magnitude and phase
    return [
      180 / Math.PI * Math.sqrt(Math.max(slope * slope * magnitude - 2 * slope * both + phase, 0)),
      Math.abs(crossover / falls) * Math.sqrt(magnitude),
    ];
  }

  const convolved = (pulse, input, k) => {
    let sum = 0;
    for (let i = Math.max(1, k - input.length + 1), last = Math.min(k, pulse.length - 1); i <= last; i++) sum += pulse[i] * input[k - i];
    return sum;
  };

  /* Outputs y and inputs x of the plant in the loop, from rest, for the reference, and what is
     added to the input and to the output, by sample; NaN from where the output runs away. */
  function simulated({pulse, Ts}, C, delay, samples, reference, disturbance, added = () => 0) {
    const {b, a} = difference(C, Ts), [y, x, u, e] = Array.from({length: 4}, () => new Float64Array(samples));
    for (let k = 0; k < samples; k++) {
      y[k] = convolved(pulse, x, k) + added(k);
      if (!(Math.abs(y[k]) < 1e6)) return {y: y.fill(NaN, k), x};
      e[k] = reference - y[k];
      let command = 0;
      for (let i = 0; i < b.length && i <= k; i++) command += b[i] * e[k - i];
      for (let i = 1; i < a.length && i <= k; i++) command -= a[i] * u[k - i];
      u[k] = command;
      x[k] = (k >= delay ? u[k - delay] : 0) + disturbance;
    }
    return {y, x};
  }

  const EVENTS = {step: [1, 0], disturbance: [0, 1]};  // of the reference, and of the plant's input

  /* Output after either event. */
  function responses(model, C, delay, samples) {
    return Object.fromEntries(Object.entries(EVENTS).map(([name, event]) => [name, simulated(model, C, delay, samples, ...event).y]));
  }

  /* Half widths of the bands of `responses`; null where the recording does not tell.  A change d of
     the pulse response changes the output by d * x through the loop's sensitivity, so by d * (that
     applied to x). */
  function halfWidths(model, C, delay, samples) {
    if (!model.doubt) return null;
    return Object.fromEntries(Object.entries(EVENTS).map(([name, event]) => {
      const {x} = simulated(model, C, delay, samples, ...event);
      const {y} = simulated(model, C, delay, samples, 0, 0, (k) => x[k]);
      const squares = Float64Array.from(y, (_, k) => model.doubt.reduce((sum, pulse) => sum + convolved(pulse, y, k) ** 2, 0));
      return [name, squares.map(Math.sqrt)];
    }));
  }

  /* Whether the loop is stable: its phase runs below -180 degrees nowhere above magnitude 1 at the
     last crossing, and the step settles towards the reference. */
  function stable(found, {step}) {
    if (!(found.phaseMargin > 0) || !(found.gainMargin > 0)) return false;
    const n = step.length, late = step.subarray(Math.floor(0.75 * n));
    return late.every((value) => Math.abs(value) < 10);
  }

  return {KINDS, controller, design, deviations, difference, gains, halfWidths, loop, margins, pi, plant, polar, responses, spread, stable};
})();

if (typeof module !== "undefined") module.exports = Loop;
