// The drawing: the SVG of `heavebond draw`, moved and scaled by mouse and keyboard, its parts and wires selected.

import { byId } from "./dom.js";

const SVG = "http://www.w3.org/2000/svg";
const LEAST = 0.05, MOST = 6, STEP = 40, RIM = [130, 80]; // px; the rim on both sides is where new columns and rows begin
const RIM_SHARE = 0.12; // of a small sheet at most

export class Diagram {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.onpick = (/** @type {string} */ kind, /** @type {string} */ path) => studio.pick(kind, path);
    this.onopen = (/** @type {string} */ path) => studio.openBlock(path);
    this.sheet = byId("sheet");
    /** @type {SVGSVGElement|null} */
    this.svg = null;
    this.drawn = ""; // of what is drawn
    this.scale = 1;
    this.x = 0;
    this.y = 0;
    this.frame = 0;
    /** @type {{kind: string, path: string}|null} */
    this.picked = null;
    this.fitted = false; // shows all, as long as nobody moves or scales it
    new ResizeObserver(() => { if (this.fitted) this.fit(); }).observe(this.sheet);
    this.listen();
  }

  /** @param {string} text @param {Record<string, any>} parts @param {boolean} fit */
  draw(text, parts, fit) {
    const key = text + JSON.stringify(Object.entries(parts).map(([path, part]) => [path, part.kind, part.block, part.ports]));
    if (key === this.drawn && !fit) return; // a comment or a value was typed
    this.drawn = key;
    const held = document.activeElement?.closest?.("[data-part], .reach"), focus = held && this.sheet.contains(held) ?
      [held.getAttribute("data-part"), held.getAttribute("data-node")] : null;
    const svg = /** @type {any} */ (document.importNode(new DOMParser().parseFromString(text, "image/svg+xml").documentElement, true));
    const before = this.svg?.viewBox.baseVal;
    this.sheet.replaceChildren(svg);
    this.svg = svg;
    if (before && !fit) { // what stands where it stood stays on the screen where it is
      this.x += (svg.viewBox.baseVal.x - before.x) * this.scale;
      this.y += (svg.viewBox.baseVal.y - before.y) * this.scale;
    }
    svg.querySelector(":scope > rect")?.remove(); // the white sheet; the page gives the ground
    // all sizes first: a change between two of them would lay out the whole drawing again
    const groups = [...svg.querySelectorAll("g.part[data-part]")], boxes = groups.map((group) => group.getBBox());
    groups.forEach((group, k) => this.prepare(group, boxes[k], parts));
    for (const note of svg.querySelectorAll("[data-note]"))
      for (const [name, value] of [["tabindex", "0"], ["role", "button"], ["aria-label", `note ${note.textContent}`]]) note.setAttribute(name, value);
    for (const wire of svg.querySelectorAll("path.wire[data-node]")) {
      const reach = document.createElementNS(SVG, "path");
      for (const [name, value] of [["d", wire.getAttribute("d")], ["data-node", wire.getAttribute("data-node")], ["class", "reach"],
        ["tabindex", "0"], ["role", "button"], ["aria-label", `node ${wire.getAttribute("data-node")}`]]) reach.setAttribute(name, value);
      wire.after(reach);
    }
    this.studio.wiring.draw(svg, parts);
    if (fit) this.fit();
    else { this.fitted = false; this.place(); } // everything stays on the screen where it is
    if (this.picked) this.pick(this.picked.kind, this.picked.path);
    if (focus) /** @type {any} */ ([...this.sheet.querySelectorAll("g.part, .reach")].find((found) => focus[0] ?
      found.getAttribute("data-part") === focus[0] : found.getAttribute("data-node") === focus[1] && found.classList.contains("reach")))?.focus();
  }

  /** A frame around a part, which takes clicks and shows what is selected. @param {any} group @param {DOMRect} box @param {Record<string, any>} parts */
  prepare(group, box, parts) {
    const path = group.getAttribute("data-part"), part = parts[path];
    const frame = document.createElementNS(SVG, "rect");
    for (const [name, value] of [["x", box.x - 4], ["y", box.y - 4], ["width", box.width + 8], ["height", box.height + 8], ["rx", 5], ["class", "frame"]])
      frame.setAttribute(String(name), String(value));
    group.prepend(frame);
    group.setAttribute("tabindex", "0");
    group.setAttribute("role", "button");
    group.setAttribute("aria-label", part ? `${path}, ${part.kind}${part.block ? ", a block" : ""}` : path);
  }

  /** No drawing: the diagram has no parts. */
  clear() {
    this.sheet.replaceChildren();
    this.svg = null;
    this.drawn = "";
  }

  /** A point of the screen in the coordinates of the drawing. @param {{clientX: number, clientY: number}} event */
  point(event) {
    const box = this.sheet.getBoundingClientRect(), view = this.svg?.viewBox.baseVal;
    return { x: (view?.x ?? 0) + (event.clientX - box.left - this.x) / this.scale, y: (view?.y ?? 0) + (event.clientY - box.top - this.y) / this.scale };
  }

  /** @param {string} path @returns {any} */
  group(path) { return [...this.sheet.querySelectorAll("g.part")].find((g) => g.getAttribute("data-part") === path) ?? null; }

  /** The name of a part beside its picture. @param {string} path @returns {any} */
  caption(path) { return [...this.sheet.querySelectorAll("g[data-part]:not(.part)")].find((g) => g.getAttribute("data-part") === path) ?? null; }

  /** Show all where what is selected lies outside of what is seen. */
  reveal() {
    const box = this.picked?.kind === "part" && this.group(this.picked.path)?.getBoundingClientRect(), seen = this.sheet.getBoundingClientRect();
    // the transform of the new drawing is set with the next frame
    if (box) requestAnimationFrame(() => requestAnimationFrame(() => {
      const now = this.picked && this.group(this.picked.path)?.getBoundingClientRect();
      if (now && (now.left < seen.left || now.right > seen.right || now.top < seen.top || now.bottom > seen.bottom)) this.fit();
    }));
  }

  /** @param {string[]} parts */
  blame(parts) {
    for (const group of this.sheet.querySelectorAll("g.part")) group.classList.toggle("faulty", parts.includes(group.getAttribute("data-part") ?? ""));
  }

  /** @param {string} kind part, node or nothing @param {string} path */
  pick(kind, path) {
    this.picked = kind ? { kind, path } : null;
    for (const found of this.sheet.querySelectorAll("[data-note]")) found.classList.toggle("picked", kind === "note" && found.getAttribute("data-note") === path);
    for (const found of this.sheet.querySelectorAll("g.part, .reach")) {
      const own = found.getAttribute(kind === "node" ? "data-node" : "data-part");
      found.classList.toggle("picked", Boolean(kind) && (own === path || (kind === "part" && this.studio.chosen.includes(own))) && (kind === "node") === found.classList.contains("reach"));
    }
    this.studio.wiring.names(kind === "part" && !this.studio.chosen.length ? [path] : []);
  }

  fit() {
    if (!this.svg) return;
    const { clientWidth: width, clientHeight: height } = this.sheet;
    const w = Number(this.svg.getAttribute("width")), h = Number(this.svg.getAttribute("height"));
    const [across, along] = this.studio.edits.possible ? [Math.min(RIM[0], RIM_SHARE * width), Math.min(RIM[1], RIM_SHARE * height)] : [0, 0];
    this.scale = Math.min(1.6, Math.max(LEAST, Math.min((width - across) / w, (height - along) / h)));
    this.x = (width - w * this.scale) / 2;
    this.y = (height - h * this.scale) / 2;
    this.fitted = true;
    this.place();
  }

  /** @param {number} factor @param {number} [x] @param {number} [y] about which point of the sheet */
  zoom(factor, x = this.sheet.clientWidth / 2, y = this.sheet.clientHeight / 2) {
    const scale = Math.min(MOST, Math.max(LEAST, this.scale * factor)), real = scale / this.scale;
    this.x = x - (x - this.x) * real;
    this.y = y - (y - this.y) * real;
    this.scale = scale;
    this.fitted = false;
    this.place();
  }

  /** @param {number} dx @param {number} dy */
  move(dx, dy) {
    this.x += dx;
    this.y += dy;
    this.fitted = false;
    this.place();
  }

  place() {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      if (this.svg) this.svg.style.transform = `translate(${this.x}px, ${this.y}px) scale(${this.scale})`;
    });
  }

  listen() {
    const sheet = this.sheet;
    /** @type {{x: number, y: number, moved: boolean, target: any}|null} */
    let held = null;
    sheet.addEventListener("pointerdown", (event) => {
      if (event.button > 1) return;
      if (event.button === 0 && this.studio.handling.begin(event)) return;
      if (event.button === 0 && event.shiftKey && this.studio.edits.possible) { this.studio.handling.band(event); return; }
      held = { x: event.clientX, y: event.clientY, moved: false, target: event.target };
      sheet.setPointerCapture(event.pointerId);
    });
    sheet.addEventListener("pointermove", (event) => {
      if (!held) return;
      const dx = event.clientX - held.x, dy = event.clientY - held.y;
      if (!held.moved && Math.hypot(dx, dy) < 4) return;
      held.moved = true;
      sheet.classList.add("panning");
      this.move(dx, dy);
      held.x = event.clientX;
      held.y = event.clientY;
    });
    sheet.addEventListener("pointerup", () => {
      if (held && !held.moved) this.choose(held.target);
      held = null;
      sheet.classList.remove("panning");
    });
    sheet.addEventListener("dblclick", (event) => {
      const under = document.elementFromPoint(event.clientX, event.clientY)?.closest("[data-part], [data-note]");
      if (under?.hasAttribute("data-note")) { this.studio.pick("note", under.getAttribute("data-note") ?? ""); document.getElementById("note-text")?.focus(); }
      else if (under) this.onopen(under.getAttribute("data-part") ?? "");
    });
    sheet.addEventListener("wheel", (event) => {
      event.preventDefault();
      const box = sheet.getBoundingClientRect();
      this.zoom(Math.exp(-event.deltaY / 400), event.clientX - box.left, event.clientY - box.top);
    }, { passive: false });
    sheet.addEventListener("keydown", (event) => this.key(event));
    byId("zoom").addEventListener("click", (event) => {
      const what = /** @type {HTMLElement} */ (event.target).dataset.zoom;
      if (what === "fit") this.fit();
      else if (what) this.zoom(what === "in" ? 1.3 : 1 / 1.3);
    });
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const port = /** @type {any} */ (event.target)?.getAttribute?.("data-port");
    if (event.key === "Escape" && this.studio.wiring.from) { this.studio.wiring.end(); this.studio.say(""); return; }
    if (port && (event.key === "Enter" || event.key === " ")) {
      event.preventDefault();
      if (this.studio.wiring.from) this.studio.wiring.join(port);
      else this.studio.wiring.begin(port);
      return;
    }
    const part = /** @type {any} */ (event.target)?.closest?.("g.part")?.getAttribute("data-part");
    if (part && !part.includes(".") && event.key === "Enter" && event.shiftKey) { event.preventDefault(); this.studio.chooseToo(part); return; }
    if (this.studio.edits.possible && this.studio.edits.key(event)) return;
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    /** @type {Record<string, () => void>} */
    const keys = { ArrowLeft: () => this.move(STEP, 0), ArrowRight: () => this.move(-STEP, 0), ArrowUp: () => this.move(0, STEP),
      ArrowDown: () => this.move(0, -STEP), "+": () => this.zoom(1.3), "=": () => this.zoom(1.3), "-": () => this.zoom(1 / 1.3),
      "0": () => this.fit(), Enter: () => this.choose(event.target), " ": () => this.choose(event.target),
      Escape: () => this.choose(null), o: () => this.picked?.kind === "part" && this.onopen(this.picked.path), e: () => this.picked?.kind === "part" && void this.studio.editBlock(this.picked.path) };
    const act = keys[event.key];
    if (act) { event.preventDefault(); act(); }
  }

  /** @param {any} target */
  choose(target) {
    const part = target?.closest?.("[data-part]"), wire = target?.closest?.(".reach");
    const note = target?.closest?.("[data-note]");
    if (note) this.onpick("note", note.getAttribute("data-note"));
    else if (wire) this.onpick("node", wire.getAttribute("data-node"));
    else if (part) this.onpick("part", part.getAttribute("data-part"));
    else this.onpick("", "");
  }
}
