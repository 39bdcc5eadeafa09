"""Build script of docs/components/: a page for each component and function, made from its file alone, and the indexes.

    python docs/component_pages.py [FOLDER]        writes the pages (`make pages`)
    pages()  ->  {"index.md": ..., "pneumatic/receiver.md": ..., "pneumatic/receiver.svg": ..., ...}

Restrictions come first, as they decide whether a component may be used. Equations are TeX between dollar signs, which
mkdocs, GitHub and editors render.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from heavebond.core.presentation import number, unit_label
from heavebond.core.writable import write_text
from heavebond.language.definition import Component, Domain, EquationLine, Parameter, SearchRange, SignalPort, Variable
from heavebond.language.library import bundled, called_functions, example, library
from heavebond.pictures.drawing import symbol_picture
from heavebond.text.expression import Equation, Function, Name
from heavebond.text.tex import equation_tex, formula_tex, symbol_tex, text_tex
from heavebond.text.yaml_source import read_text

NO_EXAMPLE = "There is none yet."
GENERATED = "<!-- Made from the component's file by `make pages`; changes belong there. -->"
PLACES = {"across": "between two nodes of its domain", "at": "on a node", "in series": "between a port and its node",
          "input": "before a signal input", "channel": "in a measured channel",
          "parameter": "as the factor of a parameter of a part"}
MOTION = {"middle": "at the middle of the motion of", "half": "at half the span of", "peak": "at the peak of"}


def pages() -> dict[str, str]:
    """Every page and picture by its path below `docs/components/`."""
    known = library()
    root = bundled("components").resolve()
    found: dict[str, str] = {}
    domains: dict[str, list[Component]] = {}
    for name, path in known.files.items():
        component = known.component(name)
        place = path.resolve().relative_to(root)
        domains.setdefault(place.parts[0], []).append(component)
        found[place.with_suffix(".md").as_posix()] = _page(component, known.domains)
        found[place.with_suffix(".svg").as_posix()] = symbol_picture(component)
    by_domain = {f"{domain}/index.md": _domain_index(domain, components) for domain, components in domains.items()}
    callers: dict[str, list[Component]] = {name: [] for name in known.functions}
    for component in (c for components in domains.values() for c in components):
        for function in called_functions(component):
            callers[function.name].append(component)
    functions = [known.functions[name] for name in sorted(known.functions)]
    found.update({f"functions/{f.name}.md": _function_page(f, callers[f.name], root) for f in functions})
    laws = [c for components in domains.values() for c in components]
    return {"index.md": _index(domains, functions), "generalisations.md": _generalisations(laws, root),
            "functions/index.md": _function_index(functions), **by_domain, **found}


def write_pages(folder: Path) -> int:
    """Write all pages below `folder`, take away those of components that are gone; the number of components."""
    made = pages()
    for old in folder.rglob("*.md"):
        if old.relative_to(folder).as_posix() not in made and read_text(old).startswith(GENERATED):
            old.unlink()
            old.with_suffix(".svg").unlink(missing_ok=True)
    for name, text in made.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    return sum(name.endswith(".svg") for name in made)


def _index(domains: dict[str, list[Component]], functions: Sequence[Function]) -> str:
    rows = [(f"[{domain.replace('_', ' ')}]({domain}/index.md)", str(len(components)),
             ", ".join(f"[{c.name}]({domain}/{c.path.stem}.md)" for c in _sorted(components)))
            for domain, components in domains.items()]
    return "\n".join([GENERATED, "", "# Components", "",
                      "Every component of the library by domain. A component of your own is a file beside your diagram, see",
                      "[your own component](../tutorials/own_component.md).", "",
                      *_table(("domain", "components", "which"), rows), "",
                      "Components that contain a simpler one are [generalisations](generalisations.md) of it.", "",
                      "Laws that several components share are [functions](functions/index.md): "
                      + ", ".join(f"[{f.name}](functions/{f.name}.md)" for f in functions) + "."]) + "\n"


def _generalisations(components: Sequence[Component], root: Path) -> str:
    """The laws that a diagnosis tries in place of a simpler one."""
    pages = {c.name: f"[{c.name}]({c.path.resolve().relative_to(root).with_suffix('.md').as_posix()})" for c in components}
    rows = [(pages[old], pages[c.name], effect.kind, ", ".join(f"`{k}` = {f.text}" for k, f in effect.start.items()),
             ", ".join(f"`{name}`" + (f" {_sought(s)}" if s is not None else "") for name, s in
                       (effect.amplitude or effect.shapes).items()))
            for c in components for effect in c.effects for old in effect.replaces]
    return "\n".join([GENERATED, "", "# Generalisations", "", "[All domains](index.md)", "",
                      "Components that contain a simpler one. A [diagnosis](../diagnosis.md) tries each in place of the "
                      "simpler one, beginning at the values at which the two laws are equal. If the number that makes the "
                      "effect has a range, they are equal in the limit at one of its ends.", "",
                      *_table(("in place of", "component", "class", "equal at", "effect"),
                              sorted(rows, key=lambda row: row[0]))]) + "\n"


def _function_index(functions: Sequence[Function]) -> str:
    rows = [(f"[{f.name}]({f.name}.md)", _prose(f.summary)) for f in functions]
    return "\n".join([GENERATED, "", "# Functions", "", "[All domains](../index.md)", "",
                      "A function is a law that several components share. It is called in equations by its name, see",
                      "[functions](../../language.md#functions).", "", *_table(("function", "what it gives"), rows)]) + "\n"


def _function_page(function: Function, callers: Sequence[Component], root: Path) -> str:
    own = {step.name for step in function.steps} | {*function.inputs, *function.constants}
    steps = [f"{equation_tex(Equation(Name((s.name,), 0, 0), s.expr), own)} && {text_tex(s.label)}" for s in function.steps]
    inputs, outputs = ([(f"`{q.name}`", f"${symbol_tex(q.name)}$", _unit(q.unit.text), _prose(q.description))
                        for q in group.values()] for group in (function.inputs, function.outputs))
    constants = [(f"`{q.name}`", f"${symbol_tex(q.name)}$", _unit(q.unit.text), number(q.value or 0.0), _prose(q.doc))
                 for q in function.constants.values()]
    used = [f"[{c.name}](../{c.path.resolve().relative_to(root).with_suffix('.md').as_posix()})"
            for c in _sorted([*callers])]
    lines = [GENERATED, "", f"# {function.name}", "",
             f"**Restrictions.** {_prose(function.restrictions or 'None are stated.')}", "", _prose(function.summary), "",
             f"A call is written `{function.usage}`."]
    for title, body in (("Inputs", _table(("input", "", "unit", "meaning"), inputs)),
                        ("Outputs", _table(("output", "", "unit", "meaning"), outputs)),
                        ("Constants", _table(("constant", "", "unit", "value", "meaning"), constants)),
                        ("Equations", _aligned(steps)), ("Source", [_prose(function.source)] if function.source else []),
                        ("Used by", [", ".join(used) + "."] if used else [])):
        if body:
            lines += ["", f"## {title}", "", *body]
    return "\n".join(lines) + "\n"


def _domain_index(domain: str, components: list[Component]) -> str:
    rows = [(f"![]({c.path.stem}.svg)", f"[{c.name}]({c.path.stem}.md)", _prose(c.summary)) for c in _sorted(components)]
    return "\n".join([GENERATED, "", f"# {domain.replace('_', ' ').capitalize()}", "", "[All domains](../index.md)", "",
                      *_table(("symbol", "component", "what it is"), rows)]) + "\n"


def _sorted(components: list[Component]) -> list[Component]:
    return sorted(components, key=lambda c: c.name)


def _page(component: Component, domains: dict[str, Domain]) -> str:
    lines = [GENERATED, "", f"# {component.name}", "", f"![{component.name}]({component.path.stem}.svg)", "",
             f"**Restrictions.** {_prose(component.restrictions or 'None are stated.')}", "", _prose(component.summary)]
    for title, body in (("Ports and signs", _ports(component, domains)), ("Parts", _parts(component)),
                        ("Equations", _equations(component)), ("Start", _start(component)),
                        ("States", _states(component)), ("Events", _events(component)),
                        ("Energy", _energy(component)), ("Parameters", _parameters(component)),
                        ("Variables", _variables(component)), ("What the diagnosis seeks", _effects(component)),
                        ("Source", [_prose(component.source)] if component.source else []),
                        ("Example", _example(component))):
        if body:
            lines += ["", f"## {title}", "", *body]
    return "\n".join(lines) + "\n"


# -- sections ----------------------------------------------------------------------------------------------------------
def _ports(component: Component, domains: dict[str, Domain]) -> list[str]:
    rows, powers = [], set()
    for port in component.ports.values():
        domain = domains.get(port.domain)
        count = f", ${formula_tex(port.count)}$ of them" if port.count is not None else ""
        members = _members(port.name, domain) if domain else "effort and flow of the domain it is wired to"
        rows.append((f"`{port.name}`", (port.domain if domain else "any") + count, members, _prose(port.doc)))
        powers.add(_power_of(domain) if domain else "effort times flow")
    rows += [(f"`{s.name}`", f"signal {s.direction}{_size(s)}", _unit(s.unit.text), _prose(s.doc))
             for s in component.signals.values()]
    lines = _table(("port", "kind", "variables", "meaning"), rows)
    if powers:
        lines += ["", f"The power into the component at a port is {' or '.join(sorted(powers))}."]
    return lines


def _size(item: SignalPort | Parameter | Variable) -> str:
    """`, n` of a vector, `, n x m` of a matrix."""
    if item.count is None:
        return ""
    columns = "" if item.columns is None else rf" \times {formula_tex(item.columns)}"
    return f", ${formula_tex(item.count)}{columns}$"


def _members(port: str, domain: Domain) -> str:
    return ", ".join(f"${formula_tex(Name((port, m.name), 0, 0))}$ {m.doc} ({_unit(m.unit.text)})"
                     for m in domain.members.values())


def _power_of(domain: Domain) -> str:
    if domain.power:
        return f"${symbol_tex(domain.power)}$"
    return "$" + " + ".join(rf"{symbol_tex(effort)} \, {symbol_tex(flow)}" for effort, flow in domain.pairs) + "$"


def _parts(component: Component) -> list[str]:
    if not component.composite:
        return []
    rows = [(f"`{i.name}`", i.kind, ", ".join(f"`{k}: {getattr(v, 'text', 'measured')}`" for k, v in i.settings.items()))
            for i in component.body.instances.values()]
    wires = [(f"`{w.name}`", ", ".join(f"`{e.path}`" for e in w.ends)) for w in component.body.wires.values()]
    return [*_table(("part", "component", "set to"), rows), "", *_table(("node", "joins"), wires)]


def _equations(component: Component) -> list[str]:
    rows = [_equation(line, component.variables | component.parameters) for line in component.equations]
    called = ", ".join(f"[{f.name}](../functions/{f.name}.md)" for f in called_functions(component))
    return [*_aligned(rows), *(["", f"Functions: {called}."] if called else [])]


def _equation(line: EquationLine, own: Iterable[str]) -> str:
    condition = ""
    if line.each is not None:
        index, low, high = line.each
        condition = rf"\quad ({index} = {formula_tex(low)}, \ldots, {formula_tex(high)})"
    return f"{equation_tex(line.tree, own)}{condition} && {text_tex(line.label)}"


def _aligned(rows: Sequence[str]) -> list[str]:
    if not rows:
        return []
    return ["$$", r"\begin{aligned}", *(row + r" \\" for row in rows[:-1]), rows[-1], r"\end{aligned}", "$$"]


def _start(component: Component) -> list[str]:
    values = ", ".join(f"`{r.target.text}` starts {'in its steady state' if r.steady else f'at `{r.value.text}`'}"
                       for r in component.initial)
    return [f"Unless the diagram gives an initial value, {values}."] if values else []


def _states(component: Component) -> list[str]:
    return _table(("state", "on entry", "transitions", "meaning"), [
        (f"`{s.name}`", ", ".join(f"`{r.target.text} = {r.value.text}`" for r in s.entry),
         ", ".join(f"to `{t.target}`: `{t.text}`" for t in s.transitions), _prose(s.doc)) for s in component.states])


def _events(component: Component) -> list[str]:
    words = {"condition": "as this becomes true:", "at": "once, at", "every": "again and again, every"}
    return [f"* `{e.name}` happens {words[e.key]} `{e.formula.text}`"
            + (f" from `{e.first.text}` on" if e.first is not None else "")
            + f"; then, by an impulse of `{e.impulse}`, " * bool(e.impulse) + "; then " * (not e.impulse)
            + ", ".join(f"`{r.target.text}` becomes `{r.value.text}`" for r in e.resets)
            + f" if that lets `{e.moves}` change, else " * bool(e.moves)
            + ", ".join(f"`{r.target.text}` becomes `{r.value.text}`" for r in e.otherwise) + "."
            for e in component.when]


def _energy(component: Component) -> list[str]:
    own = component.variables | component.parameters
    rows = [rf"\text{{{word}}}\quad & {formula_tex(f.tree, own)}" for word, f in (
        ("stored energy", component.stores), ("dissipated power", component.dissipates),
        ("power that does not close", component.unbalanced)) if f is not None]
    lines = _aligned(rows)
    if component.unbalanced_why:
        lines += ["", f"It does not close because {component.unbalanced_why}."]
    if component.power:
        said = "A source: its power comes from elsewhere." if component.power == "source" else \
            f"Its power is not closed: {component.power.removeprefix('controlled, ')}."
        lines += ["", said] if lines else [said]
    if component.requires:
        lines += ["", "It must hold that " + " and ".join(f"${formula_tex(f.tree, own)}$" for f in component.requires) + "."]
    return lines


def _parameters(component: Component) -> list[str]:
    rows = [(f"`{p.name}`", f"${symbol_tex(p.name)}$", "whole" if p.integer else _unit(p.unit.text) + _size(p), _default(p),
             _bounds(p.low, p.high), _prose(p.doc)) for p in component.parameters.values()]
    return _table(("parameter", "", "unit", "default", "bounds", "meaning"), rows)


def _default(parameter: Parameter) -> str:
    if parameter.medium:
        own = f"; without one `{parameter.default.text}`" if parameter.default is not None else ""
        return f"`{parameter.medium}` of the circuit's medium{own}"
    if parameter.neutral is not None and parameter.default is None:
        return f"{number(parameter.neutral)} (absent)"
    return f"`{parameter.default.text}`" if parameter.default is not None else "must be given"


def _bounds(low: float | None, high: float | None) -> str:
    parts = [f"≥ {low:.6g}" if low is not None else "", f"≤ {high:.6g}" if high is not None else ""]
    return ", ".join(part for part in parts if part)


def _variables(component: Component) -> list[str]:
    return _table(("variable", "", "unit", "meaning"), [
        (f"`{v.name}`", f"${symbol_tex(v.name)}$", _unit(v.unit.text) + _size(v), _prose(v.doc) + _held(v))
        for v in component.variables.values()])


def _held(variable: Variable) -> str:
    return "" if variable.held is None else f"; changed by events only, {number(variable.held)} at first"


def _effects(component: Component) -> list[str]:
    lines = []
    for effect in component.effects:
        where = "in the place of " + " or ".join(f"a {kind}" for kind in effect.replaces) if effect.replaces else \
            " or ".join(PLACES[word] for word in effect.attaches)
        lines.append(f"* Missing as a whole: **{effect.kind}**, {_prose(effect.description)}. It is tried {where}.")
        sizes = [f"`{name}`" + (f" {_sought(s)}" if s is not None else "") for name, s in effect.amplitude.items()]
        lines += [f"* Its size: {', '.join(sizes)}."] if sizes else []
        equal = [f"`{name}` = {formula.text}" for name, formula in effect.start.items()]
        lines += [f"* Equal to the simpler part at {', '.join(equal)}."] if equal else []
        shapes = [f"`{name}` {_sought(s)}" for name, s in effect.shapes.items()]
        lines += [f"* Sought with it: {', '.join(shapes)}."] if shapes else []
    for p in component.parameters.values():
        if p.kind and p.neutral is not None:
            ranged = f", sought {_sought(p.sought)}" if p.sought is not None else ""
            woken = f"; it wakes with {', '.join(f'`{w}`' for w in p.wakes_with)}" if p.wakes_with else ""
            lines.append(f"* Dormant inside: **{p.kind}**, `{p.name}`, absent at {number(p.neutral)}{ranged}{woken}.")
    return lines


def _sought(sought: SearchRange) -> str:
    if sought.range is not None:
        unit = sought.range.unit
        ends = (unit.from_si(end) for end in (sought.range.low, sought.range.high))
        return f"from {' to '.join(number(end) for end in ends)}" + f" {_unit(unit.text)}".removesuffix(" –")
    return f"held {MOTION[sought.held]} `{sought.seen}`" if sought.held else f"where `{sought.seen}` moves"


def _example(component: Component) -> list[str]:
    path = example(component)
    if path is None:
        return [NO_EXAMPLE]
    return [f"`heavebond run examples/{path.stem}` runs it.", "", f"<!-- bundled: examples/{path.name} -->", "```yaml",
            *read_text(path).rstrip("\n").split("\n"), "```"]


# -- Markdown ----------------------------------------------------------------------------------------------------------
def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table; columns in which nothing stands are left out."""
    kept = [k for k in range(len(head)) if any(row[k] for row in rows)]
    if not kept:
        return []
    return ["| " + " | ".join(cells[k] for k in kept) + " |" for cells in (head, ["---"] * len(head), *rows)]


def _prose(text: str) -> str:
    """Words of a file inside Markdown, where stars and brackets mean something."""
    return re.sub(r"([*|<\[\]])", r"\\\1", text)


def _unit(text: str) -> str:
    """A unit as it is printed; one that is open (`$U`) as it is written, since a dollar sign begins a formula."""
    return f"`{text}`" if "$" in text else unit_label(text)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "components"
    print(f"wrote pages about {write_pages(target)} components to {target}")
