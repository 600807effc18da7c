/* The report's sliders, charts and copy buttons; the numbers come from loop.js. */
"use strict";

(() => {
  const model = JSON.parse(document.getElementById("model").textContent);
  const section = document.getElementById("live"), find = (name) => section.querySelector(`[data-${name}]`);
  const {start, range, Ts, names, texts} = model;
  const controls = Object.fromEntries(["crossover", "margin", "delay"].map((n) => [n, section.querySelector(`#${n}`)]));
  const fresh = {kind: start.kind, crossover: start.crossover, margin: start.phase_margin, delay: start.delay};
  let state = {...fresh};

  const fixed = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits).replace("-", "−") : "none");
  const plain = (value, n = 6) => (Number.isFinite(value) ? String(Number(value.toPrecision(n))) : "none");
  const untouched = () => Object.keys(fresh).every((name) => state[name] === fresh[name]);

  /* The answer where nothing was moved, else rule R around the model behind it. */
  const chosen = (crossover = state.crossover) => (untouched() && crossover === state.crossover
    ? Loop.pi(start.kp, start.Ti)
    : Loop.design(model, state.kind, crossover, state.margin, state.delay));

  function evaluated(C) {
    const found = Loop.margins(model, C, state.delay);
    const samples = Math.min(model.pulse.length, Math.round(4 / state.crossover / Ts) + 1);
    const drawn = Loop.responses(model, C, state.delay, samples);
    return {C, found, drawn, stable: Loop.stable(found, drawn), spread: Loop.spread(model, C, state.delay, found)};
  }

  const factors = (model.known || {factors: [NaN, NaN]}).factors;  // half widths of 90 % intervals, in deviations

  /* Charts */
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const SYNC = uPlot.sync("frequency");
  const charts = [];

  function axis(label, more = {}) {
    return {
      label, stroke: () => style("--ink"), font: "12px system-ui", labelFont: "12px system-ui", labelSize: 18,
      grid: {stroke: () => style("--line"), width: 1}, ticks: {stroke: () => style("--line"), width: 1}, size: 52, ...more,
    };
  }

  const HERTZ = (u, ticks) => ticks.map((v) => (v == null ? null : String(Number(v.toPrecision(3)))));

  /* Under a chart: what its lines are, and their values where the pointer is. */
  function key(host, entries) {
    const line = document.createElement("p");
    line.className = "key";
    const parts = entries.map(([name]) => {
      const part = document.createElement("span");
      part.className = name;
      line.append(part);
      return part;
    });
    host.after(line);
    return (u) => parts.forEach((part, i) => {
      const [name, told] = entries[i], text = told(u, u.cursor.idx);
      part.replaceChildren(...(text && name !== "at" ? [document.createElement("i")] : []), text);
    });
  }

  function chart(name, height, {hooks = {}, ...options}, data, entries) {
    const host = find(name), tell = entries ? key(host, entries) : () => {};
    const plot = new uPlot({
      width: host.clientWidth, height, legend: {show: false}, cursor: {drag: {x: false, y: false}}, ...options,
      hooks: {...hooks, setCursor: [tell], setData: [tell]},
    }, data, host);
    charts.push({plot, host, height});
    return plot;
  }

  const LINE = {width: 2, points: {show: false}};
  const loopLine = () => style("--loop"), other = () => style("--other");
  const HIDDEN = {stroke: "transparent", points: {show: false}};
  const BAND = {fill: () => style("--band")};

  /* What a key says of a line, and of a band between two. */
  const line = (label, index, n, unit = "") => (u, at) => {
    const value = at == null ? null : u.data[index][at];
    return `${typeof label === "function" ? label() : label}${value == null ? "" : ` ${fixed(value, n)}${unit}`}`;
  };
  const band = (low, high, n) => (u, at) => {
    if (!u.data[low].some((v) => v != null)) return "";
    const [from, to] = at == null ? [null, null] : [u.data[low][at], u.data[high][at]];
    return from == null ? "90 %" : `90 % ${fixed(from, n)} to ${fixed(to, n)}`;
  };

  function dashed(u, at, horizontal) {
    const {ctx, bbox} = u, place = u.valToPos(at, horizontal ? "y" : "x", true);
    ctx.save();
    ctx.strokeStyle = style("--muted");
    ctx.setLineDash([4, 4]);
    ctx.beginPath();
    if (horizontal) { ctx.moveTo(bbox.left, place); ctx.lineTo(bbox.left + bbox.width, place); }
    else { ctx.moveTo(place, bbox.top); ctx.lineTo(place, bbox.top + bbox.height); }
    ctx.stroke();
    ctx.restore();
  }

  let now = null;  // what is shown
  const marks = (level, at) => ({drawAxes: [(u) => { dashed(u, level, true); const x = at(); if (Number.isFinite(x)) dashed(u, x, false); }]});
  const frequency = {time: false, distr: 3};

  const hertz = model.omega.map((w) => w / (2 * Math.PI));

  function bode(name, label, unit, level, at, scale, bottom) {
    return chart(name, 190, {
      bands: [{series: [3, 2], ...BAND}],
      scales: {x: {...frequency, range: () => [hertz[0], hertz[hertz.length - 1]]}, y: scale},
      cursor: {sync: {key: SYNC.key}, drag: {x: false, y: false}}, hooks: marks(level, at),
      axes: [axis(bottom, {values: HERTZ, size: bottom ? 34 : 20}), axis(label)],
      series: [{}, {stroke: loopLine, ...LINE}, HIDDEN, HIDDEN],
    }, [[0.1, 1], [0, 0], [0, 0], [0, 0]], [
      ["at", (u, i) => (i == null ? "" : `${plain(u.data[0][i], 3)} Hz`)],
      ["this", line("this loop", 1, 1, unit)], ["band", band(2, 3, 1)],
    ]);
  }

  /* A range about a middle, so that circles are round: 3.2 units over the shorter side. */
  function around(u, middle, side) {
    const least = Math.min(u.bbox.width, u.bbox.height), half = least > 0 ? 1.6 * side / least : 1.6;
    return [middle - half, middle + half];
  }

  function nyquist() {
    const path = (u, index) => {
      const [xs, ys] = u.data[index];
      const shape = new Path2D();
      xs.forEach((x, i) => {
        const px = u.valToPos(x, "x", true), py = u.valToPos(ys[i], "y", true);
        if (i) shape.lineTo(px, py); else shape.moveTo(px, py);
      });
      return {stroke: shape};
    };
    const series = (label, stroke, more = {}) => ({label, stroke, width: 2, paths: path, points: {show: false}, facets: [{scale: "x", auto: true}, {scale: "y", auto: true}], ...more});
    return chart("nyquist", 300, {
      mode: 2, cursor: {show: false},
      scales: {x: {time: false, range: (u) => around(u, -0.5, u.bbox.width)}, y: {range: (u) => around(u, -0.3, u.bbox.height)}},
      axes: [axis("real part", {size: 34}), axis("imaginary part")],
      series: [{}, series("loop", loopLine), series("unit circle", () => style("--muted"), {width: 1, dash: [4, 4]}),
        series("modulus margin", () => style("--mark"), {width: 1}), series("-1", () => style("--ink"), {width: 3})],
    }, [null, ...Array(4).fill([[0, 0], [0, 0]])]);
  }

  let sides = [["slower", NaN], ["faster", NaN]];  // loops beside the chosen one, and their crossovers
  const side = (i) => () => (Number.isFinite(sides[i][1]) ? `${sides[i][0]}, ${fixed(sides[i][1], 2)} Hz` : "");

  function response(name, label) {
    const thin = (dash) => ({stroke: other, width: 1.5, dash, points: {show: false}});
    return chart(name, 220, {
      bands: [{series: [5, 4], ...BAND}],
      axes: [axis("time [s]", {size: 34}), axis(label)], scales: {x: {time: false}},
      series: [{}, {stroke: loopLine, ...LINE}, thin([6, 4]), thin([2, 3]), HIDDEN, HIDDEN],
    }, [[0, 1], ...Array(5).fill([0, 0])], [
      ["at", (u, i) => (i == null ? "" : `${fixed(u.data[0][i], 2)} s`)],
      ["this", line("this loop", 1, 3)], ["band", band(4, 5, 3)],
      ["slower", line(side(0), 2, 3)], ["faster", line(side(1), 3, 3)],
    ]);
  }

  const plots = {
    magnitude: bode("magnitude", "magnitude [dB]", " dB", 0, () => now && now.found.crossover, {range: (u, low, high) => [Math.max(low, -50), Math.min(high, 50)]}, ""),
    phase: bode("phase", "phase [deg]", "°", -180, () => now && now.found.crossover, {range: (u, low, high) => [Math.max(low, -300), Math.max(high, -30)]}, "frequency [Hz]"),
    nyquist: nyquist(),
    step: response("step", names.output),
    disturbance: response("disturbance", names.output),
  };

  const circle = (x, y, r) => {
    const turns = Array.from({length: 91}, (_, i) => i * Math.PI / 45);
    return [turns.map((t) => x + r * Math.cos(t)), turns.map((t) => y + r * Math.sin(t))];
  };

  const edges = (values, half) => [-1, 1].map((sign) => values.map((v, i) => (v != null && half && Number.isFinite(half[i]) ? v + sign * half[i] : null)));

  function draw(others) {
    const grid = model.omega.map((w) => Loop.loop(model, now.C, w, state.delay));
    const known = hertz.map((f) => Loop.deviations(model, f));
    for (const [name, part, unit, factor] of [["magnitude", 0, 20 / Math.LN10, factors[1]], ["phase", 1, 180 / Math.PI, factors[0]]]) {
      const values = grid.map((v) => v[part] * unit);
      plots[name].setData([hertz, values, ...edges(values, known.map((d) => factor * d[part] * unit))]);
    }
    const points = grid.map((v) => Loop.polar(...v)).filter(([re, im]) => Math.hypot(re, im) < 20);
    plots.nyquist.setData([null, [points.map((p) => p[0]), points.map((p) => p[1])], circle(0, 0, 1),
      circle(-1, 0, now.found.modulusMargin), circle(-1, 0, 0.01)]);
    const time = Array.from(now.drawn.step, (_, k) => k * Ts);
    const shown = (values) => time.map((_, k) => (Number.isFinite(values[k]) ? values[k] : null));
    const half = now.stable ? Loop.halfWidths(model, now.C, state.delay, time.length) : null;
    for (const name of ["step", "disturbance"]) {
      const values = shown(now.drawn[name]);
      plots[name].setData([time, values, ...others.map((o) => shown(o ? o.drawn[name] : [])), ...edges(values, half && half[name])]);
    }
  }

  /* Text */
  function interval(metric, value, spread, factor, n) {
    const half = factor * spread;
    const [low, high] = untouched() && start.intervals ? start.intervals[metric] : [value - half, value + half];
    return Number.isFinite(low) ? `${fixed(low, n)} to ${fixed(high, n)}` : "the recording does not tell";
  }

  function equation(C) {
    const {b, a} = Loop.difference(C, Ts), sign = (x) => (x < 0 ? "-" : "+");
    const past = a.slice(1).map((x, i) => `${sign(-x)} ${plain(Math.abs(x))} u[k-${i + 1}]`);
    const errors = b.map((x, i) => `${sign(x)} ${plain(Math.abs(x))} e[k${i ? `-${i}` : ""}]`);
    return `u[k] = ${[...past, ...errors].join(" ")}`.replace("= + ", "= ").replace("1 u[", "u[");
  }

  function gainText(C, n) {
    const g = Loop.gains(C);
    const parts = [`Kp ${plain(g.Kp, n)}${names.gain ? ` ${names.gain}` : ""}`];
    if (g.Ki) parts.push(`Ti ${plain(g.Ti, n)} s`);
    if (g.Kd) parts.push(`Td ${plain(g.Kd / g.Kp, n)} s`, `Tf ${plain(C.Tf, n)} s`);
    return parts.join(", ");
  }

  function matlab(C) {
    const {b, a} = Loop.difference(C, Ts);
    return `C = tf([${b.map((x) => x.toPrecision(15)).join(", ")}], [${a.map((x) => x.toPrecision(15)).join(", ")}], ${Ts});`;
  }

  function program(C) {
    if (!texts.c || state.kind !== "PI") return null;
    const g = Loop.gains(C);
    const values = {KP: g.Kp, TI: g.Ti, GAIN: g.Kp * (1 + Ts / (2 * g.Ti)), STEP: g.Kp * Ts / g.Ti, TRACKING: Ts / Math.max(g.Ti, Ts)};
    return texts.c.replace(/@(\w+)@/g, (_, name) => { const v = values[name].toPrecision(17); return /[.e]/.test(v) ? v : `${v}.0`; });
  }

  const command = () => `${texts.command} --crossover ${plain(state.crossover)} --phase-margin ${plain(state.margin)} --delay ${plain(state.delay * Ts)}`;
  const copies = {
    gains: () => gainText(now.C), equation: () => equation(now.C), matlab: () => matlab(now.C),
    c: () => program(now.C), command,
  };

  const SPEEDS = [["slow", 1 / 1.5], ["medium", 1], ["fast", 1.5]];

  /* A table's row: its name, a number, what is said of it; or a number for each label. */
  function row([name, ...cells], labels) {
    const made = document.createElement("tr"), head = document.createElement("th");
    head.scope = "row";
    head.textContent = name;
    made.append(head, ...cells.map((content, i) => {
      const cell = document.createElement("td");
      cell.className = i && !labels ? "words" : "number";
      if (labels) cell.dataset.label = labels[i];
      cell.textContent = content;
      return cell;
    }));
    return made;
  }

  const COLUMNS = [...find("speeds").parentElement.querySelectorAll("thead th")].slice(1).map((cell) => cell.textContent);
  const overshoot = (step) => Math.max(0, ...step) - 1;

  function speedRow({name, crossover, it}) {
    const values = !it ? ["none"] : !it.stable ? [gainText(it.C, 4), "unstable"] : [
      gainText(it.C, 4), `${fixed(it.found.phaseMargin, 1)}°`, fixed(it.found.modulusMargin, 2), `${fixed(1e3 * it.found.delayMargin, 0)} ms`,
      it.C.rho && Loop.gains(it.C).Ki ? `${fixed(100 * Math.max(overshoot(it.drawn.step), 0), 0)} %` : "none"];
    const made = row([`${name}, ${fixed(crossover, 2)} Hz`, ...COLUMNS.map((_, i) => values[i] || "")], COLUMNS);
    if (name === "medium") made.className = "current";
    return made;
  }

  function speeds() {
    const within = (f) => f >= range.slowest * 0.999 && f <= range.fastest * 1.001;
    return SPEEDS.map(([name, times]) => {
      const crossover = state.crossover * times, C = within(crossover) ? chosen(crossover) : null;
      return {name, crossover, it: C && evaluated(C)};
    });
  }

  function show() {
    for (const [name, digit] of [["crossover", 2], ["margin", 0]]) find(`${name}-value`).textContent = fixed(state[name], digit);
    find("delay-value").textContent = fixed(1e3 * state.delay * Ts, 4).replace(/\.?0+$/, "");
    controls.crossover.setAttribute("aria-valuetext", `${fixed(state.crossover, 2)} Hz`);
    controls.margin.setAttribute("aria-valuetext", `${fixed(state.margin, 0)} degrees`);
    controls.delay.setAttribute("aria-valuetext", `${fixed(1e3 * state.delay * Ts, 1)} milliseconds`);
    const C = chosen();
    section.classList.toggle("none", C === null);
    find("reset").disabled = untouched();
    document.documentElement.classList.toggle("moved", !untouched());
    const message = find("message");
    if (C === null) {
      message.textContent = `No ${state.kind} reaches this: the plant lags too little at ${fixed(state.crossover, 2)} Hz. Ask for a faster loop or for more phase margin.`;
      now = null;
      return;
    }
    const three = speeds();
    now = evaluated(C);
    const {found, spread} = now;
    message.textContent = !now.stable ? "The loop is unstable."
      : C.limited ? `A ${state.kind} cannot supply the phase here: phase margin is given up.` : "";
    find("gains").textContent = gainText(C);
    find("equation").textContent = equation(C);
    const rows = [
      ["Phase margin", `${fixed(found.phaseMargin, 1)}°`, interval("phase", found.phaseMargin, spread[0], factors[0], 2)],
      ["Crossover", `${fixed(found.crossover, 2)} Hz`, interval("crossover", found.crossover, spread[1], factors[1], 3)],
      ["Gain margin", `${fixed(found.gainMargin, 1)} dB`, ""],
      ["Modulus margin", fixed(found.modulusMargin, 2), ""],
      ["Largest sensitivity", fixed(1 / found.modulusMargin, 2), ""],
      ["Delay margin", `${fixed(1e3 * found.delayMargin, 0)} ms`, ""],
    ];
    find("margins").replaceChildren(...rows.map((cells) => row(cells)));
    find("speeds").replaceChildren(...three.map(speedRow));
    sides = [["slower", three[0]], ["faster", three[2]]].map(([name, {crossover, it}]) => [name, it ? crossover : NaN]);
    find("copy-c").hidden = program(C) === null;
    draw([three[0].it, three[2].it]);
  }

  /* Wiring */
  controls.crossover.min = Math.log(range.slowest);
  controls.crossover.max = Math.log(range.fastest);
  controls.delay.max = start.delay + range.delay;

  function place() {
    controls.crossover.value = Math.log(state.crossover);
    controls.margin.value = state.margin;
    controls.delay.value = state.delay;
    section.querySelectorAll("input[name=kind]").forEach((input) => { input.checked = input.value === state.kind; });
  }

  controls.crossover.addEventListener("input", () => { state.crossover = Number(Math.exp(controls.crossover.value).toPrecision(4)); show(); });
  controls.margin.addEventListener("input", () => { state.margin = Number(controls.margin.value); show(); });
  controls.delay.addEventListener("input", () => { state.delay = Number(controls.delay.value); show(); });
  section.querySelectorAll("input[name=kind]").forEach((input) => input.addEventListener("change", () => { state.kind = input.value; show(); }));
  find("reset").addEventListener("click", () => { state = {...fresh}; place(); show(); });

  section.querySelectorAll("[data-copy]").forEach((button) => button.addEventListener("click", async () => {
    const text = copies[button.dataset.copy](), said = find("copied");
    try {
      await navigator.clipboard.writeText(text);
      said.textContent = `Copied: ${button.textContent.toLowerCase()}.`;
    } catch {  // a page opened from a file may not be allowed to
      const area = find("text");
      area.hidden = false;
      area.value = text;
      area.select();
      said.textContent = "Copy the selected text.";
    }
  }));

  const PAPER = 310;  // half of a printed page, in CSS pixels
  function sized(widthOf) {
    charts.forEach(({plot, host, height}) => plot.setSize({width: widthOf(host), height}));
    queueMicrotask(() => plots.nyquist.setData(plots.nyquist.data));  // its circles stay round
  }
  const resized = () => sized((host) => host.clientWidth);
  addEventListener("beforeprint", () => sized(() => PAPER));
  addEventListener("afterprint", resized);
  new ResizeObserver(resized).observe(section);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => charts.forEach(({plot}) => plot.redraw()));
  document.documentElement.classList.add("script");
  place();
  resized();
  show();
  section.loop = {Loop, model};
})();
