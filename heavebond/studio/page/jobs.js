// Long computations: estimation, localisation, diagnosis and tuning with their progress, their stop and their results.

import { cloud, look, timeChart } from "./charts.js";
import { byId, el, number } from "./dom.js";
import { commandForm, commandResult } from "./commands.js";
import { problemList, problemsOf, resultItems } from "./results.js";
import { tuningForm, variable } from "./tuning.js";

/** @type {Record<string, {title: string, words: string, button: string, command: string}>} */
const KINDS = {
  fit: { title: "Estimate the free parameters", words: "Estimates the parameters under free: within their ranges, so that the model follows the fitted records best. The error on held-out records shows whether this is enough.", button: "Estimate", command: "fit" },
  where: { title: "Locate the error", words: "Finds when and in what state of motion the error of the model is large, and estimates the force or flow that is missing at each place of the drawing.", button: "Locate", command: "localize" },
  diagnose: { title: "Identify the missing effect", words: "Adds each effect of the library at each place where it fits, estimates it together with the free parameters, and decides by the error on held-out records.", button: "Diagnose", command: "diagnose" },
  try: { title: "One effect tried by hand", words: "", button: "", command: "try" },
  study: { title: "Run the study", words: "Simulates, tunes and measures each case of the file. Completed cases are stored in a folder next to the file: after a stop, run the study again to continue.", button: "Run the study", command: "study" },
  command: { title: "Analyses", words: "The other commands of the command line, applied to the saved file with the values of the sliders; a slider that moves repeats the command.", button: "Run it", command: "" },
  tune: { title: "Tune parameters", words: "Minimises a cost over parameters within their ranges, by exact gradients.", button: "Tune", command: "tune" },
};

export class Jobs {
  /** @type {Map<string, any>} */ known = new Map(); // computations of this document by their kind
  /** @type {Map<string, Promise<any>>} */ arrays = new Map();
  tuning = false; // whether the form for tuning is open
  /** @type {{classes: string[], seconds: string}} */ options = { classes: [], seconds: "600" };
  /** @type {any} */ fitting = null; // classes of effects that fit in the diagram
  /** @type {any} */ asked = null; // the command that was run last, without the values of sliders
  pending = false; // whether it is repeated when it ends
  commands = { command: "", values: {}, closed: false }; // of the forms
  /** @type {any} */ refused = null;
  /** @type {any} */ forms = undefined; // of the commands, by the kind of document
  reporting = false;
  reported = ""; // the file of the report
  /** @type {number|undefined} */ clock = undefined;

  /** @param {any} studio @param {any} evidence */
  constructor(studio, evidence) {
    this.studio = studio;
    this.evidence = evidence;
    this.clear();
  }

  clear() {
    Object.assign(this, { known: new Map(), arrays: new Map(), tuning: false, options: { classes: [], seconds: "600" }, fitting: null, asked: null, pending: false, refused: null, reporting: false, reported: "" });
    this.commands = { command: "", values: {}, closed: false };
    this.loaded = false; // whether the server was asked how they stand
    clearInterval(this.clock);
  }

  /** @param {string} kind */
  state(kind) { return this.known.get(kind); }

  get running() { return [...this.known.values()].find((job) => job.state === "running"); }

  /** How the computations of this document stand, which another tab or an earlier page may have begun. */
  async load() {
    this.loaded = true;
    const name = this.studio.document.name, told = await this.studio.link.ask("jobs", { name }).catch(() => ({ jobs: [] }));
    if (this.studio.document?.name !== name) return;
    for (const job of told.jobs) this.pushed(job);
  }

  /** @param {any} job */
  pushed(job) {
    if (job.name !== this.studio.document?.name) return;
    const before = this.known.get(job.kind);
    if (before && before.number > job.number) return;
    this.known.set(job.kind, { ...job, at: performance.now() });
    if (before?.state === "running" && job.state !== "running" && job.kind === "command" && this.pending) queueMicrotask(() => this.again());
    if (before?.state === "running" && job.state !== "running") {
      const title = KINDS[job.kind].title.toLowerCase();
      this.studio.say({ done: `${title}: done in ${duration(job.seconds)}`, failed: `${title}: failed`, stopped: `${title}: stopped` }[/** @type {string} */ (job.state)] ?? "");
    }
    byId("stop").hidden = !this.running && !this.studio.runs.busy && !this.evidence.comparing;
    if (before?.state === job.state && job.state === "running" && this.refresh(job)) return;
    this.evidence.show();
    this.studio.panel.show();
  }

  /** A computation begun on what stands in the file. @param {string} kind @param {Record<string, any>} [given] */
  async begin(kind, given = {}) {
    this.refused = null;
    if (this.studio.unsaved) {
      this.refused = { kind, problems: [{ message: "The text is not saved: what is found is written as files that extend it.", hint: "Save it first (Ctrl+S).", notes: [] }] };
      this.evidence.show();
      return;
    }
    const name = this.studio.document.name;
    try {
      const told = await this.studio.link.ask("begin", { name, kind, given });
      this.pushed(told.job);
      if (kind === "try") this.evidence.choose("diagnose");
    } catch (error) {
      this.refused = { kind, problems: problemsOf(error) };
      this.evidence.show();
    }
  }

  async stop() {
    const job = this.running;
    if (job) await this.studio.link.ask("end", { number: job.number }).catch(() => null);
  }

  /** @param {any} job @param {string} key */
  array(job, key) {
    const name = `${job.number}/${key}`;
    if (!this.arrays.has(name)) this.arrays.set(name, this.studio.link.ask("array", { number: job.number, key }).then((/** @type {any} */ told) => told.series));
    return this.arrays.get(name);
  }

  /** Write what was found, and open it. @param {any} job @param {any} given */
  async add(job, given) {
    try {
      const told = await this.studio.link.ask("add", { number: job.number, given });
      const rungs = job.ladder.slice(0, Math.max(2, job.ladder.length - (job.result.adds.length - (given.count ?? 1)))), from = this.studio.document.name;
      await this.studio.open(told.open);
      this.evidence.note = `Wrote ${told.files.join(", ")}. ${fallen(rungs, from)}`;
      this.evidence.show();
    } catch (error) {
      this.refused = { kind: job.kind, problems: problemsOf(error) };
      this.evidence.show();
    }
  }

  /** The report of a diagnosis, written beside the experiment. @param {any} job */
  async report(job) {
    this.reporting = true;
    this.evidence.show();
    try {
      const told = await this.studio.link.ask("add", { number: job.number, given: { report: true } });
      this.reported = told.open;
    } catch (error) {
      this.refused = { kind: job.kind, problems: problemsOf(error) };
    }
    this.reporting = false;
    this.evidence.show();
  }

  /** @param {boolean} open @param {string} [tab] */
  openTuning(open, tab = "tune") {
    this.tuning = open;
    this.evidence.layout();
    if (open) { void this.load(); this.evidence.choose(tab); }
    else byId(this.evidence.tab === "command" ? "analyse" : "tune").focus();
  }

  /** A mark at the title of a tab. @param {string} tab */
  mark(tab) {
    const job = this.shown(tab);
    return job?.state === "running" ? " …" : job?.state === "done" ? " ✓" : "";
  }

  /** The computation that a tab shows: a diagnosis, or an effect tried after it. @param {string} tab */
  shown(tab) {
    const job = this.state(tab), tried = tab === "diagnose" ? this.state("try") : null;
    return tried && (!job || tried.number > job.number) ? tried : job;
  }

  // -- what a tab shows ----------------------------------------------------------------------------------------------
  /** @param {string} tab */
  async content(tab) {
    const job = this.shown(tab), what = KINDS[tab];
    if (tab === "command") this.forms ??= (await this.studio.link.ask("forms").catch(() => ({ forms: {} }))).forms;
    const extra = tab === "where" && job?.result ? await this.place(job) : null;
    return (/** @type {HTMLElement} */ place) => {
      const running = Boolean(this.running);
      if (tab === "command" && job?.state === "failed") this.commands.closed = false; // the options are to be changed
      const failures = [...(this.refused?.kind === tab || (tab === "diagnose" && this.refused?.kind === "try") ? problemList(this.refused.problems) : []), ...(job?.state === "failed" ? problemList(job.problems) : [])];
      place.append(el("div", { class: "task" }, el("h2", {}, what.title), el("p", { class: "said" }, what.words,
        tab === "command" ? null : el("span", { class: "hint" }, " On the command line: ", el("code", {}, `heavebond ${what.command} ${this.studio.document.name.replace(/^bundled:/, "")}`))),
      ...(tab === "command" ? [...failures, ...commandForm(this.studio, this.forms, this.commands, running, (given) => this.command(given))] : [tab === "tune" ? tuningForm(this.studio, running, (given) => this.begin("tune", given)) : this.form(tab, what, running)])));
      if (tab !== "command") place.append(...failures); // above the many options of a command
      if (!job) return;
      if (job.state === "running") place.append(this.progress(job));
      if (job.state === "stopped") place.append(el("p", { class: "verdict" }, "Stopped before there was a result."));
      if (job.ladder.length) place.append(el("div", { id: "ladder" }, ...this.ladder(job)));
      if (job.result) this.result(place, job, extra);
    };
  }

  /** The classes of effects that fit in the diagram, all or some of which are tried. */
  classList() {
    const words = () => this.options.classes.length ? `only ${this.options.classes.join(", ")}` : "effects of all classes", summary = el("summary", { id: "only" }, words());
    const box = (/** @type {string} */ name) => el("label", {}, el("input", { type: "checkbox", name: "class", value: name, checked: this.options.classes.includes(name), onchange: (/** @type {any} */ e) => {
      this.options.classes = this.fitting.filter((/** @type {string} */ c) => c === name ? e.target.checked : this.options.classes.includes(c));
      summary.textContent = words();
    } }), ` ${name}`);
    const list = el("div", { class: "class-list" }, ...(this.fitting ?? []).map(box));
    return el("details", { class: "classes", ontoggle: async (/** @type {any} */ e) => {
      if (!e.target.open || list.childElementCount) return;
      list.replaceChildren("listing the effects that fit…");
      const told = await this.studio.link.ask("classes", this.evidence.question()).catch((/** @type {any} */ error) => ({ error }));
      this.fitting = told.classes ?? null;
      list.replaceChildren(...(told.classes ? told.classes.map(box) : [told.error?.message ?? "not available"]));
    } }, summary, list);
  }

  /** A command with the values of the sliders. @param {any} given */
  command(given) {
    this.asked = given;
    this.commands.closed = true;
    const sliders = Object.entries(this.studio.runs.values).map(([path, value]) => `${path}=${value}`);
    return this.begin("command", sliders.length && given.settable ? { ...given, values: { ...given.values, settings: [...(given.values.settings ?? []), ...sliders] } } : given);
  }

  /** A slider has moved: run the command that is shown again. */
  again() {
    if (this.evidence.place.hidden || this.evidence.tab !== "command" || !this.asked?.settable) return;
    this.pending = Boolean(this.running);
    if (!this.pending) void this.command(this.asked);
  }

  /** @param {string} tab @param {any} what @param {boolean} running */
  form(tab, what, running) {
    const go = () => this.begin(tab, tab === "diagnose" ? { seconds: Number(this.options.seconds) || 600, classes: this.options.classes } : {});
    const nothing = tab === "fit" && !Object.keys(this.studio.view?.experiment?.free ?? {}).length;
    return el("form", { class: "choices", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); if (!running && !nothing) void go(); } },
      el("button", { class: "main", id: `begin-${tab}`, disabled: running || nothing }, what.button),
      ...(tab === "diagnose" ? [
        this.classList(),
        el("label", {}, "for at most ", el("input", { id: "seconds", class: "short", inputmode: "numeric", value: this.options.seconds, oninput: (/** @type {any} */ e) => { this.options.seconds = e.target.value; } }), " s")] : []),
      nothing ? this.howToFree() : null);
  }

  /** What to type where an experiment estimates no parameter. */
  howToFree() {
    const [first] = variable(this.studio.view);
    return el("span", { class: "hint", id: "how-to-free" }, "No parameter is estimated yet. Write into the experiment which, and within what range: ",
      el("code", {}, `free: {${first ? `${first.path}: ${first.text}` : "spring.c: 40 kN/m"} +- 20 %}`), ".");
  }

  /** @param {any} job */
  progress(job) {
    const bar = el("progress", { id: "progress", "aria-label": "progress" }), best = el("p", { class: "best", id: "best" }), text = el("p", { class: "said", id: "progress-text" });
    const box = el("div", { class: "running" }, el("div", { class: "choices" }, bar, el("button", { id: "end", onclick: () => this.stop() }, "Stop"), el("span", { id: "elapsed", class: "hint" })), text, best);
    clearInterval(this.clock);
    this.clock = setInterval(() => this.tick(), 250);
    queueMicrotask(() => { this.refresh(job); this.tick(); });
    return box;
  }

  tick() {
    const job = this.running, place = document.getElementById("elapsed");
    if (!job || !place) { clearInterval(this.clock); return; }
    place.textContent = duration(job.seconds + (performance.now() - job.at) / 1000);
  }

  /** New words on the progress without making the page anew; whether that sufficed. @param {any} job */
  refresh(job) {
    const bar = /** @type {HTMLProgressElement|null} */ (document.getElementById("progress"));
    if (!bar) return this.shown(this.evidence.tab)?.number !== job.number; // another tab is open
    const shown = this.shown(this.evidence.tab);
    if (shown?.number !== job.number) return true;
    if (job.of) { bar.max = job.of; bar.value = job.done; } else bar.removeAttribute("value");
    byId("progress-text").textContent = job.stopping ? "stopping: completing the result with the best so far; a second Stop discards it" : job.text;
    byId("best").textContent = job.best ? `best so far: ${job.best.name}, reduced chi-square ${job.best.chi2} on held-out data` : "";
    document.getElementById("ladder")?.replaceChildren(...this.ladder(job));
    return !job.ladder.length || document.getElementById("ladder") !== null;
  }

  /** The error of each model, as bars and in figures. @param {any} job */
  ladder(job) {
    const rows = job.ladder.map((/** @type {any} */ r) => ({ name: r.name, chi2: r.chi2_held_out ?? r.chi2_fit, error: r.error_held_out ?? r.error_fit, open: r.error_fit === null }));
    if (job.state === "running" && job.best && !rows.some((/** @type {any} */ r) => r.name === `+ ${job.best.name}`))
      rows.push({ name: `+ ${job.best.name}, being tried`, chi2: Number(job.best.chi2), error: null, open: true });
    const most = Math.max(1, ...rows.map((/** @type {any} */ r) => Math.log10(Math.max(r.chi2, 1)) || 0));
    return [el("h3", {}, "Reduced chi-square on held-out data (1 = noise level; bars logarithmic), and the error in % of what was measured"), el("ul", { class: "ladder" }, ...rows.map((/** @type {any} */ r) => {
      const bar = el("span", { class: `fall${r.open ? " open" : ""}` });
      bar.style.width = `${(2 + 98 * Math.log10(Math.max(r.chi2, 1)) / most).toFixed(1)}%`;
      return el("li", {}, el("span", { class: "rung" }, r.name), el("span", { class: "course" }, bar), el("span", { class: "figure" }, number(r.chi2, 4)),
        el("span", { class: "figure" }, r.error === null ? "" : `${number(100 * r.error, 3)} %`));
    }))];
  }

  /** @param {HTMLElement} place @param {any} job @param {any} extra */
  result(place, job, extra) {
    const { result } = job;
    if (job.version !== this.studio.document.version) place.append(el("p", { class: "verdict" }, "The file has changed since this was computed."));
    if (result.partial) place.append(el("p", { class: "verdict" }, "The search was ended early: this is its best so far."));
    const adds = (result.adds ?? []).map((/** @type {any} */ a, /** @type {number} */ k, /** @type {any[]} */ all) => el("button", { class: k === all.length - 1 ? "main" : null, id: `add-${k}`, disabled: !job.can_write,
      onclick: () => this.add(job, a) }, addWords(job.kind, a, all)));
    if (adds.length) place.append(el("div", { class: "choices", id: "adds" }, ...adds, el("span", { class: "hint" }, this.writes(job.kind))));
    if (job.kind === "diagnose") place.append(el("p", { class: "choices" }, el("button", { id: "write-report", disabled: !job.can_write || this.reporting, onclick: () => this.report(job) }, this.reporting ? "Writing the report…" : "Write the report"),
      this.reported ? el("a", { id: "report", href: `reports/${encodeURIComponent(this.reported)}`, target: "_blank", rel: "noopener" }, `Open ${this.reported}`) : el("span", { class: "hint" }, "one HTML file with all pictures and tables, to print or to send")));
    extra?.(place);
    for (const picture of result.pictures ?? []) place.append(el("figure", { class: "picture" }, el("img", { src: `data:image/svg+xml;charset=utf-8,${encodeURIComponent(picture.svg)}`, alt: picture.title }), picture.words && el("figcaption", { class: "hint" }, picture.words)));
    place.append(...resultItems(result.items));
    if (job.kind === "command") place.append(...commandResult(result).filter((found) => found !== null));
    else if (result.files) place.append(el("p", { class: "said" }, "Written: ", el("code", {}, `${result.folder}/`), ` ${result.files.join(", ")}`));
    if (result.others?.length) place.append(el("h3", {}, "Another effect in its place"), el("p", { class: "said" }, "Estimates it in the same diagram; it can be added then."),
      el("ul", { class: "others" }, ...result.others.map((/** @type {any} */ o, /** @type {number} */ k) => el("li", {}, el("button", { id: `other-${k}`, disabled: Boolean(this.running), onclick: () => this.begin("try", { component: o.component, where: o.where }) }, "Try"),
        ` ${o.label} (${o.kind}), reduced chi-square ${number(o.chi2, 4)} held out`))));
    if (job.kind === "try") place.append(el("p", {}, el("button", { id: "to-diagnosis", disabled: !this.state("diagnose"), onclick: () => { this.known.delete("try"); this.evidence.show(); } }, "Back to the diagnosis")));
  }

  /** @param {string} kind */
  writes(kind) {
    return kind === "tune" ? "writes a diagram that extends this one and opens it" : "writes a diagram that extends this one and an experiment on it, and opens the experiment; no file is changed";
  }

  // -- places --------------------------------------------------------------------------------------------------------
  /** Places of the localisation at a part or node, the likeliest first. @param {string} kind @param {string} path */
  placesAt(kind, path) {
    const places = this.state("where")?.result?.places ?? [];
    const all = places.map((/** @type {any} */ place, /** @type {number} */ k) => ({ k, place })), nodes = this.nodesOf(path);
    if (kind === "node") return all.filter((/** @type {any} */ { place }) => place.nodes.includes(path));
    const beside = all.filter((/** @type {any} */ { place }) => place.nodes.length === 2 && place.components.includes(path)); // else at one of its nodes
    return beside.length ? beside : all.filter((/** @type {any} */ { place }) => place.nodes.length === 1 && nodes.includes(place.nodes[0]));
  }

  /** @param {string} part */
  nodesOf(part) {
    return Object.entries(this.studio.view.nodes).filter(([, node]) => node.ends.some((/** @type {string} */ end) => end.startsWith(`${part}.`))).map(([path]) => path);
  }

  /** The force or flow at the chosen place, over time and over what is around it. @param {any} job */
  async place(job) {
    const { places } = job.result, chosen = this.evidence.chosen, k = chosen.place >= 0 && chosen.place < places.length ? chosen.place : 0, place = places[k];
    if (!place) return null;
    const courses = await Promise.all(place.records.map((/** @type {string} */ r) => this.array(job, `place/${k}/${r}`)));
    const clouds = await Promise.all(place.over.map((/** @type {any} */ o) => this.array(job, o.key)));
    const curves = await Promise.all(place.over.map((/** @type {any} */ o) => o.curve ? this.array(job, `${o.key}/curve`) : null));
    return (/** @type {HTMLElement} */ into) => {
      const c = look();
      into.append(el("div", { class: "choices" }, el("label", {}, "At ", el("select", { id: "choose-place", onchange: (/** @type {any} */ e) => { chosen.place = Number(e.target.value); this.evidence.show(); } },
        ...places.map((/** @type {any} */ p, /** @type {number} */ n) => el("option", { value: n, selected: n === k }, `${p.name} (explains ${number(Math.round(1e4 * p.explained) / 100, 4)} %)`)))),
      el("span", { class: "hint" }, "or click a part or wire of the drawing")), el("p", { class: "said" }, place.words));
      place.over.forEach((/** @type {any} */ o, /** @type {number} */ n) => {
        const [x, y, up] = clouds[n];
        into.append(el("p", { class: "said" }, `over ${o.formula}: R² ${number(Math.max(o.r2, 0), 3)} on data not used`));
        this.evidence.charts.push(cloud(into, { x, y, up, xLabel: o.unit ? `${o.formula} [${o.unit}]` : o.formula, yLabel: `${place.what} [${place.unit}]`, height: 230, describe: `${place.what} at ${place.name} over ${o.formula}`, curve: curves[n] }));
      });
      place.records.forEach((/** @type {string} */ r, /** @type {number} */ n) => {
        const [time, value, band] = courses[n], colour = c.colours[n % c.colours.length];
        this.evidence.charts.push(timeChart(into, { time, unit: place.unit, height: 150, sync: `place-${r}`, describe: `${place.what} at ${place.name} in ${r} over time`, band: [2, 3],
          lines: [{ label: `${place.what} at ${place.name}, ${r}`, values: value, colour }, { label: "+ 2 standard deviations", values: value.map((/** @type {number} */ v, /** @type {number} */ i) => v + band[i]), colour, width: 0 },
            { label: "− 2 standard deviations", values: value.map((/** @type {number} */ v, /** @type {number} */ i) => v - band[i]), colour, width: 0 }] }));
      });
    };
  }
}

/** @param {string} kind @param {any} add @param {any[]} all */
function addWords(kind, add, all) {
  if (kind === "fit" || kind === "tune") return `Write ${add.label}`;
  return all.length > 1 && add.count > 1 ? `Add the first ${add.count}, with ${add.label}` : `Add it: ${add.label}`;
}

/** How far an error fell. @param {any[]} rungs @param {string} from */
function fallen(rungs, from) {
  if (rungs.length < 2) return "";
  const [first, last] = [rungs[0], rungs[rungs.length - 1]], held = last.chi2_held_out !== null, chi2 = (/** @type {any} */ r) => number(held ? r.chi2_held_out : r.chi2_fit, 4);
  const error = (/** @type {any} */ r) => number(100 * (held ? r.error_held_out : r.error_fit), 3);
  return `On ${held ? "held-out" : "fitted"} data the error fell from ${error(first)} % to ${error(last)} % of what was measured, reduced chi-square from ${chi2(first)} (${from}) to ${chi2(last)}.`;
}

/** @param {number} seconds */
function duration(seconds) {
  const whole = Math.round(seconds);
  return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
}
