// Records beside the model: what is shown of an experiment under its drawing.

import { cloud, look, onDark, timeChart } from "./charts.js";
import { byId, el, number, unitLabel } from "./dom.js";
import { Jobs } from "./jobs.js";
import { problemList, problemsOf, resultItems } from "./results.js";

/** @type {Record<string, string>} */
const TABS = { records: "Records", residual: "Residual", fit: "Estimate", where: "Locate", diagnose: "Diagnose", command: "Analyses" };

export class Evidence {
  active = false; // whether the document is an experiment
  tab = "records";
  /** @type {any} */ told = null;
  /** @type {any} */ failed = null;
  /** @type {any} */ chosen = {};
  /** @type {Map<string, any>} */ fetched = new Map();
  /** @type {any[]} */ charts = [];
  note = ""; // on how this experiment came about
  serial = 0;
  turn = 0;
  comparing = false;
  waiting = false;
  following = false;
  /** @type {string|null} */ text = null; // that was compared
  compared = Promise.resolve(); // when the present comparison ends

  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.place = byId("evidence");
    this.jobs = new Jobs(studio, this);
    this.clear();
    onDark(() => this.show());
    new ResizeObserver(() => this.fit()).observe(this.place);
  }

  /** As for a document that was just opened. */
  clear() {
    Object.assign(this, { active: false, tab: "records", told: null, failed: null, fetched: new Map(), note: "", text: null, comparing: false, waiting: false,
      chosen: { record: "", channel: "", signal: "", place: -1 } });
    this.serial++; // a comparison that is under way is of another document
    this.jobs.clear();
    this.destroy();
    this.layout();
  }

  /** Whether the document is an experiment; after a check. @param {any} view */
  recognise(view) {
    const was = this.active;
    this.active = view?.evidence ?? (was && view.problems.length > 0); // a text that cannot be read is what it was
    this.layout();
    if ((this.active && !was) || (view?.study && !this.jobs.loaded)) void this.jobs.load();
  }

  /** After a check: compare where something has changed. @param {any} view */
  viewed(view) {
    const text = this.studio.editor.text;
    if (!this.active || !view.experiment) { this.show(); return; }
    if (view.problems.length) this.show();
    else if (!this.told || this.text !== text) {
      this.compared = this.compare();
      if (!this.told) this.show();
    }
    else this.show();
  }

  layout() {
    const records = this.active || this.jobs.tuning || Boolean(this.studio.view?.study), changed = this.place.hidden === records;
    const study = Boolean(this.studio.view?.study);
    const component = Boolean(this.studio.view?.component); // runs within a diagram only
    for (const id of ["runs", "plots"]) byId(id).hidden = records || component;
    this.studio.animation?.show();
    byId("evidence-bar").hidden = this.place.hidden = !records;
    for (const id of ["run", "derive"]) byId(id).hidden = this.active || component || study;
    byId("records").hidden = component || study;
    byId("compare").hidden = !this.active;
    byId("tune").hidden = this.active || component || study || !this.studio.view?.parts;
    byId("toggle-palette").hidden = this.active || study; // parts are placed on the diagram, not on an experiment
    byId("analyse").hidden = this.active || component || study || !this.studio.view?.parts;
    byId("differences").hidden = component || !this.studio.view?.parts;
    byId("add-note").hidden = !this.studio.edits.possible;
    if (changed && this.studio.view?.svg) this.studio.diagram.fit();
  }

  // -- comparison ----------------------------------------------------------------------------------------------------
  question() { return { name: this.studio.document.name, text: this.studio.editor.text, values: this.studio.runs.values }; }

  /** Compare the model with the records as `heavebond compare` does: one at a time, the newest counts. */
  async compare() {
    const asked = ++this.serial, name = this.studio.document.name, began = performance.now();
    this.text = this.studio.editor.text;
    this.comparing = true;
    byId("stop").hidden = false;
    const clock = setInterval(() => { if (asked === this.serial) this.studio.say(`simulating the records, ${((performance.now() - began) / 1000).toFixed(0)} s`); }, 500);
    try {
      const told = await this.studio.link.ask("compare", this.question());
      if (asked !== this.serial || this.studio.document?.name !== name || told.kind === "superseded") return;
      if (told.kind === "stopped") { this.studio.say("stopped"); return; }
      if (told.kind !== "done") return;
      this.told = told;
      this.failed = null;
      this.fetched.clear();
      this.studio.say(`compared in ${((performance.now() - began) / 1000).toFixed(1)} s`);
    } catch (error) {
      if (asked !== this.serial || this.studio.document?.name !== name) return;
      this.failed = error;
      this.studio.say("the comparison failed");
    } finally {
      clearInterval(clock);
      if (asked === this.serial) {
        this.comparing = false;
        byId("stop").hidden = !this.studio.runs.busy;
      }
    }
    this.show();
  }

  /** A slider moved: compare again, and with the newest value where it moved meanwhile. */
  async follow() {
    this.waiting = true;
    if (this.following) return;
    this.following = true;
    while (this.waiting) {
      this.waiting = false;
      await this.compare();
    }
    this.following = false;
  }

  /** Numbers of a chart, fetched once for each comparison. @param {string} what @param {Record<string, any>} given */
  async numbers(what, given) {
    const key = JSON.stringify([what, given]);
    if (!this.fetched.has(key)) this.fetched.set(key, this.studio.link.ask(what, { ...this.question(), ...given }));
    return this.fetched.get(key);
  }

  // -- what is shown -------------------------------------------------------------------------------------------------
  destroy() {
    for (const chart of this.charts) chart.destroy();
    this.charts = [];
  }

  fit() {
    for (const chart of this.charts) chart.setSize({ width: Math.max(200, this.place.clientWidth - 26), height: chart.height - (chart.legendHeight ?? 0) });
  }

  /** @param {string} tab */
  choose(tab) {
    this.tab = tab;
    this.show();
    document.getElementById(`tab-${tab}`)?.focus();
  }

  show() {
    if (this.place.hidden) return;
    this.bar();
    const turn = ++this.turn, here = () => turn === this.turn && !this.place.hidden;
    const scroll = this.place.scrollTop, held = document.activeElement?.id;
    void this.content(here).then((made) => {
      if (!here() || !made) return;
      this.destroy();
      const tail = el("div", {});
      this.place.replaceChildren(tail);
      made(tail);
      this.place.scrollTop = scroll;
      if (held && document.activeElement === document.body) document.getElementById(held)?.focus();
    });
  }

  /** The tabs; made once, as a button that is made anew while it is pressed is never clicked. */
  bar() {
    const study = Boolean(this.studio.view?.study);
    const tabs = this.active ? Object.entries(TABS) : study ? [["study", "Study"], ["command", "Analyses"]] : [["tune", "Tune"], ["command", "Analyses"]], place = byId("evidence-bar");
    const keys = tabs.map((t) => t[0]);
    if (!keys.includes(this.tab)) this.tab = keys[0];
    if (place.dataset.tabs !== keys.join()) {
      place.dataset.tabs = keys.join();
      place.replaceChildren(...tabs.map(([key, title]) => el("button", { id: `tab-${key}`, role: "tab", "aria-controls": "evidence", onclick: () => this.choose(key),
        onkeydown: (/** @type {KeyboardEvent} */ event) => this.arrow(event, keys) }, title, el("span", { class: "mark" }))),
      el("span", { class: "grow" }), ...(this.active || study ? [] : [el("button", { id: "close-tuning", onclick: () => this.jobs.openTuning(false) }, "Back to the runs")]));
    }
    for (const key of keys) {
      const tab = byId(`tab-${key}`);
      tab.setAttribute("aria-selected", String(this.tab === key));
      tab.tabIndex = this.tab === key ? 0 : -1;
      /** @type {HTMLElement} */ (tab.lastChild).textContent = this.jobs.mark(key);
    }
  }

  /** @param {KeyboardEvent} event @param {string[]} keys */
  arrow(event, keys) {
    const step = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowLeft: -1 })[event.key];
    if (!step) return;
    event.preventDefault();
    this.choose(keys[(keys.indexOf(this.tab) + step + keys.length) % keys.length]);
  }

  /** What the tab shows, made into a place; nothing where it is not known yet. @param {() => boolean} here @returns {Promise<((place: HTMLElement) => void)|null>} */
  async content(here) {
    const problems = this.studio.view?.problems ?? [];
    if (this.active && problems.length) return (place) => place.append(el("p", { class: "empty" }, "The experiment cannot be read yet: its problems are listed below the text."));
    if (this.tab === "records" || this.tab === "residual") {
      if (this.failed) return (place) => place.append(...problemList(problemsOf(this.failed)));
      if (!this.told) return (place) => place.append(el("p", { class: "empty" }, "Simulating the records…"));
      return this.tab === "records" ? this.records(here) : this.residual(here);
    }
    return this.jobs.content(this.tab);
  }

  names() {
    const records = Object.keys(this.told.records);
    if (!records.includes(this.chosen.record)) this.chosen.record = records[0];
    const channels = Object.keys(this.told.records[this.chosen.record].channels);
    if (!channels.includes(this.chosen.channel)) this.chosen.channel = channels[0];
    const signals = this.told.variables.map((/** @type {any} */ v) => v.name);
    if (!signals.includes(this.chosen.signal)) this.chosen.signal = signals[0] ?? "";
    return { records, channels };
  }

  /** @param {string} id @param {string} label @param {[string, string][]} options @param {string} key */
  select(id, label, options, key) {
    return el("label", {}, `${label} `, el("select", { id, onchange: (/** @type {any} */ event) => { this.chosen[key] = event.target.value; this.show(); } },
      ...options.map(([value, text]) => el("option", { value, selected: value === this.chosen[key] }, text))));
  }

  /** @param {() => boolean} here */
  async records(here) {
    const { records, channels } = this.names(), record = this.chosen.record;
    const numbers = await Promise.all(channels.map((channel) => this.numbers("channel", { record, channel }))).catch((error) => error);
    if (!here()) return null;
    if (numbers instanceof Error || numbers.some((/** @type {any} */ n) => n.kind !== "done")) return null;
    return (/** @type {HTMLElement} */ place) => {
      const use = this.told.records[record].use;
      place.append(el("div", { class: "choices" }, this.select("choose-record", "Record", records.map((r) => [r, `${r} (${this.told.records[r].use})`]), "record"),
        el("span", { class: "hint" }, use === "fit" ? "fitted; shaded where samples are held out" : "not fitted: what counts is the error here")));
      if (this.note) place.append(el("p", { class: "note", id: "note" }, this.note));
      const verdict = this.told.verdicts[record];
      if (verdict) place.append(el("p", { class: "verdict" }, verdict));
      channels.forEach((channel, k) => this.beside(place, channel, numbers[k]));
      place.append(...resultItems(this.told.items));
    };
  }

  /** A channel measured and simulated, its residual below. @param {HTMLElement} place @param {string} channel @param {any} told */
  beside(place, channel, told) {
    const c = look(), [time, measured, model, residual, counts] = told.series, sync = `evidence-${this.studio.document.name}`;
    const shaded = heldOut(time, counts);
    this.charts.push(timeChart(place, { time, unit: told.unit, height: 150, sync, shaded, describe: `${channel}, measured and simulated, over time`,
      lines: [{ label: `${channel} measured`, values: measured, colour: c.quiet, width: 2.6 }, { label: "model", values: model, colour: c.colours[0], width: 1.4 }] }));
    this.charts.push(timeChart(place, { time, unit: told.unit, height: 122, sync, shaded, levels: [2 * told.noise, -2 * told.noise], describe: `residual of ${channel} over time`,
      lines: [{ label: `residual (measured − model), rms ${told.rms}, noise ${told.noise_words}`, values: residual, colour: c.colours[1], width: 1.2 }] }));
  }

  /** @param {() => boolean} here */
  async residual(here) {
    const { records, channels } = this.names(), { record, channel, signal } = this.chosen;
    const told = await this.numbers("against", { record, channel, signal }).catch((/** @type {any} */ error) => error);
    const where = this.jobs.state("where"), states = (where?.result?.states ?? []).filter((/** @type {any} */ s) => s.channel === channel);
    const curves = await Promise.all(states.map((/** @type {any} */ s) => this.jobs.array(where, s.key)));
    if (!here()) return null;
    return (/** @type {HTMLElement} */ place) => {
      place.append(el("div", { class: "choices" }, this.select("choose-record", "Residual of record", records.map((r) => [r, r]), "record"),
        this.select("choose-channel", "channel", channels.map((name) => [name, name]), "channel"),
        this.select("choose-signal", "over", this.told.variables.map((/** @type {any} */ v) => [v.name, `${v.name} (${v.doc})`]), "signal")));
      if (told instanceof Error) { place.append(el("p", { class: "verdict" }, told.message)); return; }
      const [x, y, up] = told.series;
      this.charts.push(cloud(place, { x, y, up, xLabel: `${signal} [${told.across}]`, yLabel: `residual of ${channel} [${told.unit}]`, height: 260,
        describe: `residual of ${channel} over ${signal}` }));
      place.append(el("p", { class: "said" }, "A residual that follows a speed points to friction or damping, one that follows a position to a spring or a stop, one that follows a pressure to leakage or compressibility. A loop points to hysteresis, play or a delay."));
      if (states.length) place.append(el("h3", {}, "Variables that the error follows, from the localisation"));
      states.forEach((/** @type {any} */ s, /** @type {number} */ k) => {
        const [sx, sy] = curves[k];
        this.charts.push(timeCurve(place, sx, sy, `${s.variable} [${s.unit}]`, `error of ${channel} [${s.of}]`, `R² ${number(s.r2, 3)} on data not used`));
      });
      if (!where?.result) place.append(el("p", { class: "said" }, "Locate ranks the variables that the error follows, on data that was not used to find them."));
    };
  }

  /** What the experiment says, for the panel. */
  summary() {
    const said = this.studio.view?.experiment;
    if (!this.active || !said) return [];
    const list = (/** @type {any[]} */ rows) => el("ul", { class: "signals" }, ...rows);
    const free = Object.entries(said.free).map(([name, f]) => el("li", {}, el("code", {}, name), ` ${number(f.low, 4)} .. ${number(f.high, 4)} ${f.unit === "1" ? "" : unitLabel(f.unit)}`));
    return [el("h3", {}, "Records"), list(said.records.map((/** @type {any} */ r) => el("li", {}, el("code", {}, r.name), ` ${r.file}, ${r.use}`))),
      el("h3", {}, "Driven by"), Object.keys(said.inputs).length ? list(Object.entries(said.inputs).map(([name, column]) => el("li", {}, el("code", {}, name), ` column ${column}`))) : el("p", {}, "The diagram's own inputs; no column of the records drives it."),
      el("h3", {}, "Compared"), list(said.outputs.map((/** @type {any} */ o) => el("li", {}, el("code", {}, o.name), o.formula === o.name ? "" : ` = ${o.formula}`, ` [${o.unit}]`))),
      ...(free.length ? [el("h3", {}, "Free to be estimated"), list(free)] : [])];
  }

  // -- parts ---------------------------------------------------------------------------------------------------------
  /** What would have to act at the part or node that is selected, for the panel. @param {string} kind @param {string} path */
  about(kind, path) {
    if (!this.active) return [];
    const found = this.jobs.placesAt(kind, path), where = this.jobs.state("where");
    const show = (/** @type {number} */ k) => { this.chosen.place = k; this.choose("where"); };
    if (!where?.result) return [el("h3", {}, "What is missing here?"), el("p", {}, "The additional force or flow at this place with which the model would follow its records."),
      el("button", { id: "locate-here", onclick: () => { this.choose("where"); void this.jobs.begin("where"); } }, "Locate the error")];
    return [el("h3", {}, "What is missing here?"), ...(found.length ? found.slice(0, 3).map((/** @type {any} */ { k, place }) => el("div", { class: "implied" }, el("p", {}, place.words),
      el("button", { id: `implied-${k}`, onclick: () => show(k) }, `Show the ${place.what}`))) : [el("p", {}, "No force or flow at this place would explain the records better.")])];
  }

  /** @param {string} kind @param {string} path */
  picked(kind, path) {
    if (!this.active || this.tab !== "where") return;
    const found = this.jobs.placesAt(kind, path);
    if (found.length) { this.chosen.place = found[0].k; this.show(); }
  }
}

/** Stretches of time whose samples are held out. @param {ArrayLike<number>} time @param {ArrayLike<number>} counts @returns {[number, number][]} */
function heldOut(time, counts) {
  /** @type {[number, number][]} */
  const found = [];
  for (let k = 0; k < counts.length; k++) {
    if (counts[k] !== 2) continue;
    if (k && counts[k - 1] === 2) found[found.length - 1][1] = time[k];
    else found.push([time[k], time[k]]);
  }
  return found;
}

/** A curve of one variable over another. @param {HTMLElement} place @param {any} x @param {any} y @param {string} xLabel @param {string} yLabel @param {string} words */
function timeCurve(place, x, y, xLabel, yLabel, words) {
  place.append(el("p", { class: "said" }, words));
  return cloud(place, { x, y, up: new Float64Array(x.length).fill(1), xLabel, yLabel, height: 190, describe: `${yLabel} over ${xLabel}`, curve: [x, y, y] });
}
