"use strict";
// The page of `yawrate app`: fields are named as the options of `yawrate tune`; nothing is computed.

const LARGEST = 100e6; // bytes; the server refuses more, too
const ROLES = ["time", "input", "output", "speed", "reference"];
const UNITED = ["time", "input", "output", "speed"];
const UNITS = {
  time: ["s", "ms", "us", "ns", "min"],
  input: ["rad", "deg"],
  output: ["rad/s", "deg/s"],
  speed: ["m/s", "km/h", "mph"],
};
const EXPORTS = { report: "Report (HTML)", json: "Answer (JSON)", c: "Controller in C (ZIP)", matlab: "Controller in MATLAB", st: "Controller in structured text" };
const VERDICTS = { usable: "usable", usable_with_care: "usable with care", refuse: "refused" };
const find = (name, inside = document) => inside.querySelector(name);
const logs = [];
let tuners = [];

async function ask(address, options = {}) {
  let response;
  try {
    response = await fetch(address, options);
  } catch {
    return { error: "The command has ended, or it refused the file: see its terminal." };
  }
  return response.status === 204 ? {} : response.json();
}

function post(address, form) {
  return ask(address, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(form) });
}

function made(tag, attributes = {}, text = "") {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.textContent = text;
  return element;
}

function tell(element, words) {
  element.textContent = words || "";
  element.hidden = !words;
}

// ---- logs

async function add(file) {
  if (file.size > LARGEST) {
    tell(find("#failure"), `${file.name}: The log is above 100 MB: use \`yawrate tune\`, or a part of it.`);
    return;
  }
  tell(find("#failure"), "");
  const log = new Log(file.name);
  const told = await ask(`logs?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
  log.number = told.number;
  if (told.number === undefined) {
    log.remove();
    tell(find("#failure"), `${file.name}: ${told.error}`);
  } else log.show(told);
}

class Log {
  constructor(name) {
    this.name = name;
    this.form = {};
    this.asked = this.tuned = 0; // numbers of the last requests: answers to earlier ones are late
    this.reading = this.tuning = false;
    this.plots = [];
    this.panel = find("#log").content.cloneNode(true).firstElementChild;
    this.tab = made("button", { type: "button", role: "tab" }, name);
    tell(this.part("name"), name);
    this.busy({ reading: true });
    find("#logs").append(this.panel);
    find("#tabs").append(this.tab);
    logs.push(this);
    this.tab.addEventListener("click", () => choose(this));
    this.part("remove").addEventListener("click", () => this.remove());
    this.part("form").addEventListener("change", () => this.changed());
    this.part("form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.tune();
    });
    this.part("whole").addEventListener("click", () => this.stretch("", ""));
    offer(this.part("tuners"));
    choose(this);
  }

  part(name) {
    return find(`[data-${name}]`, this.panel);
  }

  busy(changes) {
    Object.assign(this, changes);
    this.part("busy").textContent = this.tuning ? "Tuning…" : this.reading ? "Reading…" : "";
    find("button.main", this.panel).disabled = this.tuning;
  }

  remove() {
    logs.splice(logs.indexOf(this), 1);
    this.plots.forEach((plot) => plot.destroy());
    this.panel.remove();
    this.tab.remove();
    if (this.number !== undefined) ask(`logs/${this.number}`, { method: "DELETE" });
    overview();
    choose(logs[logs.length - 1]);
  }

  fields() {
    const form = {};
    for (const field of this.part("form").elements) {
      if (!field.name) continue;
      form[field.name] = field.type === "checkbox" ? field.checked : field.value;
    }
    return form;
  }

  async changed() {
    const asked = ++this.asked;
    this.part("answer").classList.add("stale");
    this.busy({ reading: true });
    const told = await post(`logs/${this.number}`, this.fields());
    if (asked === this.asked) this.show(told);
  }

  show(told) {
    this.busy({ reading: false });
    tell(this.part("error"), told.error);
    tell(this.part("command"), told.command);
    this.part("same").hidden = !told.command;
    this.part("form").hidden = !told.columns || told.columns.length === 0;
    if (told.columns) this.roles(told.columns, told.roles || []);
    this.part("notes").replaceChildren(...(told.notes || []).map((note) => made("li", {}, note)));
    if (told.tuner) find("option", this.part("tuners")).textContent = `by default (${told.tuner})`;
    if (told.stretch) this.used = told.stretch;
    for (const [name, i] of [["from", 0], ["to", 1]])
      find(`[name=${name}]`, this.panel).placeholder = told.stretch ? seconds(told.stretch[i]) : "";
    if (told.loop) {
      const filled = [...this.part("loop").elements].some((field) => field.value);
      this.part("loop").hidden = Object.keys(told.loop).length === 0 && !filled;
      for (const [name, value] of Object.entries(told.loop)) find(`[name=${name}]`, this.panel).placeholder = number(value);
    }
    if (told.plot) this.draw(told.plot);
  }

  roles(columns, roles) {
    const body = this.part("roles");
    if (!body.children.length)
      for (const role of ROLES) body.append(row(role, columns, roles.find((r) => r.role === role)));
    for (const role of ROLES) {
      const known = roles.find((r) => r.role === role);
      const column = find(`[name=${role}-column]`, body);
      column.options[0].textContent = known && known.column && !column.value ? known.column : roles.length ? "none" : "by its name";
      const unit = find(`[name=${role}-unit]`, body);
      if (unit) unit.placeholder = known ? known.unit : "";
      const value = find("[name=speed]", body);
      if (role === "speed") value.hidden = Boolean(column.value || (known && known.column));
    }
  }

  stretch(from, to) {
    find("[name=from]", this.panel).value = from;
    find("[name=to]", this.panel).value = to;
    this.changed();
  }

  draw(plot) {
    this.plots.forEach((old) => old.destroy());
    const place = this.part("plots");
    place.replaceChildren();
    this.drawn = plot;
    if (this.panel.hidden) return; // it has no width then
    this.plots = ["input", "output"].map((signal, i) => {
      place.append(made("h3", {}, plot.labels[i]));
      return chart(place, plot.time, plot[signal], signal, this);
    });
  }

  async tune() {
    const tuned = ++this.tuned;
    const asked = this.asked;
    this.busy({ tuning: true });
    const told = await post(`logs/${this.number}/answer`, this.fields());
    this.busy({ tuning: false });
    tell(this.part("error"), told.error);
    this.part("answer").hidden = Boolean(told.error);
    this.answer = told.answer;
    overview();
    if (told.error) return;
    this.part("answer").classList.toggle("stale", asked !== this.asked);
    this.part("report").src = `logs/${this.number}/report?${tuned}`;
    this.part("exports").replaceChildren(
      ...told.exports.map((target) => made("a", { class: "button", href: `logs/${this.number}/files/${target}`, download: "" }, EXPORTS[target])),
    );
    this.part("answer").scrollIntoView();
  }
}

function row(role, columns, known) {
  const line = made("tr");
  line.append(made("th", { scope: "row" }, known && known.words !== role && role !== "speed" ? `${role} (${known.words})` : role));
  const cell = made("td");
  const column = made("select", { name: `${role}-column`, "aria-label": `Column of the ${role}` });
  column.append(made("option", { value: "" }), ...columns.map((name) => made("option", { value: name }, name)));
  cell.append(column);
  if (role === "speed") cell.append(made("input", { name: "speed", inputmode: "decimal", "aria-label": "Speed as a number", placeholder: "or a constant speed" }));
  const unit = made("td");
  if (UNITED.includes(role))
    unit.append(made("input", { name: `${role}-unit`, list: `units-${role}`, "aria-label": `Unit of the ${role}` }));
  line.append(cell, unit);
  return line;
}

function chart(place, time, values, signal, log) {
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const axis = { size: 30, font: "12px system-ui, sans-serif", stroke: () => colour("--muted"), grid: { stroke: () => colour("--line"), width: 1 }, ticks: { show: false } };
  return new uPlot(
    {
      width: place.clientWidth,
      height: 150,
      legend: { show: false },
      scales: { x: { time: false } },
      cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false } },
      axes: [axis, { ...axis, size: 56 }],
      series: [{}, { stroke: () => colour(`--${signal}`), width: 1, points: { show: false } }],
      hooks: {
        drawClear: [
          (u) => {
            if (!log.used) return;
            const [left, right] = log.used.map((t) => u.valToPos(t, "x", true));
            u.ctx.fillStyle = colour("--band");
            u.ctx.fillRect(left, u.bbox.top, right - left, u.bbox.height);
          },
        ],
        setSelect: [
          (u) => {
            const { left, width } = u.select;
            if (width < 3) return;
            const [from, to] = [left, left + width].map((x) => seconds(u.posToVal(x, "x")));
            log.stretch(from, to);
          },
        ],
      },
    },
    [time, values],
    place,
  );
}

// ---- the page around them

function choose(chosen) {
  find("#tabs").hidden = logs.length < 2;
  for (const log of logs) {
    log.panel.hidden = log !== chosen;
    log.tab.setAttribute("aria-selected", log === chosen);
  }
  if (chosen && chosen.drawn) chosen.draw(chosen.drawn);
}

function overview() {
  const answered = logs.filter((log) => log.answer);
  find("#overview").hidden = answered.length < 2;
  find("#overview tbody").replaceChildren(
    ...answered.map(({ name, answer }) => {
      const line = made("tr");
      const gains = Object.entries(answer.gains);
      const metrics = Object.entries(answer.metrics);
      const one = ([key, value]) => `${key.replaceAll("_", " ")} ${number(value)} ${answer.units[key] || ""}`.trim();
      const listed = (pairs) => pairs.map(one).join(", ");
      line.append(
        made("td", {}, name),
        made("td", {}, VERDICTS[answer.verdict]),
        made("td", {}, listed(gains)),
        made("td", {}, listed(metrics.map(([key, metric]) => [key, metric.value]))),
      );
      return line;
    }),
  );
}

function seconds(time) {
  return String(Number(time.toFixed(4))); // as a number of seconds since 1970 it has 14 digits
}

function number(value) {
  return value === null ? "none" : String(Number(value.toPrecision(4)));
}

function offer(select) {
  for (const name of tuners) select.append(made("option", { value: name }, name));
}

async function take(files) {
  for (const file of files) await add(file);
}

const drop = find("#drop");
find("#files").addEventListener("change", (event) => {
  take([...event.target.files]);
  event.target.value = "";
});
for (const name of ["dragenter", "dragover", "dragleave", "drop"])
  window.addEventListener(name, (event) => {
    event.preventDefault();
    drop.classList.toggle("over", name === "dragenter" || name === "dragover");
    if (name === "drop") take([...event.dataTransfer.files]);
  });
function redraw() {
  for (const log of logs) if (log.drawn) log.draw(log.drawn);
}
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
let wide = window.innerWidth;
window.addEventListener("resize", () => {
  if (window.innerWidth !== wide) redraw(); // a phone's bars come and go as one scrolls
  wide = window.innerWidth;
});
for (const [role, units] of Object.entries(UNITS)) {
  const list = made("datalist", { id: `units-${role}` });
  list.append(...units.map((unit) => made("option", { value: unit })));
  document.body.append(list);
}
ask("choices").then((told) => {
  tuners = told.tuners || [];
  logs.forEach((log) => offer(log.part("tuners")));
});
