// The differences of the open diagram from another one: a list in the panel, and marks on the drawing.

import { busy, byId, el } from "./dom.js";

const SVG = "http://www.w3.org/2000/svg", HIGH = 34, APART = 14, LETTER = 6.4; // px of the boxes of removed parts
/** @type {[string, string][]} */
const KINDS = [["part", "Parts"], ["value", "Values"], ["wire", "Wires"], ["output", "Outputs"], ["start", "Start"], ["run", "Run"]];

export class Differences {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.other = ""; // the diagram with which the open one is compared
    /** @type {any[]|null} */ this.found = null;
    this.failed = "";
    this.high = 0; // of the drawing without removed parts
    byId("differences").onclick = () => void this.ask();
  }

  /** No comparison any more. */
  clear() {
    Object.assign(this, { other: "", found: null, failed: "" });
    this.mark();
  }

  /** Ask for the other diagram. */
  async ask() {
    const { studio } = this, home = await studio.link.ask("list"), own = studio.document.name;
    const dialog = /** @type {HTMLDialogElement} */ (byId("ask")), form = /** @type {HTMLFormElement} */ (dialog.querySelector("form"));
    const options = (/** @type {string} */ label, /** @type {any[]} */ list) => list.length ? el("optgroup", { label }, ...list.map((d) => el("option", { value: d.name, selected: d.name === this.other }, d.name.replace(/^bundled:/, "")))) : null;
    const all = (/** @type {any[]} */ list) => list.filter((d) => d.name !== own && d.kind !== "component");
    const select = el("select", { id: "other-diagram" }, options("In the folder", all(home.diagrams ?? [])), options("Bundled machines", all(home.machines ?? [])));
    const wrong = el("p", { class: "wrong", role: "alert" });
    form.replaceChildren(el("b", {}, "Compare with another diagram"), el("p", {}, el("label", { for: "other-diagram" }, "The other diagram is the state before, the open one the state after:")), select, wrong,
      el("menu", {}, el("button", { type: "button", onclick: () => dialog.close() }, "Cancel"), el("button", { class: "main" }, "Compare")));
    form.onsubmit = (event) => {
      event.preventDefault();
      void busy(form, async () => {
        this.other = /** @type {HTMLSelectElement} */ (/** @type {any} */ (select)).value;
        await this.refresh();
        if (this.failed) { wrong.textContent = this.failed; this.clear(); return; }
        dialog.close();
        studio.pick("", "");
      });
    };
    dialog.setAttribute("aria-label", "Compare with another diagram");
    dialog.showModal();
  }

  /** Compare again, after a change. */
  async refresh() {
    const { studio, other } = this;
    if (!other) return;
    const { name, text, values } = studio.evidence.question();
    try {
      const told = await studio.link.ask("difference", { name, text, values, other });
      if (this.other !== other || studio.document?.name !== name || told.kind !== "done") return;
      Object.assign(this, { found: told.differences, failed: "" });
    } catch (error) {
      this.failed = error instanceof Error ? error.message : String(error);
    }
    this.mark();
    if (!studio.picked) studio.panel.show();
  }

  /** Marks of added and changed parts and wires; removed parts are boxes below the drawing. */
  mark() {
    const { svg } = this.studio.diagram, names = ["added", "changed"];
    if (!svg) return;
    for (const shape of svg.querySelectorAll(".added, .changed")) shape.classList.remove(...names);
    if (svg.querySelector(".removed-parts")) { svg.querySelector(".removed-parts")?.remove(); this.height(svg, this.high); }
    for (const d of this.found ?? []) {
      if (d.mark === "removed" && d.about === "part") continue;
      if (d.about === "wire") for (const wire of svg.querySelectorAll("path.wire")) { if (wire.getAttribute("data-node") === d.path) wire.classList.add(d.mark === "added" ? "added" : "changed"); }
      if (d.about === "part" || d.about === "value") this.shown(d)?.classList.add(d.about === "part" && d.mark === "added" && !this.inside(d) ? "added" : "changed");
    }
    const gone = (this.found ?? []).filter((d) => d.about === "part" && d.mark === "removed");
    if (!gone.length) return;
    const view = svg.viewBox.baseVal, wide = 16 + LETTER * Math.max(12, ...gone.map((d) => Math.max(d.path.length, d.before.length))), columns = Math.max(1, Math.floor(view.width / (wide + APART))), group = document.createElementNS(SVG, "g");
    group.setAttribute("class", "removed-parts");
    gone.forEach((d, k) => {
      const x = view.x + APART + (k % columns) * (wide + APART), y = view.y + view.height + Math.floor(k / columns) * (HIGH + APART);
      const make = (/** @type {string} */ tag, /** @type {Record<string, any>} */ given, /** @type {string} */ text = "") => {
        const made = document.createElementNS(SVG, tag);
        for (const [name, value] of Object.entries(given)) made.setAttribute(name, String(value));
        made.textContent = text;
        group.append(made);
      };
      make("rect", { x, y, width: wide, height: HIGH, rx: 4 });
      make("text", { x: x + 8, y: y + 14, class: "name" }, d.path);
      make("text", { x: x + 8, y: y + 27 }, d.before);
    });
    this.high = view.height;
    svg.append(group);
    this.height(svg, view.height + Math.ceil(gone.length / columns) * (HIGH + APART));
    if (this.studio.diagram.fitted) this.studio.diagram.fit();
  }

  /** @param {any} svg @param {number} high */
  height(svg, high) {
    const view = svg.viewBox.baseVal;
    svg.setAttribute("height", String(high));
    svg.setAttribute("viewBox", `${view.x} ${view.y} ${view.width} ${high}`);
  }

  /** The shape on the drawing that shows a difference: of its part, or of the closed block around it. @param {any} d @returns {Element|null} */
  shown(d) {
    for (let path = d.about === "part" ? d.path : this.part(d); path; path = path.split(".").slice(0, -1).join(".")) {
      const group = this.studio.diagram.group(path);
      if (group) return group;
    }
    return null;
  }

  /** Whether a part is drawn as a block around it only. @param {any} d */
  inside(d) { return this.shown(d)?.getAttribute("data-part") !== d.path; }

  /** The part that has a value. @param {any} d */
  part(d) {
    for (let path = d.path.split(".").slice(0, -1).join("."); path; path = path.split(".").slice(0, -1).join(".")) if (this.studio.view?.parts?.[path]) return path;
    return "";
  }

  /** The list for the panel. @returns {Node[]} */
  list() {
    if (!this.other) return [];
    const { studio } = this;
    /** @type {any[]} */
    const found = this.found ?? [];
    const entry = (/** @type {any} */ d) => {
      const part = d.about === "part" ? d.mark !== "removed" && d.path : d.about === "value" ? this.part(d) : "", node = d.about === "wire" && studio.view?.nodes?.[d.path] ? d.path : "";
      const go = part ? () => studio.panel.hierarchy.selectPath(part) : node ? () => studio.pick("node", node) : null;
      return el("li", { class: d.mark }, go ? el("button", { class: "plain", onclick: go }, d.path) : el("b", {}, d.path), ` ${d.mark}`,
        el("div", { class: "mono" }, d.before && el("del", {}, d.before), d.before && d.after ? " → " : "", d.after && el("ins", {}, d.after)));
    };
    return [el("h3", {}, `Differences from ${this.other.replace(/^bundled:/, "")}`), this.failed ? el("p", { class: "verdict", role: "alert" }, this.failed) : el("p", { role: "status" }, found.length ? `${found.length} ${found.length > 1 ? "differences" : "difference"}, before → after` : "The two diagrams do not differ."),
      ...KINDS.flatMap(([about, title]) => {
        const list = found.filter((d) => d.about === about);
        return list.length ? [el("b", {}, title), el("ul", { class: "differences" }, ...list.map(entry))] : [];
      }), el("button", { id: "end-differences", onclick: () => { this.clear(); studio.panel.show(); } }, "End the comparison")];
  }
}
