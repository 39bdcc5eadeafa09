// What the mouse does on the drawing besides panning: parts dragged, wires drawn, components dropped from the library.

import { byId, el } from "./dom.js";
import { cellAt, Guides } from "./grid.js";

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
    if (part && !part.includes(".") && this.studio.view?.grid?.cells[part]) {
      if (event.shiftKey) { event.preventDefault(); this.studio.chooseToo(part); return true; }
      this.drag(event, part);
      return true;
    }
    return false;
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
      const inside = Object.keys(this.studio.view?.grid?.cells ?? {}).filter((part) => {
        const found = this.studio.diagram.group(part)?.querySelector(".frame")?.getBoundingClientRect();
        return found && found.left >= edges[0] && found.top >= edges[1] && found.right <= edges[2] && found.bottom <= edges[3];
      });
      this.studio.chooseParts([...new Set([...this.studio.chosen, ...inside])]);
    }, () => frame.remove());
  }

  /** A part, with all that are selected together with it. @param {PointerEvent} event @param {string} part */
  drag(event, part) {
    const { diagram, edits, view: { grid }, chosen } = this.studio, start = diagram.point(event), together = chosen.includes(part);
    const place = (/** @type {string} */ name) => [grid.xs[grid.cells[name][0]], grid.ys[grid.cells[name][1]]], [x0, y0] = place(part);
    const groups = (together ? chosen : [part]).map((/** @type {string} */ name) => ({ group: diagram.group(name), at: place(name), was: diagram.group(name).getAttribute("transform") }));
    const free = together ? { ...grid, cells: { [part]: grid.cells[part] } } : grid; // all move, so no cell is taken
    /** @type {any} */ let guides = null;
    /** @type {any} */ let cell = null;
    const end = () => { guides?.end(); for (const { group, was } of groups) { group.setAttribute("transform", was); group.classList.remove("dragged"); } this.sheet.classList.remove("dragging"); };
    this.follow(event, (move) => {
      if (!guides && Math.hypot(move.clientX - event.clientX, move.clientY - event.clientY) < SLACK) return;
      if (!guides) { guides = new Guides(diagram.svg); for (const { group } of groups) group.classList.add("dragged"); this.sheet.classList.add("dragging"); }
      const { x, y } = diagram.point(move), dx = x - start.x, dy = y - start.y;
      for (const { group, at } of groups) group.setAttribute("transform", `translate(${at[0] + dx} ${at[1] + dy})`);
      cell = cellAt(free, x0 + dx, y0 + dy, part);
      guides.show(cell);
    }, () => {
      end();
      if (!cell) diagram.choose(diagram.group(part));
      else if (!cell.same) void edits.act({ act: together ? "move_parts" : "move", part, column: cell.column, row: cell.row, ...(together ? { parts: chosen } : {}) });
    }, end);
  }

  /** A component from the library. @param {PointerEvent} event @param {any} component @param {() => void} onclick */
  bring(event, component, onclick) {
    const { diagram, edits, view } = this.studio;
    /** @type {any} */ let ghost = null;
    /** @type {any} */ let guides = null;
    /** @type {any} */ let cell = null;
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
      const over = move.clientX > box.left && move.clientX < box.right && move.clientY > box.top && move.clientY < box.bottom;
      cell = over ? cellAt(diagram.svg ? view?.grid : null, diagram.point(move).x, diagram.point(move).y) : null;
      if (cell) guides.show(cell);
    }, () => {
      end();
      if (!ghost) onclick();
      else if (cell) void edits.act({ act: "place", kind: component.name, column: cell.column, row: cell.row }).then((/** @type {any} */ done) => { if (done) this.studio.panel.ask(); });
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

/** The symbol of a component as a picture. @param {any} component */
export function symbolOf(component) {
  const svg = /** @type {any} */ (document.importNode(new DOMParser().parseFromString(component.svg, "image/svg+xml").documentElement, true));
  svg.querySelector(":scope > rect")?.remove();
  svg.querySelector(":scope > title")?.remove();
  svg.setAttribute("aria-hidden", "true");
  return svg;
}
