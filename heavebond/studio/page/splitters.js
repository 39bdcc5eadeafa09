// Borders between the panes, moved by mouse and keyboard; their places are kept in the browser.

import { byId } from "./dom.js";

const STEP = 24; // px by which a key moves a border
/** @typedef {{id: string, pane: string, variable: string, across: boolean, sign: number, least: number, rest: number}} Border */
/** @type {Border[]} */
const BORDERS = [
  { id: "split-text", pane: "text", variable: "--text", across: true, sign: 1, least: 180, rest: 560 },
  { id: "split-panel", pane: "panel", variable: "--panel", across: true, sign: -1, least: 200, rest: 560 },
  { id: "split-drawing", pane: "diagram", variable: "--drawing", across: false, sign: 1, least: 120, rest: 220 }];

/** Make the borders of the page movable. */
export function splitters() {
  for (const border of BORDERS) {
    const handle = byId(border.id), whole = byId(border.across ? "model" : "middle");
    const size = () => { const box = byId(border.pane).getBoundingClientRect(); return border.across ? box.width : box.height; };
    const set = (/** @type {number} */ px) => {
      const most = Math.max(border.least, (border.across ? whole.clientWidth : whole.clientHeight) - border.rest);
      const value = `${Math.round(Math.min(most, Math.max(border.least, px)))}px`;
      document.documentElement.style.setProperty(border.variable, value);
      if (!border.across) whole.classList.add("resized");
      localStorage.setItem(`pane:${border.id}`, value);
      handle.setAttribute("aria-valuenow", String(parseInt(value, 10)));
    };
    const reset = () => {
      document.documentElement.style.removeProperty(border.variable);
      if (!border.across) whole.classList.remove("resized");
      localStorage.removeItem(`pane:${border.id}`);
    };
    const kept = parseFloat(localStorage.getItem(`pane:${border.id}`) ?? "");
    if (kept > 0) { document.documentElement.style.setProperty(border.variable, `${kept}px`); if (!border.across) whole.classList.add("resized"); }
    handle.title = "Drag to move the border (arrow keys); double click for the usual place";
    handle.addEventListener("pointerdown", (event) => {
      const begin = border.across ? event.clientX : event.clientY, before = size();
      handle.setPointerCapture(event.pointerId);
      const move = (/** @type {PointerEvent} */ now) => set(before + border.sign * ((border.across ? now.clientX : now.clientY) - begin));
      handle.addEventListener("pointermove", move);
      handle.addEventListener("lostpointercapture", () => handle.removeEventListener("pointermove", move), { once: true });
    });
    handle.addEventListener("dblclick", reset);
    handle.addEventListener("keydown", (event) => {
      const step = /** @type {Record<string, number>} */ (border.across ? { ArrowRight: STEP, ArrowLeft: -STEP } : { ArrowDown: STEP, ArrowUp: -STEP })[event.key];
      if (step) { event.preventDefault(); set(size() + border.sign * step); }
      if (event.key === "Home") { event.preventDefault(); reset(); }
    });
  }
}
