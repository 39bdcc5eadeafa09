// The studio: what is open, what is run, and who is told of it.

import { Completion } from "./completion.js";
import { Animation } from "./animation.js";
import { askName, byId, el, message } from "./dom.js";
import { Diagram } from "./diagram.js";
import { Differences } from "./differences.js";
import { Edits } from "./edits.js";
import { Editor } from "./editor.js";
import { Evidence } from "./evidence.js";
import { DiagramFile } from "./file.js";
import { Handling } from "./handling.js";
import { showHome } from "./home.js";
import { showKeys } from "./keys.js";
import { Link } from "./link.js";
import { Machine } from "./machine.js";
import { savePicture } from "./picture.js";
import { Palette } from "./palette.js";
import { Panel } from "./panel.js";
import { RecordFiles } from "./records.js";
import { isUnconnected } from "./results.js";
import { Runs } from "./runs.js";
import { splitters } from "./splitters.js";
import { Tour } from "./tour.js";
import { Wiring } from "./wiring.js";

const NARROW = 900; // px, as in the styles
const FEW = 2; // problems of one kind that are listed one by one

class Studio {
  constructor() {
    const nonce = /** @type {HTMLMetaElement} */ (document.querySelector("meta[name=studio-nonce]")).content;
    /** @type {any} */ this.document = null;
    /** @type {any} */ this.view = null;
    /** @type {string[]} */ this.opened = [];
    /** @type {any} */ this.picked = null; // the part or node in the panel
    /** @type {string[]} */ this.chosen = []; // the parts that are moved, copied and deleted together, the picked one among them
    /** @type {string[]} */ this.trail = []; // the diagrams from which one came to the block that is edited
    this.folder = "";
    this.runsFmus = false;
    this.file = new DiagramFile(this);
    this.editor = new Editor(byId("editor"), nonce, () => this.file.changed(), (line) => this.atLine(line), (context) => this.completion.propose(context));
    this.completion = new Completion(this);
    this.edits = new Edits(this);
    this.wiring = new Wiring(this);
    this.handling = new Handling(this);
    this.diagram = new Diagram(this);
    this.palette = new Palette(this);
    this.panel = new Panel(this);
    this.runs = new Runs(this);
    this.machine = new Machine(this);
    this.animation = new Animation(this);
    this.runs.plots.onpoint = (time) => this.animation.pointed(time);
    this.evidence = new Evidence(this);
    this.records = new RecordFiles(this);
    this.differences = new Differences(this);
    this.tour = new Tour(this);
    this.link = new Link((message) => this.pushed(message), (open) => this.file.linked(open));
    this.listen();
    splitters();
    if (innerWidth <= NARROW) this.toggleText(); // the text takes the place of the panel there
  }

  async begin() {
    await this.link.ready;
    const told = await this.link.ask("home");
    this.folder = told.folder;
    this.runsFmus = Boolean(told.fmus); // whether the studio was started with the permission to run FMUs
    const wanted = decodeURIComponent(location.hash.slice(1)) || told.first;
    if (wanted) await this.open(wanted).catch((error) => this.home(error));
    else await this.home();
  }

  listen() {
    byId("go-home").onclick = () => this.home();
    byId("show-keys").onclick = showKeys;
    byId("go-back").onclick = () => this.goBack();
    byId("save").onclick = () => this.file.save();
    byId("copy").onclick = () => this.make("copy");
    byId("derive").onclick = () => this.make("derive");
    byId("run").onclick = () => this.runs.run();
    byId("stop").onclick = () => this.stop();
    byId("compare").onclick = () => this.evidence.compare();
    byId("tune").onclick = () => this.evidence.jobs.openTuning(true);
    byId("analyse").onclick = () => this.evidence.jobs.openTuning(true, "command");
    byId("undo").onclick = () => this.editor.undo();
    byId("redo").onclick = () => this.editor.redo();
    byId("toggle-palette").onclick = () => this.palette.toggle();
    byId("toggle-text").onclick = () => this.toggleText();
    byId("to-problems").onclick = () => {
      if (byId("model").classList.contains("no-text")) this.toggleText();
      byId("problems").focus();
    };
    addEventListener("hashchange", () => {
      const name = decodeURIComponent(location.hash.slice(1));
      if (name !== (this.document?.name ?? "")) void (name ? this.open(name).catch((e) => this.home(e)) : this.home());
    });
    document.addEventListener("paste", (event) => {
      const text = event.clipboardData?.getData("text/plain") ?? "";
      if (this.typing(event.target) || !this.edits.possible || !/^\s*components:/.test(text)) return;
      event.preventDefault();
      this.edits.paste(text);
    });
    byId("add-note").onclick = () => this.edits.addNote();
    const picture = /** @type {HTMLSelectElement} */ (byId("picture"));
    picture.onchange = () => { void savePicture(this, picture.value).catch((error) => this.edits.refuse(error.message)); picture.value = ""; };
    addEventListener("beforeunload", (event) => { if (this.unsaved) event.preventDefault(); });
    addEventListener("keydown", (event) => {
      const mod = event.ctrlKey || event.metaKey;
      if (mod && event.key === "s") { event.preventDefault(); void this.file.save(); }
      if (mod && event.key === "Enter") { event.preventDefault(); void this.runs.run(); }
      if (event.altKey && event.key === "t") { event.preventDefault(); this.toggleText(); }
      if (event.altKey && event.key === "ArrowUp" && this.trail.length && !this.typing(event.target)) { event.preventDefault(); void this.goBack(); }
      if (event.altKey && event.key === "h") { event.preventDefault(); void this.home(); }
      if (event.altKey && event.key === "l" && this.document) { event.preventDefault(); this.palette.toggle(); }
      if (event.key === "/" && !mod && !event.altKey && this.edits.possible && !this.typing(event.target) && !document.querySelector("dialog[open]")) { event.preventDefault(); this.palette.toggle(true); }
      if (event.key === "?" && !mod && !this.typing(event.target) && !document.querySelector("dialog[open]")) { event.preventDefault(); showKeys(); }
      if (mod && !this.typing(event.target)) {
        const key = event.key.toLowerCase();
        if (key === "z" && !event.shiftKey) { event.preventDefault(); this.editor.undo(); }
        if (key === "y" || (key === "z" && event.shiftKey)) { event.preventDefault(); this.editor.redo(); }
      }
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

  /** Whether keys go into a text here, which has its own undo. @param {any} target */
  typing(target) { return Boolean(target?.closest?.(".cm-editor, input:not([type=range]):not([type=checkbox]), textarea")); }

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
    byId("model").hidden = byId("tools").hidden = byId("go-home").hidden = byId("go-back").hidden = byId("foot").hidden = true;
    byId("unsaved").hidden = true;
    byId("home").hidden = false;
    this.banner(error instanceof Error ? [error.message] : []);
    this.say("");
    showHome(this, told);
  }

  /** @param {string} name @param {string[]} [trail] the diagrams from which one came here */
  async open(name, trail = []) {
    this.file.keepDraft();
    const told = await this.link.ask("open", { name });
    this.document = told;
    Object.assign(this, { view: null, opened: [], picked: null, chosen: [], trail });
    byId("go-back").hidden = !trail.length;
    byId("go-back").textContent = `← ${(trail.at(-1) ?? "").split("/").at(-1)}`;
    this.diagram.picked = null;
    this.runs.clear();
    this.animation.clear();
    this.evidence.clear();
    this.palette.clear();
    this.differences.clear();
    this.diagram.clear();
    location.hash = encodeURIComponent(name);
    document.title = `${name} - heavebond studio`;
    byId("title").textContent = name.replace(/^bundled:/, "") + (told.name.startsWith("bundled:") ? " (bundled, read only)" : told.writable ? "" : " (read only)");
    byId("home").hidden = true;
    byId("model").hidden = byId("tools").hidden = byId("go-home").hidden = byId("foot").hidden = false;
    this.banner([]);
    this.say("");
    this.editor.open(told.text, told.writable);
    this.file.marks();
    this.file.offerDraft();
    byId("problems").replaceChildren(); // those of the diagram before
    byId("to-problems").textContent = "";
    this.panel.show();
    byId("nothing").replaceChildren(el("p", {}, "Reading the diagram…"));
    byId("nothing").hidden = false;
    await this.check(true);
    if (this.edits.possible && this.view?.parts && !this.view.svg) this.palette.toggle(true);
    if (this.document?.name === name) void this.readAhead(name);
  }

  /** The first run finds its equations ready, sliders follow at once, and the library opens without a wait. @param {string} name */
  async readAhead(name) {
    if (this.view?.runs) await this.runs.prepare();
    if (this.edits.possible && this.document?.name === name) await Promise.resolve(this.palette.load()).catch(() => undefined);
  }

  /** @param {(string|Node)[]} parts */
  banner(parts) {
    const answered = parts.some((part) => part instanceof HTMLButtonElement); // one that asks stays until it is answered
    byId("banner").replaceChildren(...parts, ...(answered || !parts.length ? [] : [el("span", { class: "grow" }), el("button", { id: "close-banner", "aria-label": "Close the message", onclick: () => this.banner([]) }, "×")]));
    byId("banner").hidden = !parts.length;
  }

  /** A diagram of one's own from this one. @param {string} how */
  make(how) {
    const origin = this.document.name, first = `my_${origin.replace(/^bundled:|\.ya?ml$/g, "").split("/").at(-1)}`;
    const words = how === "copy" ? "Name of the new folder (letters, digits and _):" : "Name of the new diagram (letters, digits and _):";
    askName(how === "copy" ? "A copy with all files of the machine" : "A diagram that extends this one", words, first, async (name) => {
      const made = await this.link.ask(how, { name, origin, values: this.runs.values });
      return () => this.open(made.name);
    });
  }

  toggleText() {
    const hidden = byId("model").classList.toggle("no-text");
    byId("toggle-text").setAttribute("aria-pressed", String(!hidden));
    if (!hidden && this.palette.instead) this.palette.toggle(false);
  }

  // -- drawing -------------------------------------------------------------------------------------------------------
  /** @param {boolean} fit */
  async check(fit) {
    const name = this.document?.name, text = this.editor.text;
    clearTimeout(this.file.checking);
    /** @type {any} */
    const told = await this.link.ask("view", { name, text, opened: this.opened }).catch((error) => ({ kind: "failed", error }));
    if (told.kind !== "done" || this.document?.name !== name) {
      if (told.kind === "failed" && this.document?.name === name) { this.hint(false); this.say(told.error.message); }
      return;
    }
    const first = !this.view?.svg, empty = told.parts && !told.svg;
    // while a part's component is being typed, the drawing of before stays
    const drawn = Boolean(told.svg && told.parts && (told.whole || first)) || empty;
    this.view = drawn ? told : { ...told, ...this.view, problems: told.problems, evidence: told.evidence, experiment: told.experiment ?? this.view?.experiment };
    if (empty) this.diagram.clear();
    else if (drawn) { this.diagram.draw(told.svg, told.parts, fit || first); this.animation.draw(); }
    this.hint(empty);
    byId("diagram").classList.toggle("stale", !drawn && Boolean(this.view.svg));
    byId("stale").hidden = drawn || !this.view.svg;
    this.editor.mark(told.problems);
    // a port that is not connected is marked itself
    this.diagram.blame(told.problems.filter((/** @type {any} */ p) => p.part && !isUnconnected(p)).map((/** @type {any} */ p) => p.part));
    this.showProblems(told.problems);
    if (empty) byId("to-problems").textContent = ""; // an empty sheet is no mistake
    this.runs.checked(text);
    if (drawn && text === this.editor.text) this.tidy();
    this.evidence.recognise(this.view);
    this.panel.show();
    this.differences.mark();
    void this.differences.refresh();
    this.evidence.viewed(this.view);
  }

  /** What to do with an empty sheet. @param {boolean} empty */
  hint(empty) {
    byId("nothing").hidden = !empty;
    if (empty) byId("nothing").replaceChildren(el("h2", {}, "An empty sheet"), el("ol", {},
      el("li", {}, "Open the ", el("button", { id: "open-library", onclick: () => this.palette.toggle(true) }, "Library"), " and drag a component here, or select it and press Enter."),
      el("li", {}, "Draw wires from port to port: a port that is not connected is an orange circle."),
      el("li", {}, "Press Run, then click parts and wires to plot their signals.")), el("p", {}, "Or write ", el("code", {}, "components:"), " and ", el("code", {}, "nodes:"), " in the text."));
  }

  /** Forget what the diagram no longer has. */
  tidy() {
    const known = new Set([...this.view.parameters, ...Object.values(this.view.parts).flatMap((p) => p.parameters)].filter((p) => p.slider).map((p) => p.path));
    if (this.picked && !this.view[`${this.picked.kind}s`]?.[this.picked.path]) this.picked = this.diagram.picked = null;
    if (!this.picked || this.chosen.some((part) => !this.view.parts[part])) this.chosen = [];
    this.runs.values = Object.fromEntries(Object.entries(this.runs.values).filter(([path]) => known.has(path)));
    if (!this.runs.plotted.length && !this.runs.live) this.runs.recall(this.view.outputs.slice(0, 4).map((/** @type {any} */ o) => o.name));
  }

  /** @param {any[]} problems */
  showProblems(problems) {
    const loose = problems.filter(isUnconnected), many = loose.length > FEW ? loose : [];
    const item = (/** @type {any} */ p) => el("li", {}, el("button", { class: "problem", onclick: () => {
      if (p.line) this.editor.show(p.line, true);
      if (p.part) this.pick("part", p.part);
    } }, el("b", {}, p.line ? `line ${p.line}: ` : p.file ? `${p.file}, line ${p.other_line}: ` : ""), ...message(p.message),
    el("span", { class: "hint" }, ...message([...p.notes, p.hint].filter(Boolean).join("\n")))));
    byId("problems").replaceChildren(problems.length ? el("ul", {}, ...problems.filter((p) => !many.includes(p)).map(item),
      many.length ? el("li", {}, el("details", {}, el("summary", {}, `${many.length} ports and inputs are not connected yet`), el("ul", {}, ...many.map(item)))) : null) : el("p", { class: "fine" }, "No problems found."));
    const count = byId("to-problems");
    count.textContent = problems.length ? `${problems.length} ${problems.length > 1 ? "problems" : "problem"}` : "No problems";
    count.classList.toggle("wrong", problems.length > 0);
  }

  /** Parts of the outermost sheet together; the last of them is the one that leads. @param {string[]} parts */
  chooseParts(parts) {
    if (parts.length < 2) { this.pick(parts.length ? "part" : "", parts[0] ?? ""); return; }
    this.picked = { kind: "part", path: parts[parts.length - 1] };
    this.chosen = parts;
    this.diagram.pick("part", this.picked.path);
    this.panel.show();
    byId("panel").scrollTop = 0;
    this.say(`${parts.length} parts selected`);
  }

  /** One part more, or one less. @param {string} path */
  chooseToo(path) {
    const now = this.chosen.length ? this.chosen : this.picked?.kind === "part" && !this.picked.path.includes(".") ? [this.picked.path] : [];
    this.chooseParts(now.includes(path) ? now.filter((p) => p !== path) : [...now, path]);
  }

  /** @param {string} kind @param {string} path */
  pick(kind, path) {
    this.picked = kind ? { kind, path } : null;
    this.chosen = [];
    this.diagram.pick(kind, path);
    this.panel.show();
    byId("panel").scrollTop = 0;
    this.evidence.picked(kind, path);
    const line = kind && this.view?.[`${kind}s`]?.[path]?.line;
    if (line && document.activeElement !== this.editor.view.contentDOM) this.editor.show(line);
  }

  /** @param {number} line */
  atLine(line) {
    const found = Object.entries(this.view?.parts ?? {}).find(([path, part]) => part.line === line && !path.includes("."));
    if (found) this.pick("part", found[0]);
  }

  /** The file of a component, with the way back. @param {string} path @param {string} [part] of it that is selected there */
  async editBlock(path, part) {
    const found = this.view?.parts?.[path];
    if (!found?.file) { if (found) this.edits.refuse(`'${found.kind}' is part of the library or of a bundled machine, which cannot be changed.`); return; }
    await this.open(found.file, [...this.trail, this.document.name]);
    if (part) this.pick("part", part.slice(path.length + 1));
  }

  /** The diagram from which one came, with its text as it was left. */
  async goBack() {
    const trail = this.trail.slice(), name = trail.pop();
    if (!name) return;
    await this.open(name, trail);
    document.getElementById("draft-take")?.click();
  }

  /** @param {string} path */
  openBlock(path) {
    if (!this.view?.parts?.[path]?.block) return;
    this.opened = this.opened.includes(path) ? this.opened.filter((p) => p !== path && !p.startsWith(`${path}.`)) : [...this.opened, path];
    this.pick("part", path);
    return this.check(true);
  }
}

const studio = new Studio();
Object.assign(window, { studio }); // for tests, and for who wants to look
void studio.begin();
