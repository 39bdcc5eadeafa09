// The first page: the diagrams of the folder, a new one, and the machines that come with heavebond.

import { askName, byId, el } from "./dom.js";

/** @param {any} studio @param {any} told */
export function showHome(studio, told) {
  const open = (/** @type {string} */ name, /** @type {string} */ text) => el("button", { class: "plain", "data-open": name, onclick: () => studio.open(name) }, text);
  const fresh = (/** @type {boolean} */ empty) => askName(empty ? "An empty diagram" : "A new diagram", "Its name, letters, digits and _:", "machine", async (name) => {
    const made = await studio.link.ask("new", { name, empty });
    return () => studio.open(made.name);
  });
  const cards = (/** @type {any[]} */ found) => el("ul", { class: "cards" }, ...found.map((d) => {
    const cut = d.name.lastIndexOf("/") + 1;
    return el("li", { "data-words": `${d.name} ${d.summary}`.toLowerCase() }, cut ? el("span", { class: "where" }, d.name.slice(0, cut)) : null, el("b", {}, open(d.name, d.name.slice(cut))), d.summary && el("p", {}, d.summary));
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
      el("button", { id: "new-empty", onclick: () => fresh(true) }, "Empty diagram"), el("input", { id: "filter", type: "search", placeholder: "Find a diagram", "aria-label": "Find a diagram by name or summary", autocomplete: "off", oninput: (/** @type {any} */ event) => filter(event.target.value) })), own,
    ...(experiments.length ? [el("h2", {}, "Experiments"), el("p", {}, "Diagrams with measured records."), cards(experiments)] : []),
    ...(studies.length ? [el("h2", {}, "Studies"), el("p", {}, "Many runs of a diagram: parameters varied, measured and tuned."), cards(studies)] : []),
    ...(components.length ? [el("h2", {}, "Components"), el("p", {}, "Parts of your own, for the diagrams in their folder."), cards(components)] : []),
    el("h2", {}, "Machines that come with heavebond"), el("p", {}, "To be looked at, run, and copied into the folder."),
    el("ul", { class: "cards" }, ...[...machines].map(([name, all]) => machine(open, name, all))));
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

/** @param {(name: string, text: string) => Node} open @param {string} name @param {any[]} all */
function machine(open, name, all) {
  const main = all.find((m) => m.name === `bundled:${name}`), rest = all.filter((m) => m !== main);
  const list = el("ul", {}, ...rest.map((m) => el("li", { title: m.summary }, open(m.name, m.name.split("/").at(-1)), m.kind === "experiment" ? el("span", { class: "hint" }, " experiment with records") : null)));
  const words = { "data-words": `${name} ${all.map((m) => `${m.name} ${m.summary}`).join(" ")}`.toLowerCase() };
  if (!main) return el("li", words, el("b", {}, name), el("p", {}, "A collection of small diagrams."), el("details", {}, el("summary", {}, `${rest.length} diagrams`), list));
  return el("li", words, el("b", {}, open(main.name, name)), el("p", {}, main.summary),
    rest.length ? el("details", {}, el("summary", {}, `${rest.length} ${rest.length > 1 ? "variants" : "variant"}`), list) : null,
    main.studies ? el("p", {}, `Its copy comes with ${main.studies} studies.`) : null);
}
