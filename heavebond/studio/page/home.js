// The first page: the diagrams of the folder, a new one, and the machines that come with heavebond.

import { askName, byId, el } from "./dom.js";

export const FMU = /\.fmu$/i;

/** @param {any} studio @param {any} told */
export function showHome(studio, told) {
  const open = (/** @type {string} */ name, /** @type {string} */ text) => el("button", { class: "plain", "data-open": name, onclick: () => studio.open(name) }, text);
  const fresh = (/** @type {boolean} */ empty) => {
    const templates = empty ? undefined : el("fieldset", { class: "templates" }, el("legend", {}, "Begin with"), ...told.templates.map((/** @type {any} */ t, /** @type {number} */ k) =>
      el("label", {}, el("input", { type: "radio", name: "template", value: t.name, checked: k === 0 }), t.title)));
    askName(empty ? "An empty diagram" : "A new diagram", "Name (letters, digits and _):", "machine", async (name) => {
      const chosen = /** @type {HTMLInputElement|null} */ (byId("ask").querySelector("[name=template]:checked"));
      const made = await studio.link.ask("new", { name, empty, ...(chosen ? { template: chosen.value } : {}) });
      return () => studio.open(made.name);
    }, "Make", templates);
  };
  const chooser = /** @type {HTMLInputElement} */ (el("input", { id: "import-file", type: "file", accept: ".emx,.urdf,.fmu", hidden: true, onchange: () => { const [file] = chooser.files ?? []; if (file) void importModel(studio, file); chooser.value = ""; } }));
  const drawings = new Drawings(studio);
  const cards = (/** @type {any[]} */ found) => el("ul", { class: "cards" }, ...found.map((d) => {
    const cut = d.name.lastIndexOf("/") + 1;
    return drawings.on(d.name, el("li", { "data-words": `${d.name} ${d.summary}`.toLowerCase() }, cut ? el("span", { class: "where" }, d.name.slice(0, cut)) : null, el("b", {}, open(d.name, d.name.slice(cut))), d.summary && el("p", {}, d.summary)));
  }));
  const diagrams = told.diagrams.filter((/** @type {any} */ d) => d.kind === "model"), of = (/** @type {string} */ kind) => told.diagrams.filter((/** @type {any} */ d) => d.kind === kind), experiments = of("experiment"), components = of("component"), studies = of("study");
  const own = diagrams.length ? cards(diagrams)
    : !told.there ? el("p", { class: "verdict", role: "alert" }, `The folder ${told.folder} is not there any more. Put it back, or start heavebond studio in another folder.`)
    : el("p", { class: "none" }, "No diagrams yet. Make a new one, or copy a machine from below and change it.");
  /** @type {Map<string, any[]>} */
  const machines = new Map();
  for (const m of told.machines) machines.set(m.machine, [...(machines.get(m.machine) ?? []), m]);
  byId("home").replaceChildren(
    el("h2", {}, "Diagrams in ", el("code", { title: told.folder }, told.folder.split("/").at(-1) || told.folder)), el("div", { class: "start" }, el("button", { class: "main", id: "new", onclick: () => fresh(false) }, "New diagram"),
      el("button", { id: "new-empty", onclick: () => fresh(true) }, "Empty diagram"), el("button", { id: "import", title: "Translate a 20-sim model (.emx) or a robot (.urdf) into a folder with a diagram and components, or begin a diagram with an FMU (.fmu)", onclick: () => chooser.click() }, "Import…"), chooser,
      el("button", { id: "begin-tour", title: "The studio in three minutes, on the heave compensator", onclick: () => void studio.tour.begin() }, "Tour"), el("input", { id: "filter", type: "search", placeholder: "Find a diagram", "aria-label": "Find a diagram by name or summary", autocomplete: "off", oninput: (/** @type {any} */ event) => filter(event.target.value) })), own,
    ...(experiments.length ? [el("h2", {}, "Experiments"), el("p", {}, "Diagrams with measured records."), cards(experiments)] : []),
    ...(studies.length ? [el("h2", {}, "Studies"), el("p", {}, "Many runs of a diagram: parameters varied, measured and tuned."), cards(studies)] : []),
    ...(components.length ? [el("h2", {}, "Components"), el("p", {}, "Parts of your own, for the diagrams in their folder."), cards(components)] : []),
    el("h2", {}, "Machines that come with heavebond"), el("p", {}, "Open and run them, or copy them into the folder."),
    el("ul", { class: "cards" }, ...[...machines].map(([name, all]) => machine(open, name, all, drawings))));
}

/** A model of another program into the folder; what was not translated is listed. An FMU becomes the first part of a new diagram. @param {any} studio @param {File} file */
export async function importModel(studio, file) {
  if (FMU.test(file.name)) {
    const name = file.name.replace(FMU, "").replace(/\W+/g, "_").replace(/^[\d_]+/, "");
    askName(`A diagram with ${file.name}`, "Name (letters, digits and _):", name || "machine", async (/** @type {string} */ wanted) => {
      const made = await studio.link.ask("new", { name: wanted, empty: true });
      return async () => { await studio.open(made.name); await studio.palette.addFmus([file]); };
    });
    return;
  }
  try {
    studio.banner([`Importing ${file.name}…`]);
    const made = await studio.link.ask("import", { name: file.name, content: await base64(file) });
    await studio.open(made.name);
    if (made.untranslated.length) studio.banner([`Not translated: ${made.untranslated.join("; ")}.${made.placeholders.length ? ` ${made.placeholders.join(", ")}: components without a law, which you write.` : ""}`]);
  } catch (error) {
    studio.banner([error instanceof Error ? error.message : String(error)]);
  }
}

/** The bytes of a file as text. @param {File} file @returns {Promise<string>} */
const base64 = (file) => new Promise((done, failed) => {
  const reader = new FileReader();
  reader.onload = () => done(String(reader.result).split(",")[1] ?? "");
  reader.onerror = () => failed(new Error(`${file.name} cannot be read`));
  reader.readAsDataURL(file);
});

/** @type {Map<string, SVGElement>} the drawings as they were last, shown until the present ones are known */
const last = new Map();
const KEPT = 100, MANY = 1200; // drawings; elements of a drawing, above which it is a box of few pixels anyway

/** Small drawings on the cards, made one after the other as the cards come into view. */
class Drawings {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    /** @type {Map<Element, string>} */ this.waiting = new Map();
    this.working = false;
    this.observer = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) {
        const name = /** @type {HTMLElement} */ (target).dataset.drawing ?? "";
        if (isIntersecting) this.waiting.set(target, name);
        else this.waiting.delete(target); // scrolled by
      }
      void this.work();
    }, { root: byId("home"), rootMargin: "80px" });
  }

  /** @template {HTMLElement} T @param {string} name @param {T} card */
  on(name, card) {
    const frame = el("div", { class: "thumbnail waiting", "data-drawing": name, "aria-hidden": "true" }, "drawing…");
    if (last.has(name)) frame.classList.remove("waiting");
    if (last.has(name)) frame.replaceChildren(/** @type {any} */ (last.get(name)).cloneNode(true));
    card.prepend(frame);
    this.observer.observe(frame);
    return card;
  }

  async work() {
    if (this.working) return;
    this.working = true;
    while (this.waiting.size && !byId("home").hidden) {
      const [frame, name] = /** @type {[HTMLElement, string]} */ (this.waiting.entries().next().value);
      this.waiting.delete(frame);
      if (!frame.isConnected) continue;
      this.observer.unobserve(frame);
      try { this.show(frame, name, (await this.studio.link.ask("thumbnail", { name })).svg ?? ""); }
      catch (error) {
        last.delete(name);
        frame.classList.replace("waiting", "broken");
        frame.replaceChildren("cannot be drawn");
        frame.title = error instanceof Error ? error.message : String(error);
        frame.removeAttribute("aria-hidden");
      }
    }
    this.working = false;
  }

  /** @param {HTMLElement} frame @param {string} name @param {string} text */
  show(frame, name, text) {
    frame.classList.remove("waiting");
    frame.replaceChildren();
    if (!text) return;
    const svg = /** @type {any} */ (document.importNode(new DOMParser().parseFromString(text, "image/svg+xml").documentElement, true));
    svg.querySelector(":scope > rect")?.remove();
    if (svg.querySelectorAll("*").length > MANY) return;
    for (const shape of svg.querySelectorAll("[data-part], [data-node]")) for (const name of ["data-part", "data-node"]) shape.removeAttribute(name); // nothing to select
    frame.replaceChildren(svg);
    const boxes = [...svg.querySelectorAll("g.part, path.wire")].map((shape) => shape.getBoundingClientRect()).filter((b) => b.width || b.height), on = svg.getScreenCTM();
    if (boxes.length && on) { // without the room of the title and the key
      const [x, y] = [Math.min(...boxes.map((b) => b.left)) - 2, Math.min(...boxes.map((b) => b.top)) - 2];
      const [w, h] = [Math.max(...boxes.map((b) => b.right)) - x + 2, Math.max(...boxes.map((b) => b.bottom)) - y + 2];
      svg.setAttribute("viewBox", [(x - on.e) / on.a, (y - on.f) / on.d, w / on.a, h / on.d].join(" "));
    }
    last.delete(name);
    last.set(name, svg.cloneNode(true));
    if (last.size > KEPT) last.delete(last.keys().next().value ?? "");
  }
}

/** Only cards that have all words of a search; headings without cards go, too. @param {string} text */
function filter(text) {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  for (const card of /** @type {NodeListOf<HTMLElement>} */ (byId("home").querySelectorAll(".cards > li"))) card.hidden = !words.every((w) => card.dataset.words?.includes(w));
  for (const cards of byId("home").querySelectorAll(".cards")) {
    const none = Boolean(words.length) && ![...cards.children].some((card) => !(/** @type {HTMLElement} */ (card).hidden));
    for (let above = cards.previousElementSibling; above?.matches("h2, p"); above = above.matches("h2") ? null : above.previousElementSibling) /** @type {HTMLElement} */ (above).hidden = none;
  }
}

/** @param {(name: string, text: string) => Node} open @param {string} name @param {any[]} all @param {Drawings} drawings */
function machine(open, name, all, drawings) {
  const main = all.find((m) => m.name === `bundled:${name}`), rest = all.filter((m) => m !== main);
  const list = el("ul", {}, ...rest.map((m) => el("li", { title: m.summary }, open(m.name, m.name.split("/").at(-1)), m.kind === "experiment" ? el("span", { class: "hint" }, " experiment with records") : null)));
  const words = { "data-words": `${name} ${all.map((m) => `${m.name} ${m.summary}`).join(" ")}`.toLowerCase() };
  if (!main) return el("li", words, el("b", {}, name), el("p", {}, "A collection of small diagrams."), el("details", {}, el("summary", {}, `${rest.length} diagrams`), list));
  return drawings.on(main.name, el("li", words, el("b", {}, open(main.name, name)), el("p", {}, main.summary),
    rest.length ? el("details", {}, el("summary", {}, `${rest.length} ${rest.length > 1 ? "variants" : "variant"}`), list) : null,
    main.studies ? el("p", {}, `Its copy comes with ${main.studies} studies.`) : null));
}
