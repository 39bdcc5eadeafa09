// Two cursors on the charts over time, and what the signals do between them.

import { el, number, unitLabel } from "./dom.js";

const STEPS = 200; // arrow keys move a cursor by this part of the run

/** Minimum, maximum, mean and root mean square between two times, by the trapezoidal rule on the samples and the ends. @param {ArrayLike<number>} time @param {ArrayLike<number>} values @param {number} from @param {number} to */
export function between(time, values, from, to) {
  const t = [from], v = [at(time, values, from)];
  for (let k = 0; k < time.length; k++) if (time[k] > from && time[k] < to) { t.push(time[k]); v.push(values[k]); }
  t.push(to);
  v.push(at(time, values, to));
  let area = 0, square = 0, low = Infinity, high = -Infinity;
  for (let k = 0; k < t.length; k++) {
    low = Math.min(low, v[k]);
    high = Math.max(high, v[k]);
    if (!k) continue;
    const dt = t[k] - t[k - 1];
    area += dt * (v[k] + v[k - 1]) / 2;
    square += dt * (v[k] * v[k] + v[k] * v[k - 1] + v[k - 1] * v[k - 1]) / 3; // of a straight line
  }
  const span = to - from;
  return { min: low, max: high, mean: span > 0 ? area / span : v[0], rms: span > 0 ? Math.sqrt(square / span) : Math.abs(v[0]) };
}

/** The value at a time, on a straight line between two samples. @param {ArrayLike<number>} time @param {ArrayLike<number>} values @param {number} t */
export function at(time, values, t) {
  let low = 0, high = time.length - 1;
  if (t <= time[0]) return values[0];
  if (t >= time[high]) return values[high];
  while (high - low > 1) { const middle = (low + high) >> 1; if (time[middle] <= t) low = middle; else high = middle; }
  return values[low] + (values[high] - values[low]) * (t - time[low]) / (time[high] - time[low] || 1);
}

export class Cursors {
  on = false;
  /** @type {number[]} */ times = [];
  next = 0; // the one that the next click moves

  /** @param {any} plots */
  constructor(plots) {
    this.plots = plots;
    this.place = el("div", { class: "cursors", role: "group", "aria-label": "Cursors" });
  }

  /** @param {number} first @param {number} last time of the run */
  begin(first, last) {
    this.on = true;
    this.times = [first + (last - first) / 3, first + 2 * (last - first) / 3];
  }

  /** A click on a chart moves the nearer cursor there. @param {number} time */
  put(time) {
    const k = Math.abs(time - this.times[0]) <= Math.abs(time - this.times[1]) ? 0 : 1;
    this.times[k] = time;
    this.times.sort((a, b) => a - b);
    this.moved();
  }

  moved() {
    this.plots.redraw();
    this.plots.onchoice?.();
  }

  /** The lines on a chart. @param {any} chart */
  draw(chart) {
    if (!this.on) return;
    const { ctx, bbox } = chart, style = getComputedStyle(document.body);
    ctx.save();
    ctx.setLineDash([]); // of the last line of the chart
    ctx.strokeStyle = style.getPropertyValue("--warn");
    ctx.fillStyle = ctx.strokeStyle;
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    this.times.forEach((time, k) => {
      const x = chart.valToPos(time, "x", true);
      if (x < bbox.left || x > bbox.left + bbox.width) return;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.fillText("AB"[k], x + 3 * devicePixelRatio, bbox.top + 11 * devicePixelRatio);
    });
    ctx.restore();
  }

  /** The table of the values. @param {any[]} groups */
  table(groups) {
    if (!this.on) { this.place.replaceChildren(); return this.place; }
    const [a, b] = this.times, held = /** @type {HTMLElement|null} */ (document.activeElement)?.id ?? "";
    const field = (/** @type {number} */ k) => el("label", {}, `${"AB"[k]} `, el("input", { id: `cursor-${"ab"[k]}`, class: "short mono", inputmode: "decimal", value: number(this.times[k], 6), "aria-label": `time of cursor ${"AB"[k]} in s`,
      onchange: (/** @type {any} */ e) => { const t = Number(e.target.value); if (Number.isFinite(t) && e.target.value.trim()) { this.times[k] = t; this.times.sort((p, q) => p - q); } this.moved(); },
      onkeydown: (/** @type {KeyboardEvent} */ e) => {
        const way = { ArrowUp: 1, ArrowDown: -1 }[e.key], time = groups[0]?.lines[0]?.run.time;
        if (!way || !time) return;
        e.preventDefault();
        this.times[k] = Math.min(time[time.length - 1], Math.max(time[0], this.times[k] + way * (time[time.length - 1] - time[0]) / STEPS));
        this.moved();
      } }), " s");
    const rows = groups.filter((g) => !g.frequency && !this.plots.over(g)).flatMap((g) => g.lines.map((/** @type {any} */ l) => {
      const { time } = l.run, values = l.run.series.get(l.name), p = at(time, values, a), q = at(time, values, b), f = between(time, values, a, b);
      const unit = g.unit === "1" ? "" : unitLabel(g.unit);
      return el("tr", {}, el("th", { scope: "row" }, l.run.label ? `${l.name} (${l.run.label})` : l.name), el("td", { class: "words" }, unit), ...[p, q, q - p, f.min, f.max, f.mean, f.rms].map((v) => el("td", {}, number(v / g.scale))));
    }));
    this.place.replaceChildren(el("div", { class: "choices" }, field(0), field(1), el("span", { id: "cursor-span" }, `B − A ${number(b - a)} s, 1/(B − A) ${number(1 / (b - a))} Hz`), el("span", { class: "hint" }, "a click on a chart moves the nearer one; arrow keys in a field move it")),
      el("div", { class: "scroll" }, el("table", { class: "figures", id: "cursor-table" }, el("thead", {}, el("tr", {}, ...["signal", "unit", "at A", "at B", "B − A", "min", "max", "mean", "rms"].map((h, k) => el("th", { scope: "col", class: k < 2 ? "words" : null }, h)))), el("tbody", {}, ...rows))));
    if (held.startsWith("cursor-")) document.getElementById(held)?.focus();
    return this.place;
  }
}
