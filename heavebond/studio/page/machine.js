// The machine itself in motion: the shapes under `view:` as a run moves them, beside the drawing.

import { byId, el } from "./dom.js";
import { problemList } from "./results.js";

const SVG = "http://www.w3.org/2000/svg";

export class Machine {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.place = byId("machine");
    this.on = false;
    /** @type {any} */ this.film = null; // what `heavebond animate` shows, of the run `of`
    /** @type {any} */ this.of = null;
    /** @type {any[]} */ this.shapes = [];
    /** @type {any} */ this.scene = null; // of a machine in space
    /** @type {Map<string, any>} */ this.films = new Map(); // of the kept runs, by their keys; nothing of one that failed
    this.overlaid = ""; // keys of the kept runs in the scene
  }

  /** @param {boolean} on */
  toggle(on) {
    this.on = on;
    this.layout();
    void this.follow();
  }

  layout() {
    const shown = this.on && !byId("player").hidden && this.studio.view?.moves;
    if (this.place.hidden === !shown) return;
    this.place.hidden = !shown;
    byId("diagram").classList.toggle("with-machine", shown);
    this.studio.diagram.fit();
  }

  /** The film of the newest run that is no preview. */
  async follow() {
    const { live } = this.studio.runs, { document: file, link } = this.studio;
    this.layout();
    if (this.place.hidden || !live || live.preview || this.of === live) return;
    this.of = live;
    if (!this.film) this.place.replaceChildren(el("p", { class: "empty" }, "Making the film…"));
    try {
      const told = await link.ask("film", { name: file.name, text: live.text, values: live.values });
      if (told.kind !== "done" || this.of !== live) return;
      this.film = told.film;
      if (this.film.solids) await this.buildInSpace();
      else this.build();
      this.at(this.studio.animation.time);
    } catch (error) {
      this.film = null;
      this.place.replaceChildren(...problemList(/** @type {any} */ (error).problems ?? [{ message: String(error) }]));
    }
  }

  clear() {
    this.film = this.of = null;
    this.films.clear();
    this.scene?.dispose();
    this.scene = null;
    this.place.replaceChildren();
    this.layout();
  }

  /** A machine in space, with the camera of the one before it if its shapes are the same. */
  async buildInSpace() {
    await script("space/three.js");
    await script("space/scene.js");
    const runs = await this.keptFilms(), before = this.scene, stage = el("div", { class: "stage" }), tools = el("div", { class: "choices", role: "group", "aria-label": "camera and picture" });
    this.place.replaceChildren(stage, tools);
    this.scene = new (/** @type {any} */ (window)).SpaceScene(stage, tools, { ...this.film, runs });
    if (before) {
      this.scene.lookAs(before);
      before.dispose();
    }
  }

  /** The visible kept runs other than the newest run. */
  shownKept() {
    const { kept = [], live } = this.studio.runs, same = (/** @type {any} */ run) => live && run.text === live.text && JSON.stringify(run.values) === JSON.stringify(live.values);
    return kept.filter((/** @type {any} */ run) => run.visible && !same(run));
  }

  /** The films of the kept runs in space, which are drawn over the newest run. */
  async keptFilms() {
    const kept = this.shownKept(), { document: file, link } = this.studio;
    this.overlaid = kept.map((/** @type {any} */ run) => run.key).join();
    for (const run of kept) {
      if (this.films.has(run.key)) continue;
      const told = await link.ask("film", { name: file.name, text: run.text, values: run.values }).catch(() => null);
      this.films.set(run.key, told?.kind === "done" && told.film.solids ? told.film : null);
    }
    return kept.filter((/** @type {any} */ run) => this.films.get(run.key)).map((/** @type {any} */ run) => ({ ...this.films.get(run.key), label: run.label }));
  }

  /** After runs have been kept, forgotten, hidden or shown. */
  async renew() {
    if (!this.scene || this.place.hidden || !this.film?.solids || this.overlaid === this.shownKept().map((/** @type {any} */ run) => run.key).join()) return;
    await this.buildInSpace();
    this.at(this.studio.animation.time);
  }

  /** y goes upwards in m, that of the picture downwards. */
  build() {
    this.scene?.dispose();
    this.scene = null;
    const [left, bottom, right, top] = this.film.edges;
    const make = (/** @type {Element} */ parent, /** @type {string} */ tag, /** @type {Record<string, any>} */ given, text = "") => {
      const made = document.createElementNS(SVG, tag);
      for (const [key, value] of Object.entries(given)) made.setAttribute(key, String(value));
      made.textContent = text;
      return parent.appendChild(made);
    };
    const svg = document.createElementNS(SVG, "svg");
    for (const [key, value] of [["viewBox", `${left} ${-top} ${right - left} ${top - bottom}`], ["role", "img"], ["aria-label", "the machine in motion"]]) svg.setAttribute(key, value);
    const letter = this.letter = Math.max((top - bottom) / 34, (right - left) / 40);
    this.shapes = this.film.shapes.map((/** @type {any} */ shape) => {
      const group = make(svg, "g", { class: `shape ${shape.colour}` });
      return { shape, paths: shape.outlines.map((/** @type {any} */ o) => make(group, "path", { class: `${o.fill} ${o.edge || "bare"}` })) };
    });
    for (const found of this.shapes) if (found.shape.label) found.label = make(svg, "text", { "font-size": letter }, found.shape.label); // over all shapes
    this.place.replaceChildren(/** @type {any} */ (svg));
  }

  /** The machine at an instant. @param {number} time */
  at(time) {
    if (this.place.hidden || !this.film) return;
    const [begin, end, frames] = this.film.times, far = (time - begin) / (end - begin || 1) * (frames - 1);
    const frame = Math.max(0, Math.min(frames - 1, far)), k = Math.min(Math.floor(frame), Math.max(0, frames - 2)), part = frame - k;
    if (this.film.solids) {
      this.scene?.show(frame);
      return;
    }
    const along = (/** @type {number[]} */ c) => c[k] + part * ((c[k + 1] ?? c[k]) - c[k]);
    const follow = (/** @type {any} */ course) => typeof course === "number" ? course : course[1] + along(this.film.tracks[course[0]]);
    for (const { shape, paths, label } of this.shapes) {
      const [x, y, u, v, width, barrel] = shape.courses.map(follow), length = Math.hypot(u - x, v - y) || 1e-12, dx = (u - x) / length, dy = (v - y) / length;
      shape.outlines.forEach((/** @type {any} */ outline, /** @type {number} */ i) => paths[i].setAttribute("d", `M${outline.corners.map((/** @type {number[]} */ [a, b, w]) => {
        const s = a * length + b * barrel, n = w * width;
        return `${(x + s * dx - n * dy).toFixed(5)} ${(-(y + s * dy + n * dx)).toFixed(5)}`;
      }).join("L")}`));
      if (label) this.write(label, shape, x, y, u, v, width, length, Math.abs(dy) > 0.5);
    }
  }

  /** Inside a shape where the label fits, else beside it. @param {any} label @param {any} shape @param {number} x @param {number} y @param {number} u @param {number} v @param {number} width @param {number} length @param {boolean} steep */
  write(label, shape, x, y, u, v, width, length, steep) {
    const letter = this.letter ?? 0, ground = shape.kind === "ground", across = ["level", "mark"].includes(shape.kind);
    const room = (ground || shape.kind === "box") && label.getComputedTextLength() < length && letter < width;
    label.setAttribute("text-anchor", room ? "middle" : across ? "end" : "start");
    label.setAttribute("x", room ? (x + u) / 2 : across ? this.film.edges[2] - letter / 2 : Math.max(x, u) + (steep ? width / 2 : 0) + letter / 2);
    label.setAttribute("y", ground ? -y + width / 2 + 0.35 * letter : across ? -y - letter / 3 : -(y + v) / 2 + 0.35 * letter);
  }
}

/** @type {Map<string, Promise<void>>} */
const LOADED = new Map();

/** Load a script that is no module, once. @param {string} address */
function script(address) {
  if (!LOADED.has(address)) {
    LOADED.set(address, new Promise((done, failed) => {
      const tag = document.createElement("script");
      tag.src = address;
      tag.onload = () => done();
      tag.onerror = () => { LOADED.delete(address); failed(new Error(`${address} cannot be loaded`)); };
      document.head.append(tag);
    }));
  }
  return LOADED.get(address);
}
