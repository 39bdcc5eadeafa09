// Completion in the text: keys, components, parameters with their units, ports, and names for formulas.

const SECTIONS = ["model", "summary", "extends", "parameters", "components", "nodes", "set", "remove", "initial", "show", "simulate", "view", "source", "notes"];
const COMPONENT = ["component", "summary", "restrictions", "source", "ports", "parameters", "variables", "equations", "components", "nodes", "stores", "dissipates", "requires", "symbol"];
const SIMULATE = ["until", "every", "solver"];

export class Completion {
  /** @param {any} studio */
  constructor(studio) { this.studio = studio; }

  /** @param {any} context of CodeMirror */
  async propose(context) {
    const line = context.state.doc.lineAt(context.pos), before = line.text.slice(0, context.pos - line.from);
    const word = /[\w.]*$/.exec(before)?.[0] ?? "";
    if (!word && !context.explicit && !/(is: ?|[{,[]\s*|=\s*)$/.test(before)) return null;
    const options = await this.options(context.state.doc, line.number, before);
    return options.length ? { from: context.pos - word.length, options, validFor: /^[\w.]*$/ } : null;
  }

  /** @param {any} doc @param {number} number @param {string} before the text of the line up to the cursor */
  async options(doc, number, before) {
    if (/^\w*$/.test(before)) return (this.studio.view?.component ? COMPONENT : SECTIONS).map((label) => ({ label, type: "keyword", apply: `${label}: ` }));
    const section = this.section(doc, number);
    if (section === "components") {
      const { palette } = this.studio;
      if (!palette.components) await palette.load();
      if (!palette.components) return []; // the library is still being loaded, for another request
      if (/\bis:\s*\w*$/.test(before)) return [...palette.components.values()].map((c) => ({ label: c.name, type: "class", info: c.summary }));
      const kind = palette.components.get(/\bis:\s*(\w+)/.exec(doc.line(number).text)?.[1] ?? "");
      if (kind && /[{,]\s*\w*$/.test(before)) return [...this.parameters(kind, doc.line(number).text), { label: "at", type: "property", apply: "at: [", detail: "place in the drawing" }];
      if (/\{\s*\w*$/.test(before)) return [{ label: "is", type: "property", apply: "is: " }];
      return /=[^,}]*$/.test(before) ? this.names() : [];
    }
    if (section === "nodes") return this.ports(doc);
    if (section === "simulate") return /[{,]\s*\w*$|^\s+\w*$/.test(before) ? SIMULATE.map((label) => ({ label, type: "property", apply: `${label}: ` })) : [];
    if (section === "set") return Object.values(this.studio.view?.parts ?? {}).flatMap((p) => p.parameters).map((p) => ({ label: p.path, type: "property", apply: `${p.path}: `, detail: p.unit, info: p.doc }));
    return ["initial", "show", "parameters", "view"].includes(section) ? this.names() : [];
  }

  /** The section in which a line stands. @param {any} doc @param {number} number */
  section(doc, number) {
    for (let k = number; k > 0; k--) {
      const found = /^(\w+)\s*:/.exec(doc.line(k).text);
      if (found) return found[1];
    }
    return "";
  }

  /** Parameters and inputs that a part does not have yet. @param {any} kind @param {string} line */
  parameters(kind, line) {
    const given = new Set([...line.matchAll(/(\w+)\s*:/g)].map((m) => m[1]));
    return [...Object.entries(kind.parameters), ...kind.inputs.map((/** @type {string} */ name) => [name, ""])].filter(([name]) => !given.has(name))
      .map(([name, unit]) => ({ label: name, type: "property", apply: `${name}: `, detail: unit }));
  }

  /** Ports, those that are not connected first. @param {any} doc */
  ports(doc) {
    const text = doc.toString();
    return Object.entries(this.studio.view?.parts ?? {}).flatMap(([, part]) => part.ports ?? []).filter((port) => text.includes(`${port.path.split(".")[0]}:`))
      .map((port) => ({ label: port.path, type: "variable", detail: port.domain, info: port.node ? `on node ${port.node}` : "not connected", boost: port.node ? -1 : 1 }));
  }

  /** Variables and parameters for formulas. */
  names() {
    const { view } = this.studio;
    if (!view?.parts) return [];
    const owners = [...Object.values(view.parts), ...Object.values(view.nodes)];
    return [...view.parameters.map((/** @type {any} */ p) => ({ label: p.path, type: "constant", detail: p.unit, info: p.doc })),
      ...owners.flatMap((o) => [...(o.parameters ?? []).map((/** @type {any} */ p) => ({ label: p.path, type: "constant", detail: p.unit, info: p.doc })),
        ...o.signals.map((/** @type {any} */ s) => ({ label: s.name, type: "variable", detail: s.unit, info: s.doc }))])];
  }
}
