/* The loop around a plant whose response is known: design rule, margins and responses.

   Pure functions of the report's numbers, which are described in live.py; page.js shows what they
   find.  Frequencies are in rad/s, phases in rad, complex numbers are [re, im]. */
"use strict";

if (typeof require !== "undefined") globalThis.Controllers = require("./controllers.js");

const Loop = (() => {
  const LEAST_LAG = 1.0027 * Math.PI / 180;  // as yawrate_env.loop.law keeps it

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

  /* Log magnitude and phase of a signal that the controller sees, the delay (in samples) in it. */
  function response(model, seen, omega, delay) {
    const places = logOmega(model), at = Math.log(omega);
    return [
      interpolated(places, seen.log_magnitude, at),
      interpolated(places, seen.phase, at) - omega * delay * model.Ts,
    ];
  }

  /* Tustin's rule takes omega to this. */
  const warped = (omega, Ts) => 2 / Ts * Math.tan(omega * Ts / 2);

  /* Rule R for one kind: gains by name with which the loop crosses 1 where asked, with the margin
     asked for, as yawrate_env.loop.law has it.  `limited` where the kind cannot supply the phase
     and margin is given up; null where no controller of the kind has the phase. */
  function shaped(model, {law}, {crossover, margin, delay}) {
    const {Ts} = model, {zeros: n, integrators: m, filtered, centred} = law, derives = n > m;
    const omega = 2 * Math.PI * crossover, v = warped(omega, Ts);
    const [magnitude, angle] = response(model, model.seen[0], omega, delay);
    const needed = margin * Math.PI / 180 - Math.PI - angle;
    if (centred) {
      if (!(Math.abs(needed) < Math.PI / 2)) return null;
      const root = Math.sqrt((1 + Math.sin(needed)) / (1 - Math.sin(needed)));
      return [{kp: Math.exp(-magnitude) / root, T_lead: root / v, T_lag: 1 / (root * v)}, false];
    }
    const Tf = !derives ? 0 : filtered ? Math.max(Math.tan(LEAST_LAG / 2) / v, Ts / 2) : Ts / 2;
    const alpha = Math.atan(v * Tf), high = (n - m) * Math.PI / 2 - alpha;
    if (!n) {
      const enough = needed > high - Math.PI + margin * Math.PI / 180 && needed <= high + 1e-9;
      const k = Math.exp(-magnitude) * v ** m;
      return [{kp: m ? 0 : k, Ki: m ? k : 0}, !enough];
    }
    if (!(needed > alpha * (derives ? n - 1 : 0) - m * Math.PI / 2)) return null;
    const limited = needed >= high, phase = limited ? high - LEAST_LAG : needed;
    const lag = (phase + alpha - (n - m) * Math.PI / 2) / n, tangent = -Math.tan(lag), T = 1 / (tangent * v);
    const gain = Math.exp(-magnitude) / Math.cos(alpha) * (-Math.sin(lag)) ** (n - m);
    const k = m ? gain / Math.hypot(1, tangent) : gain;
    const Ki = m ? k / T : 0, Kp = m && derives ? 2 * k - Ki * Tf : k;
    const Kd = derives ? k * T - (m ? Kp : k) * Tf : 0;
    return [{kp: Kp, Ki, Ti: Kp / Ki, Td: Kd / Kp, Tf, b: 1}, limited];
  }

  /* The controller at a position {kind, crossover, margin, delay, asked, b}: by rule R, or from the
     gains by delay and what the rule is asked for; null where there is none. */
  function design(model, position) {
    const kind = model.kinds[position.kind], names = kind.gains.map(([name]) => name);
    let gains, limited = false;
    if (kind.law) {
      const found = shaped(model, kind, position);
      if (!found) return null;
      limited = found[1];
      gains = Object.fromEntries(names.map((name) => [name, found[0][name]]));
    } else {
      const row = kind.table[position.delay][position.asked];
      if (row.includes(null)) return null;
      gains = Object.fromEntries(names.map((name, i) => [name, row[i]]));
    }
    if ("b" in gains && position.b != null) gains.b = position.b;
    return Controllers.controller(kind, gains, model.Ts, limited);
  }

  /* A polynomial in delta at omega. */
  function value(polynomial, [re, im]) {
    return polynomial.reduce((found, c) => { const [x, y] = times(found, [re, im]); return [x + c, y]; }, [0, 0]);
  }
  const ratio = ([a, b], [c, d]) => { const size = c * c + d * d; return [(a * c + b * d) / size, (b * c - a * d) / size]; };

  function deltaOf(omega, Ts) {
    const half = Math.sin(omega * Ts / 2);
    return [-2 * half * half / Ts, Math.sin(omega * Ts) / Ts];
  }

  /* The loop, L = sum N_i/D S_i. */
  function loop(model, C, omega, delay) {
    const delta = deltaOf(omega, model.Ts);
    const fed = model.seen.reduce(([re, im], seen, i) => {
      const [x, y] = times(value(C.seen[i], delta), polar(...response(model, seen, omega, delay)));
      return [re + x, im + y];
    }, [0, 0]);
    return ratio(fed, value(C.denominator, delta));
  }

  const logarithm = ([re, im]) => 0.5 * Math.log(re * re + im * im);
  const angle = ([re, im]) => Math.atan2(im, re);

  /* Angles without jumps. */
  function unwrapped(angles) {
    let turns = 0;
    return angles.map((value, i) => {
      if (i) turns -= Math.round((value - angles[i - 1]) / (2 * Math.PI));
      return value + 2 * Math.PI * turns;
    });
  }

  /* Log magnitude, and phase between -270 and 90 degrees at first, of the loop at model.omega. */
  function bode(values) {
    const phase = unwrapped(values.map(angle)), turn = 2 * Math.PI * Math.ceil((phase[0] - Math.PI / 2) / (2 * Math.PI));
    return [values.map(logarithm), phase.map((value) => value - turn)];
  }

  const overOmega = (model, C, delay) => model.omega.map((omega) => loop(model, C, omega, delay));

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
    const {omega} = model, L = (w) => loop(model, C, w, delay), values = overOmega(model, C, delay);
    let crossover = NaN, turn = NaN, gain = Infinity;
    let above = omega.length - 1;  // the highest frequency of magnitude 1 or more
    while (above >= 0 && logarithm(values[above]) < 0) above--;
    if (above >= 0 && above < omega.length - 1) crossover = root((w) => logarithm(L(w)), omega[above], omega[above + 1]);
    for (let i = 0, last = omega.length - 1; i < last; i++) {
      const [one, next] = [values[i], values[i + 1]], crosses = (one[1] < 0) !== (next[1] < 0);
      if ((one[0] > 0 && next[0] > 0) || !(crosses || i + 1 === last)) continue;
      const at = crosses ? root((w) => L(w)[1], omega[i], omega[i + 1]) : omega[last];  // real at half the rate
      const [re] = L(at), found = -Math.log(-re);
      if (re < 0 && Math.abs(found) < Math.abs(gain)) { gain = found; turn = at; }
    }
    let nearest = 0;
    const far = (w) => distance(L(w)), all = values.map(distance);
    all.forEach((d, i) => { if (d < all[nearest]) nearest = i; });
    let low = omega[Math.max(nearest - 1, 0)], high = omega[Math.min(nearest + 1, omega.length - 1)];
    for (let i = 0; i < 60; i++) {
      const left = high - 0.6180339887498949 * (high - low), right = low + 0.6180339887498949 * (high - low);
      if (far(left) < far(right)) high = right; else low = left;
    }
    const phase = Number.isNaN(crossover) ? NaN : turned(angle(L(crossover)) + Math.PI);
    return {
      phaseMargin: phase * 180 / Math.PI,
      crossover: crossover / (2 * Math.PI),
      gainMargin: gain * 20 / Math.LN10,
      phaseCrossover: turn / (2 * Math.PI),
      modulusMargin: Math.min(far((low + high) / 2), all[nearest]),
      delayMargin: ((phase + 2 * Math.PI) % (2 * Math.PI)) / crossover,
      turns: turns(values),
    };
  }

  /* By how much 1 + L turns from the lowest frequency to the highest. */
  function turns(values) {
    const angles = unwrapped(values.map(([re, im]) => angle([1 + re, im])));
    return angles[angles.length - 1] - angles[0];
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
    const falls = (logarithm(ends[1]) - logarithm(ends[0])) / (2 * step);
    const slope = turned(angle(ends[1]) - angle(ends[0])) / (2 * step) / falls;  // what is required is minus the plant's magnitude and phase
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

  /* Outputs y, commands u and inputs x of the plant in the loop, from rest, for the reference, and
     what is added to the input and to the output, by sample; NaN from where the output runs away.
     The controller in observer form, as yawrate_env.loop.feedback has it. */
  function simulated(model, C, delay, samples, reference, disturbance, added = () => 0) {
    const {pulse, Ts} = model, order = C.denominator.length - 1, w = new Float64Array(order + 1);
    const [y, x, u] = Array.from({length: 3}, () => new Float64Array(samples));
    for (let k = 0; k < samples; k++) {
      y[k] = convolved(pulse, x, k) + added(k);
      if (!(Math.abs(y[k]) < 1e6)) return {y: y.fill(NaN, k), u: u.fill(NaN, k), x};
      const seen = model.seen.map((one) => (one.pulse ? convolved(one.pulse, x, k) : y[k]));
      const fed = (i) => seen.reduce((total, value, j) => total - C.seen[j][i] * value, C.reference[i] * reference);
      u[k] = fed(0) + w[0];
      for (let i = 1; i <= order; i++) w[i - 1] += Ts * (w[i] - C.denominator[i] * u[k] + fed(i));
      x[k] = (k >= delay ? u[k - delay] : 0) + disturbance;
    }
    return {y, u, x};
  }

  const EVENTS = {step: [1, 0], disturbance: [0, 1]};  // of the reference, and of the plant's input

  /* Output after either event, and the command after the first. */
  function responses(model, C, delay, samples) {
    const found = Object.entries(EVENTS).map(([name, event]) => [name, simulated(model, C, delay, samples, ...event)]);
    return {...Object.fromEntries(found.map(([name, {y}]) => [name, y])), command: found[0][1].u};
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

  /* Whether the loop is stable: 1 + L turns by half a turn for each unstable pole of the open loop
     and a quarter for each integrator (Nyquist), where these are known, and the step stays small.
     Below the lowest frequency the controller turns it as its integrator lets go; what the plant
     does there is less than the last three eighths of a turn. */
  function stable(model, C, found, {step}) {
    const late = step.subarray(Math.floor(0.75 * step.length));
    if (!late.every((value) => Math.abs(value) < 10)) return false;
    if (model.unstable == null) return found.phaseMargin > 0 && found.gainMargin > 0;
    const last = C.denominator.length - 1, own = last > 0 && C.denominator[last] === 0 ? 1 : 0;
    const delta = deltaOf(model.omega[0], model.Ts);
    const below = own * (angle(ratio(value(C.seen[0], delta), value(C.denominator, delta))) + Math.PI / 2);
    return found.turns + below > Math.PI * (model.unstable + (model.integrators + own) / 2 - 0.75);
  }

  return {...Controllers, bode, design, deviations, halfWidths, loop, margins, overOmega, responses, spread, stable};
})();

if (typeof module !== "undefined") module.exports = Loop;
