/* The report's sliders, charts and copy buttons; the numbers come from loop.js. */
"use strict";

(() => {
  const model = JSON.parse(document.getElementById("model").textContent);
  const section = document.getElementById("live"), find = (name) => section.querySelector(`[data-${name}]`);
  const {start, Ts, names, texts, pace} = model, {equation, fixed, gainText, matlab, plain, program} = Texts(model);
  const sliders = Object.fromEntries(model.sliders.map((one) => [one.name, {...one, input: section.querySelector(`#${one.name}`)}]));
  const fresh = {kind: start.kind, b: null};  // b is the rule's own until it is moved
  for (const name of Object.keys(sliders)) fresh[name] = name === "b" ? null : start[name];
  let state = {...fresh};

  const untouched = () => Object.keys(fresh).every((name) => state[name] === fresh[name]);
  /* A slider's value as text. */
  function told({name, values, factor = 1}, value) {
    const shown = values ? values[value] : factor * (value ?? now?.C.gains.b ?? 1);
    return name === "margin" ? fixed(shown, 0) : plain(shown, 3);
  }
  const withUnit = (slider, value) => `${told(slider, value)}${slider.unit === "°" ? "" : " "}${slider.unit}`.trim();

  /* The answer where nothing was moved, else the rule around the model behind it. */
  function chosen(position = state) {
    const own = model.kinds[position.kind];
    const C = untouched() && position === state ? Loop.controller(own, start.gains, Ts) : Loop.design(model, position);
    return C && {...C, kind: position.kind};
  }

  /* Samples that four periods of a loop's crossover take. */
  function horizon(C) {
    const {crossover} = Loop.margins(model, C, state.delay);
    const period = 1 / (Number.isFinite(crossover) ? crossover : model.crossover);
    return Math.min(model.pulse.length, Math.max(Math.round(4 * period / Ts) + 1, 50));
  }

  function evaluated(C, samples) {
    const found = Loop.margins(model, C, state.delay);
    const drawn = Loop.responses(model, C, state.delay, samples);
    return {C, found, drawn, stable: Loop.stable(model, C, found, drawn), spread: Loop.spread(model, C, state.delay, found)};
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
    return chart(name, 230, {
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

  let sides = ["", ""];  // what is said of the loops beside the chosen one
  const side = (i) => () => sides[i];

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

  /* Samples after which both responses stay within 2 % of their ends, and half as many again. */
  function shownUntil({step, disturbance}) {
    const settled = [step, disturbance].map((values) => {
      const end = values[values.length - 1], size = values.reduce((most, v) => Math.max(most, Math.abs(v)), 0);
      return Number.isFinite(end) ? values.findLastIndex((v) => Math.abs(v - end) > 0.02 * size) : step.length;
    });
    return Math.min(step.length, Math.max(Math.round(1.5 * Math.max(...settled)), Math.round(step.length / 4)));
  }

  function draw(others) {
    const values = Loop.overOmega(model, now.C, state.delay), grid = Loop.bode(values);
    const known = hertz.map((f) => Loop.deviations(model, f));
    for (const [name, part, unit, factor] of [["magnitude", 0, 20 / Math.LN10, factors[1]], ["phase", 1, 180 / Math.PI, factors[0]]]) {
      const line = grid[part].map((v) => v * unit);
      plots[name].setData([hertz, line, ...edges(line, known.map((d) => factor * d[part] * unit))]);
    }
    const points = values.filter(([re, im]) => Math.hypot(re, im) < 20);
    plots.nyquist.setData([null, [points.map((p) => p[0]), points.map((p) => p[1])], circle(0, 0, 1),
      circle(-1, 0, now.found.modulusMargin), circle(-1, 0, 0.01)]);
    const time = Array.from({length: shownUntil(now.drawn)}, (_, k) => k * Ts);
    const shown = (values) => time.map((_, k) => (Number.isFinite(values[k]) ? values[k] : null));
    const half = now.stable ? Loop.halfWidths(model, now.C, state.delay, time.length) : null;
    for (const name of ["step", "disturbance"]) {
      const values = shown(now.drawn[name]);
      plots[name].setData([time, values, ...others.map((o) => shown(o ? o.drawn[name] : [])), ...edges(values, half && half[name])]);
    }
  }

  /* Text */
  function interval(metric, value, spread, factor, n) {
    const half = factor * spread, own = untouched() ? start.intervals[metric] : undefined;
    const ends = own || (!untouched() && Number.isFinite(half) ? [value - half, value + half] : null);
    if (ends) return `${fixed(ends[0], n)} to ${fixed(ends[1], n)}`;
    const silent = untouched() ? own === null : spread !== undefined && model.known;
    return silent ? "the recording does not tell" : "";
  }

  const command = () => (texts.command && state.kind === start.kind
    ? `${texts.command} --crossover ${plain(state.crossover)} --phase-margin ${plain(state.margin)} --delay ${plain(state.delay * Ts)}` : null);
  const copies = {
    gains: () => gainText(now.C), equation: () => equation(now.C), matlab: () => matlab(now.C),
    c: () => program(now.C), command,
  };

  const SPEEDS = [["slow", -1], ["medium", 0], ["fast", 1]];

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

  function speedRow({name, asked, it}) {
    const values = !it ? ["none"] : !it.stable ? [gainText(it.C, 4), "unstable"] : [
      gainText(it.C, 4), `${fixed(it.found.phaseMargin, 1)}°`, fixed(it.found.modulusMargin, 2), seconds(it.found.delayMargin),
      `${fixed(100 * Math.max(overshoot(it.drawn.step), 0), 0)} %`];
    const made = row([`${name}, ${asked}`, ...COLUMNS.map((_, i) => values[i] || "")], COLUMNS);
    if (name === "medium") made.className = "current";
    return made;
  }

  const seconds = (value) => (value < 1 ? `${fixed(1e3 * value, 0)} ms` : `${plain(value, 3)} s`).replace(/^none.*/, "none");

  /* The loop at hand between a slower and a faster one; null beside it where the slider ends. */
  function speeds(samples) {
    if (!pace) return [];
    const slider = sliders[pace.slider], {min, max} = slider, at = state[pace.slider];
    return SPEEDS.map(([name, times]) => {
      const value = pace.factor ? at * pace.factor ** times : at + times * pace.steps;
      const place = slider.log ? Math.log(value) : value, within = place >= min - 1e-3 && place <= max + 1e-3;
      const C = !times ? chosen() : within ? chosen({...state, [pace.slider]: value}) : null;
      return {name, asked: within ? withUnit(slider, value) : "", it: C && evaluated(C, samples)};
    });
  }

  const MARGINS = [
    ["Phase margin", (it) => (Number.isFinite(it.found.phaseMargin) ? `${fixed(it.found.phaseMargin, 1)}°` : "none"), "phase_margin", (it) => [it.found.phaseMargin, it.spread[0], factors[0], 2]],
    ["Crossover", (it) => (Number.isFinite(it.found.crossover) ? `${plain(it.found.crossover, 3)} Hz` : "none"), "crossover", (it) => [it.found.crossover, it.spread[1], factors[1], 3 - Math.min(Math.floor(Math.log10(it.found.crossover)), 0)]],
    ["Gain margin", (it) => (Number.isFinite(it.found.gainMargin) ? `${fixed(it.found.gainMargin, 1)} dB` : "none"), "gain_margin", (it) => [it.found.gainMargin, undefined, NaN, 2]],
    ["Modulus margin", (it) => fixed(it.found.modulusMargin, 2), "modulus_margin", (it) => [it.found.modulusMargin, undefined, NaN, 3]],
    ["Largest sensitivity", (it) => fixed(1 / it.found.modulusMargin, 2), "Ms", (it) => [1 / it.found.modulusMargin, undefined, NaN, 3]],
    ["Delay margin", (it) => seconds(it.found.delayMargin), "delay_margin", (it) => [it.found.delayMargin, undefined, NaN, 3]],
    ["Overshoot", (it) => `${fixed(100 * Math.max(overshoot(it.drawn.step), 0), 0)} %`, "overshoot", () => [0, undefined, NaN, 1]],
    ["Largest command", (it) => `${plain(it.drawn.command.reduce((most, u) => Math.max(most, Math.abs(u)), 0), 3)} ${names.command}`.trim(), "", () => [0, undefined, NaN, 1]],
  ];

  function show() {
    const kind = model.kinds[state.kind], C = chosen();
    for (const slider of Object.values(sliders)) {
      slider.input.closest("label").hidden = !kind.sliders.includes(slider.name);
    }
    section.classList.toggle("none", C === null);
    find("reset").disabled = untouched();
    document.documentElement.classList.toggle("moved", !untouched());
    const message = find("message");
    if (C === null) {
      const slower = kind.law ? "Ask for a faster loop or for more phase margin." : "Move the slider back.";
      message.textContent = `No ${state.kind} reaches this${kind.law ? `: the plant lags too little or too much at ${withUnit(sliders.crossover, state.crossover)}` : ""}. ${slower}`;
      now = null;
      said();
      return;
    }
    const samples = horizon(C), three = speeds(samples);
    now = pace ? three[1].it : evaluated(C, samples);
    said();
    message.textContent = !now.stable ? "The loop is unstable."
      : C.limited ? `A ${state.kind} cannot supply the phase here: phase margin is given up.` : "";
    find("gains").textContent = gainText(C);
    find("equation").textContent = equation(C);
    const rows = MARGINS.map(([name, text, metric, more]) => {
      const [value, spread, factor, digits] = more(now);
      return [name, text(now), metric ? interval(metric, value, spread, factor, digits) : "after the step"];
    });
    find("margins").replaceChildren(...rows.map((cells) => row(cells)));
    find("speeds").replaceChildren(...three.filter(({asked}) => asked).map(speedRow));
    find("speeds").closest("table").hidden = find("paces").hidden = !pace;
    const beside = [three[0], three[2]];
    sides = beside.map((one, i) => (one && one.it ? `${["slower", "faster"][i]}, ${one.asked}` : ""));
    for (const name of ["c", "command"]) section.querySelector(`[data-copy=${name}]`).hidden = copies[name]() === null;
    draw(beside.map((one) => one && one.it));
  }

  /* Values beside the sliders. */
  function said() {
    for (const slider of Object.values(sliders)) {
      find(`${slider.name}-value`).textContent = told(slider, state[slider.name]);
      slider.input.setAttribute("aria-valuetext", withUnit(slider, state[slider.name]));
    }
  }

  /* Wiring */
  const kinds = section.querySelector("#kind");

  function place() {
    kinds.value = state.kind;
    for (const {name, input, log} of Object.values(sliders)) {
      const value = state[name] ?? start.gains.b ?? 1;
      input.value = log ? Math.log(value) : value;
    }
  }

  for (const {name, input, log} of Object.values(sliders)) {
    input.addEventListener("input", () => { state[name] = log ? Number(Math.exp(input.value).toPrecision(4)) : Number(input.value); show(); });
  }
  kinds.addEventListener("change", () => { state.kind = kinds.value; show(); });
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
