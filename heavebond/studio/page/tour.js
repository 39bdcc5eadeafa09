// A tour of three minutes on the bundled compensator: each step marks one element, says what it does, and does it on request.

import { byId, el } from "./dom.js";

export const MACHINE = "bundled:cmc_ahc", RECORDS = "bundled:passive_rig/friction";
const GAP = 10; // px between an element and the words about it

/** @typedef {{title: string, words: string, at: () => Element|null, before?: () => any}} Step */

export class Tour {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    this.at = -1;
    this.turn = 0;
    /** @type {Element|null} */ this.marked = null;
    this.box = byId("tour");
    this.box.addEventListener("keydown", (event) => {
      if (event.key === "ArrowRight") void this.go(this.at + 1);
      else if (event.key === "ArrowLeft") void this.go(this.at - 1);
      else return;
      event.preventDefault();
    });
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.at >= 0 && !document.querySelector("dialog[open]")) { event.preventDefault(); event.stopImmediatePropagation(); this.end(); }
    }, { capture: true });
    addEventListener("resize", () => this.place());
    byId("home").addEventListener("scroll", () => this.place());
  }

  /** @returns {Step[]} */
  get steps() {
    const { studio } = this, find = (/** @type {string} */ selector) => () => document.querySelector(selector);
    const ready = async () => {
      if (studio.document?.name !== MACHINE) await studio.open(MACHINE);
      if (studio.runs.live || studio.runs.busy) return;
      await studio.runs.run();
    };
    return [
      { title: "The drawing", words: "This is a heave compensator: it holds a drill string still while the vessel moves in the waves. The drawing shows its parts and wires, the text on the left describes the same machine. A change of one changes the other.",
        at: find("#diagram"), before: async () => { if (studio.document?.name !== MACHINE) await studio.open(MACHINE); studio.pick("", ""); } },
      { title: "Run", words: "Run (Ctrl+Enter) simulates the machine. Next presses it for you.", at: find("#run") },
      { title: "The charts", words: "The outputs of the run are plotted, one chart for each unit. Drag across a chart to zoom in; a double click shows the whole run.", at: find("#plots"), before: ready },
      { title: "The panel", words: "Click a part to show its parameters and signals. This is the controller. Tick a signal to plot it.", at: find("#selected"),
        before: async () => { await ready(); studio.pick("part", "controller"); } },
      { title: "A slider", words: "Move a slider: the machine is simulated while it moves. 'Keep this run', above the charts, keeps the present run for comparison with the next one.", at: find("[data-parameter='controller.K_p']"),
        before: async () => { await ready(); studio.pick("part", "controller"); } },
      { title: "A block", words: "A block contains further parts. A double click (or O) opens it on the drawing: this is the inside of the active compensator.", at: find("#diagram"),
        before: async () => { await ready(); if (!studio.view.opened.includes("ahc")) await studio.openBlock("ahc"); else studio.pick("part", "ahc"); } },
      { title: "The play of the run", words: "▶ plays the run on the drawing: colours and widths of the wires show velocity and flow. Animation shows the machine in motion.", at: find("#player"), before: ready },
      { title: "Records and diagnosis", words: "An experiment compares a diagram with measured records. This one is of a rig with a part that the diagram lacks: Residual shows the difference, Locate finds its place, and Diagnose proposes the missing law.", at: find("#evidence-bar"),
        before: async () => { if (studio.document?.name !== RECORDS) await studio.open(RECORDS); await studio.evidence.compared; } },
      { title: "The end", words: "Copy… writes a machine with all its files into your folder, where you can change it. The key ? lists all keys.", at: find("#copy"), before: async () => { if (studio.document?.name !== MACHINE) await studio.open(MACHINE); } },
    ];
  }

  /** From its first step. */
  async begin() { await this.go(0); }

  /** @param {number} k */
  async go(k) {
    const { steps } = this, turn = ++this.turn;
    if (k < 0) return;
    if (k >= steps.length) { this.end(); return; }
    this.at = k;
    const step = steps[k];
    this.box.hidden = false;
    this.box.setAttribute("aria-busy", "true");
    for (const button of this.box.querySelectorAll("button")) /** @type {HTMLButtonElement} */ (button).disabled = button.id !== "tour-end";
    try { await step.before?.(); }
    catch (error) { if (turn === this.turn) { this.end(); this.studio.banner([error instanceof Error ? error.message : String(error)]); } return; }
    if (turn !== this.turn || this.at < 0) return; // ended, or gone on meanwhile
    const last = k === steps.length - 1;
    this.box.removeAttribute("aria-busy");
    this.box.replaceChildren(el("h2", { id: "tour-title" }, step.title), el("p", { id: "tour-words" }, step.words),
      el("menu", {}, el("span", { class: "count" }, `${k + 1} of ${steps.length}`), el("button", { id: "tour-end", onclick: () => this.end() }, last ? "Close" : "End the tour (Esc)"),
        k > 0 && el("button", { id: "tour-back", onclick: () => void this.go(k - 1) }, "Back"), !last && el("button", { id: "tour-next", class: "main", onclick: () => void this.go(k + 1) }, "Next")));
    this.marked?.classList.remove("toured");
    this.marked = step.at();
    this.marked?.classList.add("toured");
    this.marked?.scrollIntoView({ block: "nearest" });
    this.place();
    document.getElementById(last ? "tour-end" : "tour-next")?.focus();
  }

  /** The words beside the element, within the page. */
  place() {
    if (this.at < 0) return;
    const about = this.marked?.getBoundingClientRect() ?? new DOMRect(innerWidth / 2, innerHeight / 3, 0, 0), { offsetWidth: wide, offsetHeight: high } = this.box;
    const inside = about.width > innerWidth / 3 && about.height > high + 3 * GAP; // a wide pane: to the left of it, or in its lower corner
    const y = inside ? about.bottom - high - GAP : about.bottom + GAP + high < innerHeight ? about.bottom + GAP : about.top - high - GAP;
    const x = inside ? about.left > wide ? about.left - wide : about.left + GAP : about.right - wide;
    this.box.style.left = `${Math.max(GAP, Math.min(innerWidth - wide - GAP, x))}px`;
    this.box.style.top = `${Math.max(GAP, Math.min(innerHeight - high - GAP, y))}px`;
  }

  /** At any time. */
  end() {
    this.turn++;
    this.at = -1;
    this.box.hidden = true;
    this.marked?.classList.remove("toured");
    this.marked = null;
    (this.studio.document ? byId("sheet") : byId("begin-tour")).focus();
  }
}
