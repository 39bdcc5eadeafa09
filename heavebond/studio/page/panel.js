// What is known of the selected part, wire or diagram: its parameters with sliders, its signals.

import { askName, byId, el, number, unitLabel } from "./dom.js";
import { Hierarchy } from "./hierarchy.js";
import { SIGNAL } from "./plots.js";
import { isUnconnected, problemList } from "./results.js";

const TICKS = 1000, LISTED = 40; // steps of a slider; signals of a search that are listed

const ROUNDING = 1e-12; // share of the largest value of a signal below which a value is printed as 0

/** @type {WeakMap<any, number>} */
const LARGEST = new WeakMap();

/** The largest absolute value of a series. @param {ArrayLike<number>} series */
function largest(series) {
  let most = LARGEST.get(series) ?? 0;
  if (!LARGEST.has(series)) {
    for (let k = 0; k < series.length; k++) most = Math.max(most, Math.abs(series[k]) || 0);
    LARGEST.set(series, most);
  }
  return most;
}

/** A path that may go on in the next line behind each dot. @param {string} path */
const breakable = (path) => path.split(/(?<=\.)/).flatMap((piece, k) => k ? [el("wbr"), piece] : [piece]);

export class Panel {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.place = byId("selected");
    this.hierarchy = new Hierarchy(studio);
    /** @type {Map<string, [number, number]>} */
    this.ranges = new Map(); // of sliders that a user gave other ends
    this.sought = ""; // words of the search for signals
  }

  show() {
    const { view, picked } = this.studio, held = /** @type {HTMLElement|null} */ (document.activeElement), focus = held && this.place.contains(held) ? held.id : "";
    const aside = byId("panel"), scroll = aside.scrollTop;
    this.hierarchy.show();
    this.place.replaceChildren(...(view?.parts ? this.content(view, picked) : []));
    aside.scrollTop = scroll;
    if (focus) document.getElementById(focus)?.focus();
    void this.fetchValues();
  }

  /** @param {any} view @param {any} picked */
  content(view, picked) {
    const part = picked?.kind === "part" ? view.parts[picked.path] : null, node = picked?.kind === "node" ? view.nodes[picked.path] : null;
    if (this.studio.chosen.length) return this.studio.edits.several(this.studio.chosen);
    if (part) return this.part(picked.path, part, view);
    if (picked?.kind === "note" && view.notes?.[picked.path]) return this.studio.edits.noteForm(picked.path);
    if (node) return [...this.studio.edits.tools(picked.path), el("p", {}, `Node (${node.domain}). It joins:`), this.ends(node), ...this.lines(node), ...this.studio.evidence.about("node", picked.path), ...this.signals("Signals", node.signals)];
    if (view.study) return [el("h2", {}, view.study.name), el("p", {}, view.study.summary), el("p", {}, `${view.study.cases} ${view.study.cases === 1 ? "case" : "cases"} of the diagram ${view.name}, which is shown here.`)];
    if (view.component) return [el("h2", {}, view.name), el("p", {}, view.summary), ...this.parameters(view.parameters), ...this.studio.edits.ports(view.component),
      el("h3", {}, "More"), el("p", {}, "The inside of a component. Changes act wherever a diagram uses it, once the file is saved.")];
    return [el("h2", {}, view.name), el("p", {}, view.summary), ...this.changed(), ...this.studio.differences.list(), ...this.studio.evidence.summary(), ...this.parameters(view.parameters), ...this.settings(view),
      ...this.signals(view.named ? "Outputs" : "States", view.outputs, view.named), view.outputs.length || this.studio.evidence.active ? null : el("p", {}, "The diagram has no outputs yet."),
      ...this.search(view), el("h3", {}, "More"), el("p", {}, "Click a part or a wire of the drawing, or go there by Tab and press Enter: its parameters and signals appear here.")].filter(Boolean);
  }

  /** @param {string} path @param {any} part @param {any} view */
  part(path, part, view) {
    const open = view.opened.includes(path);
    return [...this.studio.edits.tools(path), ...problemList(view.problems.filter((/** @type {any} */ p) => p.part === path && !isUnconnected(p))), el("p", {}, el("button", { class: "plain", title: "Read about the component", onclick: () => this.about(part.kind) }, part.kind), ` ${part.summary}`),
      part.block && el("button", { id: "open-block", onclick: () => this.studio.openBlock(path) }, open ? "Close the block (O)" : "Open the block (O)"),
      part.file && el("button", { id: "edit-block", title: `Open ${part.file}, where this component is described (E)`, onclick: () => this.studio.editBlock(path) }, part.block ? "Edit the block (E)" : "Edit the component (E)"),
      ...this.owner(path, view),
      ...this.lines(part), ...this.studio.evidence.about("part", path), ...this.parameters(part.parameters), ...this.studio.edits.ports(part), ...this.signals("Signals", part.signals)].filter(Boolean);
  }

  /** The block in which a part is, whose file has it. @param {string} path @param {any} view */
  owner(path, view) {
    const owner = path.split(".").slice(0, -1).join("."), block = view.parts[owner];
    if (!block) return [];
    return [el("p", {}, `Inside of the block ${owner} (${block.kind}). `, block.file ? el("button", { class: "plain", id: "edit-owner", onclick: () => this.studio.editBlock(owner, path) }, "Edit it there")
      : "It is part of the library or of a bundled machine, which cannot be changed.")];
  }

  /** @param {string} kind */
  about(kind) {
    const { palette } = this.studio;
    if (!palette.shown) palette.toggle(true);
    void Promise.resolve(palette.load()).then(() => palette.tell(kind));
  }

  /** The ports on a node, each to be taken off. @param {any} node */
  ends(node) {
    return el("ul", { class: "ports" }, ...node.ends.map((/** @type {string} */ end) => el("li", {}, el("button", { class: "plain", onclick: () => this.studio.pick("part", end.split(".").slice(0, -1).join(".")) }, end),
      this.studio.edits.possible && el("button", { class: "plain quiet", title: `Take ${end} off the node`, "aria-label": `take ${end} off the node`, onclick: () => this.studio.edits.act({ act: "leave", port: end }) }, "×"))));
  }

  /** Ask for the first value that is missing. */
  ask() {
    const field = /** @type {HTMLInputElement|null} */ (this.place.querySelector(".missing input"));
    if (field) field.focus();
    else byId("sheet").focus();
  }

  /** @param {any} thing */
  lines(thing) {
    return thing.line ? [el("button", { class: "plain", id: "to-line", onclick: () => this.studio.editor.show(thing.line, true) }, `line ${thing.line} of the text`)] : [];
  }

  changed() {
    /** @type {string[]} */
    const paths = Object.keys(this.studio.runs.values);
    if (!paths.length) return [];
    return [el("h3", {}, "Changed by sliders"), el("ul", { class: "signals" }, ...paths.map((path) => el("li", {}, el("code", {}, `${path} = ${this.studio.runs.values[path]}`)))),
      el("p", {}, "These values apply to runs on this page. The text is not changed."),
      this.studio.document.writable && !this.studio.evidence.active && el("button", { id: "write-values", onclick: () => this.studio.runs.writeValues() }, "Write them into the text"), " ",
      el("button", { id: "reset-all", onclick: () => this.studio.runs.setValues({}) }, "Back to the text's values")];
  }

  /** @param {any[]} parameters */
  parameters(parameters) {
    return parameters.length ? [el("h3", {}, "Parameters"), ...parameters.map((p) => this.parameter(p))] : [];
  }

  /** @param {any} p */
  parameter(p) {
    const id = `p-${p.path}`, given = this.studio.runs.values[p.path], s = p.slider;
    const unit = s ? s.unit : "";
    const now = s ? (given !== undefined ? parseFloat(given) : s.value) : 0;
    const limits = p.limits?.some((/** @type {any} */ v) => v !== null) ? ` (${p.limits[0] === null ? "" : `at least ${number(p.limits[0])}`}${p.limits.every((/** @type {any} */ v) => v !== null) ? ", " : ""}${p.limits[1] === null ? "" : `at most ${number(p.limits[1])}`}${p.unit && p.unit !== "1" ? ` ${unitLabel(p.unit)}` : ""})` : "";
    const wrong = el("div", { class: "wrong", role: "alert" });
    const written = this.studio.edits.possible && p.path.split(".").length <= 2; // of the diagram itself, not inside a block
    const field = s && !written && el("input", { id, value: number(now, 6), inputmode: "decimal", "aria-describedby": `${id}-doc`,
      onchange: (/** @type {any} */ event) => this.typed(p, event.target, wrong) });
    const text = written && el("input", { id, class: "mono", value: given ?? p.text, "aria-describedby": `${id}-doc`, spellcheck: "false", autocomplete: "off", placeholder: p.unit && p.unit !== "1" ? `value in ${p.unit}` : "value",
      title: "Enter writes the value into the text", onchange: (/** @type {any} */ event) => this.write(p, event.target, wrong) });
    return el("div", { class: `parameter${given !== undefined ? " changed" : ""}${p.needed ? " missing" : ""}`, "data-parameter": p.path },
      el("div", { class: "head" }, el("label", { for: s || written ? id : null, title: p.path }, p.name),
        el("span", { class: "value" }, text || (s ? field : el("code", {}, p.text))), s && !written ? el("span", { class: "unit" }, unitLabel(unit)) : null),
      ...(s ? this.slider(p, now) : []), wrong, el("div", { class: "doc", id: `${id}-doc` }, `${p.doc}${limits} `,
        given !== undefined && el("button", { class: "plain", id: `${id}-reset`, onclick: () => this.studio.runs.setValue(p.path, undefined) }, `back to ${p.text}`)));
  }

  /** @param {any} p @param {number} now */
  slider(p, now) {
    const s = p.slider;
    let [from, to] = this.ranges.get(p.path) ?? [s.from, s.to];
    from = Math.min(from, now);
    to = Math.max(to, now);
    const log = s.log && from > 0;
    const value = (/** @type {number} */ tick) => log ? from * (to / from) ** (tick / TICKS) : from + (to - from) * tick / TICKS;
    const tick = log ? Math.log(now / from) / Math.log(to / from) * TICKS : (now - from) / (to - from) * TICKS;
    const range = /** @type {HTMLInputElement} */ (el("input", { type: "range", id: `s-${p.path}`, min: 0, max: TICKS, step: "any", value: tick,
      "aria-label": `${p.path}${s.unit ? ` in ${s.unit}` : ""}`, "aria-valuetext": `${number(now)} ${s.unit}`,
      onpointerenter: () => this.studio.runs.live && void this.studio.runs.prepare(), onpointerdown: () => void this.studio.runs.prepare(), onfocus: () => void this.studio.runs.prepare() }));
    const told = () => this.text(s, Number(value(Number(range.value)).toPrecision(4)));
    range.addEventListener("input", () => {
      range.setAttribute("aria-valuetext", told());
      const shown = /** @type {HTMLInputElement} */ (document.getElementById(`p-${p.path}`));
      shown.value = shown.classList.contains("mono") ? told() : String(parseFloat(told()));
      this.studio.runs.slide(p.path, told());
    });
    range.addEventListener("change", () => this.studio.runs.setValue(p.path, told()));
    range.addEventListener("keydown", (event) => { // a thousandth of the range is no step for a key
      const step = /** @type {Record<string, number>} */ ({ ArrowRight: 10, ArrowUp: 10, ArrowLeft: -10, ArrowDown: -10, PageUp: 100, PageDown: -100 })[event.key];
      if (!step) return;
      event.preventDefault();
      range.value = String(Number(range.value) + step);
      range.dispatchEvent(new Event("input"));
      range.dispatchEvent(new Event("change"));
    });
    return [range, el("div", { class: "ends" }, el("span", {}, number(from, 4)), el("span", {}, log ? "logarithmic " : "", this.studio.evidence.active ? null : el("button", { class: "plain", id: `sweep-${p.path}`, title: "Simulate with several values, laid over each other", onclick: () => this.sweep(p, now) }, "several values…")), el("span", {}, number(to, 4)))];
  }

  /** Ask for the values of a sweep, and run it. @param {any} p @param {number} now */
  sweep(p, now) {
    const s = p.slider, inside = (/** @type {number} */ v) => (s.low === null || v >= s.low) && (s.high === null || v <= s.high);
    const proposed = (now ? [0.5, 0.7, 1, 1.4, 2].map((f) => f * now) : [s.from, (s.from + s.to) / 2, s.to]).filter(inside).map((v) => number(v, 3));
    askName(`Runs with several values of ${p.path}`, `Numbers${s.unit ? ` in ${unitLabel(s.unit)}` : ""}, apart by commas or blanks:`, proposed.join(", "), async (text) => {
      const values = text.split(/[,;\s]+/).filter(Boolean).map(Number);
      if (!values.length || values.length > 20 || values.some((v) => !Number.isFinite(v))) throw new Error("Type up to 20 numbers.");
      void this.studio.runs.sweep(p.path, values.map((v) => this.text(s, v)));
    }, "Run");
  }

  /** @param {any} s @param {number} value */
  text(s, value) { return s.unit ? `${value} ${s.unit}` : String(value); }

  /** @param {any} p @param {HTMLInputElement} field @param {HTMLElement} wrong */
  typed(p, field, wrong) {
    const s = p.slider, value = Number(field.value.trim());
    const said = field.value.trim() === "" || !Number.isFinite(value) ? "Type a number." :
      s.low !== null && value < s.low ? `The least is ${number(s.low)} ${s.unit}.` : s.high !== null && value > s.high ? `The most is ${number(s.high)} ${s.unit}.` : "";
    wrong.textContent = said;
    field.setAttribute("aria-invalid", String(Boolean(said)));
    if (!said) this.studio.runs.setValue(p.path, this.text(s, value));
  }

  /** A value into the text; the slider's, if there was one, is given up for it. @param {any} p @param {HTMLInputElement} field @param {HTMLElement} wrong */
  write(p, field, wrong) {
    const { [p.path]: tried, ...values } = this.studio.runs.values;
    void this.studio.edits.write({ act: "set", path: p.path, value: field.value }, field, wrong).then((/** @type {boolean} */ done) => {
      if (!done) return;
      if (tried !== undefined || this.studio.runs.live) this.studio.runs.setValues(values);
    });
  }

  /** How a run begins and ends. @param {any} view */
  settings(view) {
    const { edits, evidence } = this.studio, told = view.settings;
    if (!told || evidence.active || (!edits.possible && !told.until)) return [];
    const row = (/** @type {string} */ id, /** @type {string} */ label, /** @type {any} */ field) => el("div", { class: "parameter setting" }, el("div", { class: "head" }, el("label", { for: id }, ...breakable(label)), el("span", { class: "value" }, field)), el("div", { class: "wrong", role: "alert" }));
    const act = (/** @type {any} */ action, /** @type {any} */ event) => void edits.write({ ...action, value: event.target.value }, event.target, event.target.closest(".parameter").querySelector(".wrong"));
    const field = (/** @type {string} */ key, /** @type {string} */ label, /** @type {string} */ hint) => row(`run-${key}`, label, el("input", { id: `run-${key}`, class: "mono", value: told[key], disabled: !edits.possible, placeholder: hint, spellcheck: "false", autocomplete: "off",
      onchange: (/** @type {any} */ e) => act({ act: "setting", key }, e) }));
    const start = el("select", { id: "run-start", disabled: !edits.possible, onchange: (/** @type {any} */ e) => act({ act: "setting", key: "start" }, e) },
      ...[["", "from initial values"], ["rest", "at rest"], ["steady", "in equilibrium"]].map(([key, words]) => el("option", { value: key, selected: key === told.start }, words)));
    const given = Object.entries(told.initial).map(([name, value]) => row(`initial-${name}`, name, el("input", { id: `initial-${name}`, class: "mono", value, disabled: !edits.possible, spellcheck: "false", autocomplete: "off",
      title: "Value at the start; an empty field removes it", onchange: (/** @type {any} */ e) => act({ act: "initial", signal: name }, e) })));
    return [el("h3", {}, "Run"), field("until", "duration", "such as 5 s"), field("every", "output interval", "such as 5 ms"), row("run-start", "start", start), ...given];
  }

  /** What a signal may be besides being plotted: an output of the diagram, with a value at the start. @param {any} s @param {boolean} output whether it is one already */
  more(s, output) {
    const { edits, picked, view } = this.studio;
    if (!edits.possible) return null;
    const signal = output ? s.doc : s.name, back = picked ? { [picked.kind]: picked.path } : {}, given = view.settings?.initial[s.name] ?? "";
    const shown = view.named && view.outputs.some((/** @type {any} */ o) => o.doc === signal);
    return el("span", { class: "more" },
      el("button", { class: "plain quiet", title: shown ? "No longer an output of the diagram" : "Make it an output of the diagram, under show:", "aria-label": shown ? `${signal} no longer an output` : `${signal} an output`,
        onclick: () => edits.act({ act: "show", signal, unit: s.unit, on: !shown, ...back }) }, shown ? "− output" : "+ output"),
      output ? null : el("button", { class: "plain quiet", title: "Value at the start of a run, under initial:", "aria-label": `value of ${signal} at the start`, onclick: () =>
        askName(`${signal} at the start`, `A value${s.unit && s.unit !== "1" ? ` in ${unitLabel(s.unit)} or another unit of its kind` : ""}; nothing removes it:`, given || (s.unit && s.unit !== "1" ? `0 ${s.unit}` : "0"), async (value) => {
          await edits.act({ act: "initial", signal, value, ...back }, (/** @type {string} */ words) => { throw new Error(words); });
        }, "Set") }, given ? `start ${given}` : "start"));
  }

  /** @param {string} title @param {any[]} signals @param {boolean} [outputs] whether they stand under show: */
  signals(title, signals, outputs = false) {
    if (!signals.length || this.studio.evidence.active) return [];
    return [el("h3", {}, `${title} to plot`), el("ul", { class: "signals" }, ...signals.map((s) => el("li", {}, this.tick(s, "y"), this.studio.picked || outputs ? this.more(s, outputs) : null)))];
  }

  /** A signal with its unit, to be plotted. @param {any} s @param {string} list */
  tick(s, list) {
    return el("label", { title: `${s.name}: tick it to plot it, or drag it into a chart`, draggable: "true", ondragstart: (/** @type {DragEvent} */ event) => event.dataTransfer?.setData(SIGNAL, s.name) },
      el("input", { type: "checkbox", id: `${list}-${s.name}`, checked: this.studio.runs.plotted.includes(s.name),
        onchange: (/** @type {any} */ event) => this.studio.runs.plot(s.name, event.target.checked) }),
      el("span", {}, el("span", { class: "mono" }, s.name), s.unit && s.unit !== "1" ? ` [${unitLabel(s.unit)}]` : "", " ", el("output", { class: "worth-now", "data-signal": s.name }), " ", el("span", { class: "doc" }, s.doc)));
  }

  /** Fetch the signals that are listed, then show their values at the instant of the run. */
  async fetchValues() {
    const places = /** @type {NodeListOf<HTMLElement>} */ (this.place.querySelectorAll(".worth-now"));
    await this.studio.runs.fetch([...places].map((place) => place.dataset.signal ?? ""));
    this.values();
  }

  /** The values of the listed signals at the instant of the run: that of the cursor over the charts. */
  values() {
    const run = this.studio.runs.live, time = this.studio.animation?.time ?? 0;
    let k = 0;
    if (run) for (let high = run.time.length - 1; k < high;) { const middle = (k + high + 1) >> 1; if (run.time[middle] <= time) k = middle; else high = middle - 1; }
    for (const place of /** @type {NodeListOf<HTMLElement>} */ (this.place.querySelectorAll(".worth-now"))) {
      const name = place.dataset.signal ?? "", series = run?.series.get(name) ?? run?.listed?.get(name), base = run?.units[name] ?? "", size = series ? largest(series) : 0;
      const [, unit, scale] = (run?.readable[base] ?? []).find((/** @type {any[]} */ [smallest]) => size && size >= smallest) ?? [0, base, 1]; // as on the charts
      place.textContent = series ? `${number(Math.abs(series[k]) < ROUNDING * size ? 0 : series[k] / scale, 4)}${unit && unit !== "1" ? ` ${unitLabel(unit)}` : ""}` : "";
      place.title = series ? `at ${number(run.time[k])} s` : "";
    }
  }

  /** All signals of the machine by words of their names, units and descriptions. @param {any} view */
  search(view) {
    const all = [...new Map([...Object.values(view.parts), ...Object.values(view.nodes)].flatMap((of) => of.signals).map((s) => [s.name, s])).values()];
    if (!all.length || this.studio.evidence.active) return [];
    const list = el("ul", { class: "signals" }), count = el("p", { role: "status" });
    const show = () => {
      const words = this.sought.toLowerCase().split(/\s+/).filter(Boolean);
      const found = words.length ? all.filter((s) => words.every((word) => `${s.name} ${s.unit} ${s.doc}`.toLowerCase().includes(word))) : [];
      count.textContent = words.length ? `${found.length} of ${all.length} signals${found.length > LISTED ? `, the first ${LISTED} are listed` : ""}` : `${all.length} signals`;
      list.replaceChildren(...found.slice(0, LISTED).map((s) => el("li", {}, this.tick(s, "f"))));
      if (list.isConnected) void this.fetchValues();
    };
    const input = el("input", { id: "find-signal", type: "search", value: this.sought, placeholder: "part, variable, unit or word", spellcheck: "false", autocomplete: "off",
      oninput: (/** @type {any} */ e) => { this.sought = e.target.value; show(); } });
    show();
    return [el("h3", {}, el("label", { for: "find-signal" }, "All signals")), input, count, list];
  }
}
