// What is to be tuned: free parameters with their ranges, the cost, the limits.

import { el, number } from "./dom.js";

/** Parameters with a number of their own that may be changed. @param {any} view @returns {any[]} */
export function variable(view) {
  return [...view.parameters, ...Object.entries(view.parts).filter(([path]) => !path.includes(".")).flatMap(([, part]) => part.parameters)]
    .filter((p) => p.slider && p.slider.value && /^[-+.\d]/.test(p.text));
}

/** @param {any} studio @param {boolean} running @param {(given: any) => void} begin */
export function tuningForm(studio, running, begin) {
  const view = studio.view, state = studio.tuningState ??= {};
  const kept = state[studio.document.name] ??= { free: {}, cost: "", limits: "", evaluate: "" };
  const parameters = variable(view);
  const unit = (/** @type {any} */ s) => s.unit ? ` ${s.unit}` : "";
  const usual = (/** @type {any} */ p) => p.slider.value > 0 ? `0 .. ${number(3 * p.slider.value, 4)}${unit(p.slider)}` : `${number(3 * p.slider.value, 4)} .. 0${unit(p.slider)}`;
  const rows = parameters.map((p) => {
    const range = el("input", { id: `range-${p.path}`, "aria-label": `range of ${p.path}`, value: kept.free[p.path] ?? usual(p), disabled: !(p.path in kept.free), oninput: (/** @type {any} */ e) => { kept.free[p.path] = e.target.value; } });
    return el("li", {}, el("label", {}, el("input", { type: "checkbox", id: `free-${p.path}`, checked: p.path in kept.free, onchange: (/** @type {any} */ e) => {
      if (e.target.checked) kept.free[p.path] = /** @type {any} */ (range).value; else delete kept.free[p.path];
      /** @type {any} */ (range).disabled = !e.target.checked;
    } }), ` ${p.path} = ${p.text}`), range);
  });
  const field = (/** @type {string} */ key, /** @type {string} */ label, /** @type {string} */ hint) => el("p", { class: "row" }, el("label", { for: `tune-${key}` }, label), el("input", { id: `tune-${key}`, class: "wide", value: kept[key], placeholder: hint, spellcheck: "false", oninput: (/** @type {any} */ e) => { kept[key] = e.target.value; } }));
  const output = view.outputs[0]?.name ?? "load.x";
  return el("form", { id: "tuning", onsubmit: (/** @type {Event} */ event) => {
    event.preventDefault();
    if (!running) begin({ free: Object.entries(kept.free).map(([path, range]) => `${path}=${range}`), cost: kept.cost, limits: kept.limits.split(";").map((/** @type {string} */ t) => t.trim()).filter(Boolean), evaluate: kept.evaluate });
  } }, el("details", { open: true }, el("summary", {}, "Parameters to tune, with their ranges"), el("ul", { class: "frees" }, ...rows)),
  field("cost", "Cost to minimise", `such as rms(${output})`), field("limits", "Constraints", `such as peak(${output}) < 1; several apart by ;`), field("evaluate", "Evaluated time", "the whole run, or 2 .. 4 s"),
  el("button", { class: "main", id: "begin-tune", disabled: running }, "Tune"));
}
