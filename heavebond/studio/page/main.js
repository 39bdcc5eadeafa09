// The studio: what is open, what is run, and who is told of it.

import { askName, byId, el } from "./dom.js";
import { Diagram } from "./diagram.js";
import { Editor } from "./editor.js";
import { showHome } from "./home.js";
import { Link, Refused } from "./link.js";
import { Panel } from "./panel.js";
import { DASHES, Plots } from "./plots.js";

const CHECKED = 250; // ms after the last key until the text is checked
const DRAFTED = 400; // ms until it is kept as a draft

class Studio {
  constructor() {
    const nonce = /** @type {HTMLMetaElement} */ (document.querySelector("meta[name=studio-nonce]")).content;
    /** @type {any} */ this.document = null;
    /** @type {any} */ this.view = null;
    /** @type {Record<string, string>} */ this.values = {};
    /** @type {string[]} */ this.plotted = [];
    /** @type {string[]} */ this.opened = [];
    /** @type {any} */ this.picked = null;
    /** @type {any} */ this.live = null;
    /** @type {any[]} */ this.kept = [];
    this.serial = 0;
    this.folder = "";
    this.busy = 0;
    this.editor = new Editor(byId("editor"), nonce, () => this.changed(), (line) => this.atLine(line));
    this.diagram = new Diagram((kind, path) => this.pick(kind, path), (path) => this.openBlock(path));
    this.panel = new Panel(this);
    this.plots = new Plots();
    this.link = new Link((message) => this.pushed(message), (open) => this.linked(open));
    this.listen();
  }

  async begin() {
    await this.link.ready;
    const told = await this.link.ask("home");
    this.folder = told.folder;
    const wanted = decodeURIComponent(location.hash.slice(1)) || told.first;
    if (wanted) await this.open(wanted).catch((error) => this.home(error));
    else await this.home();
  }

  listen() {
    byId("go-home").onclick = () => this.home();
    byId("save").onclick = () => this.save();
    byId("copy").onclick = () => this.make("copy");
    byId("derive").onclick = () => this.make("derive");
    byId("run").onclick = () => this.run();
    byId("stop").onclick = () => this.stop();
    byId("toggle-text").onclick = () => this.toggleText();
    addEventListener("hashchange", () => {
      const name = decodeURIComponent(location.hash.slice(1));
      if (name !== (this.document?.name ?? "")) void (name ? this.open(name).catch((e) => this.home(e)) : this.home());
    });
    addEventListener("beforeunload", (event) => { if (this.unsaved) event.preventDefault(); });
    addEventListener("keydown", (event) => {
      const mod = event.ctrlKey || event.metaKey;
      if (mod && event.key === "s") { event.preventDefault(); void this.save(); }
      if (mod && event.key === "Enter") { event.preventDefault(); void this.run(); }
      if (event.altKey && event.key === "t") { event.preventDefault(); this.toggleText(); }
      if (event.altKey && event.key === "h") { event.preventDefault(); void this.home(); }
      if (event.key === "Escape" && this.busy) void this.stop();
    });
  }

  get unsaved() { return Boolean(this.document) && this.editor.text !== this.document.text; }

  /** @param {string} words */
  say(words) { byId("status").textContent = words; }

  // -- pages ---------------------------------------------------------------------------------------------------------
  /** @param {any} [error] */
  async home(error) {
    this.keepDraft();
    const told = await this.link.ask("home");
    this.document = null;
    this.folder = told.folder;
    location.hash = "";
    document.title = byId("title").textContent = "heavebond studio";
    byId("model").hidden = byId("tools").hidden = byId("go-home").hidden = true;
    byId("unsaved").hidden = true;
    byId("home").hidden = false;
    this.banner(error instanceof Error ? [error.message] : []);
    this.say("");
    showHome(this, told);
  }

  /** @param {string} name */
  async open(name) {
    this.keepDraft();
    const told = await this.link.ask("open", { name });
    this.document = told;
    Object.assign(this, { view: null, values: {}, plotted: [], opened: [], picked: null, live: null, kept: [], serial: 0 });
    location.hash = encodeURIComponent(name);
    document.title = `${name} - heavebond studio`;
    byId("title").textContent = name.replace(/^bundled:/, "") + (told.name.startsWith("bundled:") ? " (bundled, read only)" : told.writable ? "" : " (read only)");
    byId("home").hidden = true;
    byId("model").hidden = byId("tools").hidden = byId("go-home").hidden = false;
    this.banner([]);
    this.say("");
    this.editor.open(told.text, told.writable);
    this.plots.empty("Press Run (Ctrl+Enter) to simulate. Then click parts and wires to find signals to plot, and move the sliders of parameters.");
    this.marks();
    this.showRuns();
    this.offerDraft();
    await this.check(true);
  }

  /** @param {(string|Node)[]} parts */
  banner(parts) {
    byId("banner").replaceChildren(...parts);
    byId("banner").hidden = !parts.length;
  }

  /** A diagram of one's own from this one. @param {string} how */
  make(how) {
    const origin = this.document.name, first = `my_${origin.replace(/^bundled:|\.ya?ml$/g, "").split("/").at(-1)}`;
    const words = how === "copy" ? "Name of the new folder, letters, digits and _:" : "Name of the new diagram, letters, digits and _:";
    askName(how === "copy" ? "A copy with all files of the machine" : "A diagram that extends this one", words, first, async (name) => {
      const made = await this.link.ask(how, { name, origin, values: this.values });
      await this.open(made.name);
    });
  }

  toggleText() {
    const hidden = byId("model").classList.toggle("no-text");
    byId("toggle-text").setAttribute("aria-pressed", String(!hidden));
  }

  // -- text ----------------------------------------------------------------------------------------------------------
  marks() {
    byId("unsaved").hidden = !this.unsaved;
    /** @type {HTMLButtonElement} */ (byId("save")).disabled = !this.document?.writable || !this.unsaved;
    byId("save").hidden = !this.document?.writable;
    byId("copy").hidden = !/^bundled:\w+$/.test(this.document?.name ?? "");
  }

  changed() {
    this.marks();
    clearTimeout(this.checking);
    this.checking = setTimeout(() => this.check(false), CHECKED);
    clearTimeout(this.drafting);
    this.drafting = setTimeout(() => this.keepDraft(), DRAFTED);
  }

  get draftKey() { return `draft:${this.folder}:${this.document.name}`; }

  /** What is not saved outlives the page and the server: it is kept in the browser. */
  keepDraft() {
    clearTimeout(this.drafting);
    if (!this.document?.writable || this.offered) return;
    if (this.unsaved) localStorage.setItem(this.draftKey, JSON.stringify({ text: this.editor.text, base: this.document.version, when: Date.now() }));
    else localStorage.removeItem(this.draftKey);
  }

  offerDraft() {
    this.offered = false;
    const draft = JSON.parse(localStorage.getItem(this.draftKey) ?? "null");
    if (!draft || !this.document.writable) return;
    if (draft.text === this.document.text) { localStorage.removeItem(this.draftKey); return; }
    this.offered = true;
    const end = (/** @type {boolean} */ take) => {
      this.offered = false;
      this.banner([]);
      if (take) this.editor.replace(draft.text);
      else localStorage.removeItem(this.draftKey);
    };
    const other = draft.base === this.document.version ? "" : " The file has changed since.";
    this.banner([`There is text of ${new Date(draft.when).toLocaleString()} that was not saved.${other}`,
      el("button", { class: "main", id: "draft-take", onclick: () => end(true) }, "Take it"), el("button", { id: "draft-drop", onclick: () => end(false) }, "Throw it away")]);
  }

  async save() {
    if (!this.document?.writable || !this.unsaved) return;
    const text = this.editor.text;
    try {
      const saved = await this.link.ask("save", { name: this.document.name, text, base: this.document.version });
      Object.assign(this.document, { text: saved.text, version: saved.version });
      this.keepDraft();
      this.marks();
      this.say("saved");
    } catch (error) {
      if (error instanceof Refused && error.problems[0].code === "file-changed") return; // the push tells of it
      this.banner([error instanceof Error ? error.message : String(error)]);
    }
  }

  /** @param {any} message */
  pushed(message) {
    if (message.push === "others") { void this.check(false); this.say("a file that the diagram reads has changed"); return; }
    if (!this.document || message.name !== this.document.name) return;
    const text = this.editor.text, before = this.document.text;
    if (text === message.text || text === before) {
      this.document = { ...this.document, ...message };
      this.editor.replace(message.text);
      this.keepDraft();
      this.marks();
      this.say("read again: the file has changed on disk");
      return;
    }
    const end = (/** @type {boolean} */ take) => {
      this.document = { ...this.document, ...message };
      if (take) this.editor.replace(message.text);
      this.banner([]);
      this.marks();
      this.keepDraft();
    };
    this.banner([`${message.name} has changed on disk, and here is text that is not saved. Nothing was overwritten.`,
      el("button", { id: "take-disk", onclick: () => end(true) }, "Take the file's text (undo brings mine back)"),
      el("button", { id: "keep-mine", onclick: () => end(false) }, "Keep mine (saving replaces the file's)")]);
  }

  /** @param {boolean} open */
  linked(open) {
    if (open && this.document) void this.link.ask("open", { name: this.document.name }).then((told) => {
      this.banner([]);
      this.pushed({ push: "disk", ...told });
      void this.check(false);
    });
    if (!open) this.banner(["The studio's server has ended. Start `heavebond studio` again: unsaved text is kept in this browser and offered on its new page."]);
  }

  // -- drawing -------------------------------------------------------------------------------------------------------
  /** @param {boolean} fit */
  async check(fit) {
    const name = this.document?.name;
    const told = await this.link.ask("view", { name, text: this.editor.text, opened: this.opened }).catch((error) => ({ kind: "failed", error }));
    if (told.kind !== "done" || this.document?.name !== name) {
      if (told.kind === "failed" && this.document?.name === name) this.say(told.error.message);
      return;
    }
    const drawn = Boolean(told.svg), first = !this.view?.svg;
    this.view = told.parts ? told : { ...this.view, ...told, svg: told.svg ?? this.view?.svg };
    if (drawn) this.diagram.draw(told.svg, told.parts ?? this.view.parts ?? {}, fit || first);
    byId("diagram").classList.toggle("stale", !drawn && Boolean(this.view.svg));
    byId("stale").hidden = drawn || !this.view.svg;
    this.editor.mark(told.problems);
    this.diagram.blame(told.problems.map((/** @type {any} */ p) => p.part).filter(Boolean));
    this.showProblems(told.problems);
    if (told.parts) this.tidy();
    this.panel.show();
  }

  /** Forget what the diagram no longer has. */
  tidy() {
    const known = new Set([...this.view.parameters, ...Object.values(this.view.parts).flatMap((p) => p.parameters)].filter((p) => p.slider).map((p) => p.path));
    this.values = Object.fromEntries(Object.entries(this.values).filter(([path]) => known.has(path)));
    if (!this.plotted.length && !this.live) this.plotted = this.view.outputs.slice(0, 4).map((/** @type {any} */ o) => o.name);
  }

  /** @param {any[]} problems */
  showProblems(problems) {
    const list = problems.map((p) => el("li", {}, el("button", { class: "problem", onclick: () => {
      if (p.line) this.editor.show(p.line, true);
      if (p.part) this.pick("part", p.part);
    } }, el("b", {}, p.line ? `line ${p.line}: ` : p.file ? `${p.file}, line ${p.other_line}: ` : ""), p.message,
    el("span", { class: "hint" }, [...p.notes, p.hint].filter(Boolean).join("\n")))));
    byId("problems").replaceChildren(problems.length ? el("ul", {}, ...list) : el("p", { class: "fine" }, "No problems found."));
  }

  /** @param {string} kind @param {string} path */
  pick(kind, path) {
    this.picked = kind ? { kind, path } : null;
    this.diagram.pick(kind, path);
    this.panel.show();
    byId("panel").scrollTop = 0;
    const line = kind && this.view?.[kind === "part" ? "parts" : "nodes"]?.[path]?.line;
    if (line && document.activeElement !== this.editor.view.contentDOM) this.editor.show(line);
  }

  /** @param {number} line */
  atLine(line) {
    const found = Object.entries(this.view?.parts ?? {}).find(([path, part]) => part.line === line && !path.includes("."));
    if (found) this.pick("part", found[0]);
  }

  /** @param {string} path */
  openBlock(path) {
    if (!this.view?.parts?.[path]?.block) return;
    this.opened = this.opened.includes(path) ? this.opened.filter((p) => p !== path && !p.startsWith(`${path}.`)) : [...this.opened, path];
    this.pick("part", path);
    void this.check(true);
  }

  // -- runs ----------------------------------------------------------------------------------------------------------
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
    this.panel.show();
    if (this.live) void this.run();
  }

  /** The values of the sliders into the text, one step for undo. */
  async writeValues() {
    const before = this.editor.text, values = this.values;
    try {
      const told = await this.link.ask("write", { text: before, values });
      if (this.editor.text !== before) return; // typed meanwhile
      this.editor.replace(told.text);
      this.values = {};
      this.panel.show();
      this.say("written into the text, not saved yet");
    } catch (error) {
      this.banner([error instanceof Error ? error.message : String(error)]);
    }
  }

  /** Begin to build what sliders run with. */
  prepare() {
    const text = this.editor.text;
    if (this.prepared === text) return;
    this.prepared = text;
    void this.link.ask("prepare", { name: this.document.name, text }).catch(() => { this.prepared = undefined; });
  }

  /** While a slider moves: one run at a time, and always of the newest value. @param {string} path @param {string} value */
  slide(path, value) {
    this.values = { ...this.values, [path]: value };
    this.waitingPreview = true;
    if (!this.previewing) void this.preview();
  }

  async preview() {
    this.previewing = true;
    /** @type {number[]} */
    const done = [];
    while (this.waitingPreview) {
      this.waitingPreview = false;
      const values = this.values, asked = performance.now();
      try {
        const told = await this.link.ask("preview", this.question(values));
        if (told.kind === "done" && !this.busy) {
          this.live = this.made(told, values);
          this.live.preview = true;
          this.showPlots();
        }
      } catch (error) {
        this.say(error instanceof Error ? error.message.split("\n")[0] : "");
        break;
      }
      done.push(performance.now());
      if (done.length > 11) done.shift();
      if (done.length > 2) this.say(`${((done.length - 1) / (done[done.length - 1] - done[0]) * 1000).toFixed(0)} runs a second`);
      this.lag = performance.now() - asked;
    }
    this.previewing = false;
  }

  /** @param {Record<string, string>} values */
  question(values) { return { name: this.document.name, text: this.editor.text, values, names: this.plotted }; }

  /** @param {any} told @param {Record<string, string>} values */
  made(told, values) {
    const [time, ...columns] = told.series;
    return { id: "live", live: true, label: this.kept.length ? "now" : "", dash: 0, visible: true, time, told, values, text: this.editor.text,
      units: { ...told.units }, series: new Map(told.signals.map((/** @type {string} */ n, /** @type {number} */ k) => [n, columns[k]])) };
  }

  async run() {
    if (!this.document || !this.view?.parts) return;
    const values = this.values, began = performance.now(), name = this.document.name;
    this.busy++;
    byId("stop").hidden = false;
    const here = () => this.document?.name === name;  // the page may show another diagram by the end
    const clock = setInterval(() => { if (here()) this.say(`running, ${((performance.now() - began) / 1000).toFixed(0)} s`); }, 500);
    try {
      const told = await this.link.ask("run", this.question(values));
      if (!here()) return;
      if (told.kind === "stopped") this.say("stopped");
      if (told.kind !== "done") return;
      this.live = this.made(told, values);
      this.banner([]);
      this.say(`${told.points} points in ${((performance.now() - began) / 1000).toFixed(1)} s, solver ${told.solver}`);
      await this.complete();
    } catch (error) {
      if (!here()) return;
      this.say("the run failed");
      this.plots.empty(error instanceof Error ? error.message : String(error));
      this.live = null;
    } finally {
      clearInterval(clock);
      if (!--this.busy) byId("stop").hidden = true;
      this.showRuns();
    }
  }

  async stop() {
    await this.link.ask("stop");
  }

  /** @param {string} name @param {boolean} on */
  plot(name, on) {
    this.plotted = on ? [...this.plotted, name] : this.plotted.filter((n) => n !== name);
    void this.complete();
  }

  get visible() { return [...this.kept.filter((r) => r.visible), ...(this.live ? [this.live] : [])]; }

  /** Fetch the signals that a run lacks, then show all. */
  async complete() {
    for (const run of this.visible) {
      const names = this.plotted.filter((n) => !run.series.has(n));
      if (!names.length) continue;
      try {
        const told = await this.link.ask("signals", { name: this.document.name, text: run.text, values: run.values, names });
        if (told.kind !== "done") continue;
        if (run.preview) { // the run that the command line makes takes the place of the slider's
          const again = await this.link.ask("run", { name: this.document.name, text: run.text, values: run.values, names: this.plotted });
          if (again.kind === "done") Object.assign(run, this.made(again, run.values), { preview: false });
          continue;
        }
        const [, ...columns] = told.series ?? [];
        told.signals.forEach((/** @type {string} */ n, /** @type {number} */ k) => { run.series.set(n, columns[k]); run.units[n] = told.units[n]; });
      } catch {
        // a run of a text that had the signal's part not yet goes without it
      }
    }
    this.showPlots();
  }

  keep() {
    if (!this.live) return;
    this.serial++;
    const changed = Object.entries(this.live.values).map(([path, value]) => `${path.split(".").at(-1)} = ${value}`).slice(0, 2).join(", ");
    this.kept.push({ ...this.live, id: `run ${this.serial}`, live: false, label: changed || `run ${this.serial}`, dash: 1 + (this.serial - 1) % (DASHES.length - 1) });
    this.live.label = "now";
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
      el("input", { type: "checkbox", checked: run.visible, "aria-label": `show ${run.label}`, onchange: (/** @type {any} */ e) => { run.visible = e.target.checked; void this.complete(); } }),
      el("input", { type: "text", value: run.label, "aria-label": "name of the run", title: Object.entries(run.values).map(([k, v]) => `${k} = ${v}`).join(", "),
        onchange: (/** @type {any} */ e) => { run.label = e.target.value; this.showPlots(); } }),
      el("button", { title: "Forget this run", "aria-label": `forget ${run.label}`, onclick: () => { this.kept = this.kept.filter((r) => r !== run); if (!this.kept.length && this.live) this.live.label = ""; this.showRuns(); this.showPlots(); } }, "×")));
    const name = (this.view?.name ?? "run").replace(/\W+/g, "_");
    byId("runs").replaceChildren(...(this.live || kept.length ? [el("button", { id: "keep", disabled: !this.live, title: "Keep this run to compare others with it", onclick: () => this.keep() }, "Keep this run"), ...kept,
      el("span", { class: "grow" }), el("button", { id: "png", onclick: () => this.plots.png(name) }, "PNG"),
      el("button", { id: "csv", onclick: () => this.plots.csv(name, this.visible, this.plotted) }, "CSV")] : [el("span", {}, "No run yet.")]));
  }

  showPlots() {
    const runs = this.visible;
    if (!runs.length) return;
    if (!this.plotted.length) { this.plots.empty("No signal is chosen. Tick signals in the panel on the right."); return; }
    this.plots.show(runs, this.plotted, this.below());
  }

  /** The verdict and the figures of the newest run, as `heavebond run` prints them. */
  below() {
    const told = this.live?.told;
    if (!told?.outputs) return [];
    const figure = (/** @type {number|null} */ v) => v === null ? "—" : String(Number(Math.abs(v) < 1e-12 ? 0 : v.toPrecision(5)));
    const rows = Object.entries(told.outputs).map(([name, f]) => el("tr", {}, el("th", { scope: "row" }, name), el("td", {}, f.unit), ...["min", "max", "rms", "final"].map((k) => el("td", {}, figure(f[k])))));
    return [...(told.verdict.status === "clean" ? [] : [el("p", { class: "verdict" }, told.verdict.text)]), ...told.notes.map((/** @type {string} */ n) => el("p", { class: "verdict" }, n)),
      el("table", { class: "figures" }, el("thead", {}, el("tr", {}, ...["output", "unit", "min", "max", "rms", "final"].map((h) => el("th", { scope: "col" }, h)))), el("tbody", {}, ...rows))];
  }
}

const studio = new Studio();
Object.assign(window, { studio }); // for tests, and for who wants to look
void studio.begin();
