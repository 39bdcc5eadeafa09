// The commands of the command line as forms: their options, the run, and what it printed and drew.

import { el } from "./dom.js";

/** The kind of the document that is open. @param {any} studio */
const kindOf = (studio) => studio.evidence.active ? "experiment" : studio.view?.study ? "study" : "model";

/** The names of the diagram that a value may have, by what an option asks for. @param {any} view @returns {Record<string, string[]>} */
function namesOf(view) {
  const parts = Object.values(view?.parts ?? {}), parameters = [...view?.parameters ?? [], ...parts.flatMap((p) => p.parameters)].map((p) => p.path);
  const signals = [...view?.outputs ?? [], ...parts.flatMap((p) => p.signals), ...Object.values(view?.nodes ?? {}).flatMap((n) => n.signals ?? [])].map((s) => s.name);
  const inputs = parts.flatMap((p) => p.ports.filter((/** @type {any} */ port) => port.direction === "in").map((/** @type {any} */ port) => port.path));
  return { parameters: [...new Set(parameters)], signals: [...new Set(signals)], inputs: [...new Set(inputs)] };
}

/** Which of these an option asks for; empty for a time or a number. @param {string} metavar */
const asked = (metavar) => /INPUT/.test(metavar) ? "inputs" : /PARAMETER|PATH/.test(metavar) ? "parameters" : /SIGNAL|OUTPUT|VARIABLE|FORMULA/.test(metavar) ? "signals" : "";

/** The form of a command; `begin` is called with its values. @param {any} studio @param {any} all of the server @param {any} state that is kept @param {boolean} running @param {(given: any) => void} begin */
export function commandForm(studio, all, state, running, begin) {
  const found = all[kindOf(studio)] ?? [];
  if (!found.length) return [el("p", { class: "empty" }, "This kind of document has no further analyses.")];
  const chosen = found.find((/** @type {any} */ c) => c.name === state.command) ?? found[0], kept = state.values[chosen.name] ??= {};
  const row = (/** @type {any} */ o) => {
    const id = `option-${o.name}`, offered = o.kind === "text" && !/^(experiment|study)$/.test(kindOf(studio)) ? asked(o.metavar) : "", words = `${o.help}${o.required ? " Required." : ""}`;
    const field = o.kind === "flag" ? el("input", { type: "checkbox", id, checked: Boolean(kept[o.name]), onchange: (/** @type {any} */ e) => { kept[o.name] = e.target.checked; } })
      : o.kind === "choice" ? el("select", { id, onchange: (/** @type {any} */ e) => { kept[o.name] = e.target.value; } }, el("option", { value: "" }, "default"), ...o.choices.map((/** @type {string} */ c) => el("option", { value: c, selected: c === kept[o.name] }, c)))
        : el(o.several ? "textarea" : "input", { id, class: "mono", rows: o.several ? Math.max(1, String(kept[o.name] ?? "").split("\n").length) : null, value: kept[o.name] ?? "", placeholder: `${o.metavar}${o.several ? ", one in a line" : ""}`, spellcheck: "false", autocomplete: "off", list: offered && !o.several ? `names-${offered}` : null, required: o.required, oninput: (/** @type {any} */ e) => { kept[o.name] = e.target.value; } });
    const add = offered && o.several ? el("input", { class: "add-name mono", list: `names-${offered}`, placeholder: "add a name", "aria-label": `add a name to ${o.flag.replace(/^-+/, "")}`, autocomplete: "off", onchange: (/** @type {any} */ e) => {
      const text = String(kept[o.name] ?? "").trim();
      field.value = kept[o.name] = [text, e.target.value + (/PATH=/.test(o.metavar) ? "=" : "")].filter(Boolean).join("\n");
      field.rows = field.value.split("\n").length;
      e.target.value = "";
      field.focus();
    } }) : null;
    return el("tr", {}, el("th", { scope: "row" }, el("label", { for: id }, o.flag.replace(/^-+/, ""))), el("td", { class: "words" }, field, add), el("td", { class: "words doc" }, words));
  };
  const names = Object.entries(namesOf(studio.view)).map(([key, list]) => el("datalist", { id: `names-${key}` }, ...list.map((name) => el("option", { value: name }))));
  return [...names, el("form", { id: "command-form", onsubmit: (/** @type {Event} */ event) => {
    event.preventDefault();
    if (running) return;
    const values = Object.fromEntries(chosen.options.map((/** @type {any} */ o) => [o.name, o.several ? String(kept[o.name] ?? "").split("\n").map((t) => t.trim()).filter(Boolean) : kept[o.name] ?? ""])
      .filter((/** @type {any[]} */ [, value]) => value !== "" && value !== false && (!Array.isArray(value) || value.length)));
    begin({ settable: chosen.options.some((/** @type {any} */ o) => o.name === "settings"), command: chosen.name, values, picture: chosen.picture && kept[" picture"] !== false, format: kept[" format"] ?? chosen.formats[0] ?? "" });
  } }, el("div", { class: "choices" }, el("label", {}, "Analysis ", el("select", { id: "command", onchange: (/** @type {any} */ e) => { state.command = e.target.value; state.closed = false; studio.evidence.show(); } },
    ...found.map((/** @type {any} */ c) => el("option", { value: c.name, selected: c === chosen }, `${c.name}: ${c.summary}`)))),
  chosen.picture && el("label", {}, el("input", { type: "checkbox", id: "command-picture", checked: kept[" picture"] !== false, onchange: (/** @type {any} */ e) => { kept[" picture"] = e.target.checked; } }), " picture"),
  chosen.formats.length > 0 && el("label", {}, "file ", el("select", { id: "command-format", onchange: (/** @type {any} */ e) => { kept[" format"] = e.target.value; } }, ...chosen.formats.map((/** @type {string} */ f) => el("option", { value: f, selected: f === kept[" format"] }, f ? `.${f}` : "none")))),
  el("button", { class: "main", id: "begin-command", disabled: running }, "Run it")),
  el("details", { class: "command-options", open: !state.closed, ontoggle: (/** @type {any} */ e) => { state.closed = !e.target.open; } }, el("summary", {}, "Options"),
    el("div", { class: "scroll" }, el("table", { class: "options" }, el("tbody", {}, ...chosen.options.map(row))))))];
}

/** What a command printed. @param {any} result */
export function commandResult(result) {
  return [el("p", { class: "said" }, "The same on the command line: ", el("code", {}, result.command)), ...result.warnings.map((/** @type {string} */ line) => el("p", { class: "verdict" }, line)),
    result.text.trim() ? el("pre", { id: "printed", tabindex: "0" }, result.text) : null, result.files.length ? el("p", { class: "said" }, "Written: ", ...result.files.flatMap((/** @type {string} */ file, /** @type {number} */ k) => [k ? ", " : "",
      file.endsWith(".html") ? el("a", { href: `reports/${file.split("/").map(encodeURIComponent).join("/")}`, target: "_blank", rel: "noopener" }, file) : el("code", {}, file)])) : null];
}
