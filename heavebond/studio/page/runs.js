// Runs: the values of the sliders, the newest run, those that are kept, and the signals that are plotted.

import { askName, byId, el, unitLabel } from "./dom.js";
import { EventLog } from "./events.js";
import { DASHES, Plots } from "./plots.js";
import { problemList, problemsOf } from "./results.js";

const SOON = 20; // s of all kept runs up to which they are computed when the diagram is opened again
const QUICK = 2000; // ms of a run up to which sliders are made ready behind it; slower ones cannot follow the mouse

export class Runs {
  /** @type {Record<string, string>} */ values = {}; // of the sliders
  /** @type {string[]} */ plotted = [];
  /** @type {any} */ live = null;
  /** @type {any[]} */ kept = [];
  resume = false; // whether the restoring of kept runs gave way to a run
  /** @type {string|null} */ failed = null; // text of a run that failed, whose problems are shown
  /** @type {any[]} */ stored = []; // kept when the diagram was open before, not computed yet
  /** @type {any[]} */ failing = []; // of these, those that could not be computed: they are tried again when the diagram is opened
  /** @type {Set<string>} */ forgotten = new Set(); // keys of runs that are no longer kept, which another tab may still have
  /** @type {any} */ dirty = null; // the document whose layout is to be stored
  storing = false;

  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.plots = new Plots();
    this.log = new EventLog(studio);
    this.plots.onmarks = (chart) => this.log.draw(chart);
    this.plots.onchoice = () => this.remember();
    this.plots.ondrop = (name, base) => this.dropped(name, base);
    this.plots.onspectrum = (run, name) => void this.spectrum(run, name);
    this.busy = this.begun = this.serial = 0;
    this.clear();
  }

  /** As for a diagram that was just opened. */
  clear() {
    Object.assign(this, { values: {}, plotted: [], live: null, kept: [], stored: [], failing: [], recalled: false, restoring: false, resume: false });
    this.serial = 0;
    this.log.clear();
    this.invite();
    this.showRuns();
  }

  /** What to do where there is no run. */
  invite() {
    this.failed = null;
    this.plots.empty("Press Run (Ctrl+Enter) to simulate. Then click parts and wires to find signals to plot, and move the sliders of parameters.");
  }

  /** The text has been checked: the problems of a run of an earlier text are no longer those of the diagram. @param {string} text */
  checked(text) { if (this.failed !== null && this.failed !== text && !this.live && !this.busy) { this.invite(); this.studio.say(""); } }

  /** @param {string} path @param {string|undefined} value */
  setValue(path, value) {
    const values = { ...this.values };
    if (value === undefined) delete values[path];
    else values[path] = value;
    this.setValues(values);
  }

  /** @param {Record<string, string>} values */
  setValues(values) {
    this.values = values;
    this.studio.panel.show();
    if (this.studio.evidence.active) void this.studio.evidence.follow();
    else if (this.live) void this.run();
    this.studio.evidence.jobs.again();
  }

  /** The values of the sliders into the text, one step for undo. */
  async writeValues() {
    const before = this.studio.editor.text, values = this.values;
    try {
      const told = await this.studio.link.ask("write", { text: before, values });
      if (this.studio.editor.text !== before) return; // typed meanwhile
      this.studio.editor.replace(told.text);
      this.values = {};
      this.studio.panel.show();
      this.studio.say("written into the text, not saved yet");
    } catch (error) {
      this.studio.banner([error instanceof Error ? error.message : String(error)]);
    }
  }

  /** Begin to build what sliders run with. */
  prepare() {
    const text = this.studio.editor.text;
    if (this.prepared === text || this.studio.evidence.active) return Promise.resolve();
    this.prepared = text;
    return this.studio.link.ask("prepare", this.question({})).then(() => undefined, () => { this.prepared = undefined; });
  }

  /** While a slider moves: one run at a time, and always of the newest value. @param {string} path @param {string} value */
  slide(path, value) {
    this.values = { ...this.values, [path]: value };
    if (this.studio.evidence.active) { void this.studio.evidence.follow(); return; }
    this.waitingPreview = true;
    if (!this.previewing) void this.preview();
  }

  async preview() {
    this.previewing = true;
    /** @type {number[]} */
    const done = [];
    const name = this.studio.document?.name;
    while (this.waitingPreview && this.studio.document?.name === name) {
      this.waitingPreview = false;
      const values = this.values, asked = performance.now(), begun = this.begun;
      try {
        const told = await this.studio.link.ask("preview", this.question(values));
        if (this.studio.document?.name !== name) break; // the page shows another diagram by now
        if (told.kind === "done" && !this.busy && begun === this.begun) { // a run that was asked for later is exact
          this.live = this.made(told, values);
          this.live.preview = true;
          this.showPlots();
        }
      } catch (error) {
        this.studio.say(error instanceof Error ? error.message.split("\n")[0] : "");
        break;
      }
      done.push(performance.now());
      if (done.length > 11) done.shift();
      if (done.length > 2) this.studio.say(`${((done.length - 1) / (done[done.length - 1] - done[0]) * 1000).toFixed(0)} runs a second`);
      this.lag = performance.now() - asked;
    }
    this.previewing = false;
  }

  /** @param {Record<string, string>} values */
  question(values) { return { name: this.studio.document.name, text: this.studio.editor.text, values, names: this.plotted }; }

  /** @param {any} told @param {Record<string, string>} values */
  made(told, values) {
    const [time, ...columns] = told.series;
    return { id: "live", live: true, label: this.kept.length ? "now" : "", dash: 0, visible: true, time, told, values, text: this.studio.editor.text,
      units: { ...told.units }, readable: { ...told.readable }, series: new Map(told.signals.map((/** @type {string} */ n, /** @type {number} */ k) => [n, columns[k]])) };
  }

  /** Runs with several values of a parameter, kept and laid over each other; Stop ends them. @param {string} path @param {string[]} values */
  async sweep(path, values) {
    const before = this.values, name = this.studio.document.name;
    for (const value of values) {
      this.values = { ...before, [path]: value };
      if (!await this.run() || this.studio.document?.name !== name) break;
      this.keep(`${path.split(".").at(-1)} = ${value}`);
    }
    if (this.studio.document?.name === name) this.setValues(before);
  }

  /** Simulate with the values of the sliders; whether there is a result. */
  async run() {
    if (!this.studio.document || !this.studio.view?.parts) return false;
    if (this.studio.view.study) { void this.studio.evidence.jobs.begin("study"); return false; }
    if (this.studio.view.component) { this.studio.say("a component runs as a part of a diagram"); return false; }
    if (this.studio.evidence.active) { await this.studio.evidence.compare(); return false; }
    const values = this.values, began = performance.now(), name = this.studio.document.name;
    this.busy++;
    this.begun++;
    this.waitingPreview = false; // this run has the newest values
    byId("stop").hidden = false;
    const here = () => this.studio.document?.name === name;  // the page may show another diagram by the end
    const clock = setInterval(() => { if (here()) this.studio.say(`running, ${((performance.now() - began) / 1000).toFixed(0)} s`); }, 500);
    try {
      const told = await this.studio.link.ask("run", this.question(values));
      if (!here()) return false;
      if (told.kind === "stopped") this.studio.say("stopped");
      if (told.kind !== "done") return false;
      this.live = { ...this.made(told, values), seconds: (performance.now() - began) / 1000 };
      this.studio.banner([]);
      this.studio.say(`${told.points} points in ${((performance.now() - began) / 1000).toFixed(1)} s, solver ${told.solver}`);
      if (performance.now() - began < QUICK) void this.prepare();
      await this.complete();
      return true;
    } catch (error) {
      if (!here()) return false;
      this.studio.say("the run failed");
      const moved = Object.entries(values).map(([path, value]) => `${path} = ${value}`);
      this.plots.empty(...problemList(problemsOf(error)), moved.length ? el("p", { class: "said" }, "This run has the values of sliders: ", el("code", {}, moved.join(", ")), ".") : "");
      this.failed = this.studio.editor.text;
      this.live = null;
      return false;
    } finally {
      clearInterval(clock);
      if (!--this.busy) byId("stop").hidden = true;
      this.showRuns();
      void this.studio.panel.fetchValues();
      if (this.resume && !this.busy && here()) { this.resume = false; void this.restore(); }
    }
  }

  async stop() {
    await this.studio.link.ask("stop");
  }

  /** @param {string} name @param {boolean} on */
  plot(name, on) {
    this.plotted = on ? [...this.plotted, name] : this.plotted.filter((n) => n !== name);
    this.remember();
    void this.complete();
  }

  /** A signal was dragged from the panel into a chart, or beside the charts. @param {string} name @param {string} base */
  dropped(name, base) {
    const pane = base.split("#")[1];
    if (!base) this.plots.panes[name] = name;
    else if (pane) this.plots.panes[name] = pane;
    else delete this.plots.panes[name];
    this.plot(name, true);
  }

  get layoutKey() { return `plots:${this.studio.folder}/${this.studio.document.name}`; }

  /** What is plotted, and how, and the kept runs, each text once. */
  layout() {
    const runs = [...this.failing, ...this.stored, ...this.kept], texts = [...new Set(runs.map((run) => run.text))], { plots } = this;
    const kept = runs.map(({ key, label, values, text, visible, seconds }) => ({ key, label, values, text: texts.indexOf(text), visible, seconds }));
    return { plotted: this.plotted, choices: plots.choices, large: plots.large, panes: plots.panes, order: plots.order, columns: plots.columns, limits: plots.limits,
      cursors: plots.cursors.on ? plots.cursors.times : null, events: this.log.on, texts, kept };
  }

  /** Keep what is plotted, and how, for the next time that this diagram is opened: beside its file, for a bundled one in the browser. */
  remember() {
    const { document: file } = this.studio;
    if (!file) return;
    file.layout = this.layout();
    if (file.writable) void this.store(file);
    else localStorage.setItem(this.layoutKey, JSON.stringify(file.layout));
  }

  /** Write the layout; one request at a time, the newest one last. @param {any} file */
  async store(file) {
    this.dirty = file;
    if (this.storing) return;
    this.storing = true;
    try {
      while (this.dirty) {
        const now = this.dirty;
        this.dirty = null;
        const told = await this.studio.link.ask("layout", { name: now.name, layout: now.layout, base: now.layout_version });
        if (told.kind !== "done") break;
        now.layout_version = told.layout_version;
        if (told.layout) this.merge(now, told.layout);
      }
    } catch (error) {
      this.studio.say(error instanceof Error ? error.message.split("\n")[0] : "");
    } finally { this.storing = false; }
  }

  /** Another tab has stored its layout: the runs that it kept are added, and the charts are those of this tab. @param {any} file @param {any} other */
  merge(file, other) {
    const here = this.studio.document === file, own = new Set(file.layout.kept.map((/** @type {any} */ run) => run.key));
    const further = storedRuns(other).filter((run) => !own.has(run.key) && !this.forgotten.has(run.key));
    if (here) {
      this.stored.push(...further);
      file.layout = this.layout();
      this.showRuns();
    } else {
      const texts = [...new Set([...file.layout.texts, ...further.map((run) => run.text)])];
      file.layout = { ...file.layout, texts, kept: [...file.layout.kept, ...further.map((run) => ({ ...run, text: texts.indexOf(run.text) }))] };
    }
    this.dirty = file;
  }

  /** Simulate the runs that were kept when the diagram was open before; each has its text and its values. */
  async restore() {
    const name = this.studio.document?.name, begun = this.begun, here = () => this.studio.document?.name === name;
    if (this.restoring) return;
    this.restoring = true;
    byId("stop").hidden = false;
    this.busy++;
    this.showRuns();
    try {
      while (this.stored.length && here() && this.begun === begun) { // a run that is asked for goes first
        const [next] = this.stored;
        this.studio.say(`computing the kept run ${next.label}`);
        const told = await this.studio.link.ask("run", { name, text: next.text, values: next.values, names: this.plotted });
        if (!here()) return;
        if (told.kind !== "done") break;
        this.serial++;
        this.kept.push({ ...this.made(told, next.values), ...next, ...this.marks() });
        this.stored.shift();
        this.showPlots();
      }
      if (this.begun === begun) this.studio.say("");
    } catch (error) {
      const failing = here() && this.stored.shift(), reason = error instanceof Error ? error.message : String(error);
      if (failing) {
        this.failing.push({ ...failing, reason });
        this.studio.say(`the kept run ${failing.label} failed: ${reason.split("\n")[0]}`);
      }
    } finally {
      this.restoring = false;
      if (!--this.busy) byId("stop").hidden = true;
      if (here()) { this.showRuns(); if (this.begun !== begun) this.resume = true; }
    }
  }

  /** What tells a kept run from the others. */
  marks() { return { id: `run ${this.serial}`, live: false, dash: 1 + (this.serial - 1) % (DASHES.length - 1) }; }

  /** What was plotted the last time; the first outputs without it. @param {string[]} outputs */
  recall(outputs) {
    const file = this.studio.document, kept = file.layout ?? JSON.parse(localStorage.getItem(this.layoutKey) ?? "null"), { plots } = this;
    const list = (/** @type {any} */ found) => Array.isArray(found) ? found : null, record = (/** @type {any} */ found) => found && typeof found === "object" && !Array.isArray(found) ? found : {};
    this.plotted = list(kept?.plotted) ?? outputs;
    if (!this.recalled) this.stored = storedRuns(kept);
    this.recalled = true;
    this.log.on = Boolean(kept?.events);
    Object.assign(plots, { choices: record(kept?.choices), large: kept?.large ?? "", panes: record(kept?.panes), order: list(kept?.order) ?? [], columns: kept?.columns ?? 1, limits: kept?.limits ?? null });
    plots.cursors.on = list(kept?.cursors)?.length === 2;
    if (plots.cursors.on) plots.cursors.times = kept.cursors;
    this.showRuns();
    if (this.stored.length && this.stored.reduce((sum, run) => sum + (run.seconds ?? 0), 0) < SOON) void this.restore();
  }

  /** The density of a signal over the frequency, as `heavebond signal` computes it. @param {any} run @param {string} name */
  async spectrum(run, name) {
    run.spectra ??= new Map();
    run.wanted ??= new Set();
    if (run.wanted.has(name)) return;
    run.wanted.add(name);
    try {
      const told = await this.studio.link.ask("spectrum", { name: this.studio.document.name, text: run.text, values: run.values, names: [name] });
      if (told.kind === "done") { run.spectra.set(name, told.series ?? []); this.showPlots(); }
    } catch (error) {
      this.studio.say(error instanceof Error ? error.message.split("\n")[0] : "");
      for (const key of Object.keys(this.plots.choices)) if (this.plots.choices[key].over === "~spectrum") this.plots.choose(key, { over: "" });
    }
  }

  /** A signal by a formula of others, such as `crown.x - platform.x`; the server checks its units. */
  derive() {
    const known = this.live;
    if (!known) return;
    askName("A signal by a formula", "Formula of signals and parameters, such as body.x - wheel.x or spring.F*der(spring.s):", "", async (formula) => {
      if (!formula) throw new Error("Write a formula, such as body.x - wheel.x.");
      if (!this.plotted.includes(formula)) {
        await this.studio.link.ask("signals", { name: this.studio.document.name, text: known.text, values: known.values, names: [formula] });
        return () => this.plot(formula, true);
      }
    }, "Plot");
  }

  /** Fetch signals of the newest run that are listed in the panel but not plotted. @param {string[]} names */
  async fetch(names) {
    const run = this.live;
    if (!run || run.preview || this.busy) return;
    run.listed ??= new Map();
    const missing = names.filter((n) => !run.series.has(n) && !run.listed.has(n));
    if (!missing.length) return;
    for (const n of missing) run.listed.set(n, null); // asked for once
    try {
      const told = await this.studio.link.ask("signals", { name: this.studio.document.name, text: run.text, values: run.values, names: missing });
      const [, ...columns] = told.series ?? [];
      for (const n of told.kind === "done" ? [] : missing) run.listed.delete(n);
      told.signals?.forEach((/** @type {string} */ n, /** @type {number} */ k) => { run.listed.set(n, columns[k]); run.units[n] ??= told.units[n]; });
      for (const [unit, steps] of Object.entries(told.readable ?? {})) run.readable[unit] ??= steps;
    } catch {
      // a signal that the run does not have is listed without a value
    }
  }

  get visible() { return [...this.kept.filter((r) => r.visible), ...(this.live ? [this.live] : [])]; }

  /** Fetch the signals that a run lacks, then show all. */
  async complete() {
    for (const run of this.visible) {
      const names = this.plotted.filter((n) => !run.series.has(n));
      if (!names.length) continue;
      try {
        const told = await this.studio.link.ask("signals", { name: this.studio.document.name, text: run.text, values: run.values, names });
        if (told.kind !== "done") continue;
        if (run.preview) { // the run that the command line makes takes the place of the slider's
          const again = await this.studio.link.ask("run", { name: this.studio.document.name, text: run.text, values: run.values, names: this.plotted });
          if (again.kind === "done") Object.assign(run, this.made(again, run.values), { preview: false });
          continue;
        }
        const [, ...columns] = told.series ?? [];
        told.signals.forEach((/** @type {string} */ n, /** @type {number} */ k) => { run.series.set(n, columns[k]); run.units[n] = told.units[n]; });
        Object.assign(run.readable, told.readable);
      } catch {
        // a run of a text that had the signal's part not yet goes without it
      }
    }
    this.showPlots();
  }

  /** @param {string} [label] */
  keep(label) {
    if (!this.live) return;
    this.serial++;
    const changed = Object.entries(this.live.values).map(([path, value]) => `${path.split(".").at(-1)} = ${value}`).slice(0, 2).join(", ");
    this.kept.push({ ...this.live, ...this.marks(), key: crypto.randomUUID(), label: label || changed || `run ${this.serial}` });
    this.live.label = "now";
    this.remember();
    this.showRuns();
    this.showPlots();
  }

  showRuns() {
    const line = (/** @type {any} */ run) => {
      const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), path = document.createElementNS("http://www.w3.org/2000/svg", "path");
      for (const [k, v] of [["width", "30"], ["height", "8"], ["aria-hidden", "true"]]) svg.setAttribute(k, v);
      for (const [k, v] of [["d", "M0 4h30"], ["stroke", "currentColor"], ["stroke-width", "1.6"], ["stroke-dasharray", DASHES[run.dash].join(" ") || "none"]]) path.setAttribute(k, v);
      svg.append(path);
      return svg;
    };
    const kept = this.kept.map((run) => el("span", { class: "kept" }, line(run),
      el("input", { type: "checkbox", checked: run.visible, "aria-label": `show ${run.label}`, onchange: (/** @type {any} */ e) => { run.visible = e.target.checked; this.remember(); void this.complete(); } }),
      el("input", { type: "text", value: run.label, "aria-label": "name of the run", title: Object.entries(run.values).map(([k, v]) => `${k} = ${v}`).join(", "),
        onchange: (/** @type {any} */ e) => { run.label = e.target.value; this.remember(); this.showPlots(); } }),
      el("button", { title: "Forget this run", "aria-label": `forget ${run.label}`, onclick: () => { this.forgotten.add(run.key); this.kept = this.kept.filter((r) => r !== run); if (!this.kept.length && this.live) this.live.label = ""; this.remember(); this.showRuns(); this.showPlots(); } }, "×")));
    const failing = this.failing.map((run) => el("span", { class: "kept failing", title: run.reason }, `${run.label} failed`,
      el("button", { title: "Forget this run", "aria-label": `forget ${run.label}`, onclick: () => { this.forgotten.add(run.key); this.failing = this.failing.filter((r) => r !== run); this.remember(); this.showRuns(); } }, "×")));
    const name = (this.studio.view?.name ?? "run").replace(/\W+/g, "_");
    const waiting = this.stored.length && !this.restoring ? [el("button", { id: "restore", title: this.stored.map((run) => run.label).join(", "), onclick: () => void this.restore() }, `Compute ${this.stored.length} kept ${this.stored.length > 1 ? "runs" : "run"}`)] : [];
    byId("runs").replaceChildren(...waiting, ...failing, ...(this.live || kept.length ? [el("button", { id: "keep", disabled: !this.live, title: "Keep this run to compare others with it", onclick: () => this.keep() }, "Keep this run"), ...kept,
      el("span", { class: "grow" }), el("button", { id: "formula", disabled: !this.live, title: "Plot a formula of signals", onclick: () => this.derive() }, "Formula…"),
      ...this.log.button(),
      el("button", { id: "measure", disabled: !this.live, "aria-pressed": String(this.plots.cursors.on), title: "Two cursors, with the values of the signals at them and between them", onclick: () => { this.plots.measure(); this.remember(); byId("measure").setAttribute("aria-pressed", String(this.plots.cursors.on)); } }, "Measure"),
      el("select", { id: "columns", "aria-label": "charts beside each other", onchange: (/** @type {any} */ e) => { this.plots.columns = Number(e.target.value); this.remember(); this.showPlots(); } }, ...[1, 2, 3].map((n) => el("option", { value: n, selected: n === this.plots.columns }, n === 1 ? "1 column" : `${n} columns`))),
      el("button", { id: "charts-only", "aria-pressed": String(byId("middle").classList.contains("charts-only")), title: "Charts without the drawing, and back", onclick: () => { const on = byId("middle").classList.toggle("charts-only"); byId("charts-only").setAttribute("aria-pressed", String(on)); } }, "Charts only"),
      el("button", { id: "png", onclick: () => this.plots.png(`${name}_charts`) }, "PNG"),
      el("button", { id: "csv", onclick: () => this.plots.csv(`${name}_charts`, this.visible, this.plotted) }, "CSV")] : []));
    this.studio.animation?.follow();
    byId("runs").classList.toggle("bare", !this.live && !kept.length && !waiting.length && !failing.length);
  }

  showPlots() {
    void this.studio.machine?.renew();
    const runs = this.visible;
    this.studio.animation?.follow();
    if (!runs.length) return;
    if (!this.plotted.length) { this.plots.empty("No signal is chosen. Tick signals in the panel on the right."); return; }
    this.plots.show(runs, this.plotted, this.above(), [...this.below(), this.log.place]);
    void this.log.follow();
  }

  /** What is wrong with the newest run, above its charts, so that nobody takes them for granted. */
  above() {
    const told = this.live?.told;
    return told ? [...(told.verdict.status === "clean" ? [] : [told.verdict.text]), ...(told.notes ?? [])].map((/** @type {string} */ words) => el("p", { class: "verdict" }, words)) : [];
  }

  /** The figures of the newest run, as `heavebond run` prints them. */
  below() {
    const told = this.live?.told;
    if (!told?.outputs) return [];
    const figure = (/** @type {number|null} */ v) => v === null ? "—" : String(Number(Math.abs(v) < 1e-12 ? 0 : v.toPrecision(5)));
    const rows = Object.entries(told.outputs).map(([name, f]) => el("tr", {}, el("th", { scope: "row" }, name), el("td", { class: "words" }, unitLabel(f.unit)), ...["min", "max", "rms", "final"].map((k) => el("td", {}, figure(f[k])))));
    return [el("table", { class: "figures" }, el("thead", {}, el("tr", {}, ...["output", "unit", "min", "max", "rms", "final"].map((h, k) => el("th", { scope: "col", class: k < 2 ? "words" : null }, h)))), el("tbody", {}, ...rows))];
  }
}

/** The kept runs of a stored layout; those of earlier versions have their texts in place and no keys. @param {any} layout @returns {any[]} */
function storedRuns(layout) {
  const runs = Array.isArray(layout?.kept) ? layout.kept : [];
  return runs.map((/** @type {any} */ run) => ({ ...run, key: run.key ?? crypto.randomUUID(), text: typeof run.text === "number" ? layout.texts?.[run.text] : run.text }))
    .filter((/** @type {any} */ run) => typeof run.text === "string" && run.values && typeof run.values === "object");
}
