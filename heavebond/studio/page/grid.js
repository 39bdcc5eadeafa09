// The grid of the drawing: where something that is dragged comes to lie, and the lines that show with what it is in line.

const SVG = "http://www.w3.org/2000/svg";
export const GRID = 10; // px of a step
const TEXT = [6, 2]; // width and height of a short text, in steps
const NEAR = 9; // px within which a part is drawn into line with another

/** The place on the grid for a point, in line with another part or port where one is near. @param {Record<string, any[]>} places of all parts, in steps @param {Iterable<string>} moving @param {number} x @param {number} y @param {number[][]} [ports] points of the thing that is moved, relative to it @param {number[][]} [ends] points of others with which ports may be in line */
export function snapped(places, moving, x, y, ports = [], ends = []) {
  const still = Object.entries(places ?? {}).filter(([name]) => ![...moving].includes(name)).map(([, place]) => place);
  const axis = (/** @type {number} */ k, /** @type {number} */ value) => {
    let best = GRID * Math.round(value / GRID), least = NEAR, line = null;
    const wanted = [...still.map((place) => [GRID * place[k], GRID * place[k]]), ...ends.flatMap((end) => ports.map((port) => [end[k] - port[k], end[k]]))];
    for (const [to, at] of wanted) if (Math.abs(to - value) < least && to % GRID === 0) { best = to; least = Math.abs(to - value); line = at; }
    return { value: best, line };
  };
  const across = axis(0, x), down = axis(1, y);
  return { x: across.value / GRID, y: down.value / GRID, lines: [across.line, down.line] };
}

/** A free place for a part that is placed by the keyboard: right of a part, below it, else below all; in steps. @param {Record<string, any[]>} places @param {string} [beside] */
export function freePlace(places, beside) {
  const all = Object.values(places ?? {});
  if (!all.length) return { x: 0, y: 0 };
  const [x, y] = places[beside ?? ""] ?? [all[0][0], Math.max(...all.map((place) => place[1]))];
  const free = (/** @type {number} */ a, /** @type {number} */ b) => all.every((place) => Math.abs(place[0] - a) > 8 || Math.abs(place[1] - b) > 8);
  for (let far = 12; far < 120; far += 12) for (const [dx, dy] of beside && places[beside] ? [[far, 0], [0, far], [-far, 0], [0, -far]] : [[0, far]]) if (free(x + dx, y + dy)) return { x: x + dx, y: y + dy };
  return { x, y: y + 120 };
}

/** The place nearest to a point, in steps, where a short text lies on no part, wire or other text. @param {any} svg @param {number} x @param {number} y */
export function freeText(svg, x, y) {
  const into = svg.getScreenCTM().inverse();
  /** @type {number[][]} */ const taken = []; // left, top, right and bottom, in px of the drawing
  for (const thing of svg.querySelectorAll("g.part, text")) {
    const box = thing.getBoundingClientRect(), a = new DOMPoint(box.left, box.top).matrixTransform(into), b = new DOMPoint(box.right, box.bottom).matrixTransform(into);
    taken.push([a.x, a.y, b.x, b.y]);
  }
  for (const wire of svg.querySelectorAll("path.wire")) for (const line of (wire.getAttribute("d") ?? "").split("M").filter(Boolean)) {
    const points = line.split("L").map((/** @type {string} */ point) => point.trim().split(/\s+/).map(Number));
    points.slice(1).forEach((/** @type {number[]} */ [u, v], /** @type {number} */ k) => taken.push([Math.min(u, points[k][0]), Math.min(v, points[k][1]), Math.max(u, points[k][0]), Math.max(v, points[k][1])]));
  }
  const free = (/** @type {number} */ a, /** @type {number} */ b) => taken.every(([left, top, right, bottom]) => GRID * (a + TEXT[0]) < left - 4 || GRID * a > right + 4 || GRID * (b + TEXT[1]) < top - 4 || GRID * b > bottom + 4);
  for (let far = 0; far < 60; far++) for (let k = -far; k <= far; k++) for (const [dx, dy] of [[k, -far], [k, far], [-far, k], [far, k]]) if (free(x + dx, y + dy)) return { x: x + dx, y: y + dy };
  return { x, y };
}

/** Lines with which the thing that is dragged is in line. */
export class Guides {
  /** @param {any} svg */
  constructor(svg) {
    this.group = document.createElementNS(SVG, "g");
    this.group.setAttribute("class", "guides");
    this.lines = [0, 1].map(() => this.group.appendChild(document.createElementNS(SVG, "path")));
    svg?.append(this.group);
  }

  /** @param {(number|null)[]} lines x and y */
  show([x, y]) {
    this.lines[0].setAttribute("d", x === null ? "" : `M${x} -60000 V60000`);
    this.lines[1].setAttribute("d", y === null ? "" : `M-60000 ${y} H60000`);
  }

  end() { this.group.remove(); }
}
