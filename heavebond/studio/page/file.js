// The file of the diagram: what is not saved, drafts, and what happens to it on disk.

import { byId, el, message as worded } from "./dom.js";
import { Refused } from "./link.js";

const CHECKED = 250; // ms after the last key until the text is checked
const DRAFTED = 400; // ms until it is kept as a draft

export class DiagramFile {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.offered = false;
    this.refused = false; // whether the banner tells that the text could not be saved, or has no file any more
  }

  get unsaved() { return Boolean(this.studio.document) && this.studio.editor.text !== this.studio.document.text; }

  marks() {
    byId("unsaved").hidden = !this.unsaved;
    /** @type {HTMLButtonElement} */ (byId("save")).disabled = !this.studio.document?.writable || !this.unsaved;
    byId("save").hidden = !this.studio.document?.writable;
    for (const id of ["undo", "redo"]) byId(id).hidden = !this.studio.document?.writable;
    /** @type {HTMLButtonElement} */ (byId("undo")).disabled = !this.studio.editor.undoable;
    /** @type {HTMLButtonElement} */ (byId("redo")).disabled = !this.studio.editor.redoable;
    byId("copy").hidden = !/^bundled:\w+$/.test(this.studio.document?.name ?? "");
  }

  changed() {
    this.marks();
    clearTimeout(this.checking);
    this.checking = setTimeout(() => this.studio.check(false), CHECKED);
    clearTimeout(this.drafting);
    this.drafting = setTimeout(() => this.keepDraft(), DRAFTED);
  }

  get draftKey() { return `draft:${this.studio.folder}:${this.studio.document.name}`; }

  /** What is not saved outlives the page and the server: it is kept in the browser. */
  keepDraft() {
    clearTimeout(this.drafting);
    if (!this.studio.document?.writable || this.offered) return;
    if (this.unsaved) localStorage.setItem(this.draftKey, JSON.stringify({ text: this.studio.editor.text, base: this.studio.document.version, when: Date.now() }));
    else localStorage.removeItem(this.draftKey);
  }

  offerDraft() {
    this.offered = false;
    const draft = JSON.parse(localStorage.getItem(this.draftKey) ?? "null");
    if (!draft || !this.studio.document.writable) return;
    if (draft.text === this.studio.document.text) { localStorage.removeItem(this.draftKey); return; }
    this.offered = true;
    const end = (/** @type {boolean} */ take) => {
      this.offered = false;
      this.studio.banner([]);
      if (take) this.studio.editor.replace(draft.text);
      else localStorage.removeItem(this.draftKey);
    };
    const other = draft.base === this.studio.document.version ? "" : " The file has changed since.";
    this.studio.banner([`There is text of ${new Date(draft.when).toLocaleString()} that was not saved.${other}`,
      el("button", { class: "main", id: "draft-take", onclick: () => end(true) }, "Take it"), el("button", { id: "draft-drop", onclick: () => end(false) }, "Throw it away")]);
  }

  async save() {
    if (!this.studio.document?.writable || !this.unsaved) return;
    const text = this.studio.editor.text;
    try {
      const saved = await this.studio.link.ask("save", { name: this.studio.document.name, text, base: this.studio.document.version });
      Object.assign(this.studio.document, { text: saved.text, version: saved.version });
      this.keepDraft();
      this.marks();
      if (this.refused) this.studio.banner([]);
      this.refused = false;
      this.studio.say("saved");
    } catch (error) {
      if (error instanceof Refused && error.problems[0].code === "file-changed") return; // the push tells of it
      this.refused = true;
      this.studio.banner([error instanceof Error ? error.message : String(error)]);
    }
  }

  /** @param {any} message */
  pushed(message) {
    if (message.push === "others") { void this.studio.check(false); this.studio.say("a file that the diagram reads has changed"); return; }
    if (!this.studio.document || message.name !== this.studio.document.name) return;
    if (message.push === "gone") {
      this.studio.document = { ...this.studio.document, text: "", version: "" }; // all of the text is unsaved now
      this.marks();
      this.keepDraft();
      this.studio.banner([`${message.name} has been removed from the folder. Its text is kept here: saving writes the file anew.`]);
      this.refused = true;
      return;
    }
    const text = this.studio.editor.text, before = this.studio.document.text;
    if (this.refused) this.studio.banner([]); // the file is there again, or another
    this.refused = false;
    if (text === message.text || text === before) {
      this.studio.document = { ...this.studio.document, ...message };
      this.studio.editor.replace(message.text);
      this.keepDraft();
      this.marks();
      this.studio.say("read again: the file has changed on disk");
      return;
    }
    const end = (/** @type {boolean} */ take) => {
      this.studio.document = { ...this.studio.document, ...message };
      if (take) this.studio.editor.replace(message.text);
      this.studio.banner([]);
      this.marks();
      this.keepDraft();
    };
    this.studio.banner([`${message.name} has changed on disk, and here is text that is not saved. Nothing was overwritten.`,
      el("button", { id: "take-disk", onclick: () => end(true) }, "Take the file's text (undo brings mine back)"),
      el("button", { id: "keep-mine", onclick: () => end(false) }, "Keep mine (saving replaces the file's)")]);
  }

  /** @param {boolean} open */
  linked(open) {
    if (open && this.studio.document) void this.studio.link.ask("open", { name: this.studio.document.name }).then((/** @type {any} */ told) => {
      this.studio.banner([]);
      if (this.offered) this.offerDraft(); // asked once more, as its banner has gone
      if (told.version !== this.studio.document?.version) this.pushed({ push: "disk", ...told });
      void this.studio.check(false);
    }, (/** @type {Error} */ error) => this.studio.banner([error.message]));
    if (!open) this.studio.banner(worded("The studio's server has ended. Start `heavebond studio` again: unsaved text is kept in this browser and offered on its new page."));
  }
}
