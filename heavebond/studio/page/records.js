// Records dropped on the page or chosen from the disk: stored in the folder, their columns proposed, an experiment made of them.

import { sketch } from "./charts.js";
import { busy, byId, el, message, number } from "./dom.js";
import { problemList } from "./results.js";
import { FMU, importModel } from "./home.js";
import { variable } from "./tuning.js";

const ROLES = [["", "not used"], ["time", "time"], ["input", "input"], ["output", "output"]];
const USES = [["fit", "fitted"], ["validate", "held out (validation)"], ["test", "held out (test)"]];

export class RecordFiles {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    const chooser = /** @type {HTMLInputElement} */ (byId("record-files"));
    byId("records").onclick = () => chooser.click();
    chooser.onchange = () => { void this.take([...(chooser.files ?? [])]); chooser.value = ""; };
    const files = (/** @type {DragEvent} */ event) => event.dataTransfer?.types.includes("Files");
    addEventListener("dragover", (event) => {
      if (!files(event)) return;
      event.preventDefault();
      document.body.classList.add("dropping");
    });
    addEventListener("dragleave", (event) => { if (!event.relatedTarget) document.body.classList.remove("dropping"); });
    addEventListener("drop", (event) => {
      document.body.classList.remove("dropping");
      if (!files(event)) return;
      event.preventDefault();
      void this.take([...(event.dataTransfer?.files ?? [])], event);
    });
  }

  /** @param {File[]} all @param {DragEvent} [event] of files that were dropped */
  async take(all, event) {
    const { studio } = this, document_ = studio.document, fmus = all.filter((file) => FMU.test(file.name)), files = all.filter((file) => !FMU.test(file.name));
    if (fmus.length && document_) await studio.palette.addFmus(fmus, event);
    else for (const file of fmus) importModel(studio, file);
    if (!files.length) return;
    if (!document_ || !studio.view?.parts) {
      studio.banner(["Open the diagram that was measured first, then drop its records there."]);
      return;
    }
    if (studio.unsaved) {
      studio.banner(["The text is not saved. Save it first (Ctrl+S): the experiment will be a file beside it."]);
      return;
    }
    studio.banner([]);
    try {
      const stored = [];
      for (const file of files) {
        studio.say(`storing ${file.name}`);
        stored.push(await this.store(document_.name, file));
      }
      studio.say("reading the record");
      if (studio.document?.name !== document_.name) return;
      if (studio.evidence.active) { await this.join(stored); return; }
      const told = await studio.link.ask("propose", { name: document_.name, text: studio.editor.text, file: stored[0] });
      studio.say("");
      if (studio.document?.name === document_.name) this.form(stored, told);
    } catch (error) {
      studio.say("");
      studio.banner(problemList(/** @type {any} */ (error).problems ?? [{ message: /** @type {any} */ (error).message, notes: [] }]));
    }
  }

  /** @param {string} beside @param {File} file */
  async store(beside, file) {
    const address = new URL("records", location.href);
    address.hash = "";
    address.search = new URLSearchParams({ beside, name: file.name }).toString();
    const told = await (await fetch(address, { method: "POST", body: file })).json();
    if (told.problems) throw Object.assign(new Error(told.problems[0].message), { problems: told.problems });
    return told.file;
  }

  /** Further records of an experiment, into its text. @param {string[]} files */
  async join(files) {
    const told = await this.studio.link.ask("join", { name: this.studio.document.name, text: this.studio.editor.text, files });
    this.studio.editor.replace(told.text);
    this.studio.say(`${told.names.join(", ")}: held out, written into the text, not saved yet`);
  }

  // -- the form ------------------------------------------------------------------------------------------------------
  /** @param {string[]} files @param {any} told */
  form(files, told) {
    const dialog = /** @type {HTMLDialogElement} */ (byId("record-form")), { studio } = this, model = studio.document.name;
    const stem = (/** @type {string} */ name) => name.replace(/^.*[/:]/, "").replace(/\.\w+$/, "").replace(/\W+/g, "_");
    const uses = files.map((file, k) => ({ file, use: k && k === files.length - 1 ? "validate" : "fit" }));
    const rows = told.columns.map((/** @type {any} */ c) => this.column(c, told));
    const wrong = el("div", { role: "alert", id: "record-wrong" });
    const name = el("input", { id: "experiment-name", value: `${stem(model)}_${stem(files[0])}`.slice(0, 60), spellcheck: "false", autocomplete: "off" });
    const every = el("input", { id: "record-every", class: "short", placeholder: "10 ms", spellcheck: "false", autocomplete: "off" });
    const timeless = el("p", {}, el("label", { for: "record-every" }, "No column is the time: the time between two rows "), every);
    const times = () => { timeless.hidden = rows.some((/** @type {any} */ r) => r.chosen().role === "time"); };
    for (const r of rows) r.row.addEventListener("change", times);
    times();
    const frees = this.frees();
    const form = el("form", { method: "dialog", onsubmit: (/** @type {Event} */ event) => {
      event.preventDefault();
      void busy(form, async () => { try {
        const made = await studio.link.ask("experiment", { model, name: /** @type {any} */ (name).value.trim(), title: `${stem(model)}, ${files.map(stem).join(", ")}`,
          files: Object.fromEntries(uses.map((u) => [u.file, u.use])), columns: rows.map((/** @type {any} */ r) => r.chosen()).filter((/** @type {any} */ c) => c.role), free: frees.chosen(), every: timeless.hidden ? "" : /** @type {any} */ (every).value.trim() });
        dialog.close();
        await studio.open(made.name);
        studio.say(`wrote ${made.name}`);
      } catch (error) {
        wrong.replaceChildren(...problemList(/** @type {any} */ (error).problems ?? [{ message: /** @type {any} */ (error).message, notes: [] }]));
        wrong.scrollIntoView({ block: "nearest" });
      } });
    } },
    el("h2", {}, `Records of ${stem(model)}`), el("p", { class: "said" }, "The role of each column is proposed from its name and unit; correct it if it is wrong. The input columns drive the model, and its outputs are compared with the output columns."),
    ...told.remarks.map((/** @type {string} */ r) => el("p", { class: "verdict" }, ...message(r))),
    el("ul", { class: "files aligned" }, ...uses.map((u, k) => el("li", {}, el("code", {}, u.file), el("select", { id: `use-${k}`, "aria-label": `use of ${u.file}`, onchange: (/** @type {any} */ e) => { u.use = e.target.value; } },
      ...USES.map(([value, text]) => el("option", { value, selected: value === u.use }, text)))))),
    files.length === 1 ? el("p", { class: "said" }, "With one record, its last third is held out of the fit. It is better to drop two records and to hold one out.") : null,
    el("div", { class: "scroll" }, el("table", { class: "columns" }, el("thead", {}, el("tr", {}, ...["column", "curve", "range", "role", "variable of the diagram", "unit", "noise", "between samples"].map((h) => el("th", { scope: "col" }, h)))),
      el("tbody", {}, ...rows.map((/** @type {any} */ r) => r.row)))),
    el("datalist", { id: "known-inputs" }, ...options(told.inputs)), el("datalist", { id: "known-outputs" }, ...options(told.outputs)),
    timeless, frees.place, el("p", {}, el("label", { for: "experiment-name" }, "Name of the experiment's file "), name, el("code", {}, ".yaml")), wrong,
    el("menu", {}, el("button", { type: "button", onclick: () => dialog.close() }, "Cancel"), el("button", { class: "main", id: "make-experiment" }, "Write the experiment")));
    dialog.replaceChildren(form);
    dialog.showModal();
    /** @type {HTMLElement|null} */ (dialog.querySelector("select"))?.focus();
  }

  /** @param {any} c @param {any} told */
  column(c, told) {
    const id = `column-${c.name}`, unit = el("input", { id: `unit-${c.name}`, class: "short", value: c.unit, "aria-label": `unit of ${c.name}`, title: c.unit_known ? "as the file gives it" : "the file gives no unit: check it" });
    const target = el("input", { id: `target-${c.name}`, value: c.target, "aria-label": `what ${c.name} is in the diagram`, spellcheck: "false", autocomplete: "off" });
    const between = el("select", { id: `between-${c.name}`, "aria-label": `${c.name} between samples` }, ...["spline", "linear", "hold"].map((v) => el("option", { value: v, selected: v === (c.interpolation || "linear") }, v)));
    const noise = el("input", { id: `noise-${c.name}`, class: "short", placeholder: "estimated", title: "Standard deviation of the noise, such as 0.2 mm; an empty field: estimated from the records", "aria-label": `noise of ${c.name}`, spellcheck: "false", autocomplete: "off" });
    const role = el("select", { id, "aria-label": `what ${c.name} is` }, ...ROLES.map(([value, text]) => el("option", { value, selected: value === c.role }, text)));
    const marks = () => {
      const now = /** @type {any} */ (role).value;
      target.hidden = noise.hidden = now !== "input" && now !== "output";
      target.setAttribute("list", now === "input" ? "known-inputs" : "known-outputs");
      between.hidden = now !== "input";
      unit.hidden = !now;
    };
    role.addEventListener("change", () => {
      const known = /** @type {any} */ (role).value === "input" ? told.inputs : told.outputs, field = /** @type {any} */ (target);
      if (!(field.value in known)) field.value = "";
      marks();
    });
    target.addEventListener("change", () => { // a unit that the file does not give follows from the signal
      const known = told[/** @type {any} */ (role).value === "input" ? "inputs" : "outputs"][/** @type {any} */ (target).value];
      if (known && !c.unit_known) /** @type {any} */ (unit).value = known[0];
    });
    marks();
    const row = el("tr", {}, el("th", { scope: "row" }, c.name), el("td", {}, c.sketch.length ? sketch(c.sketch) : ""), el("td", { class: "range" }, c.low === null ? "—" : `${number(c.low, 4)} .. ${number(c.high, 4)}`),
      el("td", {}, role), el("td", {}, target), el("td", { class: c.unit_known ? null : "unsure" }, unit), el("td", {}, noise), el("td", {}, between));
    const value = (/** @type {any} */ field) => field.value.trim();
    return { row, chosen: () => ({ column: c.name, role: value(role), target: value(target), unit: value(unit), interpolation: value(between), noise: value(noise) }) };
  }

  /** The parameters that may be estimated: a tolerance around the values of the diagram. */
  frees() {
    const parameters = variable(this.studio.view);
    const fields = parameters.map((p) => {
      const within = el("input", { id: `within-${p.path}`, class: "short", value: "20", inputmode: "decimal", "aria-label": `tolerance of ${p.path} in percent` });
      const box = el("input", { type: "checkbox", id: `free-${p.path}` });
      return { p, within, box, row: el("li", {}, el("label", {}, box, ` ${p.path} = ${p.text}`), el("span", {}, " ± ", within, " %")) };
    });
    const all = el("button", { type: "button", onclick: () => { for (const f of fields) /** @type {any} */ (f.box).checked = true; } }, "Select all");
    const place = el("details", { open: fields.length <= 12 }, el("summary", {}, "Parameters that are not known exactly (they are estimated within a tolerance)"), all, el("ul", { class: "frees" }, ...fields.map((f) => f.row)));
    return { place, chosen: () => Object.fromEntries(fields.filter((f) => /** @type {any} */ (f.box).checked).map((f) => [f.p.path, `${f.p.text} +- ${/** @type {any} */ (f.within).value.trim()} %`])) };
  }
}

/** @param {Record<string, [string, string]>} known */
function options(known) { return Object.entries(known).map(([name, [unit, doc]]) => el("option", { value: name }, `${doc}${unit && unit !== "1" ? ` [${unit}]` : ""}`)); }
