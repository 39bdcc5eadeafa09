// Edits of the drawing: each is a change of the text, so that undo and redo go over both alike.

import { byId, el, message } from "./dom.js";
import { GRID, freeText } from "./grid.js";

const TOLD = 7000; // ms for which a reason is shown
const STEP = 2; // steps of the grid that an arrow key moves
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
      const told = await studio.link.ask("edit", { name, text: before, action: { places: studio.view?.places, ...action } });
      if (told.kind !== "done" || studio.document?.name !== name) return false;
      if (studio.editor.text !== before) { this.refuse("The text was changed at the same time. Repeat the action."); return false; }
      byId("reason").hidden = true;
      studio.editor.replace(told.text);
      studio.picked = told.note ? { kind: "note", path: told.note } : told.part ? { kind: "part", path: told.part } : told.node ? { kind: "node", path: told.node } : null;
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
    if (picked?.kind === "note") return view?.notes?.[picked.path] ? picked : null;
    return picked && !picked.path.includes(".") && (picked.kind === "part" ? view?.parts?.[picked.path] : view?.nodes?.[picked.path]) ? picked : null;
  }

  remove() {
    const picked = this.selected, { chosen } = this.studio;
    if (chosen.length) { void this.act({ act: "delete", parts: chosen }); return; }
    if (picked?.kind === "note") { void this.act({ act: "note", name: picked.path, text: "", x: 0, y: 0 }); return; }
    if (picked) void this.act(picked.kind === "part" ? { act: "delete", parts: [picked.path] } : { act: "delete", nodes: [picked.path] });
  }

  copy() {
    if (this.held.length) void this.act({ act: "copy", parts: this.held });
  }

  /** The parts that are selected. @returns {string[]} */
  get held() { return this.studio.chosen.length ? this.studio.chosen : this.selected?.kind === "part" ? [this.selected.path] : []; }

  /** The selected parts with their wires as text on the clipboard, for this diagram or another one. @param {boolean} [cut] */
  async toClipboard(cut) {
    const parts = this.held, { studio } = this;
    if (!parts.length) return;
    try {
      const told = await studio.link.ask("edit", { name: studio.document.name, text: studio.editor.text, action: { act: "fragment", parts, places: studio.view?.places } });
      await navigator.clipboard.writeText(told.clipboard);
      studio.say(`${parts.length} ${parts.length > 1 ? "parts" : "part"} copied: paste with Ctrl+V here or in another diagram`);
      if (cut) this.remove();
    } catch (error) {
      this.refuse(error instanceof Error ? error.message : String(error));
    }
  }

  /** Parts from the clipboard, in the middle of what is seen or beside the originals. @param {string} clipboard */
  paste(clipboard) {
    const { diagram, view } = this.studio, names = Object.keys(view?.places ?? {});
    const own = [...clipboard.matchAll(/^ {2}(\w+): \{is/gm)].some((found) => names.includes(found[1])), box = byId("sheet").getBoundingClientRect();
    const middle = diagram.point({ clientX: box.left + box.width / 3, clientY: box.top + box.height / 3 });
    void this.act({ act: "paste", clipboard, ...(own || !diagram.svg ? {} : { x: Math.round(middle.x / GRID), y: Math.round(middle.y / GRID) }) });
  }

  /** @param {boolean} [mirror] */
  rotate(mirror) {
    if (this.selected?.kind === "part") void this.act({ act: "turn", part: this.selected.path, mirror: Boolean(mirror) });
  }

  /** A text on the drawing, near the middle of what is seen, beside parts and wires. */
  addNote() {
    const { diagram } = this.studio, box = byId("sheet").getBoundingClientRect();
    const middle = diagram.point({ clientX: box.left + box.width / 2, clientY: box.top + box.height / 4 });
    const { x, y } = freeText(diagram.svg, Math.round(middle.x / GRID), Math.round(middle.y / GRID));
    void this.act({ act: "note", text: "Note", x, y }).then((done) => {
      const field = /** @type {HTMLTextAreaElement|null} */ (document.getElementById("note-text"));
      if (done) { field?.focus(); field?.select(); }
    });
  }

  /** Parts by so many steps of the grid. @param {string[]} names @param {string} part which leads @param {number} dx @param {number} dy */
  move(names, part, dx, dy) {
    const places = this.studio.view.places;
    return this.act({ act: "move", part, to: Object.fromEntries(names.map((name) => [name, [places[name][0] + dx, places[name][1] + dy]])) });
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
    const names = this.held, picked = this.selected, note = picked?.kind === "note" ? this.studio.view.notes[picked.path] : null;
    if (note && picked) void this.act({ act: "note", name: picked.path, text: note.text, x: note.at[0] + dx, y: note.at[1] + dy });
    else if (names.length && names.every((name) => this.studio.view?.places?.[name])) void this.move(names, names[names.length - 1], dx, dy);
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
      part && el("button", { id: "item-mirror", title: "Mirror (M)", onclick: () => this.rotate(true) }, "Mirror"),
      part && el("button", { id: "item-copy", title: "Copy (Ctrl+D)", onclick: () => this.copy() }, "Copy"),
      el("button", { id: "item-delete", title: "Delete (Del)", onclick: () => this.remove() }, part ? "Delete" : "Delete the wire"),
      !part && this.studio.view.routed?.includes(path) && el("button", { id: "item-unroute", title: "Route the wire automatically again", onclick: () => this.act({ act: "route", node: path }) }, "Free its way"))];
  }

  /** A note: its text. @param {string} name */
  noteForm(name) {
    const note = this.studio.view.notes[name];
    return [el("h2", {}, "Note"), el("label", { for: "note-text" }, "Text on the drawing"), el("textarea", { id: "note-text", rows: "4", disabled: !this.possible, value: note.text,
      onchange: (/** @type {any} */ e) => this.act({ act: "note", name, text: e.target.value, x: note.at[0], y: note.at[1] }) }),
    el("div", { class: "tools" }, el("button", { id: "item-delete", disabled: !this.possible, title: "Delete (Del)", onclick: () => this.remove() }, "Delete")),
    el("p", {}, "Drag it on the drawing, or press Shift and arrow keys.")];
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
        : port.value ? el("span", { class: "doc" }, "has a value") : el("button", { class: port.default ? "plain" : "plain open", disabled: !this.possible, onclick: () => this.studio.wiring.begin(port.path) }, port.default ? "keeps its start value" : "not connected"))))];
  }

  /** Keys that act on what is selected; whether this was one of them. @param {KeyboardEvent} event */
  key(event) {
    const mod = event.ctrlKey || event.metaKey, { key } = event;
    if (mod && key === "a") { event.preventDefault(); this.studio.chooseParts(Object.keys(this.studio.view?.places ?? {})); return true; }
    /** @type {Record<string, () => void>} */
    const keys = mod ? { d: () => this.copy(), c: () => void this.toClipboard(), x: () => void this.toClipboard(true) } : event.altKey ? {} : event.shiftKey ?
      { ArrowLeft: () => this.step(-STEP, 0), ArrowRight: () => this.step(STEP, 0), ArrowUp: () => this.step(0, -STEP), ArrowDown: () => this.step(0, STEP) } :
      { Delete: () => this.remove(), Backspace: () => this.remove(), r: () => this.rotate(), m: () => this.rotate(true), F2: () => this.rename(), w: () => this.selected?.kind === "part" && this.studio.wiring.fromPart(this.selected.path) };
    if (!this.selected || !keys[key]) return false;
    event.preventDefault();
    keys[key]();
    return true;
  }
}
