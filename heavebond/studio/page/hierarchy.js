// The tree of the parts of the open machine, with the parts of its blocks below them.

import { byId, el } from "./dom.js";

const TYPED = 700; // ms between two letters of a name

export class Hierarchy {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.box = /** @type {HTMLDetailsElement} */ (byId("hierarchy"));
    this.tree = byId("tree");
    this.drawn = ""; // the parts that are listed
    /** @type {Set<string>} */ this.unfolded = new Set();
    this.word = "";
    this.last = 0;
    this.box.addEventListener("toggle", () => this.show());
    this.tree.addEventListener("click", (event) => this.click(event));
    this.tree.addEventListener("dblclick", (event) => { const item = this.item(event.target); if (item && !this.onMark(event.target)) studio.openBlock(item.dataset.path); });
    this.tree.addEventListener("keydown", (event) => this.key(event));
  }

  /** List the parts of the present diagram, and mark the selected one. */
  show() {
    const { view, document: opened } = this.studio, parts = view?.parts ?? {}, paths = Object.keys(parts);
    this.box.hidden = !paths.length;
    byId("part-count").textContent = `${paths.length}`;
    if (!this.box.open || !paths.length) return;
    const key = JSON.stringify([opened?.name, paths.map((path) => [path, parts[path].kind])]);
    if (key !== this.drawn) {
      const focused = this.item(globalThis.document.activeElement)?.dataset.path;
      this.drawn = key;
      /** @type {Map<string, string[]>} */
      const below = new Map();
      for (const path of paths) {
        const owner = this.owner(path);
        below.set(owner, [...(below.get(owner) ?? []), path]);
      }
      /** @type {(owner: string, level: number) => HTMLElement[]} */
      const list = (owner, level) => (below.get(owner) ?? []).map((path) => el("li", { role: "treeitem", "data-path": path, tabindex: "-1", "aria-level": level, "aria-selected": "false",
        "aria-expanded": below.has(path) ? String(this.unfolded.has(path)) : null, "aria-label": `${path.slice(owner ? owner.length + 1 : 0)}, ${parts[path].kind}` },
      el("span", { class: "row" }, el("span", { class: "mark", "aria-hidden": "true" }), path.slice(owner ? owner.length + 1 : 0), " ", el("span", { class: "kind" }, parts[path].kind)),
      below.has(path) ? el("ul", { role: "group" }, ...list(path, level + 1)) : null));
      this.tree.replaceChildren(...list("", 1));
      if (focused) this.focus(this.of(focused) ?? this.items()[0]);
    }
    const faulty = new Set(view.problems.map((/** @type {any} */ p) => p.part)), picked = this.studio.picked?.kind === "part" ? this.studio.picked.path : "";
    for (let above = this.owner(picked); above; above = this.owner(above)) this.fold(this.of(above), false);
    for (const item of this.all()) {
      item.setAttribute("aria-selected", String(item.dataset.path === picked || this.studio.chosen.includes(item.dataset.path)));
      item.classList.toggle("faulty", faulty.has(item.dataset.path));
    }
    const stop = this.of(picked) ?? this.all().find((item) => item.tabIndex === 0) ?? this.all()[0];
    for (const item of this.all()) item.tabIndex = item === stop ? 0 : -1;
    if (picked && !this.tree.contains(globalThis.document.activeElement)) this.of(picked)?.querySelector(".row")?.scrollIntoView({ block: "nearest" });
  }

  /** The block in which a part is; nothing for a part of the diagram itself. @param {string} path */
  owner(path) {
    const parts = this.studio.view?.parts ?? {};
    for (let cut = path.lastIndexOf("."); cut > 0; cut = path.lastIndexOf(".", cut - 1)) if (parts[path.slice(0, cut)]) return path.slice(0, cut);
    return "";
  }

  /** @returns {HTMLElement[]} */
  all() { return [.../** @type {any} */ (this.tree.querySelectorAll("li"))]; }

  /** The items that are seen, from top to bottom. */
  items() { return this.all().filter((item) => !item.parentElement?.closest("li[aria-expanded=false]")); }

  /** @param {any} target @returns {HTMLElement|null} */
  item(target) { return this.tree.contains(target) ? target.closest("li") : null; }

  /** @param {string} path */
  of(path) { return this.all().find((item) => item.dataset.path === path); }

  /** @param {any} target */
  onMark(target) { return Boolean(target.closest?.(".mark")) && Boolean(this.item(target)?.hasAttribute("aria-expanded")); }

  /** @param {HTMLElement|undefined|null} item @param {boolean} folded */
  fold(item, folded) {
    if (!item?.hasAttribute("aria-expanded")) return;
    item.setAttribute("aria-expanded", String(!folded));
    if (folded) this.unfolded.delete(item.dataset.path ?? "");
    else this.unfolded.add(item.dataset.path ?? "");
  }

  /** @param {HTMLElement|undefined|null} item */
  focus(item) {
    if (!item) return;
    for (const other of this.all()) other.tabIndex = other === item ? 0 : -1;
    item.focus();
    item.querySelector(".row")?.scrollIntoView({ block: "nearest" });
  }

  /** @param {MouseEvent} event */
  click(event) {
    const item = this.item(event.target);
    if (!item) return;
    if (this.onMark(event.target)) this.fold(item, item.getAttribute("aria-expanded") === "true");
    else if (event.detail < 2) this.select(item);
    this.focus(item);
  }

  /** @param {HTMLElement} item */
  select(item) { this.selectPath(item.dataset.path ?? ""); }

  /** Select a part on the drawing; the blocks around it are opened. @param {string} path */
  selectPath(path) {
    const { studio } = this, closed = [];
    for (let above = this.owner(path); above; above = this.owner(above)) if (!studio.view.opened.includes(above)) closed.unshift(above);
    studio.opened = [...studio.opened, ...closed.filter((block) => !studio.opened.includes(block))];
    studio.pick("part", path);
    if (closed.length) void studio.check(true);
    else studio.diagram.reveal();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const item = this.item(event.target);
    if (!item || event.ctrlKey || event.altKey || event.metaKey) return;
    const seen = this.items(), at = seen.indexOf(item), open = item.getAttribute("aria-expanded");
    const above = /** @type {HTMLElement|null|undefined} */ (item.parentElement?.closest("li"));
    /** @type {Record<string, () => void>} */
    const keys = { ArrowDown: () => this.focus(seen[at + 1]), ArrowUp: () => this.focus(seen[at - 1]), Home: () => this.focus(seen[0]), End: () => this.focus(seen[seen.length - 1]),
      ArrowRight: () => open === "false" ? this.fold(item, false) : open && this.focus(seen[at + 1]), ArrowLeft: () => open === "true" ? this.fold(item, true) : this.focus(above),
      Enter: () => this.select(item), " ": () => this.select(item) };
    const act = keys[event.key];
    if (act) act();
    else if (event.key.length === 1 && /\S/.test(event.key)) {
      if (event.timeStamp - this.last > TYPED) this.word = "";
      this.word += event.key.toLowerCase();
      this.last = event.timeStamp;
      const from = this.word.length > 1 ? at : at + 1;
      this.focus([...seen.slice(from), ...seen.slice(0, from)].find((found) => (found.getAttribute("aria-label") ?? "").toLowerCase().startsWith(this.word)));
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }
}
