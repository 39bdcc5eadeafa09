// The keys of the page, listed on request.

import { byId, el } from "./dom.js";

/** @type {[string, [string, string][]][]} */
const KEYS = [
  ["Everywhere", [["Ctrl+Enter", "run, compare with the records, run the study"], ["Esc", "stop what runs"], ["Ctrl+S", "save"], ["Ctrl+Z, Ctrl+Shift+Z", "undo, redo"],
    ["Alt+T, Alt+L", "show or hide the text, the library"], ["/", "search the library"], ["Alt+H, Alt+Up", "first page; back from a block to its diagram"], ["?", "this list"]]],
  ["On the drawing", [["Tab, Enter", "to the next part or wire; select it"], ["Shift+Enter, Ctrl+A", "add the part to those that are selected; select all parts"], ["arrow keys, +, −, 0", "move, larger, smaller, show all"], ["Shift+arrow keys", "move the selected parts by two steps of the grid"],
    ["W", "draw a wire from the selected part; Tab and Enter choose the ports"], ["F2, R, M, Ctrl+D, Del", "rename, turn, mirror, copy, delete"], ["Ctrl+C, Ctrl+X, Ctrl+V", "copy, cut and paste parts, also to another diagram"], ["O, E", "open or close a block; edit it in its own file"]]],
  ["On a chart", [["+, −, 0", "stretch the time, shrink it, show the whole run"], ["arrow keys", "earlier, later"]]],
  ["Elsewhere", [["arrow keys, Enter", "in the tree of parts: go to a part, unfold and fold a block; select"], ["arrow keys", "move a slider, the instant of a run, a border between panes; go between the tabs of an experiment"], ["Ctrl+Space, Ctrl+F", "completion and search in the text"]]]];

/** Show the list; Esc or a click on Close ends it. */
export function showKeys() {
  const dialog = /** @type {HTMLDialogElement} */ (byId("keys"));
  dialog.replaceChildren(el("h2", {}, "Keys"), ...KEYS.flatMap(([where, keys]) => [el("h3", {}, where), el("table", {}, el("tbody", {}, ...keys.map(([key, what]) => el("tr", {}, el("th", { scope: "row" }, key), el("td", {}, what)))))]),
    el("menu", {}, el("button", { class: "main", id: "close-keys", onclick: () => dialog.close() }, "Close")));
  dialog.showModal();
}
