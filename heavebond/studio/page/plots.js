// Signals over time by uPlot: one chart for each unit, linked in time; runs laid over each other.

import uPlot from "./vendor/uPlot.js";
import { byId, download, el, number, unitLabel } from "./dom.js";

// for every kind of colour vision (after Okabe and Ito), and brighter ones on a dark ground
export const COLOURS = ["#0072b2", "#c44e00", "#00785a", "#a1478a", "#8a6d00", "#1d2733"];
export const BRIGHT = ["#6cbcf0", "#ff9d5c", "#4fd1a5", "#e58ccb", "#e0c04a", "#e4e9ee"];
export const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [4, 4], [14, 4]];
const HEIGHT = 190;

export class Plots {
  constructor() {
    this.place = byId("plots");
    /** @type {any[]} */
    this.charts = [];
    this.shape = "";
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", () => { this.shape = ""; this.again?.(); });
    new ResizeObserver(() => this.fit()).observe(this.place);
    this.limits = null;
    /** @type {((time: number) => void)|undefined} */ this.onpoint = undefined;
  }

  /** @param {any[]} runs the visible ones, each with `series` by name @param {string[]} plotted @param {HTMLElement[]} above @param {HTMLElement[]} below what stands above and under the charts */
  show(runs, plotted, above, below) {
    this.place.classList.remove("bare");
    this.again = () => this.show(runs, plotted, above, below);
    const groups = grouped(runs, plotted);
    const shape = JSON.stringify([groups.map((g) => [g.unit, g.lines.map((/** @type {any} */ l) => [l.name, l.run.id, l.run.label])])]);
    if (shape !== this.shape) this.build(groups, shape);
    groups.forEach((group, k) => this.charts[k].setData(data(group), !this.limits));
    if (this.limits) for (const chart of this.charts) chart.setScale("x", this.limits);
    this.head?.replaceChildren(...above);
    this.tail?.replaceChildren(...below);
  }

  /** @param {...(Node|string)} words */
  empty(...words) {
    this.clear();
    this.place.classList.add("bare");
    this.place.replaceChildren(el("div", { class: "empty" }, ...words));
  }

  clear() {
    for (const chart of this.charts) chart.destroy();
    this.charts = [];
    this.shape = "";
  }

  /** @param {any[]} groups @param {string} shape */
  build(groups, shape) {
    this.clear();
    this.shape = shape;
    this.head = el("div", { role: "alert" });
    this.tail = el("div");
    const places = groups.map((group) => el("div", { class: "chart", role: "img",
      "aria-label": `${group.lines.map((/** @type {any} */ l) => l.name).join(", ")} over time` }));
    this.place.replaceChildren(this.head, ...places, this.tail);
    this.charts = groups.map((group, k) => new (/** @type {any} */ (uPlot))(this.options(group), data(group), places[k]));
    this.charts.forEach((chart, k) => zoomByKeys(places[k], chart, "time"));
  }

  /** @param {any} group */
  options(group) {
    const style = getComputedStyle(document.body), ink = style.color, line = style.getPropertyValue("--line"), palette = this.dark.matches ? BRIGHT : COLOURS;
    const names = [...new Set(group.lines.map((/** @type {any} */ l) => l.name))];
    const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1 }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    return {
      width: this.place.clientWidth - 26, height: HEIGHT, cursor: { sync: { key: "time" }, drag: { x: true, y: false } },
      scales: { x: { time: false } },
      legend: { markers: { width: 2, dash: (/** @type {any} */ chart, /** @type {number} */ k) => chart.series[k].dash?.length ? "dashed" : "solid" } },
      hooks: { setScale: [(/** @type {any} */ chart, /** @type {string} */ key) => key === "x" && this.linked(chart)],
        setCursor: [(/** @type {any} */ chart) => { const { left } = chart.cursor; if (!this.pointing && left >= 0) this.onpoint?.(chart.posToVal(left, "x")); }] },
      axes: [{ ...axis, size: 30, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((t) => `${number(t)} s`) },
        { ...axis, size: 66, label: group.unit === "1" ? "" : unitLabel(group.unit), labelSize: 18, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((t) => number(t)) }],
      series: [{ label: "time", value: (/** @type {any} */ _, /** @type {number} */ v) => v === null || v === undefined ? "—" : `${number(v)} s` },
        ...group.lines.map((/** @type {any} */ l, /** @type {number} */ k, /** @type {any[]} */ all) => ({
          label: l.run.label ? `${l.name} (${l.run.label})` : l.name, stroke: palette[(names.length > 1 ? names.indexOf(l.name) : (k + 1) % all.length) % palette.length], // one signal: colours tell the runs
          width: l.run.live ? 1.8 : 1.3,
          dash: DASHES[l.run.dash % DASHES.length], points: { show: false }, spanGaps: true,
          value: (/** @type {any} */ _, /** @type {number} */ v) => v === null || v === undefined ? "—" : number(v) }))] };
  }

  /** The same stretch of time in all charts. @param {any} chart */
  linked(chart) {
    if (this.linking) return;
    const { min, max } = chart.scales.x, times = chart.data[0];
    if (min === null || !times.length) return;
    const whole = min <= times[0] && max >= times[times.length - 1];
    this.limits = whole ? null : { min, max };
    this.linking = true;
    for (const other of this.charts) if (other !== chart) other.setScale("x", { min, max });
    this.linking = false;
  }

  /** The cursor of all charts at a time. @param {number} time */
  pointAt(time) {
    this.pointing = true;
    for (const chart of this.charts) {
      const { min, max } = chart.scales.x;
      chart.setCursor({ left: time >= min && time <= max ? chart.valToPos(time, "x") : -10, top: -1e4 }, false);
    }
    this.pointing = false;
  }

  fit() {
    for (const chart of this.charts) chart.setSize({ width: this.place.clientWidth - 26, height: HEIGHT });
  }

  /** All charts below each other. @param {string} name */
  png(name) {
    const canvases = this.charts.map((chart) => chart.ctx.canvas), rows = this.charts.map((chart) => chart.series.slice(1));
    const ratio = devicePixelRatio, strip = 20 * ratio;
    const whole = document.createElement("canvas");
    whole.width = Math.max(...canvases.map((c) => c.width));
    whole.height = canvases.reduce((sum, c) => sum + c.height + strip, 0);
    const pen = /** @type {CanvasRenderingContext2D} */ (whole.getContext("2d"));
    pen.fillStyle = getComputedStyle(document.body).backgroundColor;
    pen.fillRect(0, 0, whole.width, whole.height);
    pen.font = `${12 * ratio}px system-ui, sans-serif`;
    let y = 0;
    canvases.forEach((canvas, k) => {
      let x = 60 * ratio;
      for (const series of rows[k]) {
        pen.fillStyle = series._stroke ?? series.stroke();
        pen.fillText(series.label, x, y + 14 * ratio);
        x += pen.measureText(series.label).width + 20 * ratio;
      }
      pen.drawImage(canvas, 0, y + strip);
      y += canvas.height + strip;
    });
    whole.toBlob((blob) => blob && download(`${name}.png`, blob));
  }

  /** What is plotted, with all digits. @param {string} name @param {any[]} runs @param {string[]} plotted */
  csv(name, runs, plotted) {
    const columns = [], heads = [];
    for (const run of runs) {
      const mark = run.label ? ` (${run.label})` : "";
      heads.push(`time${mark} [s]`);
      columns.push(run.time);
      for (const signal of plotted.filter((s) => run.series.has(s))) {
        heads.push(`${signal}${mark} [${run.units[signal]}]`);
        columns.push(run.series.get(signal));
      }
    }
    const quoted = heads.map((head) => /[",]/.test(head) ? `"${head.replaceAll('"', '""')}"` : head);
    const lines = [quoted.join(",")];
    for (let k = 0; k < Math.max(...columns.map((c) => c.length)); k++) lines.push(columns.map((c) => k < c.length ? String(c[k]) : "").join(","));
    download(`${name}.csv`, new Blob([lines.join("\n") + "\n"], { type: "text/csv" }));
  }
}

/** A chart that is reached by Tab and zoomed in time by keys, together with those of its group. @param {HTMLElement} box @param {any} chart @param {string} group */
export function zoomByKeys(box, chart, group) {
  box.tabIndex = 0;
  box.addEventListener("keydown", (event) => {
    const { min, max } = chart.scales.x, times = chart.data[0], span = max - min, middle = chart.cursor.left >= 0 ? chart.posToVal(chart.cursor.left, "x") : (min + max) / 2;
    const about = (/** @type {number} */ factor) => [middle - (middle - min) * factor, middle + (max - middle) * factor];
    const step = (/** @type {number} */ share) => [min + share * span, max + share * span];
    const seen = /** @type {Record<string, number[]>} */ ({ "+": about(0.7), "=": about(0.7), "-": about(1 / 0.7), 0: [-Infinity, Infinity], ArrowLeft: step(-0.2), ArrowRight: step(0.2) })[event.key];
    if (!seen || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    const [from, to] = [Math.max(seen[0], times[0]), Math.min(seen[1], times[times.length - 1])];
    if (to > from) for (const other of uPlot.sync(group).plots) other.setScale("x", { min: from, max: to });
  });
}

/** Lines by their unit, with the one in which they read well: bar for large pressures in Pa. @param {any[]} runs @param {string[]} plotted */
function grouped(runs, plotted) {
  /** @type {Map<string, any>} */
  const groups = new Map();
  for (const name of plotted) {
    for (const run of runs) {
      if (!run.series.has(name)) continue;
      const unit = run.units[name];
      if (!groups.has(unit)) groups.set(unit, { unit, lines: [] });
      groups.get(unit).lines.push({ name, run });
    }
  }
  for (const group of groups.values()) {
    let size = 0;
    for (const { name, run } of group.lines) for (const v of run.series.get(name)) size = Math.max(size, Math.abs(v));
    const steps = group.lines.find((/** @type {any} */ l) => l.run.readable[group.unit])?.run.readable[group.unit];
    const [, unit, scale] = (size && steps?.find((/** @type {any[]} */ [least]) => size >= least)) || [0, group.unit, 1];
    Object.assign(group, { unit, scale });
  }
  return [...groups.values()];
}

/** The columns of a chart; runs with other times are joined. @param {any} group */
function data(group) {
  const { lines, scale } = group, times = lines[0].run.time;
  const values = (/** @type {any} */ l) => { const found = l.run.series.get(l.name); return scale === 1 ? found : found.map((/** @type {number} */ v) => v / scale); };
  const same = lines.every((/** @type {any} */ l) => l.run.time === times || (l.run.time.length === times.length && l.run.time.at(-1) === times.at(-1)));
  if (same) return [times, ...lines.map(values)];
  return uPlot.join(lines.map((/** @type {any} */ l) => [l.run.time, values(l)]));
}
