/* Controllers by the names of their gains, as polynomials and difference equations.

   As yawrate_env.loop.controllers has them; what a kind is made of is described in live.py. */
"use strict";

const Controllers = (() => {
  const product = (p, q) => {
    const out = new Array(p.length + q.length - 1).fill(0);
    p.forEach((a, i) => q.forEach((b, j) => { out[i + j] += a * b; }));
    return out;
  };
  const sum = (p, q) => p.map((a, i) => a + q[i]);
  const scaled = (p, factor) => p.map((a) => factor * a);

  /* Kp (b r - y) + Ki/s e + Kd s/(1 + Tf s) (c r - y), by the names of its gains. */
  function parallel({kp = 0, Ki = NaN, Ti = NaN, Td = NaN, Tf = NaN, b = 1, T_lead = NaN, T_lag = NaN}, c, Ts) {
    const first = (...values) => values.find((value) => !Number.isNaN(value));
    const filter = first(Tf, T_lag, Ts / 2);
    return {Kp: kp, Ki: first(Ki, kp / Ti, 0), Kd: first(kp * Td, kp * (T_lead - T_lag), 0), Tf: filter, b, c};
  }

  /* A controller u = (N_r r - sum N_i s_i)/D of the signals s_i that it sees, in polynomials of
     delta = (z - 1)/Ts, the highest power first. */
  function controller(kind, gains, Ts, limited = false) {
    const made = {gains, limited};
    if (kind.states) return {...made, reference: [gains.kr], seen: kind.states.map((name) => [gains[name]]), denominator: [1]};
    const {Kp, Ki, Kd, Tf, b, c} = parallel(gains, kind.c, Ts), h = Ts / 2, rate = 1 / (Tf + h);
    let reference = [Kp * b], output = [Kp], denominator = [1];
    if (kind.integrates) {
      [reference, output] = [reference, output].map((p) => sum([...p, 0], [h * Ki, Ki]));
      denominator = [1, 0];
    }
    if (kind.derives) {
      const pole = [1, rate], top = product([rate * Kd, 0], denominator);
      reference = sum(product(reference, pole), scaled(top, c));
      output = sum(product(output, pole), top);
      denominator = product(denominator, pole);
    }
    return {...made, reference, seen: [output], denominator};
  }

  /* b and a of sum a[i] u[k - i] = sum b[i] x[k - i], from polynomials in delta. */
  function difference(polynomial, Ts) {
    const step = [1 / Ts, -1 / Ts], n = polynomial.length - 1;
    return polynomial.reduce((found, c, i) => {
      let term = [c];
      for (let j = 0; j < n; j++) term = j < n - i ? product(term, step) : [...[0], ...term];
      return sum(found, term);
    }, new Array(n + 1).fill(0));
  }

  /* Coefficients of the reference, of what is seen, and of the command, whose first is 1. */
  function differences({reference, seen, denominator}, Ts) {
    const a = difference(denominator, Ts), of = (p) => scaled(difference(p, Ts), 1 / a[0]);
    return {reference: of(reference), seen: seen.map(of), command: of(denominator)};
  }

  return {controller, differences, parallel};
})();

if (typeof module !== "undefined") module.exports = Controllers;
