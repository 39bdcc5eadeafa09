// Wires drawn from port to port, by mouse and by keyboard: ports that fit are shown, others fade and say why they do not fit.

const SVG = "http://www.w3.org/2000/svg";
const NEAR = 16; // px around a port that count as on it
/** @type {Record<string, [number, number, string]>} */
const BESIDE = { left: [-9, -5, "end"], right: [9, -5, "start"], top: [8, -6, "start"], bottom: [9, 7, "start"] }; // where the name of a port stands

/** Whether two ports may be joined, as far as the page can tell. @param {any} one @param {any} two */
export function fits(one, two) {
  if (one.path === two.path || (one.node && one.node === two.node) || one.value || two.value) return false;
  if ((one.domain === "signal") !== (two.domain === "signal") && one.domain && two.domain) return false;
  if (one.domain && two.domain && one.domain !== two.domain) return false;
  const drives = (/** @type {any} */ port) => port.direction === (port.inner ? "in" : "out"); // an input of a block drives what is inside
  return !(drives(one) && drives(two));
}

export class Wiring {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    /** @type {any} */ this.from = null;
    /** @type {SVGGElement|null} */ this.layer = null;
    /** @type {Map<string, any>} */ this.ports = new Map();
    /** @type {[number, number]|null} */ this.anchor = null;
  }

  /** The marks of all ports on a new drawing. @param {any} svg @param {Record<string, any>} parts */
  draw(svg, parts) {
    this.layer = document.createElementNS(SVG, "g");
    this.layer.setAttribute("class", "ports");
    this.ports = new Map();
    for (const [part, { ports }] of [...Object.entries(parts), ["", this.studio.view?.component ?? {}]]) {
      for (const port of part.includes(".") ? [] : ports ?? []) {
        this.ports.set(port.path, port);
        port.marks = port.at.map((/** @type {any[]} */ [x, y]) => this.mark(port, x, y));
        this.layer.append(...port.marks);
      }
    }
    this.line = document.createElementNS(SVG, "path");
    this.line.setAttribute("class", "drawn");
    this.layer.append(this.line);
    svg.append(this.layer);
    if (this.from) { const path = this.from.path; this.end(); if (this.ports.has(path)) this.begin(path, false); }
  }

  /** @param {any} port @param {number} x @param {number} y */
  mark(port, x, y) {
    const circle = document.createElementNS(SVG, "circle");
    const words = `${port.path}, ${port.domain || "any domain"}${port.direction ? ` ${port.direction}put` : ""}${port.node ? `, on node ${port.node}` : ", not connected"}`;
    for (const [name, value] of [["cx", x], ["cy", y], ["r", 5], ["data-port", port.path], ["class", `port${port.node || port.value || port.default ? "" : " open"}`], ["role", "button"], ["aria-label", words], ["tabindex", -1]])
      circle.setAttribute(String(name), String(value));
    const title = document.createElementNS(SVG, "title");
    title.textContent = words;
    circle.append(title);
    return circle;
  }

  /** The names of the ports of the parts that are selected, but for those that the symbol shows itself. @param {string[]} parts */
  names(parts) {
    for (const found of this.layer?.querySelectorAll(".port-name") ?? []) found.remove();
    const printed = new Set(parts.flatMap((part) => [...this.studio.diagram.group(part)?.querySelectorAll("text") ?? []].map((/** @type {any} */ text) => `${part}.${text.textContent}`)));
    for (const port of parts.length ? this.ports.values() : []) {
      if (!port.value && !printed.has(port.path) && parts.includes(port.path.split(".")[0])) this.layer?.append(this.label(port.name, port.at[0]));
    }
  }

  /** @param {string} name @param {any[]} at x, y and the side of the part */
  label(name, [x, y, side]) {
    const text = document.createElementNS(SVG, "text"), [dx, dy, anchor] = BESIDE[side] ?? BESIDE.right;
    for (const [key, value] of [["x", x + dx], ["y", y + dy], ["text-anchor", anchor], ["class", "port-name"], ["aria-hidden", "true"]]) text.setAttribute(String(key), String(value));
    text.textContent = name;
    return text;
  }

  /** From a part by keyboard: from its only port, else from the one that is chosen. @param {string} part */
  fromPart(part) {
    const ports = [...this.ports.values()].filter((p) => p.path.startsWith(`${part}.`) && !p.value);
    if (!ports.length) { this.studio.edits.refuse(`'${part}' has no port to connect.`); return; }
    if (ports.length === 1) { this.begin(ports[0].path); return; }
    this.end();
    this.choose(ports);
    this.studio.say("Choose the port from which the wire goes: Tab, then Enter");
  }

  /** Marks that the keyboard goes through. @param {any[]} ports */
  choose(ports) {
    for (const port of this.ports.values()) for (const mark of port.marks) mark.setAttribute("tabindex", "-1");
    for (const port of ports) port.marks[0].setAttribute("tabindex", "0");
    (ports.find((p) => !p.node) ?? ports[0])?.marks[0].focus();
  }

  /** @param {string} path @param {boolean} [keyboard] @param {[number, number]} [at] the mark at which the wire begins */
  begin(path, keyboard = true, at) {
    const from = this.ports.get(path);
    if (!from || !this.studio.edits.possible) return;
    this.end();
    this.from = from;
    this.anchor = at ?? [from.at[0][0], from.at[0][1]];
    this.layer?.classList.add("wiring");
    const fitting = [...this.ports.values()].filter((port) => fits(from, port));
    for (const port of fitting) for (const mark of port.marks) mark.classList.add("fits");
    for (const mark of from.marks) mark.classList.add("from");
    this.studio.say(fitting.length ? `Wire from ${path}: choose the other port (Tab, Enter), Esc to leave it` : `No other port fits ${path}`);
    if (keyboard) this.choose(fitting);
  }

  /** The line to where the pointer is. @param {number} x @param {number} y */
  to(x, y) {
    if (!this.from || !this.anchor) return;
    const near = this.near(x, y);
    for (const mark of this.layer?.querySelectorAll(".under") ?? []) mark.classList.remove("under");
    near?.mark.classList.add("under");
    const [x0, y0] = this.anchor;
    this.line?.setAttribute("d", `M${x0} ${y0} L${x} ${y}`);
  }

  /** The port at a point, those that fit first. @param {number} x @param {number} y */
  near(x, y) {
    let best = null, least = NEAR;
    for (const port of this.ports.values()) {
      if (port === this.from) continue;
      port.at.forEach((/** @type {number[]} */ [px, py], /** @type {number} */ k) => {
        const far = Math.hypot(px - x, py - y) + (fits(this.from, port) ? 0 : 4);
        if (far < least) { least = far; best = { port, mark: port.marks[k] }; }
      });
    }
    return /** @type {any} */ (best);
  }

  /** The other end of the wire: a port, or a wire that is there. @param {string} path */
  join(path) {
    const from = this.from;
    this.end();
    this.studio.say("");
    if (from) void this.studio.edits.act({ act: "join", from: from.path, to: path });
  }

  end() {
    this.from = null;
    this.layer?.classList.remove("wiring");
    for (const mark of this.layer?.querySelectorAll(".fits, .from, .under") ?? []) mark.classList.remove("fits", "from", "under");
    for (const mark of this.layer?.querySelectorAll("[tabindex='0']") ?? []) mark.setAttribute("tabindex", "-1");
    this.line?.setAttribute("d", "");
  }
}
