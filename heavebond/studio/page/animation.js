// What a run does, shown on the drawing: wires and parts coloured and labelled at an instant that the charts share.

import { byId, el, number, unitLabel } from "./dom.js";

const SVG = "http://www.w3.org/2000/svg";
/** @type {[string, string, string][]} what can be shown, its name, what it tells */
const SHOWN = [["", "nothing", ""], ["effort", "effort", "force, pressure, voltage on the wires"], ["flow", "flow", "velocity, flow rate, current on the wires"], ["power", "power", "power through the wires"],
  ["energy", "energy", "energy that the parts store, and power that they dissipate"], ["modes", "modes", "shape of a mode at the start on the wires (▶ plays it), and shares of the parts in its energy"]];
const SPEEDS = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000];
const LASTING = 10; // s that a whole run takes at the speed that is chosen first
const SEEN = 0.001; // the share of the largest from which on a value is written
const PERIOD = 1.6; // s in which a mode that is played swings once
const ZERO = 1e-9; // the share of a quantity's own largest below which it is rounding
const WIDTH = [1.6, 5]; // of a wire that carries nothing and of the one that carries most
const [RISEN, FALLEN, STORED, LOST, STILL] = ["#c44e00", "#0072b2", "#0072b2", "#c44e00", "#b0bac4"];

export class Animation {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.place = byId("player");
    this.what = "";
    this.phase = 0; // of a mode that is played
    this.clear();
  }

  /** As for a diagram that was just opened, or a run that is gone. */
  clear() {
    this.stop();
    /** @type {any} */ this.data = null; // of the run `of`
    /** @type {any} */ this.of = null;
    /** @type {any[]|null} */ this.modes = null;
    this.mode = this.time = this.speed = this.phase = 0;
    this.restore();
    this.studio.machine.clear();
    this.show();
  }

  /** A run is there, or another one, or none: what is shown follows it. */
  follow() {
    const { live } = this.studio.runs;
    if (this.of === live && this.place.hidden === !live) return;
    if (!live || !this.of) this.show();
    if (!live) { this.stop(); this.restore(); this.of = this.data = null; this.studio.machine.clear(); return; }
    this.time = Math.min(Math.max(this.time, live.time[0]), live.time.at(-1));
    if (!this.of) this.show();
    else if (Number(this.range?.max) !== live.time.at(-1)) { this.speed = 0; this.show(); } // of another duration
    if (live.preview) return; // while a slider moves, the drawing waits
    this.of = live;
    this.data = this.modes = null;
    void this.studio.machine.follow();
    if (this.what) void this.load();
  }

  show() {
    const { runs, machine } = this.studio, live = runs?.live;
    this.place.hidden = !live || this.studio.evidence?.active || this.studio.evidence?.jobs.tuning;
    this.studio.machine?.layout();
    if (!live) { this.place.replaceChildren(); return; }
    const [begin, end] = [live.time[0], live.time.at(-1)];
    this.speed ||= SPEEDS.reduce((best, s) => Math.abs(Math.log((end - begin) / s / LASTING)) < Math.abs(Math.log((end - begin) / best / LASTING)) ? s : best, 1);
    this.play = el("button", { id: "play", "aria-label": "Play", title: "Show the run on the drawing", onclick: () => this.toggle() }, this.frame ? "❚❚" : "▶");
    this.range = /** @type {HTMLInputElement} */ (el("input", { type: "range", id: "instant", min: begin, max: end, step: "any", value: this.time, "aria-label": "instant of the run",
      oninput: () => { this.stop(); this.at(Number(this.range?.value)); },
      onkeydown: (/** @type {KeyboardEvent} */ event) => {
        const step = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 })[event.key];
        if (!step) return;
        event.preventDefault();
        this.stop();
        this.at(Math.min(end, Math.max(begin, this.time + step * (end - begin) / 100)));
      } }));
    this.told = el("output", { for: "instant" });
    this.legend = el("span", { class: "legend" });
    this.place.replaceChildren(this.play, this.range, this.told,
      el("select", { id: "speed", "aria-label": "speed", title: "How fast time passes on the drawing", onchange: (/** @type {any} */ e) => { this.speed = Number(e.target.value); } },
        ...SPEEDS.map((s) => el("option", { value: s, selected: s === this.speed }, s === 1 ? "real time" : `${s} ×`))),
      el("label", {}, "Colour by ", el("select", { id: "shown", onchange: (/** @type {any} */ e) => void this.choose(e.target.value) },
        ...SHOWN.map(([key, name, words]) => el("option", { value: key, selected: key === this.what, title: words }, name)))),
      this.studio.view?.moves ? el("button", { id: "toggle-machine", "aria-pressed": String(machine.on), title: "Show the machine in motion beside its drawing", onclick: (/** @type {any} */ e) => {
        machine.toggle(!machine.on);
        e.target.setAttribute("aria-pressed", String(machine.on));
      } }, "Animation") : "", this.legend);
    this.tell();
  }

  /** @param {string} what */
  async choose(what) {
    this.what = what;
    const select = /** @type {HTMLSelectElement|null} */ (document.getElementById("shown"));
    if (select) select.value = what;
    if (what === "modes") this.stop();
    this.restore();
    await this.load();
  }

  /** Fetch what is shown, once for each run. */
  async load() {
    const { link, runs, document: file } = this.studio, run = this.of;
    if (!this.what || !run) { this.tell(); return; }
    if (this.what === "modes" ? !this.modes : !this.data) this.legend?.replaceChildren("computing…");
    try {
      const given = { name: file.name, text: run.text, values: run.values };
      if (this.what === "modes") { if (!this.modes) { const told = await link.ask("modes", given); if (told.kind === "done" && runs.live === run) { this.modes = told.modes; this.mode = Math.max(0, told.modes.findIndex((/** @type {any} */ m) => m.swings)); } } }
      else if (!this.data) {
        const told = await link.ask("animation", given);
        if (told.kind === "done" && runs.live === run) { this.data = told; this.measure(told); }
      }
    } catch (error) {
      this.studio.edits.refuse(error instanceof Error ? error.message : String(error));
      this.tell();
      return;
    }
    this.draw();
  }

  /** The largest sizes: of effort and flow over each domain and unit, of power, energy and losses over all. @param {any} told */
  measure(told) {
    const { series } = told, unit = (/** @type {string} */ u) => /** @type {Record<string, number>} */ ({ kW: 1e3, MW: 1e6, kJ: 1e3, MJ: 1e6, kN: 1e3, MN: 1e6, bar: 1e5, mm: 1e-3, um: 1e-6, "mm/s": 1e-3, "kN*m": 1e3, "MN*m": 1e6 })[u] ?? 1;
    /** @type {Map<string, number>} */
    this.most = new Map();
    for (const thing of [...Object.values(told.nodes), ...Object.values(told.parts)]) {
      for (const [quantity, found] of Object.entries(thing)) {
        if (quantity === "domain") continue;
        const [row, text] = found, scale = unit(text), key = this.key(quantity, thing.domain, text);
        let size = 0;
        for (const v of series[row]) if (Math.abs(v) > size) size = Math.abs(v);
        found.push(scale, size * ZERO);
        this.most.set(key, Math.max(this.most.get(key) ?? 0, size * scale));
      }
    }
  }

  /** Among what a value is large or small. @param {string} quantity @param {string} domain @param {string} unit */
  key(quantity, domain, unit) { return quantity === "effort" || quantity === "flow" ? `${quantity} ${domain}${domain === "signal" ? unit : ""}` : quantity; }

  // -- time ----------------------------------------------------------------------------------------------------------
  toggle() {
    if (this.frame) { this.stop(); return; }
    if (!this.studio.machine.on && !this.what) void this.choose("flow");
    if (this.what === "modes") { this.swing(); return; }
    const end = this.of?.time.at(-1) ?? 0;
    if (this.time >= end) this.time = this.of?.time[0] ?? 0;
    let last = performance.now();
    const step = (/** @type {number} */ now) => {
      const passed = Math.min(0.2, (now - last) / 1000) * (this.speed ?? 1);
      last = now;
      this.at(Math.min(end, this.time + passed));
      if (this.time >= end) this.stop();
      else this.frame = requestAnimationFrame(step);
    };
    this.frame = requestAnimationFrame(step);
    if (this.play) { this.play.textContent = "❚❚"; this.play.setAttribute("aria-label", "Pause"); }
  }

  /** Play the shape of the mode, each period in the same time. */
  swing() {
    const begun = performance.now();
    const step = (/** @type {number} */ now) => {
      this.phase = 2 * Math.PI * (now - begun) / 1000 / PERIOD;
      this.drawMode();
      this.frame = requestAnimationFrame(step);
    };
    this.frame = requestAnimationFrame(step);
    if (this.play) { this.play.textContent = "❚❚"; this.play.setAttribute("aria-label", "Pause"); }
  }

  stop() {
    cancelAnimationFrame(this.frame ?? 0);
    this.frame = 0;
    if (this.play) { this.play.textContent = "▶"; this.play.setAttribute("aria-label", "Play"); }
  }

  /** Show an instant, on the drawing and in the charts. @param {number} time @param {boolean} [charts] */
  at(time, charts = true) {
    this.time = time;
    if (this.range) this.range.value = String(time);
    if (charts) this.studio.runs.plots.pointAt(time);
    this.tell();
    this.draw();
    this.studio.machine.at(time);
  }

  /** The pointer is over a chart: the drawing shows that instant. @param {number} time */
  pointed(time) { if (this.of && !this.frame && !this.place.hidden) this.at(time, false); }

  tell() {
    if (this.told) this.told.textContent = `${number(this.time, 4)} s`;
    this.studio.panel?.values();
  }

  // -- drawing -------------------------------------------------------------------------------------------------------
  /** The drawing as it is without. */
  restore() {
    const sheet = byId("sheet");
    for (const wire of sheet.querySelectorAll("path.wire")) { /** @type {any} */ (wire).style.stroke = /** @type {any} */ (wire).style.strokeWidth = ""; }
    for (const frame of sheet.querySelectorAll(".heat")) frame.remove();
    for (const label of sheet.querySelectorAll(".worth")) label.remove();
    if (this.legend) this.legend.replaceChildren();
  }

  /** As the instant is, on the drawing that is there. */
  draw() {
    if (!this.what) return;
    if (this.what === "modes") { if (this.modes) this.drawMode(); }
    else if (this.data) this.drawInstant();
    this.tellScale();
  }

  drawInstant() {
    const { series, nodes, parts } = this.data, time = series[0], sheet = byId("sheet");
    let k = 0, high = time.length - 1;
    while (k < high) { const middle = (k + high + 1) >> 1; if (time[middle] <= this.time) k = middle; else high = middle - 1; }
    if (this.what === "energy") {
      const share = (/** @type {any} */ found, /** @type {string} */ key) => found ? Math.abs(series[found[0]][k]) * found[2] / (this.most?.get(key) || 1) : 0;
      for (const group of sheet.querySelectorAll("g.part[data-part]")) {
        const part = parts[group.getAttribute("data-part") ?? ""];
        this.heat(group, share(part?.energy, "energy"), share(part?.loss, "loss"));
      }
      for (const label of sheet.querySelectorAll("g[data-part] > text.part")) {
        const part = parts[label.parentElement?.getAttribute("data-part") ?? ""];
        const words = ["energy", "loss"].filter((q) => share(part?.[q], q) > SEEN).map((q) => this.worth(part[q], k));
        this.label(label, words.join(", "));
      }
      return;
    }
    for (const wire of sheet.querySelectorAll("path.wire[data-node]")) {
      const node = nodes[wire.getAttribute("data-node") ?? ""], found = node?.[this.what], style = /** @type {any} */ (wire).style;
      if (!found) { style.stroke = STILL; style.strokeWidth = "1"; continue; }
      const value = series[found[0]][k] * found[2], share = Math.min(1, Math.abs(value) / (this.most?.get(this.key(this.what, node.domain, found[1])) || 1));
      style.stroke = `color-mix(in srgb, ${value < 0 ? FALLEN : RISEN} ${Math.round(100 * Math.sqrt(share))}%, ${STILL})`;
      style.strokeWidth = String(WIDTH[0] + (WIDTH[1] - WIDTH[0]) * share);
    }
    for (const label of sheet.querySelectorAll("text.node")) {
      const found = nodes[nameOf(label)]?.[this.what];
      this.label(label, found ? this.worth(found, k) : "");
    }
  }

  drawMode() {
    const mode = this.modes?.[this.mode ?? 0], sheet = byId("sheet");
    if (!mode) return;
    for (const wire of sheet.querySelectorAll("path.wire[data-node]")) {
      const [real, imaginary] = mode.shape[wire.getAttribute("data-node") ?? ""] ?? [0, 0], style = /** @type {any} */ (wire).style;
      const value = mode.swings ? real * Math.cos(this.phase) - imaginary * Math.sin(this.phase) : real;
      style.stroke = `color-mix(in srgb, ${value < 0 ? FALLEN : RISEN} ${Math.round(100 * Math.sqrt(Math.abs(value)))}%, ${STILL})`;
      style.strokeWidth = String(WIDTH[0] + (WIDTH[1] - WIDTH[0]) * Math.abs(value));
    }
    for (const group of sheet.querySelectorAll("g.part[data-part]")) this.heat(group, mode.energy[group.getAttribute("data-part") ?? ""] ?? 0, 0);
    for (const label of sheet.querySelectorAll("g[data-part] > text.part")) {
      const share = mode.energy[label.parentElement?.getAttribute("data-part") ?? ""] ?? 0;
      this.label(label, share >= SEEN ? `${number(100 * share, 3)} %` : "");
    }
    this.tellScale();
  }

  /** A part filled by what it stores, and bordered by what it loses. @param {Element} group @param {number} stored @param {number} lost */
  heat(group, stored, lost) {
    let found = /** @type {any} */ (group.querySelector(":scope > .heat"));
    if (!found) {
      const frame = group.querySelector(":scope > .frame");
      if (!frame) return;
      found = frame.cloneNode();
      found.setAttribute("class", "heat");
      group.append(found);
    }
    found.style.fill = STORED;
    found.style.fillOpacity = String(0.55 * Math.sqrt(Math.min(1, stored)));
    found.style.stroke = LOST;
    found.style.strokeWidth = String(6 * Math.sqrt(Math.min(1, lost)));
    found.style.strokeOpacity = lost > 1e-4 ? "0.85" : "0";
  }

  /** A quantity at an instant with its unit. @param {any} found @param {number} k */
  worth([row, unit, , zero], k) {
    const value = this.data.series[row][k];
    return `${short(Math.abs(value) <= zero ? 0 : value)}${unit ? ` ${unitLabel(unit)}` : ""}`;
  }

  /** A value behind a name on the drawing. @param {Element} text @param {string} words */
  label(text, words) {
    let found = text.querySelector(".worth");
    if (!found && !words) return;
    if (!found) {
      found = document.createElementNS(SVG, "tspan");
      found.setAttribute("class", "worth");
      found.setAttribute("dx", "4");
      text.append(found);
    }
    if (found.textContent !== words) found.textContent = words;
  }

  /** What the colours mean. */
  tellScale() {
    if (!this.legend) return;
    if (this.what === "modes" && this.modes) {
      if (this.legend.querySelector("#mode")) return;
      const words = (/** @type {any} */ m) => m.swings ? `${number(m.frequency, 4)} Hz, damping ratio ${number(m.damping, 3)}` : m.frequency ? `${m.damping < 0 ? "grows, " : ""}time constant ${number(1 / (2 * Math.PI * m.frequency), 3)} s` : "eigenvalue 0, free motion";
      this.legend.replaceChildren(this.modes.length ? el("select", { id: "mode", "aria-label": "mode", onchange: (/** @type {any} */ e) => { this.mode = Number(e.target.value); this.draw(); } },
        ...this.modes.map((/** @type {any} */ m, /** @type {number} */ k) => el("option", { value: k, selected: k === this.mode }, words(m)))) : "no modes", ` at the start${this.modes[0]?.held?.length ? `; held constant: ${this.modes[0].held.join(", ")}` : ""}`);
      return;
    }
    const key = `${this.what} ${Boolean(this.data)}`;
    if (this.legend.dataset.key === key && this.legend.childNodes.length) return;
    this.legend.dataset.key = key;
    const mark = (/** @type {string} */ kind) => el("span", { class: `key ${kind}`, "aria-hidden": "true" });
    this.legend.replaceChildren(...(!this.data || !this.what || this.what === "modes" ? [] : this.what === "energy" ? [mark("stored"), "stored energy", mark("lost"), "dissipated power"]
      : this.what === "power" ? [mark("risen"), "wider: more power"] : [mark("risen"), "positive", mark("fallen"), "negative; wider: more"]));
  }
}

/** What a caption says without the value behind it. @param {Element} text */
function nameOf(text) { return text.firstChild?.nodeType === Node.TEXT_NODE ? text.firstChild.textContent ?? "" : ""; }

/** Three digits. @param {number} value */
function short(value) { return value === 0 ? "0" : Math.abs(value) >= 1000 || Math.abs(value) < 1e-3 ? number(value, 3) : value.toPrecision(3); }
