// The studio: what is open, what is run, and who is told of it.

import { askName, byId, el } from "./dom.js";
import { Diagram } from "./diagram.js";
import { Editor } from "./editor.js";
import { Evidence } from "./evidence.js";
import { DiagramFile } from "./file.js";
import { showHome } from "./home.js";
import { Link } from "./link.js";
import { Panel } from "./panel.js";
import { RecordFiles } from "./records.js";
import { Runs } from "./runs.js";

class Studio {
  constructor() {
    const nonce = /** @type {HTMLMetaElement} */ (document.querySelector("meta[name=studio-nonce]")).content;
    /** @type {any} */ this.document = null;
    /** @type {any} */ this.view = null;
    /** @type {string[]} */ this.opened = [];
    /** @type {any} */ this.picked = null;
    this.folder = "";
    this.file = new DiagramFile(this);
    this.editor = new Editor(byId("editor"), nonce, () => this.file.changed(), (line) => this.atLine(line));
    this.diagram = new Diagram((kind, path) => this.pick(kind, path), (path) => this.openBlock(path));
    this.panel = new Panel(this);
    this.runs = new Runs(this);
    this.evidence = new Evidence(this);
    this.records = new RecordFiles(this);
    this.link = new Link((message) => this.pushed(message), (open) => this.file.linked(open));
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
    byId("save").onclick = () => this.file.save();
    byId("copy").onclick = () => this.make("copy");
    byId("derive").onclick = () => this.make("derive");
    byId("run").onclick = () => this.runs.run();
    byId("stop").onclick = () => this.stop();
    byId("compare").onclick = () => this.evidence.compare();
    byId("tune").onclick = () => this.evidence.jobs.openTuning(true);
    byId("toggle-text").onclick = () => this.toggleText();
    addEventListener("hashchange", () => {
      const name = decodeURIComponent(location.hash.slice(1));
      if (name !== (this.document?.name ?? "")) void (name ? this.open(name).catch((e) => this.home(e)) : this.home());
    });
    addEventListener("beforeunload", (event) => { if (this.unsaved) event.preventDefault(); });
    addEventListener("keydown", (event) => {
      const mod = event.ctrlKey || event.metaKey;
      if (mod && event.key === "s") { event.preventDefault(); void this.file.save(); }
      if (mod && event.key === "Enter") { event.preventDefault(); void this.runs.run(); }
      if (event.altKey && event.key === "t") { event.preventDefault(); this.toggleText(); }
      if (event.altKey && event.key === "h") { event.preventDefault(); void this.home(); }
      if (event.key === "Escape" && !document.querySelector("dialog[open]")) void this.stop();
    });
  }

  /** End what runs. */
  async stop() {
    if (this.evidence.jobs.running) await this.evidence.jobs.stop();
    else if (this.runs.busy || this.evidence.comparing) await this.runs.stop();
  }

  /** What the server tells by itself. @param {any} message */
  pushed(message) {
    if (message.push === "job") { this.evidence.jobs.pushed(message.job); return; }
    if (message.push === "others") this.evidence.text = null; // compared again
    this.file.pushed(message);
  }

  get unsaved() { return this.file.unsaved; }

  /** @param {string} words */
  say(words) { byId("status").textContent = words; }

  // -- pages ---------------------------------------------------------------------------------------------------------
  /** @param {any} [error] */
  async home(error) {
    this.file.keepDraft();
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
    this.file.keepDraft();
    const told = await this.link.ask("open", { name });
    this.document = told;
    Object.assign(this, { view: null, opened: [], picked: null });
    this.diagram.picked = null;
    this.runs.clear();
    this.evidence.clear();
    location.hash = encodeURIComponent(name);
    document.title = `${name} - heavebond studio`;
    byId("title").textContent = name.replace(/^bundled:/, "") + (told.name.startsWith("bundled:") ? " (bundled, read only)" : told.writable ? "" : " (read only)");
    byId("home").hidden = true;
    byId("model").hidden = byId("tools").hidden = byId("go-home").hidden = false;
    this.banner([]);
    this.say("");
    this.editor.open(told.text, told.writable);
    this.file.marks();
    this.file.offerDraft();
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
      const made = await this.link.ask(how, { name, origin, values: this.runs.values });
      await this.open(made.name);
    });
  }

  toggleText() {
    const hidden = byId("model").classList.toggle("no-text");
    byId("toggle-text").setAttribute("aria-pressed", String(!hidden));
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
    this.evidence.recognise(this.view);
    this.panel.show();
    this.evidence.viewed(this.view);
  }

  /** Forget what the diagram no longer has. */
  tidy() {
    const known = new Set([...this.view.parameters, ...Object.values(this.view.parts).flatMap((p) => p.parameters)].filter((p) => p.slider).map((p) => p.path));
    this.runs.values = Object.fromEntries(Object.entries(this.runs.values).filter(([path]) => known.has(path)));
    if (!this.runs.plotted.length && !this.runs.live) this.runs.plotted = this.view.outputs.slice(0, 4).map((/** @type {any} */ o) => o.name);
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
    this.evidence.picked(kind, path);
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
}

const studio = new Studio();
Object.assign(window, { studio }); // for tests, and for who wants to look
void studio.begin();
