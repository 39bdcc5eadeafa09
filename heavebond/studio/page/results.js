// Tables and lines of a result, as the command line prints them.

import { el, message } from "./dom.js";

/** @param {any[]} items @returns {any[]} */
export function resultItems(items) {
  return items.map((item) => item.rows ? table(item) : item.notes ? notes(item.notes) : item.line ? el("p", { class: item.warning ? "verdict" : "said" }, item.line) : null).filter(Boolean);
}

/** @param {any} item */
function table(item) {
  const cell = (/** @type {string} */ text, /** @type {number} */ k) => el(k ? "td" : "th", { class: k < item.text ? "words" : null, scope: k ? null : "row" }, text);
  return el("div", { class: "scroll" }, el("table", { class: "figures" }, item.title ? el("caption", {}, item.title) : null,
    el("thead", {}, el("tr", {}, ...item.head.map((/** @type {string} */ h, /** @type {number} */ k) => el("th", { scope: "col", class: k < item.text ? "words" : null }, h)))),
    el("tbody", {}, ...item.rows.map((/** @type {string[]} */ row) => el("tr", {}, ...row.map(cell))))));
}

/** @param {string[][]} rows */
function notes(rows) {
  /** @type {HTMLElement[]} */
  const parts = [];
  for (const [record, note] of rows) {
    if (record) parts.push(el("dt", {}, record));
    parts.push(el("dd", {}, note));
  }
  return el("dl", { class: "noticed", "aria-label": "noticed" }, ...parts);
}

/** Whether a port or an input is not connected yet, which its own mark on the drawing tells. @param {any} problem */
export const isUnconnected = (problem) => /^(port|input)-unconnected$/.test(problem.code);

/** What an error says, as the problems of a refusal or as one. @param {any} error @returns {any[]} */
export const problemsOf = (error) => error.problems ?? [{ message: String(error.message ?? error), notes: [] }];

/** What went wrong, in the words of the command line. @param {any[]} problems */
export function problemList(problems) {
  return problems.map((p) => el("div", { class: "verdict" }, el("b", {}, ...message(p.message)), ...[...(p.notes ?? []), p.hint].filter(Boolean).map((t) => el("div", { class: "hint" }, ...message(t)))));
}
