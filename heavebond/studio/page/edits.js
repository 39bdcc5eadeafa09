// Edits of the drawing: each is a change of the text, so that undo and redo go over both alike.

import { byId, el, message } from "./dom.js";

const TOLD = 7000; // ms for which a reason is shown
const SLOW = 500; // ms from which on the page says that an edit is under way

export class Edits {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.turn = Promise.resolve();
  }

  get possible() { return Boolean(this.studio.document?.writable) && !this.studio.view?.evidence && !this.studio.view?.study; }

  /** One action after the other; what it selects is selected. @param {Record<string, any>} action @param {(words: string) => void} [refused] where else than on the drawing the reason is told @returns {Promise<boolean>} whether it was done */
  act(action, refused = (words) => this.refuse(words)) {
    const done = this.turn.then(() => this.perform(action, refused));
    this.turn = done.then(() => undefined, () => undefined); // whatever became of one, the next has its turn
    return done;
  }

  /** @param {Record<string, any>} action @param {(words: string) => void} refused */
  async perform(action, refused) {
    const { studio } = this, before = studio.editor.text, name = studio.document?.name;
    if (!this.possible) { this.refuse(studio.view?.evidence ? "An experiment shows the diagram of another file. Open that diagram to change it." : "This diagram is read only. Copy or extend it to change it."); return false; }
    const words = "changing the text…", slow = setTimeout(() => studio.say(words), SLOW);
    try {
      const told = await studio.link.ask("edit", { name, text: before, action: { grid: studio.view?.grid, ...action } });
      if (told.kind !== "done" || studio.document?.name !== name) return false;
      if (studio.editor.text !== before) { this.refuse("The text was changed at the same time; do it once more."); return false; }
      byId("reason").hidden = true;
      studio.editor.replace(told.text);
      studio.picked = told.part ? { kind: "part", path: told.part } : told.node ? { kind: "node", path: told.node } : null;
      studio.chosen = [];
      await studio.check(false);
      if (told.parts?.length > 1) studio.chooseParts([...told.parts.filter((/** @type {string} */ part) => part !== told.part), told.part]);
      else if (studio.picked) studio.pick(studio.picked.kind, studio.picked.path);
      studio.diagram.reveal();
      if (told.removed?.length) studio.say(`also removed: ${told.removed.join(", ")} (Ctrl+Z brings all back)`);
      return true;
    } catch (error) {
      refused(error instanceof Error ? error.message : String(error));
      return false;
    } finally {
      clearTimeout(slow);
      if (byId("status").textContent === words) studio.say("");
    }
  }

  /** A value typed into a field, written into the text; one that is refused stays in the field with the reason below it. @param {Record<string, any>} action @param {HTMLInputElement} field @param {HTMLElement} wrong @returns {Promise<boolean>} whether it was written */
  write(action, field, wrong) {
    const tell = (/** @type {string} */ words) => { wrong.replaceChildren(...message(words)); field.setAttribute("aria-invalid", String(Boolean(words))); };
    tell("");
    return this.act(action, tell);
  }

  /** @param {string} words */
  refuse(words) {
    const place = byId("reason");
    place.replaceChildren(...message(words));
    place.hidden = false;
    clearTimeout(this.hiding);
    this.hiding = setTimeout(() => { place.hidden = true; }, TOLD);
  }

  /** The part or node that is selected, if it stands on the outermost sheet. */
  get selected() {
    const { picked, view } = this.studio;
    return picked && !picked.path.includes(".") && (picked.kind === "part" ? view?.parts?.[picked.path] : view?.nodes?.[picked.path]) ? picked : null;
  }

  remove() {
    const picked = this.selected, { chosen } = this.studio;
    if (chosen.length) { void this.act({ act: "delete", parts: chosen }); return; }
    if (picked) void this.act(picked.kind === "part" ? { act: "delete", parts: [picked.path] } : { act: "delete", nodes: [picked.path] });
  }

  copy() {
    const { chosen } = this.studio;
    if (chosen.length) void this.act({ act: "copy_parts", parts: chosen, part: chosen[chosen.length - 1] });
    else if (this.selected?.kind === "part") void this.act({ act: "copy", part: this.selected.path });
  }

  rotate() {
    if (this.selected?.kind !== "part") return;
    const part = this.selected.path;
    void this.act({ act: "turn", part, turn: this.studio.diagram.facing(part) });
  }

  rename() {
    const field = /** @type {HTMLInputElement|null} */ (document.getElementById("item-name"));
    field?.focus();
    field?.select();
  }

  /** @param {string} name */
  named(name) {
    const picked = this.selected;
    if (!picked || name === picked.path) return;
    void this.act(picked.kind === "part" ? { act: "rename", part: picked.path, name } : { act: "rename_node", node: picked.path, name })
      .then((done) => {
        if (!done) this.studio.panel.show();
        else if (document.activeElement?.id === "item-name") (this.studio.diagram.group(name) ?? byId("sheet")).focus({ preventScroll: true }); // Enter was pressed: the keys act on the part again
      });
  }

  /** A step over the grid by the keyboard. @param {number} dx @param {number} dy */
  step(dx, dy) {
    const picked = this.selected, grid = this.studio.view?.grid;
    if (picked?.kind !== "part" || !grid?.cells[picked.path]) return;
    const [c, r] = grid.cells[picked.path], { chosen } = this.studio, taken = new Set(Object.values(grid.cells).map(String));
    if (chosen.length) { void this.act({ act: "move_parts", parts: chosen, part: picked.path, column: Math.max(-1, Math.min(grid.xs.length, c + dx)), row: Math.max(-1, Math.min(grid.ys.length, r + dy)) }); return; }
    const beyond = taken.has(String([c + dx, r + dy])) ? 1.5 : 1;
    const limit = (/** @type {number} */ value, /** @type {number} */ count) => Math.max(-1, Math.min(count, value));
    void this.act({ act: "move", part: picked.path, column: limit(c + beyond * dx, grid.xs.length), row: limit(r + beyond * dy, grid.ys.length) });
  }

  /** The name of the selected thing and what can be done with it, for the panel. @param {string} path */
  tools(path) {
    if (!this.possible || path.includes(".")) return [el("h2", {}, path)];
    const part = this.studio.picked?.kind === "part";
    const name = el("input", { id: "item-name", class: "name", value: path, spellcheck: "false", autocomplete: "off", "aria-label": part ? "name of the part" : "name of the node", title: "Rename (F2)",
      onchange: (/** @type {any} */ event) => this.named(event.target.value.trim()),
      onkeydown: (/** @type {KeyboardEvent} */ event) => { if (event.key === "Escape") { /** @type {HTMLInputElement} */ (event.target).value = path; byId("sheet").focus(); } } });
    return [el("h2", {}, name), el("div", { class: "tools" },
      part && el("button", { id: "item-connect", title: "Draw a wire from a port of it (W)", onclick: () => this.studio.wiring.fromPart(path) }, "Connect"),
      part && el("button", { id: "item-turn", title: "Turn (R)", onclick: () => this.rotate() }, "Turn"),
      part && el("button", { id: "item-copy", title: "Copy (Ctrl+D)", onclick: () => this.copy() }, "Copy"),
      el("button", { id: "item-delete", title: "Delete (Del)", onclick: () => this.remove() }, part ? "Delete" : "Delete the wire"))];
  }

  /** What can be done with several parts, for the panel. @param {string[]} parts */
  several(parts) {
    return [el("h2", {}, `${parts.length} parts`), el("div", { class: "tools" }, el("button", { id: "item-copy", title: "Copy with the wires between them (Ctrl+D)", onclick: () => this.copy() }, "Copy"),
      el("button", { id: "item-delete", title: "Delete (Del)", onclick: () => this.remove() }, "Delete")),
    el("p", {}, "Drag one of them, or press Shift and arrow keys, to move all. Shift and a click adds or takes away a part."),
    el("ul", { class: "ports" }, ...parts.map((part) => el("li", {}, el("button", { class: "plain", onclick: () => this.studio.pick("part", part) }, part), el("span", { class: "doc" }, ` ${this.studio.view.parts[part]?.kind ?? ""}`))))];
  }

  /** The ports of a part with what they are joined to. @param {any} part */
  ports(part) {
    if (!part.ports?.length) return [];
    return [el("h3", {}, "Ports"), el("ul", { class: "ports" }, ...part.ports.map((/** @type {any} */ port) => el("li", {},
      el("b", {}, port.name), el("span", { class: "doc" }, ` ${port.domain || "any domain"}${port.direction ? ` ${port.direction}put` : ""}${port.doc ? `, ${port.doc}` : ""} `),
      port.node ? el("span", {}, el("button", { class: "plain", onclick: () => this.studio.pick("node", port.node) }, port.node),
        this.possible && el("button", { class: "plain quiet", title: `Take ${port.path} off the node`, "aria-label": `take ${port.path} off node ${port.node}`, onclick: () => this.act({ act: "leave", port: port.path }) }, "×"))
        : port.value ? el("span", { class: "doc" }, "has a value") : el("button", { class: "plain open", disabled: !this.possible, onclick: () => this.studio.wiring.begin(port.path) }, "not connected"))))];
  }

  /** Keys that act on what is selected; whether this was one of them. @param {KeyboardEvent} event */
  key(event) {
    const mod = event.ctrlKey || event.metaKey, { key } = event;
    if (mod && key === "a") { event.preventDefault(); this.studio.chooseParts(Object.keys(this.studio.view?.grid?.cells ?? {})); return true; }
    /** @type {Record<string, () => void>} */
    const keys = mod ? { d: () => this.copy() } : event.altKey ? {} : event.shiftKey ?
      { ArrowLeft: () => this.step(-1, 0), ArrowRight: () => this.step(1, 0), ArrowUp: () => this.step(0, -1), ArrowDown: () => this.step(0, 1) } :
      { Delete: () => this.remove(), Backspace: () => this.remove(), r: () => this.rotate(), F2: () => this.rename(), w: () => this.selected?.kind === "part" && this.studio.wiring.fromPart(this.selected.path) };
    if (!this.selected || !keys[key]) return false;
    event.preventDefault();
    keys[key]();
    return true;
  }
}
