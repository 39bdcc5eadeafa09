// The library: components by domain, searched, read about and placed.

import { byId, el, number } from "./dom.js";
import { GRID, freePlace } from "./grid.js";
import { symbolOf } from "./handling.js";
import { problemList } from "./results.js";

const STEPS = 12; // of the grid between FMUs that are dropped together
const BOTH = 1900; // px of the page from which on the library stands beside the text
/** Other words for what the library has. @type {Record<string, string>} */
const MEANT = { wall: "fixed", ground: "fixed", frame: "fixed", anchor: "fixed", support: "fixed", dashpot: "damper", weight: "mass", load: "mass", gravity: "weight",
  flywheel: "inertia", gearbox: "gear", reservoir: "tank", restriction: "orifice", throttle: "orifice", hose: "line", pipe: "line", battery: "voltage", coil: "inductor" };

export class Palette {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.place = byId("palette");
    /** @type {any[]} */ this.groups = [];
    this.wanted = "";
    this.loaded = "";
    /** @type {{name: string, done: Promise<any>}|null} */ this.loading = null;
    /** @type {Map<string, any>|null} */ this.components = null;
    /** @type {Set<string>} */ this.closed = new Set();
  }

  get shown() { return !this.place.hidden; }

  toggle(on = !this.shown) {
    this.place.hidden = !on;
    byId("model").classList.toggle("with-palette", on);
    byId("toggle-palette").setAttribute("aria-pressed", String(on));
    const text = !byId("model").classList.contains("no-text");
    if (on && text && innerWidth < BOTH) { this.instead = true; this.studio.toggleText(); } // the drawing keeps its room
    if (!on && this.instead) { this.instead = false; if (!text) this.studio.toggleText(); }
    if (!on) return;
    void this.load();
    document.getElementById("palette-search")?.focus(); // words may be typed before the components are there
  }

  /** As for a diagram that was just opened, whose folder may have components of its own. */
  clear() {
    this.loaded = "";
    this.components = null;
    if (this.shown) this.toggle(false);
  }

  load() {
    const name = this.studio.document.name;
    if (this.loaded === name) return undefined;
    if (this.loading?.name === name) return this.loading?.done;
    const done = this.fetch(name).catch((error) => this.content?.replaceChildren(el("p", { class: "empty" }, error.message))).finally(() => { this.loading = null; });
    this.loading = { name, done };
    return done;
  }

  /** @param {string} name of the document */
  async fetch(name) {
    this.groups = [];
    this.components = null;
    this.build();
    const told = await this.studio.link.ask("palette", { name });
    if (told.kind !== "done" || this.studio.document?.name !== name) return;
    this.loaded = name;
    this.groups = told.groups;
    this.components = new Map(told.groups.flatMap((/** @type {any} */ g) => g.components.map((/** @type {any} */ c) => [c.name, c])));
    this.closed = new Set(told.groups.map((/** @type {any} */ g) => g.name).filter((/** @type {string} */ n) => n !== "this folder"));
    this.list();
  }

  build() {
    const search = el("input", { id: "palette-search", type: "search", placeholder: "Search the library", "aria-label": "Search the library", value: this.wanted, autocomplete: "off", spellcheck: "false",
      oninput: (/** @type {any} */ event) => { this.wanted = event.target.value; this.list(); },
      onkeydown: (/** @type {KeyboardEvent} */ event) => {
        const first = (/** @type {(entry: HTMLElement) => void} */ act) => { // as soon as the library is there
          event.preventDefault();
          void Promise.resolve(this.load()).then(() => { const entry = this.entries()[0]; if (entry) act(entry); });
        };
        if (event.key === "ArrowDown") first((entry) => entry.focus());
        if (event.key === "Enter") first((entry) => this.put(entry.dataset.component ?? ""));
        if (event.key === "Escape") { this.toggle(false); byId("sheet").focus(); }
      } });
    this.content = el("div", { class: "list" });
    this.about = el("div", { class: "about", hidden: true, tabindex: "-1" });
    const chooser = /** @type {HTMLInputElement} */ (el("input", { id: "fmu-files", type: "file", accept: ".fmu", multiple: true, hidden: true,
      onchange: () => { void this.addFmus([...(chooser.files ?? [])]); chooser.value = ""; } }));
    const add = el("button", { id: "add-fmu", disabled: !this.studio.edits.possible, title: "Store an FMU (FMI 2.0 or 3.0) in the folder of the diagram and place it as a part; or drop the file on the drawing", onclick: () => chooser.click() }, "Add an FMU…");
    this.place.replaceChildren(search, this.content, this.about, el("div", { class: "more" }, add, chooser));
    this.list();
  }

  /** @returns {HTMLElement[]} */
  entries() { return [.../** @type {any} */ (this.content?.querySelectorAll("[data-component]") ?? [])]; }

  /** Components whose name or summary has all words that are searched for; names first. */
  list() {
    if (!this.components) { this.content?.replaceChildren(el("p", { class: "empty" }, "Reading the library…")); return; }
    const words = this.wanted.toLowerCase().split(/\s+/).filter(Boolean);
    const meant = words.map((w) => MEANT[w]);
    const rank = (/** @type {any} */ c) => meant.every((m) => m && c.name.toLowerCase().includes(m)) ? 0 : words.every((w) => c.name.toLowerCase().includes(w)) ? (c.name.toLowerCase().startsWith(words[0] ?? "") ? 0 : 1) :
      words.every((w) => `${c.name} ${c.summary} ${Object.values(c.ports).join(" ")}`.toLowerCase().includes(w)) ? 2 : 3;
    if (words.length) {
      const found = this.groups.flatMap((g) => g.components).map((c) => ({ c, r: rank(c) })).filter(({ r }) => r < 3).sort((a, b) => a.r - b.r || a.c.name.length - b.c.name.length);
      this.content?.replaceChildren(found.length ? el("ul", {}, ...found.slice(0, 60).map(({ c }) => this.entry(c))) : el("p", { class: "empty" }, "No component has these words."));
      return;
    }
    this.content?.replaceChildren(...this.groups.map((g) => el("details", { open: !this.closed.has(g.name),
      ontoggle: (/** @type {any} */ event) => { const open = event.target.open; this.closed[open ? "delete" : "add"](g.name); if (open && !event.target.querySelector("ul")) event.target.append(el("ul", {}, ...g.components.map((/** @type {any} */ c) => this.entry(c)))); } },
      el("summary", {}, g.name, el("span", { class: "count" }, ` ${g.components.length}`)))));
    for (const details of this.content?.querySelectorAll("details[open]") ?? []) details.dispatchEvent(new Event("toggle"));
  }

  /** @param {any} c */
  entry(c) {
    const button = el("button", { class: "component", "data-component": c.name, title: `${c.summary}\nDrag it onto the drawing, or press Enter.`,
      onpointerdown: (/** @type {PointerEvent} */ event) => { if (event.button === 0 && this.studio.edits.possible) this.studio.handling.bring(event, c, () => { button.focus(); void this.tell(c.name); }); },
      onkeydown: (/** @type {KeyboardEvent} */ event) => this.key(event, c),
      ondblclick: () => this.put(c.name) }, el("span", { class: "symbol" }, symbolOf(c)), el("span", {}, el("b", {}, ...c.name.split(/(?<=[a-z0-9])(?=[A-Z])/).flatMap((/** @type {string} */ word, /** @type {number} */ k) => k ? [el("wbr"), word] : [word])), el("span", { class: "doc" }, c.summary)));
    return el("li", {}, button);
  }

  /** @param {KeyboardEvent} event @param {any} c */
  key(event, c) {
    const all = this.entries(), k = all.indexOf(/** @type {HTMLElement} */ (event.currentTarget));
    /** @type {Record<string, () => void>} */
    const keys = { ArrowDown: () => all[k + 1]?.focus(), ArrowUp: () => (all[k - 1] ?? document.getElementById("palette-search"))?.focus(),
      Enter: () => this.put(c.name), " ": () => this.tell(c.name), Escape: () => { this.toggle(false); byId("sheet").focus(); } };
    if (!keys[event.key] || event.ctrlKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
  }

  /** Place a component: by the keyboard at a free place. @param {string} kind @param {{x: number, y: number}} [at] in steps @returns {Promise<boolean>} whether it was placed */
  async put(kind, at) {
    const { edits, view } = this.studio, place = at ?? freePlace(this.studio.diagram.svg ? view?.places : {}, edits.selected?.kind === "part" ? edits.selected.path : undefined);
    const done = await edits.act({ act: "place", kind, ...place });
    if (done) this.studio.panel.ask();
    return done;
  }

  /** Store FMUs next to the diagram and place them as parts. @param {File[]} files @param {MouseEvent} [event] the drop, if it was on the drawing */
  async addFmus(files, event) {
    const { studio } = this, { edits, diagram } = studio, name = studio.document?.name;
    if (!edits.possible) { edits.refuse("This diagram is read only. Copy or extend it to add an FMU."); return; }
    const on = event && diagram.svg && byId("sheet").contains(/** @type {Node} */ (event.target)) ? diagram.point(event) : null;
    let at = on ? { x: Math.round(on.x / GRID), y: Math.round(on.y / GRID) } : undefined;
    for (const file of files) {
      try {
        studio.say(`storing ${file.name}`);
        const stored = await studio.records.store(name, file);
        if (studio.document?.name !== name) return;
        studio.say("");
        this.loaded = ""; // it is in the library of the folder now
        if (await this.put(stored.split("/").at(-1) ?? "", at) && !studio.runsFmus) studio.banner([`${file.name} is a program. It runs if you trust it and start the studio with --allow-fmu; drawing and checking only read its description.`]);
        at &&= { x: at.x, y: at.y + STEPS };
      } catch (error) {
        studio.say("");
        studio.banner(problemList(/** @type {any} */ (error).problems ?? [{ message: /** @type {any} */ (error).message, notes: [] }]));
      }
    }
    if (this.shown) void this.load();
  }

  /** What the page of a component says. @param {string} kind */
  async tell(kind) {
    const told = await this.studio.link.ask("component", { name: this.studio.document.name, kind });
    if (told.kind !== "done" || !this.about) return;
    const limits = (/** @type {any} */ p) => [p.limits[0] !== null && `at least ${number(p.limits[0])}`, p.limits[1] !== null && `at most ${number(p.limits[1])}`].filter(Boolean).join(", ");
    this.about.hidden = false;
    this.about.replaceChildren(.../** @type {any[]} */ ([el("div", { class: "head" }, el("b", {}, told.name), el("button", { class: "main", id: "place", disabled: !this.studio.edits.possible, title: this.studio.edits.possible ? "Place it on the drawing (Enter)" : "This diagram is read only: copy or extend it to change it", onclick: () => this.put(kind) }, "Place"),
      el("button", { id: "close-about", "aria-label": "Close the description", onclick: () => { if (this.about) this.about.hidden = true; } }, "×")),
      el("p", {}, told.summary), told.restrictions && el("p", { class: "restrictions" }, `Neglected: ${told.restrictions}`),
      el("h4", {}, "Ports"), el("ul", {}, ...told.port_list.map((/** @type {any} */ p) => el("li", {}, el("code", {}, p.name), ` ${p.what}${p.doc ? `, ${p.doc}` : ""}`))),
      told.parameter_list.length && el("h4", {}, "Parameters"), told.parameter_list.length && el("ul", {}, ...told.parameter_list.map((/** @type {any} */ p) => el("li", {}, el("code", {}, p.name), `${p.unit ? ` [${p.unit}]` : ""} ${p.doc}`,
        el("span", { class: "doc" }, ` ${[p.default ? `default ${p.default}` : "required", limits(p)].filter(Boolean).join(", ")}`)))),
      told.equations.length && el("h4", {}, "Equations"), told.equations.length && el("pre", {}, told.equations.join("\n")), told.source && el("p", { class: "doc" }, `Source: ${told.source}`)]).filter(Boolean));
  }
}
