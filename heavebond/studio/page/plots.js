// Signals by uPlot: one chart for each unit, linked in time, or over another signal; runs laid over each other.

import uPlot from "./vendor/uPlot.js";
import { Cursors } from "./cursors.js";
import { askName, byId, download, el, number, unitLabel } from "./dom.js";

// for every kind of colour vision (after Okabe and Ito), and brighter ones on a dark ground
export const COLOURS = ["#0072b2", "#c44e00", "#00785a", "#a1478a", "#8a6d00", "#1d2733"];
export const BRIGHT = ["#6cbcf0", "#ff9d5c", "#4fd1a5", "#e58ccb", "#e0c04a", "#e4e9ee"];
export const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [4, 4], [14, 4]];
export const SIGNAL = "application/x-heavebond-signal"; // the kind of what is dragged from the panel into a chart
const SPECTRUM = "~spectrum"; // in place of the signal over which a chart is drawn
const HEIGHT = 190, FLAT = 1e-9; // pixels; share of its size below which the span of a signal counts as none

export class Plots {
  constructor() {
    this.place = byId("plots");
    /** @type {any[]} */
    this.charts = [];
    this.shape = "";
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", () => { this.shape = ""; this.again?.(); });
    new ResizeObserver(() => this.fit()).observe(this.place);
    /** The part of the time (s) that the charts show; null for all. @type {{min: number, max: number}|null} */
    this.limits = null;
    /** What is chosen for the chart of a unit; `limits` of its vertical axis are in the unit of the run. @type {Record<string, {unit?: string, log?: boolean, over?: string, limits?: [number, number], abscissa?: [number, number]}>} */
    this.choices = {};
    this.large = ""; // the chart that fills the place
    /** Signals that have a chart of their own, or that of another signal, by its key. @type {Record<string, string>} */
    this.panes = {};
    /** @type {string[]} */ this.order = []; // keys of the charts that were moved
    this.columns = 1; // charts beside each other
    this.cursors = new Cursors(this);
    /** @type {((run: any, name: string) => void)|undefined} */ this.onspectrum = undefined;
    /** @type {((time: number) => void)|undefined} */ this.onpoint = undefined;
    /** @type {(() => void)|undefined} */ this.onchoice = undefined;
    /** Draws marks on a chart over time. @type {((chart: any) => void)|undefined} */ this.onmarks = undefined;
    /** A signal was dragged from the panel onto a chart; its key is empty beside the charts. @type {((name: string, base: string) => void)|undefined} */ this.ondrop = undefined;
    this.receive();
  }

  /** @param {any[]} runs the visible ones, each with `series` by name @param {string[]} plotted @param {HTMLElement[]} above @param {HTMLElement[]} below what stands above and under the charts */
  show(runs, plotted, above, below) {
    this.place.classList.remove("bare");
    this.again = () => this.show(runs, plotted, above, below);
    const groups = this.groups = grouped(runs, plotted, this.choices, this.panes, this.order);
    for (const group of groups) group.frequency = this.choices[group.base]?.over === SPECTRUM;
    if (!groups.some((g) => g.base === this.large)) this.large = "";
    const shape = JSON.stringify([this.choices, this.large, this.columns, groups.map((g) => [g.base, g.unit, g.frequency && this.known(g), g.lines.map((/** @type {any} */ l) => [l.name, l.run.id, l.run.label])])]);
    if (shape !== this.shape) this.build(groups, shape);
    groups.forEach((group, k) => this.charts[k].along ? this.charts[k].along(group) : this.charts[k].setData(group.frequency ? this.spectrum(group) : data(group), group.frequency || !this.limits));
    if (this.limits) for (const chart of this.charts) if (!chart.along && !chart.frequency) chart.setScale("x", this.limits);
    this.head?.replaceChildren(...above);
    this.tail?.replaceChildren(this.cursors.table(groups), ...below);
  }

  /** The cursors have moved. */
  redraw() {
    for (const chart of this.charts) chart.redraw(false);
    this.cursors.table(this.groups ?? []);
  }

  /** Two cursors, on or off. */
  measure() {
    const times = this.groups?.[0]?.lines[0]?.run.time;
    if (this.cursors.on || !times) this.cursors.on = false;
    else this.cursors.begin(times[0], times[times.length - 1]);
    this.redraw();
  }

  /** A chart before another one. @param {string} base @param {string} before empty for the end */
  reorder(base, before) {
    const keys = (this.groups ?? []).map((/** @type {any} */ g) => g.base).filter((/** @type {string} */ key) => key !== base), k = keys.indexOf(before);
    keys.splice(k < 0 ? keys.length : k, 0, base);
    this.order = keys;
    this.shape = "";
    this.onchoice?.();
    this.again?.();
  }

  /** Each signal of a chart in its own, or all of one unit together again. @param {any} group */
  split(group) {
    const names = [...new Set(group.lines.map((/** @type {any} */ l) => l.name))];
    if (names.length > 1) for (const name of names.slice(1)) this.panes[String(name)] = String(name);
    else for (const name of names) delete this.panes[String(name)];
    this.onchoice?.();
    this.again?.();
  }

  /** The lines of a chart whose density is known. @param {any} group */
  known(group) { return group.lines.filter((/** @type {any} */ l) => l.run.spectra?.has(l.name)).map((/** @type {any} */ l) => `${l.name} ${l.run.id}`); }

  /** The densities of a chart over the frequency. @param {any} group */
  spectrum(group) {
    return uPlot.join(group.lines.map((/** @type {any} */ l) => {
      const [frequency, density] = l.run.spectra?.get(l.name) ?? [[], []];
      return [frequency, Array.from(density, (/** @type {number} */ v) => v > 0 ? v / group.scale ** 2 : null)];
    }));
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
    const names = [...new Set(groups.flatMap((g) => g.lines.map((/** @type {any} */ l) => l.name)))];
    const places = groups.map((group) => el("div", { class: "chart", role: "img",
      "aria-label": `${group.lines.map((/** @type {any} */ l) => l.name).join(", ")} over ${this.over(group) || "time"}` }));
    this.place.style.setProperty("--columns", String(this.large ? 1 : this.columns));
    const boxes = groups.map((group, k) => el("div", { class: "chart-box", "data-chart": group.base, hidden: this.large !== "" && group.base !== this.large }, this.tools(group, names), places[k]));
    this.place.replaceChildren(this.head, el("div", { class: `dock${this.columns > 1 && !this.large ? " narrow" : ""}` }, ...boxes), this.tail);
    this.charts = groups.map((group, k) => group.frequency ? this.densities(group, places[k]) : this.over(group) ? this.curves(group, places[k]) : new (/** @type {any} */ (uPlot))(this.options(group), data(group), places[k]));
    this.charts.forEach((chart, k) => { if (!chart.along) zoomByKeys(places[k], chart, chart.frequency ? `f${k}` : "time"); });
    this.charts.forEach((chart) => {
      if (chart.along || chart.frequency) return;
      let from = 0;
      chart.over.addEventListener("mousedown", (/** @type {MouseEvent} */ e) => { from = e.clientX; });
      chart.over.addEventListener("mouseup", (/** @type {MouseEvent} */ e) => { if (this.cursors.on && Math.abs(e.clientX - from) < 3) this.cursors.put(chart.posToVal(e.offsetX, "x")); });
    });
  }

  /** A chart over the frequency, both axes logarithmic. @param {any} group @param {HTMLElement} box */
  densities(group, box) {
    for (const line of group.lines) if (!line.run.spectra?.has(line.name)) this.onspectrum?.(line.run, line.name);
    if (!this.known(group).length) { // a logarithmic axis needs values
      box.replaceChildren(el("p", { class: "empty" }, "Computing the spectrum…"));
      const nothing = () => undefined;
      return { along: nothing, redraw: nothing, setSize: nothing, setScale: nothing, destroy: nothing, root: box, series: [], data: [[]] };
    }
    const given = this.options(group), tick = (/** @type {any} */ _, /** @type {(number|null)[]} */ ticks) => ticks.map((t) => t === null ? "" : number(t));
    const unit = group.unit === "1" ? "1/Hz" : `(${unitLabel(group.unit)})²/Hz`;
    const chart = new (/** @type {any} */ (uPlot))({ ...given, cursor: { drag: { x: true, y: false } }, hooks: {}, scales: { x: { time: false, distr: 3, log: 10, range: decades }, y: { distr: 3, log: 10, range: decades } },
      axes: [{ ...given.axes[0], values: tick, splits: powers, size: 44, label: "frequency [Hz]", labelSize: 18 }, { ...given.axes[1], label: unit, values: tick, splits: powers }],
      series: [{ label: "frequency", value: (/** @type {any} */ _, /** @type {number} */ v) => v === null || v === undefined ? "—" : `${number(v)} Hz` }, ...given.series.slice(1)] }, this.spectrum(group), box);
    chart.frequency = true;
    return chart;
  }

  /** Drag a chart by its handle before another one. @param {PointerEvent} event @param {string} base */
  carry(event, base) {
    event.preventDefault();
    const quit = new AbortController(), { signal } = quit;
    const under = (/** @type {PointerEvent} */ e) => document.elementFromPoint(e.clientX, e.clientY)?.closest("[data-chart]");
    const clear = () => { for (const box of this.place.querySelectorAll(".drop")) box.classList.remove("drop"); };
    addEventListener("pointermove", (e) => { clear(); under(e)?.classList.add("drop"); }, { signal });
    addEventListener("pointerup", (e) => {
      quit.abort();
      clear();
      const target = under(e), to = target?.getAttribute("data-chart") ?? "";
      if (!target || to === base) return;
      const box = target.getBoundingClientRect(), keys = (this.groups ?? []).map((/** @type {any} */ g) => g.base);
      const after = this.columns > 1 ? e.clientX > box.left + box.width / 2 : e.clientY > box.top + box.height / 2;
      this.reorder(base, after ? keys[keys.indexOf(to) + 1] ?? "" : to);
    }, { signal });
    addEventListener("pointercancel", () => { quit.abort(); clear(); }, { signal });
  }

  /** Take signals that are dragged from the panel. */
  receive() {
    const clear = () => { for (const box of this.place.querySelectorAll(".drop")) box.classList.remove("drop"); };
    this.place.addEventListener("dragover", (event) => {
      if (!event.dataTransfer?.types.includes(SIGNAL)) return;
      event.preventDefault();
      clear();
      /** @type {Element} */ (event.target).closest("[data-chart]")?.classList.add("drop");
    });
    this.place.addEventListener("dragleave", clear);
    this.place.addEventListener("drop", (event) => {
      const name = event.dataTransfer?.getData(SIGNAL);
      clear();
      if (!name) return;
      event.preventDefault();
      this.ondrop?.(name, /** @type {Element} */ (event.target).closest("[data-chart]")?.getAttribute("data-chart") ?? "");
    });
  }

  /** Ask for the ends of the vertical axis of a chart, and for the part of the time that all charts show, or of the signal over which this one is drawn. @param {any} group */
  limit(group) {
    const over = this.over(group), along = over && (this.groups ?? []).find((/** @type {any} */ g) => g.lines.some((/** @type {any} */ l) => l.name === over)), word = over ? "over" : "time";
    const factor = along?.scale ?? 1, second = over ? this.choices[group.base]?.abscissa?.map((v) => v / factor) : this.limits && [this.limits.min, this.limits.max];
    const { base, scale } = group, unit = group.unit === "1" ? "" : ` in ${unitLabel(group.unit)}`, [chart] = this.charts.filter((_, k) => this.groups?.[k]?.base === base);
    const now = this.choices[base]?.limits?.map((v) => v / scale) ?? [chart?.scales?.y?.min, chart?.scales?.y?.max];
    const range = (/** @type {number[]} */ ends) => ends.map((v) => number(v)).join(" .. "), shown = now.every(Number.isFinite) ? [range(now)] : [];
    if (second) shown.push(`${word} ${range(second)}`);
    askName("Limits of the axes", `From .. to${unit}; of ${over ? `${over}${along && along.unit !== "1" ? ` in ${unitLabel(along.unit)}` : ""}` : "the time in s"} after a semicolon; empty for automatic limits:`, shown.join("; "), async (text) => {
      /** @type {[number, number]|undefined} */ let axis, time = /** @type {any} */ (undefined);
      for (const part of text.split(";").map((p) => p.trim()).filter(Boolean)) {
        const ends = part.replace(/^(time|over)\b/, "").split("..").map((end) => Number(end.trim() || NaN));
        if (ends.length !== 2 || !ends.every(Number.isFinite) || ends[0] >= ends[1]) throw new Error(`Write the lower and the upper limit, such as 0 .. 40, or 0 .. 40; ${word} 2 .. 5.`);
        if (/^(time|over)\b/.test(part)) time = ends;
        else axis = [ends[0], ends[1]];
      }
      if (axis && this.choices[base]?.log && axis[0] <= 0) throw new Error("A logarithmic axis needs limits above zero.");
      return () => {
        if (!over) this.limits = time ? { min: time[0], max: time[1] } : null;
        this.choose(base, { limits: axis && [axis[0] * scale, axis[1] * scale], ...(over ? { abscissa: time?.map((/** @type {number} */ v) => v * factor) } : {}) });
      };
    }, "Set");
  }

  /** The signal over which the lines of a group are drawn; empty for time. @param {any} group */
  over(group) {
    const name = this.choices[group.base]?.over ?? "";
    if (name === SPECTRUM) return "";
    return group.lines.some((/** @type {any} */ l) => l.run.series.has(name)) ? name : "";
  }

  /** @param {string} base @param {Record<string, any>} given */
  choose(base, given) {
    this.choices = { ...this.choices, [base]: { ...this.choices[base], ...given } };
    this.onchoice?.();
    this.again?.();
  }

  /** Unit, logarithmic axis, abscissa and size of a chart. @param {any} group @param {string[]} names */
  tools(group, names) {
    const { base } = group, choice = this.choices[base] ?? {}, subject = group.lines[0].name;
    const option = (/** @type {string} */ value, /** @type {string} */ words, /** @type {string} */ now) => el("option", { value, selected: value === now }, words);
    const units = group.units.length > 1 ? [el("select", { "aria-label": `unit of ${subject}`, onchange: (/** @type {any} */ e) => this.choose(base, { unit: e.target.value }) },
      option("", "unit", choice.unit ?? ""), ...group.units.map((/** @type {string} */ u) => option(u, unitLabel(u), choice.unit ?? "")))] : [];
    const large = this.large === base;
    const all = this.groups ?? [], k = all.findIndex((/** @type {any} */ g) => g.base === base), several = new Set(group.lines.map((/** @type {any} */ l) => l.name)).size > 1;
    return el("div", { class: "chart-tools" },
      all.length > 1 && el("button", { class: "handle", "aria-label": `move the chart of ${subject}`, title: "Drag the chart to another place; or arrow keys", onpointerdown: (/** @type {PointerEvent} */ e) => this.carry(e, base),
        onkeydown: (/** @type {KeyboardEvent} */ e) => {
          const way = { ArrowLeft: -1, ArrowUp: -1, ArrowRight: 1, ArrowDown: 1 }[e.key];
          if (!way) return;
          e.preventDefault();
          this.reorder(base, all[way < 0 ? k - 1 : k + 2]?.base ?? (way < 0 ? all[0].base : ""));
          /** @type {HTMLElement|null} */ (this.place.querySelector(`[data-chart="${CSS.escape(base)}"] .handle`))?.focus();
        } }, "⠿"),
      (several || this.panes[subject]) && el("button", { "aria-label": several ? `a chart for each signal of ${subject}` : `${subject} into the chart of its unit`, title: several ? "A chart for each signal" : "Into the chart of its unit", onclick: () => this.split(group) }, several ? "split" : "join"),
      ...units,
      el("button", { "aria-pressed": String(Boolean(choice.log && group.positive)), disabled: !group.positive, "aria-label": `logarithmic axis of ${subject}`,
        title: group.positive ? "Logarithmic axis" : "A logarithmic axis needs values above zero", onclick: () => this.choose(base, { log: !choice.log }) }, "log"),
      el("select", { "aria-label": `what ${subject} is drawn over`, onchange: (/** @type {any} */ e) => this.choose(base, { over: e.target.value, abscissa: undefined }) },
        option("", "over time", choice.over ?? ""), option(SPECTRUM, "as spectrum", choice.over ?? ""), ...names.map((name) => option(name, `over ${name}`, this.over(group)))),
      el("button", { class: "axis-limits", "aria-pressed": String(Boolean(choice.limits)), "aria-label": `limits of the axes of ${subject}`, title: "Limits of the vertical axis and of the time", onclick: () => this.limit(group) }, "limits"),
      el("button", { "aria-pressed": String(large), "aria-label": large ? "show all charts" : `show ${subject} alone`, title: large ? "Show all charts" : "Show this chart alone",
        onclick: () => { this.large = large ? "" : base; this.shape = ""; this.onchoice?.(); this.again?.(); } }, large ? "▣" : "□"));
  }

  get width() { return Math.max(160, Math.floor(this.place.clientWidth / (this.large ? 1 : this.columns)) - 26); }

  /** @param {any} group */
  height(group) { return group.base === this.large ? Math.max(HEIGHT, this.place.clientHeight - 90) : HEIGHT; }

  /** Lines over another signal, in the order of time. @param {any} group @param {HTMLElement} box */
  curves(group, box) {
    const given = this.options(group), name = this.over(group), { abscissa } = this.choices[group.base] ?? {};
    const of = (/** @type {string} */ signal) => (this.groups ?? []).find((/** @type {any} */ g) => g.lines.some((/** @type {any} */ l) => l.name === signal)); // in the unit of its chart
    const { scale, unit } = of(name) ?? { scale: 1, unit: group.lines[0].run.units[name] };
    let shown = group;
    const lines = () => shown.lines.filter((/** @type {any} */ l) => l.run.series.has(name)).map((/** @type {any} */ l, /** @type {number} */ k) => ({ x: scaled({ run: l.run, name }, scale), y: scaled(l, shown.scale), of: given.series[k + 1] }));
    const ends = (/** @type {"x"|"y"} */ key) => { let low = Infinity, high = -Infinity; for (const l of lines()) for (const v of l[key]) if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); } return low <= high ? [low, high] : [0, 1]; };
    const draw = (/** @type {any} */ u) => {
      const { ctx } = u;
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      for (const line of lines()) {
        ctx.strokeStyle = line.of.stroke;
        ctx.lineWidth = line.of.width * devicePixelRatio;
        ctx.setLineDash((line.of.dash ?? []).map((/** @type {number} */ d) => d * devicePixelRatio));
        ctx.beginPath();
        line.y.forEach((/** @type {number} */ v, /** @type {number} */ k) => ctx.lineTo(u.valToPos(line.x[k], "x", true), u.valToPos(v, "y", true)));
        ctx.stroke();
      }
      ctx.restore();
    };
    const chart = new (/** @type {any} */ (uPlot))({ ...given, cursor: { drag: { x: true, y: true } }, hooks: { draw: [draw] },
      scales: { ...given.scales, x: { time: false, ...(abscissa ? { range: abscissa.map((v) => v / scale) } : {}) } },
      axes: [{ ...given.axes[1], size: 44, label: unit && unit !== "1" ? `${name} [${unitLabel(unit)}]` : name, labelSize: 18 }, given.axes[1]],
      series: [{ label: name }, ...given.series.slice(1).map((/** @type {any} */ one) => ({ ...one, show: true, stroke: one.stroke, paths: () => null }))] },
      [ends("x"), ...group.lines.map(() => ends("y"))], box);
    chart.along = (/** @type {any} */ next) => { shown = next; chart.setData([ends("x"), ...next.lines.map(() => ends("y"))]); };
    return chart;
  }

  /** @param {any} group */
  options(group) {
    const style = getComputedStyle(document.body), ink = style.color, line = style.getPropertyValue("--line"), palette = this.dark.matches ? BRIGHT : COLOURS;
    const names = [...new Set(group.lines.map((/** @type {any} */ l) => l.name))];
    const { limits } = this.choices[group.base] ?? {};
    const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1 }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    return {
      width: this.width, height: this.height(group), cursor: { sync: { key: "time" }, drag: { x: true, y: false } },
      scales: { x: { time: false }, y: { ...(this.choices[group.base]?.log && group.positive ? { distr: 3, log: 10 } : { range: roomy }), ...(limits ? { range: limits.map((v) => v / group.scale) } : {}) } },
      legend: { markers: { width: 2, dash: (/** @type {any} */ chart, /** @type {number} */ k) => chart.series[k].dash?.length ? "dashed" : "solid" } },
      hooks: { draw: [(/** @type {any} */ chart) => { this.cursors.draw(chart); this.onmarks?.(chart); }], setScale: [(/** @type {any} */ chart, /** @type {string} */ key) => key === "x" && this.linked(chart)],
        setCursor: [(/** @type {any} */ chart) => { const { left } = chart.cursor; if (!this.pointing && left >= 0) this.onpoint?.(chart.posToVal(left, "x")); }] },
      axes: [{ ...axis, size: 30, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((t) => `${number(t)} s`) },
        { ...axis, size: 66, label: group.unit === "1" ? "" : unitLabel(group.unit), labelSize: 18, values: (/** @type {any} */ _, /** @type {(number|null)[]} */ ticks) => ticks.map((t) => t === null ? "" : number(t)) }],
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
    for (const other of this.charts) if (other !== chart && !other.along && !other.frequency) other.setScale("x", { min, max });
    this.linking = false;
  }

  /** The cursor of all charts at a time. @param {number} time */
  pointAt(time) {
    this.pointing = true;
    for (const chart of this.charts) {
      if (chart.along || chart.frequency) continue;
      const { min, max } = chart.scales.x;
      chart.setCursor({ left: time >= min && time <= max ? chart.valToPos(time, "x") : -10, top: -1e4 }, false);
    }
    this.pointing = false;
  }

  fit() {
    for (const chart of this.charts) chart.setSize({ width: this.width, height: this.large && !chart.root.closest("[hidden]") ? Math.max(HEIGHT, this.place.clientHeight - 90) : HEIGHT });
  }

  /** All charts below each other. @param {string} name */
  png(name) {
    const charts = this.charts.filter((chart) => chart.ctx), canvases = charts.map((chart) => chart.ctx.canvas), rows = charts.map((chart) => chart.series.slice(1));
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

/** Powers of ten on an axis, not more than a label each 16 px needs. @param {any} _ @param {number} __ @param {number} low @param {number} high */
function powers(_, __, low, high) {
  const from = Math.ceil(Math.log10(low) - 1e-9), to = Math.floor(Math.log10(high) + 1e-9), step = Math.max(1, Math.ceil((to - from) / 7));
  return Array.from({ length: Math.floor((to - from) / step) + 1 }, (_, k) => 10 ** (from + k * step));
}

/** The ends of a logarithmic axis, over at most nine decades below the largest value. @param {any} _ @param {number|null} low @param {number|null} high */
function decades(_, low, high) {
  if (!high || !(high > 0)) return [0.1, 1];
  const top = 10 ** Math.ceil(Math.log10(high)), least = Math.max(low ?? 0, 1e-9 * high);
  return [Math.min(10 ** Math.floor(Math.log10(least)), top / 10), top];
}

/** The ends of an axis: of a signal that does not vary, a tenth of its size on both sides. @param {any} _ @param {number} low @param {number} high */
export function roomy(_, low, high) {
  if (low === null || high === null) return [0, 1];
  const size = Math.max(Math.abs(low), Math.abs(high)), room = size ? 0.1 * size : 1;
  return high - low <= FLAT * size ? [low - room, high + room] : /** @type {any} */ (uPlot).rangeNum(low, high, 0.1, true);
}

/** Lines by their unit, with the one that is chosen, or in which they read well: bar for large pressures in Pa. @param {any[]} runs @param {string[]} plotted @param {Record<string, any>} choices @param {Record<string, string>} panes @param {string[]} order */
function grouped(runs, plotted, choices, panes, order) {
  /** @type {Map<string, any>} */
  const groups = new Map();
  for (const name of plotted) {
    for (const run of runs) {
      if (!run.series.has(name)) continue;
      const unit = run.units[name];
      const base = panes[name] ? `${unit}#${panes[name]}` : unit;
      if (!groups.has(base)) groups.set(base, { base, unit, lines: [] });
      groups.get(base).lines.push({ name, run });
    }
  }
  for (const group of groups.values()) {
    let size = 0, least = Infinity;
    for (const { name, run } of group.lines) for (const v of run.series.get(name)) { size = Math.max(size, Math.abs(v)); if (v < least) least = v; }
    const steps = group.lines.find((/** @type {any} */ l) => l.run.readable[group.unit])?.run.readable[group.unit] ?? [];
    const base = group.unit, chosen = choices[group.base]?.unit, readable = size && steps.find((/** @type {any[]} */ [smallest]) => size >= smallest);
    const [, unit, scale] = (chosen && (chosen === base ? [0, base, 1] : steps.find((/** @type {any[]} */ [, u]) => u === chosen))) || readable || [0, base, 1];
    const units = [...new Set([base, ...steps.map((/** @type {any[]} */ [, u]) => u)])];
    Object.assign(group, { unit, scale, units, positive: least > 0 });
  }
  const place = (/** @type {any} */ g) => { const k = order.indexOf(g.base); return k < 0 ? order.length : k; };
  return [...groups.values()].sort((a, b) => place(a) - place(b));
}

/** The values of a line in the unit of its chart. @param {any} line @param {number} scale */
function scaled(line, scale) { const found = line.run.series.get(line.name); return scale === 1 ? found : found.map((/** @type {number} */ v) => v / scale); }

/** The columns of a chart; runs with other times are joined. @param {any} group */
function data(group) {
  const { lines, scale } = group, times = lines[0].run.time;
  const values = (/** @type {any} */ l) => scaled(l, scale);
  const same = lines.every((/** @type {any} */ l) => l.run.time === times || (l.run.time.length === times.length && l.run.time.at(-1) === times.at(-1)));
  if (same) return [times, ...lines.map(values)];
  return uPlot.join(lines.map((/** @type {any} */ l) => [l.run.time, values(l)]));
}
