// Charts of records and residuals by uPlot: courses over time with bands, and clouds of one signal over another.

import uPlot from "./vendor/uPlot.js";
import { el, number, unitLabel } from "./dom.js";
import { BRIGHT, COLOURS, zoomByKeys } from "./plots.js";

const DARK = matchMedia("(prefers-color-scheme: dark)");
const MOST = 6000; // points of a cloud that are drawn

/** Colours of this page now. */
export function look() {
  const style = getComputedStyle(document.body);
  return { ink: style.color, line: style.getPropertyValue("--line"), quiet: style.getPropertyValue("--quiet"), paper: style.getPropertyValue("--paper"),
    accent: style.getPropertyValue("--accent"), warn: style.getPropertyValue("--warn"), colours: DARK.matches ? BRIGHT : COLOURS };
}

/** @param {(dark: boolean) => void} act */
export function onDark(act) { DARK.addEventListener("change", () => act(DARK.matches)); }

/** @param {any} c @param {string} label */
function axes(c, label) {
  const axis = { stroke: c.ink, grid: { stroke: c.line, width: 1 }, ticks: { stroke: c.line, width: 1 }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
  return { axis, y: { ...axis, size: 66, space: 18, label: unitLabel(label), labelSize: 18, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((t) => number(t)) } };
}

/** Courses over time. A line is {label, values, colour, width, dash, points}; `band` shades stretches of time, `levels` are dashed lines.
 * @param {HTMLElement} place @param {{time: any, lines: any[], unit: string, height: number, sync: string, shaded?: [number, number][], levels?: number[], describe: string, band?: any}} given */
export function timeChart(place, given) {
  const c = look(), { axis, y } = axes(c, given.unit === "1" ? "" : given.unit);
  const box = el("div", { class: "chart", role: "img", "aria-label": given.describe });
  place.append(box);
  const shade = (/** @type {any} */ u) => {
    const { ctx } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
    ctx.clip();
    ctx.fillStyle = c.line;
    ctx.globalAlpha = 0.55;
    for (const [from, to] of given.shaded ?? []) {
      const x = u.valToPos(from, "x", true);
      ctx.fillRect(x, u.bbox.top, u.valToPos(to, "x", true) - x, u.bbox.height);
    }
    ctx.globalAlpha = 1;
    ctx.strokeStyle = c.quiet;
    ctx.setLineDash([5, 4]);
    for (const level of given.levels ?? []) {
      const at = u.valToPos(level, "y", true);
      ctx.beginPath();
      ctx.moveTo(u.bbox.left, at);
      ctx.lineTo(u.bbox.left + u.bbox.width, at);
      ctx.stroke();
    }
    ctx.restore();
  };
  const value = (/** @type {any} */ _, /** @type {number} */ v) => v === null || v === undefined ? "—" : number(v);
  const bands = given.band ? [{ series: given.band, fill: fade(given.lines[given.band[0] - 1].colour) }] : [];
  const chart = new (/** @type {any} */ (uPlot))({
    width: Math.max(200, place.clientWidth - 26), height: given.height, cursor: { sync: { key: given.sync }, drag: { x: true, y: false } }, scales: { x: { time: false } },
    legend: { markers: { width: 2 } }, hooks: { drawClear: [shade] }, bands,
    axes: [{ ...axis, size: 30, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((t) => `${number(t)} s`) }, y],
    series: [{ label: "time", value: (/** @type {any} */ _, /** @type {number} */ v) => v === null || v === undefined ? "—" : `${number(v)} s` },
      ...given.lines.map((line) => ({ label: line.label, stroke: line.colour, width: line.width ?? 1.5, dash: line.dash, spanGaps: true, value, points: { show: false } }))],
  }, [given.time, ...given.lines.map((line) => line.values)], box);
  zoomByKeys(box, chart, given.sync);
  return chart;
}

/** A colour, pale. @param {string} colour */
function fade(colour) { return `color-mix(in srgb, ${colour.trim()} 22%, transparent)`; }

/** A cloud of y over x, rising x and falling x apart by colour, and a curve through it.
 * @param {HTMLElement} place @param {{x: any, y: any, up: any, xLabel: string, yLabel: string, height: number, describe: string, curve?: any[], zero?: boolean}} given */
export function cloud(place, given) {
  const c = look(), { axis, y } = axes(c, given.yLabel);
  const box = el("div", { class: "chart", role: "img", "aria-label": given.describe });
  place.append(box);
  const n = given.x.length, step = Math.max(1, Math.ceil(n / MOST));
  const range = (/** @type {any} */ values, /** @type {number[]} */ more) => {
    let low = Infinity, high = -Infinity;
    for (const v of [values, more]) for (const w of v) if (Number.isFinite(w)) { low = Math.min(low, w); high = Math.max(high, w); }
    const room = 0.04 * (high - low) || 1;
    return [low - room, high + room];
  };
  const xs = range(given.x, given.curve ? Array.from(given.curve[0]) : []), ys = range(given.y, given.curve ? [...given.curve[1], ...given.curve[2]] : []);
  const draw = (/** @type {any} */ u) => {
    const { ctx } = u, size = 2.4 * devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
    ctx.clip();
    if (ys[0] < 0 && ys[1] > 0) { ctx.fillStyle = c.quiet; ctx.fillRect(u.bbox.left, u.valToPos(0, "y", true), u.bbox.width, 1); }
    ctx.globalAlpha = 0.6;
    for (const rising of [1, 0]) {
      ctx.fillStyle = rising ? c.colours[0] : c.colours[1];
      for (let k = 0; k < n; k += step) {
        if ((given.up[k] > 0 ? 1 : 0) !== rising) continue;
        ctx.fillRect(u.valToPos(given.x[k], "x", true) - size / 2, u.valToPos(given.y[k], "y", true) - size / 2, size, size);
      }
    }
    ctx.globalAlpha = 1;
    for (const branch of given.curve ? [1, 2] : []) {
      ctx.strokeStyle = c.ink;
      ctx.lineWidth = 2 * devicePixelRatio;
      ctx.setLineDash(branch === 2 ? [6, 4] : []);
      ctx.beginPath();
      given.curve?.[0].forEach((/** @type {number} */ v, /** @type {number} */ k) => ctx.lineTo(u.valToPos(v, "x", true), u.valToPos(given.curve?.[branch][k], "y", true)));
      ctx.stroke();
    }
    ctx.restore();
  };
  const chart = new (/** @type {any} */ (uPlot))({
    width: Math.max(200, place.clientWidth - 26), height: given.height, cursor: { drag: { x: true, y: true } }, legend: { show: false },
    scales: { x: { time: false } }, hooks: { draw: [draw] },
    axes: [{ ...axis, size: 44, label: unitLabel(given.xLabel), labelSize: 18, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((t) => number(t)) }, y],
    series: [{}, { stroke: "transparent", points: { show: false } }],
  }, [xs, ys], box);
  box.append(el("p", { class: "cloud-key" }, key(c.colours[0]), " while it rises ", key(c.colours[1]), " while it falls", given.curve ? " — black: curve learnt from the fitted records" : ""));
  return chart;
}

/** @param {string} colour */
function key(colour) {
  const mark = el("span", { class: "swatch", "aria-hidden": "true" });
  mark.style.backgroundColor = colour;
  return mark;
}

/** A small line of a column's course. @param {number[]} values */
export function sketch(values) {
  const NS = "http://www.w3.org/2000/svg", svg = document.createElementNS(NS, "svg"), path = document.createElementNS(NS, "polyline");
  const low = Math.min(...values), high = Math.max(...values), n = Math.max(1, values.length - 1);
  for (const [k, v] of [["width", "96"], ["height", "24"], ["viewBox", "0 0 96 24"], ["aria-hidden", "true"]]) svg.setAttribute(k, v);
  path.setAttribute("points", values.map((v, k) => `${(96 * k / n).toFixed(1)},${(22 - 20 * (v - low) / (high - low || 1)).toFixed(1)}`).join(" "));
  path.setAttribute("class", "sketch");
  svg.append(path);
  return svg;
}
