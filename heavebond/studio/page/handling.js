// What the mouse does on the drawing besides panning: parts dragged, wires drawn, components dropped from the library.

import { byId, el } from "./dom.js";
import { GRID, Guides, snapped } from "./grid.js";

const SLACK = 5; // px that a click may move

export class Handling {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.sheet = byId("sheet");
  }

  /** Whether a press begins something here. @param {PointerEvent} event */
  begin(event) {
    const target = /** @type {Element} */ (event.target);
    if (!this.studio.edits.possible || byId("diagram").classList.contains("stale")) return false;
    const port = target.closest("[data-port]"), part = target.closest("g.part")?.getAttribute("data-part") ?? "";
    // a press that is handled here moves no focus by itself, and the keys of the drawing act on what was clicked
    (this.studio.diagram.group(part) ?? this.sheet).focus({ preventScroll: true });
    if (this.studio.wiring.from && !this.studio.wiring.pressed) { this.finish(event); return true; } // begun by the keyboard
    if (port) { this.wire(event, port); return true; }
    if (part && !part.includes(".") && this.studio.view?.places?.[part]) {
      if (event.shiftKey) { event.preventDefault(); this.studio.chooseToo(part); return true; }
      this.drag(event, part);
      return true;
    }
    const note = target.closest("[data-note]"), wire = target.closest(".reach");
    if (note) { this.dragNote(event, note.getAttribute("data-note") ?? ""); return true; }
    if (wire && this.studio.view?.places && !(wire.getAttribute("data-node") ?? "").includes(".")) { this.dragWire(event, wire); return true; }
    return false;
  }

  /** A straight piece of a wire, moved across its direction: it is kept there. @param {PointerEvent} event @param {Element} wire */
  dragWire(event, wire) {
    const { diagram, edits } = this.studio, node = wire.getAttribute("data-node") ?? "", start = diagram.point(event);
    const piece = pieceAt(wire.getAttribute("d") ?? "", start.x, start.y);
    if (!piece) { diagram.choose(wire); return; }
    const upright = piece[0] === piece[2], line = this.studio.wiring.line, old = piece.map((v) => v / GRID);
    /** @type {number[]|null} */ let moved = null;
    this.follow(event, (move) => {
      if (!moved && Math.hypot(move.clientX - event.clientX, move.clientY - event.clientY) < SLACK) return;
      const { x, y } = diagram.point(move), by = upright ? Math.round((x - piece[0]) / GRID) * GRID : Math.round((y - piece[1]) / GRID) * GRID;
      moved = upright ? [piece[0] + by, piece[1], piece[2] + by, piece[3]] : [piece[0], piece[1] + by, piece[2], piece[3] + by];
      line?.setAttribute("d", `M${moved[0]} ${moved[1]} L${moved[2]} ${moved[3]}`);
      this.sheet.classList.add("dragging");
    }, () => {
      line?.setAttribute("d", "");
      this.sheet.classList.remove("dragging");
      if (!moved) diagram.choose(wire);
      else void edits.act({ act: "route", node, piece: moved.map((v) => v / GRID), old });
    }, () => { line?.setAttribute("d", ""); this.sheet.classList.remove("dragging"); });
  }

  /** @param {PointerEvent} event @param {string} name */
  dragNote(event, name) {
    const { diagram, edits } = this.studio, start = diagram.point(event), note = this.studio.view.notes[name];
    const group = /** @type {SVGElement} */ (this.sheet.querySelector(`[data-note="${CSS.escape(name)}"]`));
    let by = [0, 0];
    const end = () => { group.removeAttribute("transform"); this.sheet.classList.remove("dragging"); };
    this.follow(event, (move) => {
      const { x, y } = diagram.point(move);
      by = [Math.round((x - start.x) / GRID), Math.round((y - start.y) / GRID)];
      group.setAttribute("transform", `translate(${x - start.x} ${y - start.y})`);
      this.sheet.classList.add("dragging");
    }, () => {
      end();
      if (by[0] || by[1]) void edits.act({ act: "note", name, text: note.text, x: note.at[0] + by[0], y: note.at[1] + by[1] });
      else this.studio.pick("note", name);
    }, end);
  }

  /** @param {PointerEvent} event @param {Element} mark */
  wire(event, mark) {
    const { wiring, diagram } = this.studio, path = mark.getAttribute("data-port") ?? "";
    wiring.begin(path, false, [Number(mark.getAttribute("cx")), Number(mark.getAttribute("cy"))]);
    wiring.pressed = true;
    let far = false;
    this.follow(event, (move) => {
      const { x, y } = diagram.point(move);
      far ||= Math.hypot(move.clientX - event.clientX, move.clientY - event.clientY) > SLACK;
      wiring.to(x, y);
    }, (up) => {
      wiring.pressed = false;
      if (far) this.finish(up);
      else { wiring.end(); if (path.includes(".")) this.studio.pick("part", path.split(".")[0]); else this.studio.pick("", ""); wiring.begin(path); } // a click: the next one tells the other end
    }, () => { wiring.pressed = false; wiring.end(); });
  }

  /** A wire ends at a port or at a wire. @param {PointerEvent} event */
  finish(event) {
    const { wiring, diagram, view } = this.studio, { x, y } = diagram.point(event);
    const near = wiring.near(x, y), reach = document.elementsFromPoint(event.clientX, event.clientY).find((found) => found.classList.contains("reach"));
    const end = near ? near.port.path : view?.nodes?.[reach?.getAttribute("data-node") ?? ""]?.ends[0];
    if (end) wiring.join(end);
    else { wiring.end(); this.studio.say(""); }
  }

  /** A rectangle drawn with Shift: the parts in it are selected together. @param {PointerEvent} event */
  band(event) {
    const box = this.sheet.getBoundingClientRect(), frame = el("div", { class: "band" });
    /** @type {[number, number, number, number]} */ let edges = [event.clientX, event.clientY, event.clientX, event.clientY];
    this.sheet.append(frame);
    this.follow(event, (move) => {
      edges = [Math.min(event.clientX, move.clientX), Math.min(event.clientY, move.clientY), Math.max(event.clientX, move.clientX), Math.max(event.clientY, move.clientY)];
      Object.assign(frame.style, { left: `${edges[0] - box.left}px`, top: `${edges[1] - box.top}px`, width: `${edges[2] - edges[0]}px`, height: `${edges[3] - edges[1]}px` });
    }, () => {
      frame.remove();
      const inside = Object.keys(this.studio.view?.places ?? {}).filter((part) => {
        const found = this.studio.diagram.group(part)?.querySelector(".frame")?.getBoundingClientRect();
        return found && found.left >= edges[0] && found.top >= edges[1] && found.right <= edges[2] && found.bottom <= edges[3];
      });
      this.studio.chooseParts([...new Set([...this.studio.chosen, ...inside])]);
    }, () => frame.remove());
  }

  /** A part, with all that are selected together with it. @param {PointerEvent} event @param {string} part */
  drag(event, part) {
    const { diagram, edits, view: { places, parts, nodes }, chosen } = this.studio, start = diagram.point(event), names = chosen.includes(part) ? chosen : [part];
    const groups = names.map((/** @type {string} */ name) => { const group = diagram.group(name); return { name, group, caption: diagram.caption(name), at: [GRID * places[name][0], GRID * places[name][1]], was: group.getAttribute("transform") }; });
    const own = parts[part]?.ports ?? [], [x0, y0] = [GRID * places[part][0], GRID * places[part][1]];
    const ports = own.flatMap((/** @type {any} */ port) => port.at.map((/** @type {any[]} */ [x, y]) => [x - x0, y - y0]));
    const joined = new Set(own.flatMap((/** @type {any} */ port) => nodes[port.node]?.ends ?? []).filter((/** @type {string} */ end) => !names.includes(end.split(".")[0])));
    const ends = [...joined].flatMap((end) => (this.studio.wiring.ports.get(end)?.at ?? []).map((/** @type {any[]} */ [x, y]) => [x, y]));
    /** @type {any} */ let guides = null;
    /** @type {any} */ let place = null;
    const end = () => { guides?.end(); for (const { group, caption, was } of groups) { group.setAttribute("transform", was); caption?.removeAttribute("transform"); group.classList.remove("dragged"); } this.sheet.classList.remove("dragging"); };
    this.follow(event, (move) => {
      if (!guides && Math.hypot(move.clientX - event.clientX, move.clientY - event.clientY) < SLACK) return;
      if (!guides) { guides = new Guides(diagram.svg); for (const { group } of groups) group.classList.add("dragged"); this.sheet.classList.add("dragging"); }
      const { x, y } = diagram.point(move);
      place = snapped(places, names, x0 + x - start.x, y0 + y - start.y, ports, ends);
      const dx = GRID * place.x - x0, dy = GRID * place.y - y0;
      for (const { group, caption, at } of groups) { group.setAttribute("transform", `translate(${at[0] + dx} ${at[1] + dy})`); caption?.setAttribute("transform", `translate(${dx} ${dy})`); }
      guides.show(place.lines);
    }, () => {
      end();
      if (!place) diagram.choose(diagram.group(part));
      else if (GRID * place.x !== x0 || GRID * place.y !== y0) void edits.move(names, part, place.x - places[part][0], place.y - places[part][1]);
    }, end);
  }

  /** A component from the library. @param {PointerEvent} event @param {any} component @param {() => void} onclick */
  bring(event, component, onclick) {
    const { diagram, edits, view } = this.studio;
    /** @type {any} */ let ghost = null;
    /** @type {any} */ let guides = null;
    /** @type {any} */ let place = null;
    const end = () => { guides?.end(); ghost?.remove(); this.sheet.classList.remove("dragging"); };
    this.follow(event, (move) => {
      if (!ghost && Math.hypot(move.clientX - event.clientX, move.clientY - event.clientY) < SLACK) return;
      if (!ghost) {
        ghost = el("div", { class: "ghost" }, symbolOf(component));
        document.body.append(ghost);
        guides = new Guides(diagram.svg);
        this.sheet.classList.add("dragging");
      }
      ghost.style.transform = `translate(${move.clientX}px, ${move.clientY}px) translate(-50%, -50%)`;
      const box = this.sheet.getBoundingClientRect();
      const over = move.clientX > box.left && move.clientX < box.right && move.clientY > box.top && move.clientY < box.bottom, { x, y } = diagram.point(move);
      place = over ? (diagram.svg ? snapped(view?.places, [], x, y) : { x: 0, y: 0, lines: [null, null] }) : null;
      guides.show(place?.lines ?? [null, null]);
    }, () => {
      end();
      if (!ghost) onclick();
      else if (place) void edits.act({ act: "place", kind: component.name, x: place.x, y: place.y }).then((/** @type {any} */ done) => { if (done) this.studio.panel.ask(); });
    }, end);
  }

  /** What a pressed pointer does until it is released; Esc leaves it. @param {PointerEvent} event @param {(e: PointerEvent) => void} onmove @param {(e: PointerEvent) => void} onup @param {() => void} onleave */
  follow(event, onmove, onup, onleave) {
    event.preventDefault();
    const quit = new AbortController(), { signal } = quit;
    addEventListener("pointermove", onmove, { signal });
    addEventListener("pointerup", (up) => { quit.abort(); onup(up); }, { signal });
    addEventListener("pointercancel", () => { quit.abort(); onleave(); }, { signal });
    addEventListener("keydown", (key) => { if (key.key === "Escape") { key.stopPropagation(); quit.abort(); onleave(); } }, { signal, capture: true });
  }
}

/** The straight piece of a path of horizontal and vertical lines that is nearest to a point, if it is long enough to be held. @param {string} d @param {number} x @param {number} y @returns {number[]|null} */
function pieceAt(d, x, y) {
  let best = null, least = 12;
  for (const line of d.split("M").filter(Boolean)) {
    const points = line.split("L").map((p) => p.trim().split(/\s+/).map(Number));
    for (let k = 1; k < points.length; k++) {
      const [[x1, y1], [x2, y2]] = [points[k - 1], points[k]];
      const far = x1 === x2 ? Math.abs(x - x1) + Math.max(0, Math.min(y1, y2) - y, y - Math.max(y1, y2)) : Math.abs(y - y1) + Math.max(0, Math.min(x1, x2) - x, x - Math.max(x1, x2));
      if (far < least) { least = far; best = [x1, y1, x2, y2]; }
    }
  }
  return best;
}

/** The symbol of a component as a picture. @param {any} component */
export function symbolOf(component) {
  const svg = /** @type {any} */ (document.importNode(new DOMParser().parseFromString(component.svg, "image/svg+xml").documentElement, true));
  svg.querySelector(":scope > rect")?.remove();
  svg.querySelector(":scope > title")?.remove();
  svg.setAttribute("aria-hidden", "true");
  return svg;
}
