// The text of the diagram: CodeMirror with YAML, and the problems of `heavebond check` at their lines.

import * as cm from "./vendor/codemirror.js";

const look = cm.HighlightStyle.define([
  { tag: cm.tags.propertyName, color: "var(--accent)" }, { tag: cm.tags.definition(cm.tags.propertyName), color: "var(--accent)" },
  { tag: cm.tags.comment, color: "var(--quiet)", fontStyle: "italic" }, { tag: cm.tags.string, color: "light-dark(#00663d, #8fd6ae)" },
  { tag: [cm.tags.keyword, cm.tags.typeName, cm.tags.labelName], color: "var(--warn)" }]);

const theme = cm.EditorView.theme({
  "&": { color: "var(--ink)", backgroundColor: "var(--paper)" },
  ".cm-gutters": { backgroundColor: "var(--soft)", color: "var(--quiet)", borderRight: "1px solid var(--line)" },
  ".cm-activeLine, .cm-activeLineGutter": { backgroundColor: "color-mix(in srgb, var(--pick) 35%, transparent)" },
  ".cm-cursor": { borderLeftColor: "var(--ink)" },
  "&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground": { backgroundColor: "var(--pick) !important" },
  ".cm-scroller": { fontFamily: 'ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace', lineHeight: "1.5" },
  ".cm-tooltip, .cm-panels": { backgroundColor: "var(--soft)", color: "var(--ink)", border: "1px solid var(--line)" },
  ".cm-diagnostic": { whiteSpace: "pre-wrap", maxWidth: "60ch" }});

export class Editor {
  /** @param {HTMLElement} parent @param {string} nonce @param {() => void} onchange @param {(line: number) => void} online @param {(context: any) => any} propose */
  constructor(parent, nonce, onchange, online, propose) {
    this.writable = new cm.Compartment();
    this.quiet = false;
    this.extensions = [
      cm.EditorView.cspNonce.of(nonce), cm.EditorState.lineSeparator.of("\n"),
      cm.EditorView.clipboardInputFilter.of((/** @type {string} */ text) => text.replace(/\r\n?/g, "\n")), // lines from Windows; saving gives them the ends that the file has
      cm.lineNumbers(), cm.highlightActiveLine(),
      cm.highlightActiveLineGutter(), cm.highlightSpecialChars(), cm.drawSelection(), cm.history({ minDepth: 1e9 }), cm.indentUnit.of("  "),
      cm.bracketMatching(), cm.closeBrackets(), cm.search(), cm.highlightSelectionMatches(), cm.lintGutter(), cm.yaml(),
      cm.syntaxHighlighting(look), theme, cm.EditorView.contentAttributes.of({ "aria-label": "Text of the diagram" }),
      cm.autocompletion({ override: [propose] }),
      cm.keymap.of([...cm.completionKeymap, ...cm.closeBracketsKeymap, ...cm.searchKeymap, ...cm.historyKeymap, ...cm.lintKeymap,
        ...cm.defaultKeymap.filter((/** @type {any} */ k) => k.key !== "Mod-Enter")]),
      cm.EditorView.updateListener.of((/** @type {any} */ update) => {
        if (update.docChanged && !this.quiet) onchange();
        if (update.selectionSet && !update.docChanged && update.view.hasFocus)
          online(update.state.doc.lineAt(update.state.selection.main.head).number);
      }),
      this.writable.of([])];
    this.view = new cm.EditorView({ parent, state: cm.EditorState.create({ extensions: this.extensions }) });
  }

  get text() { return this.view.state.doc.toString(); }

  /** Another document: its own history. @param {string} text @param {boolean} writable */
  open(text, writable) {
    this.view.setState(cm.EditorState.create({ doc: text, extensions: this.extensions }));
    this.view.dispatch({ effects: this.writable.reconfigure(writable ? [] : [cm.EditorState.readOnly.of(true)]) });
  }

  /** The same document with another text: one step for undo, and only what differs changes. @param {string} text */
  replace(text) {
    const old = this.text;
    if (old === text) return;
    let from = 0, end = 0;
    const most = Math.min(old.length, text.length);
    while (from < most && old[from] === text[from]) from++;
    while (end < most - from && old[old.length - 1 - end] === text[text.length - 1 - end]) end++;
    this.view.dispatch({ changes: { from, to: old.length - end, insert: text.slice(from, text.length - end) }, userEvent: "input.replace" });
  }

  get undoable() { return cm.undoDepth(this.view.state) > 0; }

  get redoable() { return cm.redoDepth(this.view.state) > 0; }

  undo() { cm.undo(this.view); }

  redo() { cm.redo(this.view); }

  /** @param {any[]} problems */
  mark(problems) {
    const doc = this.view.state.doc, found = [];
    for (const p of problems) {
      if (!p.line || p.line > doc.lines) continue;
      const line = doc.line(p.line), from = Math.min(line.to, line.from + p.column - 1);
      found.push({ from, to: Math.min(line.to, from + Math.max(1, p.length)), severity: "error", source: p.code,
        message: [p.message, ...p.notes, p.hint].filter(Boolean).join("\n") });
    }
    this.view.dispatch(cm.setDiagnostics(this.view.state, found));
  }

  /** @param {number} line @param {boolean} [focus] */
  show(line, focus = false) {
    const at = this.view.state.doc.line(Math.max(1, Math.min(line, this.view.state.doc.lines))).from;
    this.view.dispatch({ selection: { anchor: at }, effects: cm.EditorView.scrollIntoView(at, { y: "center" }) });
    if (focus) this.view.focus();
  }
}
