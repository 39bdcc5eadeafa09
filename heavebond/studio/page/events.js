// The events of a run: when, in which part, by which condition, and what changed; their instants are marked in the charts.

import { byId, el, number, unitLabel } from "./dom.js";

const ROWS = 200; // that are listed at first; the charts mark all

export class EventLog {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.on = false;
    this.rows = ROWS;
    this.place = el("div", { id: "events", role: "region", "aria-label": "Events of the run", tabindex: "-1", hidden: true });
    this.clear();
  }

  /** As for a diagram that was just opened. */
  clear() {
    this.name = ""; // the event that alone is listed
    /** @type {any} */ this.of = null; // the run whose events are listed
    /** @type {any} */ this.told = null;
  }

  /** The button in the row of the runs. */
  button() {
    const n = this.studio.runs.live?.told?.events ?? 0;
    return n ? [el("button", { id: "show-events", "aria-pressed": String(this.on), title: "What switched, when and in which part", onclick: () => this.toggle() }, `${n} ${n === 1 ? "event" : "events"}`)] : [];
  }

  toggle() {
    const { runs } = this.studio;
    this.on = !this.on;
    byId("show-events").setAttribute("aria-pressed", String(this.on));
    runs.remember();
    void this.follow().then(() => { runs.plots.redraw(); if (this.on) { this.place.scrollIntoView({ block: "nearest" }); this.place.focus({ preventScroll: true }); } });
  }

  /** The instants of the events that are listed. @returns {number[]} */
  get times() { return this.on && this.told && this.of === this.studio.runs.live ? this.told.events.map((/** @type {any} */ e) => e.time) : []; }

  /** Fetch the events of the newest run and list them. */
  async follow() {
    const { runs, link } = this.studio, run = runs.live;
    this.place.hidden = !this.on || !run?.told?.events || run.preview;
    if (this.place.hidden) return;
    if (this.of === run) return;
    this.of = run;
    this.rows = ROWS;
    try {
      const told = await link.ask("events", { name: this.studio.document.name, text: run.text, values: run.values, event: this.name });
      if (told.kind !== "done" || this.of !== run) return;
      this.told = told;
      this.list();
    } catch (error) {
      this.place.replaceChildren(el("p", { class: "verdict" }, error instanceof Error ? error.message : String(error)));
    }
    runs.plots.redraw();
  }

  list() {
    const { told } = this, shown = told.events.slice(0, this.rows), names = Object.entries(told.counts);
    const change = (/** @type {any[]} */ [name, before, after, unit]) => el("span", { class: "change" }, el("code", {}, name), ` ${number(before)} → ${number(after)}${unit && unit !== "1" ? ` ${unitLabel(unit)}` : ""}`);
    const row = (/** @type {any} */ e) => el("tr", {}, el("th", { scope: "row" }, el("button", { class: "plain", title: "Show this instant on the drawing and in the charts", onclick: () => this.point(e) }, `${number(e.time, 7)} s`)),
      el("td", { class: "words" }, e.part || "—"), el("td", { class: "words" }, e.event), el("td", { class: "words" }, el("code", {}, unitLabel(e.text))), el("td", { class: "words" }, ...e.changes.flatMap((/** @type {any[]} */ c, /** @type {number} */ k) => k ? [", ", change(c)] : [change(c)])));
    this.place.replaceChildren(el("div", { class: "choices" }, el("b", {}, "Events"), el("select", { id: "event-name", "aria-label": "which events", onchange: (/** @type {any} */ e) => { this.name = e.target.value; this.of = null; void this.follow().then(() => byId("event-name").focus()); } },
      el("option", { value: "" }, "all events"), ...names.map(([name, n]) => el("option", { value: name, selected: name === this.name }, `${name} (${n})`))), el("span", { class: "hint" }, "marked at the top of the charts; a click on a time shows that instant")),
    el("div", { class: "scroll" }, el("table", { class: "figures" }, el("thead", {}, el("tr", {}, ...["time", "part", "event", "condition", "changes"].map((h) => el("th", { scope: "col", class: "words" }, h)))), el("tbody", {}, ...shown.map(row)))),
    ...(shown.length < told.events.length ? [el("button", { class: "plain", id: "more-events", onclick: () => { this.rows *= 5; this.list(); } }, `${told.events.length - shown.length} more`)] : []),
    ...(told.events.length < told.of ? [el("p", { class: "hint" }, `The first ${told.events.length} of ${told.of} events. Choose one event above, or shorten the run.`)] : []));
  }

  /** Show an instant, and its part. @param {any} event */
  point(event) {
    this.studio.animation.at(event.time);
    if (this.studio.view?.parts?.[event.part]) this.studio.pick("part", event.part);
  }

  /** The marks at the top of a chart over time. @param {any} chart */
  draw(chart) {
    const { times } = this;
    if (!times.length) return;
    const { ctx, bbox } = chart, high = 7 * devicePixelRatio;
    ctx.save();
    ctx.setLineDash([]);
    ctx.strokeStyle = getComputedStyle(document.body).getPropertyValue("--warn");
    ctx.beginPath();
    let last = -1;
    for (const time of times) {
      const x = Math.round(chart.valToPos(time, "x", true));
      if (x === last || x < bbox.left || x > bbox.left + bbox.width) continue;
      last = x;
      ctx.moveTo(x + 0.5, bbox.top);
      ctx.lineTo(x + 0.5, bbox.top + high);
    }
    ctx.stroke();
    ctx.restore();
  }
}
