"""Export of a diagram as a flat Modelica model: the equations of its components and nodes before any reduction.

Each unknown is a variable with its unit and its value at the start. Each equation has the text of its component as a
comment. Each event is a `when` clause. The other program selects the states, reduces the index and integrates, so that its
results do not depend on the methods of this package. Modelica Association, Modelica Language Specification 3.6,
https://modelica.org.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, isfinite
from pathlib import Path

import casadi as ca
import numpy as np

from heavebond.core.errors import ModelError, Place, Problem, SimulationError, listing
from heavebond.core.presentation import brief, count
from heavebond.core.units import read_unit
from heavebond.core.version import VERSION
from heavebond.core.writable import write_text
from heavebond.equations.events import FlatEvent
from heavebond.exchange.fmu_export import unit_name
from heavebond.exchange.modelica_text import RELATION, SUM, Term, added, literal, positive, written
from heavebond.exchange.portable import AT_ONCE, Quantity, derived, opened
from heavebond.language.model import Model
from heavebond.language.symbols import split, stack
from heavebond.numerics.co_simulation import foreign_parts
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.impulses import yielding
from heavebond.numerics.inputs import pieced
from heavebond.numerics.output_times import grid
from heavebond.numerics.simulation import run_by_auto, with_equations_at_zero
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.time_search import rounding
from heavebond.numerics.update_order import UpdateOrder, substituted, traced_signals

RESERVED = frozenset(re.findall(
    r"\w+", "algorithm and annotation assert block break class connect connector constant constrainedby der discrete each "
    "else elseif elsewhen encapsulated end enumeration equation expandable extends external false final flow for "
    "function if import impure in initial inner input loop model not operator or outer output package parameter "
    "partial protected public pure record redeclare replaceable return stream then true type when while within "
    "time abs sign sqrt div mod rem ceil floor integer sin cos tan asin acos atan atan2 sinh cosh tanh exp log "
    "log10 min max sum product fill zeros ones size ndims vector matrix transpose cross skew identity diagonal "
    "delay cardinality homotopy semiLinear inStream actualStream spatialDistribution getInstanceName noEvent "
    "smooth sample pre edge change reinit terminal terminate Real Integer Boolean String StateSelect piecewise "
    "piecewise_rate i"))
SPLINE = '''  function piecewise "Value of piecewise cubic polynomials"
    input Real u "time";
    input Real x[:] "beginning of each piece";
    input Real c[size(x, 1), 4] "coefficients of each piece";
    output Real y;
  protected
    Integer low;
    Integer high;
    Integer middle;
    Real s;
  algorithm
    low := 1;
    high := size(x, 1) + 1;
    while high - low > 1 loop
      middle := div(low + high, 2);
      if x[middle] > u then
        high := middle;
      else
        low := middle;
      end if;
    end while;
    s := u - x[low];
    y := c[low, 1] + s*(c[low, 2] + s*(c[low, 3] + s*c[low, 4]));
    annotation(derivative(zeroDerivative = x, zeroDerivative = c) = piecewise_rate);
  end piecewise;
  function piecewise_rate "Rate of change of piecewise cubic polynomials"
    input Real u "time";
    input Real x[:] "beginning of each piece";
    input Real c[size(x, 1), 4] "coefficients of each piece";
    input Real u_rate "rate of u";
    output Real y_rate;
  protected
    Real rates[size(x, 1), 4];
  algorithm
    for k in 1:size(x, 1) loop
      rates[k, 1] := c[k, 2];
      rates[k, 2] := 2*c[k, 3];
      rates[k, 3] := 3*c[k, 4];
      rates[k, 4] := 0;
    end for;
    y_rate := u_rate*piecewise(u, x, rates);
  end piecewise_rate;'''


@dataclass(frozen=True)
class ModelicaExport:
    """An exported Modelica model: the names in the text of the states, algebraic unknowns, parameters, inputs and outputs
    with units and values at the start in SI, `names` of all unknowns of the diagram, and the `text`."""

    name: str
    states: tuple[Quantity, ...]
    algebraic: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]
    tunable: tuple[bool, ...]
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    names: Mapping[str, str]
    text: str

    def __repr__(self) -> str:
        return brief(self, self.name, f"{count(len(self.states), 'state')}, {count(len(self.outputs), 'output')}, "
                     f"{count(len(self.parameters), 'parameter')}")


def export_modelica(model: Model, path: str | Path, inputs: Iterable[str] = ()) -> ModelicaExport:
    """Write a diagram as a Modelica model; ModelError for a part that Modelica cannot express in the same way."""
    exported = modelica(model, inputs, Path(path).stem)
    write_text(Path(path), exported.text)
    return exported


def modelica(model: Model, inputs: Iterable[str] = (), name: str = "") -> ModelicaExport:
    """The Modelica model of a diagram, with the signal inputs `inputs` opened; its name is a valid form of `name`."""
    assembly, _ = with_equations_at_zero(assemble(model), None)
    _check_expressible(assembly)
    begun = _begun(assembly)
    if wanted := list(dict.fromkeys(inputs)):
        assembly = opened(begun.assembly, wanted)[0]
    return _Writer(assembly if wanted else begun.assembly, begun, name or model.name, wanted).export()


@dataclass(frozen=True)
class _Begun:
    """The start of a run, after the events at it: the values of all raw symbols by their hashes, the parameters with the
    held variables (n_p,), and the nodes that the run filled with a small volume."""

    assembly: Assembly
    values: Mapping[int, float]
    p: Array
    filled: tuple[str, ...]


def _begun(assembly: Assembly) -> _Begun:
    """The start of a run of a diagram with its events, and the equations of this run. If the run fails otherwise, small
    volumes are added to nodes without capacity (see `run_by_auto`); the equations then contain them."""
    span, begin = np.array([assembly.begin, assembly.begin + AT_ONCE]), assembly.begin
    try:
        run = run_by_auto(Simulator(assembly, *(() if assembly.model.until else (AT_ONCE,)), solver="auto"))
    except SimulationError:  # it begins, and does not reach its end
        run = Simulator(assembly, times=span).run()
    p = run.p.copy()
    p[[h.index for h in run.assembly.flat.held]] = run.held[:, 0]
    fills = run.statistics.get("fills")
    nodes = fills["nodes"] if isinstance(fills, dict) else []
    return _Begun(run.assembly, run.assembly.point(begin, run.x[:, 0], run.z[:, 0], p, run.u[:, 0]), p, tuple(nodes))


def _check_expressible(assembly: Assembly) -> None:
    """ModelError that names the first part without an equal in Modelica."""
    flat = assembly.flat

    def refuse(message: str, place: Place, hint: str) -> None:
        raise ModelError([Problem("export-modelica", message, place, hint)])

    for path in foreign_parts(flat):
        refuse(f"{path} is an FMU, which a Modelica text cannot contain", flat.expanded.leaves[path].place,
               "Remove the FMU, and make the signals that it drives inputs (`--input`).")
    for clock in assembly.model.clocks.values():
        refuse(f"Modelica's sample() has regular clocks; {clock.text}", clock.place, "Export a variant without `clocks:`.")
    for event in flat.events:
        part = event.name.rpartition(".")[0]
        if event.breakaway is not None or event.yields_to:
            refuse(f"'{part}' decides at an event, by trial, which of several contacts move; a `when` clause cannot",
                   event.place, f"Export it as an FMU, or replace '{part}' by a friction without exact sticking "
                                "(StribeckFriction, LuGreFriction) or an elastic stop.")
    if any(event.impulse for event in flat.events) and (others := yielding(assembly.reduced)):
        refuse(f"an impact may set off {listing(others, 3)} at once, which a `when` clause cannot follow",
               next(e.place for e in flat.events if e.impulse), "Take elastic stops (EndStop), or export it as an FMU.")
    for k, entries in enumerate(flat.entries):
        if not entries:
            equation = flat.equations[k]
            refuse(f"the equation '{equation.text}' of '{equation.owner}' does not determine a variable with these values",
                   equation.place, "Give the parameter that multiplies the variable a value other than 0.")


class _Names:
    """Unique identifiers of Modelica."""

    def __init__(self) -> None:
        self.used = {*RESERVED}

    def __call__(self, name: str) -> str:
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "v"
        plain = f"v_{plain}" if plain[0].isdigit() else plain
        unique, number = plain, 2
        while unique in self.used:
            unique, number = f"{plain}_{number}", number + 1
        self.used.add(unique)
        return unique


def _quoted(text: str) -> str:
    """A string of Modelica."""
    return '"' + " ".join(text.split()).replace("\\", "\\\\").replace('"', '\\"') + '"'


class _Writer:
    def __init__(self, assembly: Assembly, begun: _Begun, name: str, wanted: Sequence[str]):
        self.assembly, self.flat, self.wanted = assembly, assembly.flat, wanted
        self.filled = begun.filled
        before = begun.assembly  # an opened input is a parameter less
        values = dict(zip(before.parameter_names, begun.p.tolist(), strict=True))
        self.p = np.array([values.get(name, value) for name, value in assembly.parameter_values.items()])
        self.point = dict[int, float]()  # the values of the raw symbols
        index = before.flat.names
        for level, known_level in zip(assembly.flat.levels, before.flat.levels, strict=False):
            self.point |= {s.element_hash(): begun.values[h] for u, s in zip(assembly.flat.unknowns, level, strict=True)
                           if u.name in index and (h := known_level[index[u.name]].element_hash()) in begun.values}
        self.fresh = _Names()
        self.class_name = self.fresh(name[:1].upper() + name[1:])
        self.updates = UpdateOrder(assembly.reduced, lambda raw: raw).at(assembly.p)
        self.declarations: list[str] = []
        self.equations: list[str] = []
        self.rates: dict[tuple[int, int], str] = {}  # the variables of derivatives, by unknown and order
        self.terms: dict[int, Term] = {}    # of each symbol, in an equation
        self.before: dict[int, Term] = {}   # the same before an event
        self.unknowns = [self.fresh(u.name) for u in self.flat.unknowns]
        self.held = {h.index: self.fresh(h.name) for h in self.flat.held}

    def export(self) -> ModelicaExport:
        """The model."""
        flat, model = self.flat, self.assembly.model
        events = [(k, e) for k, e in enumerate(flat.events) if (e.resets or e.ends) and not self._passed(e)]
        self._name_rates(events)
        parameters = self._parameters()
        self._name_symbols()
        inputs = self._records()
        for delayed in flat.delays:
            source, length = (t.text for t in written([delayed.source, delayed.delay], self.terms).terms)
            self.terms[delayed.symbols[0].element_hash()] = Term(f"delay({source}, {length})", moves=True)
        lines = self._laws()
        outputs = self._outputs()
        self._events(events)
        states = self._unknowns()
        span = grid(model, None, None) if model.until is not None else None
        experiment = "" if span is None else f"  annotation(experiment(StartTime = {literal(float(span[0]))}, StopTime = " \
            f"{literal(float(span[-1]))}, Tolerance = 1e-9, Interval = {literal(float(span[1] - span[0]))}));"
        head = [f"model {self.class_name} {_quoted(model.summary or model.name)}",
                f"  // written by heavebond {VERSION}; all values are in SI"]
        if self.filled:
            head.append(f"  // as in a run, a small volume is added at the nodes {', '.join(self.filled)}, which have no "
                        "capacity")
        text = "\n".join([*head, *([SPLINE] if flat.inputs and len(inputs) < len(flat.inputs) else []), *self.declarations,
                          "equation", *lines, *self.equations, *([experiment] if experiment else []),
                          f"end {self.class_name};", ""])
        names = {u.name: name for u, name in zip(flat.unknowns, self.unknowns, strict=True)}
        names |= {h.name: self.held[h.index] for h in flat.held}
        names |= {self.assembly.reduced.name((j, k)): name for (j, k), name in self.rates.items()}
        algebraic = [q for q in self._quantities() if q.name not in {s.name for s in states}]
        return ModelicaExport(self.class_name, tuple(states), tuple(algebraic), tuple(parameters),
                              (True,) * len(parameters), tuple(inputs), tuple(outputs), names, text)

    # -- names ---------------------------------------------------------------------------------------------------------
    def _name_rates(self, events: Sequence[tuple[int, FlatEvent]]) -> None:
        """A variable for each derivative that is a state, that an event reads, or of which there is a higher one."""
        column = {s.element_hash(): (j, k) for k, level in enumerate(self.flat.levels) for j, s in enumerate(level)}
        needed = {c for c in self.assembly.reduced.states if c[1]}
        read = [self.flat.residual_column, stack(e.indicator for _, e in events if e.indicator is not None),
                self.updates.direct, *(self.assembly.resolver().evaluate(o.expr) for o in self.assembly.model.show.values())]
        symbols = [column[h] for part in read for s in ca.symvar(part) if (h := s.element_hash()) in column]
        needed |= {(j, k) for j, top in symbols for k in range(1, top)}
        needed |= {column[h] for part in read[1:] for s in ca.symvar(part) if (h := s.element_hash()) in column
                   and column[h][1]}
        for j, order in sorted({(j, low) for j, top in needed for low in range(1, top + 1)}):
            self.rates[j, order] = self.fresh(f"der{order if order > 1 else ''}_{self.unknowns[j]}")

    def _name_symbols(self) -> None:
        flat = self.flat
        for j, name in enumerate(self.unknowns):
            names = [name, *(self.rates.get((j, k), "") for k in range(1, len(flat.levels)))]
            for k, level in enumerate(flat.levels):
                h = level[j].element_hash()
                self.terms[h] = Term(names[k] or f"der({names[k - 1]})" if k else name, moves=True)
                self.before[h] = Term(f"pre({names[k]})", moves=False)
        self.terms[flat.time.element_hash()] = self.before[flat.time.element_hash()] = Term("time")
        self.terms[flat.rate.element_hash()] = self.before[flat.rate.element_hash()] = Term("1")
        symbols, after = split(flat.p), split(self.updates.after)
        for index, name in self.held.items():
            self.terms[symbols[index].element_hash()] = Term(name)
            self.before[symbols[index].element_hash()] = Term(f"pre({name})")
            self.before[after[index].element_hash()] = Term(name)

    def _parameters(self) -> list[Quantity]:
        """Declare the parameters that occur; the elements of a list as an array."""
        flat, symbols = self.flat, split(self.flat.p)
        event_expressions = [e for event in flat.events for e in (event.indicator, event.first, event.period)
                             if e is not None]
        output_expressions = [self.assembly.resolver().evaluate(o.expr) for o in self.assembly.model.show.values()]
        delays = [e for d in flat.delays for e in (d.source, d.delay)]
        used = {s.element_hash() for s in ca.symvar(stack([flat.residual_column, self.updates.direct, *event_expressions,
                                                           *delays, *output_expressions]))}
        groups: dict[str, list[int]] = {}
        for k, q in enumerate(flat.parameters):
            if k not in self.held and symbols[k].element_hash() in used:
                whole = q.name.replace("][", ",")
                groups.setdefault(re.sub(r"\[\d+\]$", "", whole), []).append(k)
        declared: list[Quantity] = []
        for base, members in groups.items():
            numbers = [re.search(r"\[(\d+)\]$", flat.parameters[k].name) for k in members]
            listed = [int(n[1]) for n in numbers if n] == list(range(1, len(members) + 1)) and len(members) > 1
            for chunk in [members] if listed else [[k] for k in members]:
                first = flat.parameters[chunk[0]]
                name = self.fresh(base if listed else first.name)
                values = [literal(float(self.p[k])) for k in chunk]
                path, _, short = first.name.partition("[")[0].rpartition(".")
                leaf = flat.expanded.leaves.get(path)
                known = leaf.component.parameters.get(short) if leaf else None
                bounds = [] if known is None else [f"{key} = {literal(value)}" for key, value in (
                    ("min", known.low), ("max", known.high)) if value is not None and isfinite(value)]
                each = "each " if listed else ""
                attributes = ", ".join(each + part for part in (f'unit = "{unit_name(first.unit)}"', *bounds))
                doc = f"{first.name.partition('[')[0]}{': ' if known and known.doc else ''}{known.doc if known else ''}"
                self.declarations.append(
                    f"  parameter Real {name}{f'[{len(chunk)}]' if listed else ''}({attributes}) = "
                    f"{'{' + ', '.join(values) + '}' if listed else values[0]} {_quoted(doc)};")
                for position, k in enumerate(chunk, 1):
                    text = f"{name}[{position}]" if listed else name
                    self.terms[symbols[k].element_hash()] = self.before[symbols[k].element_hash()] = Term(text)
                    declared.append(Quantity(text, first.unit, float(self.p[k]), doc))
        return declared

    def _records(self) -> list[Quantity]:
        """Inputs, and the records of measured signals as arrays of cubic pieces."""
        flat, inputs = self.flat, list[Quantity]()
        records = [k for k, known in enumerate(flat.inputs) if known.name not in self.wanted]
        if records:
            whole = pieced(replace(flat, inputs=tuple(flat.inputs[k] for k in records)),
                           *(float(t) for t in grid(self.assembly.model, None, None)[[0, -1]]))
            begins = self.fresh("record_time")
            rows = ", ".join(literal(float(t)) for t in whole.columns[0])
            self.declarations.append(f'  constant Real {begins}[{whole.columns.shape[1]}](each unit = "s") = {{{rows}}} '
                                     '"beginning of each piece of the records";')
        for number, known in enumerate(flat.inputs):
            symbol = known.symbols[0].element_hash()
            if number not in records:
                name = self.fresh(f"input_{known.name}")
                start = self.point[flat.levels[0][flat.names[known.name]].element_hash()]
                self.declarations.append(f"  input Real {name}(unit = \"{unit_name(known.unit)}\", "
                                         f"start = {literal(start)}) {_quoted(known.name)};")
                inputs.append(Quantity(name, known.unit, start))
                self.terms[symbol] = Term(name, moves=True)
                continue
            name, k = self.fresh(f"record_{known.name}"), records.index(number)
            table = whole.columns[1 + 4 * k:5 + 4 * k].T
            cells = ", ".join("{" + ", ".join(literal(float(v)) for v in row) + "}" for row in table)
            self.declarations.append(f"  constant Real {name}[{len(table)}, 4] = {{{cells}}} "
                                     f"{_quoted(known.source.column)};")
            self.terms[symbol] = Term(f"piecewise(time, {begins}, {name})")
        return inputs

    # -- equations -----------------------------------------------------------------------------------------------------
    def _laws(self) -> list[str]:
        """The equations of components and nodes, with their texts."""
        flat = self.flat
        laws = written(flat.residuals, self.terms, self.fresh)
        lines = []
        for name, term in laws.common:
            self.declarations.append(f"  Real {name};")
            lines.append(f"  {name} = {term.text};")
        for (j, k), name in self.rates.items():
            lower = self.rates.get((j, k - 1), self.unknowns[j])
            lines.append(f"  {name} = der({lower});")
        for equation, term in zip(flat.equations, laws.terms, strict=True):
            lines.append(f"  {_balanced(term)} {_quoted(f'{equation.owner}: {equation.text}')};")
        return lines

    def _outputs(self) -> list[Quantity]:
        """A variable for each output under `show:`, in SI with its unit for display."""
        show, outputs = self.assembly.model.show, list[Quantity]()
        if not show:
            return outputs
        resolver = self.assembly.resolver()
        terms = written([resolver.evaluate(o.expr) for o in show.values()], self.terms).terms
        for (label, output), term in zip(show.items(), terms, strict=True):
            name, unit, base = self.fresh(f"show_{label}"), read_unit(output.unit), resolver.unit(output.expr)
            display_unit = f'displayUnit = "{unit_name(unit)}"'
            attributes = display_unit if base is None else f'unit = "{unit_name(base)}", {display_unit}'
            self.declarations.append(f"  Real {name}({attributes}) {_quoted(f'{label}: {output.text}')};")
            self.equations.append(f"  {name} = {term.text};")
            outputs.append(Quantity(name, unit, unit.from_si(self._at_start(resolver.evaluate(output.expr))), output.text))
        return outputs

    def _at_start(self, expression: ca.SX) -> float:
        """The value of a raw expression at the start; not a number if it has a derivative that no equation has."""
        symbols = ca.symvar(expression)
        known = {**self.point, self.flat.time.element_hash(): self.assembly.begin, self.flat.rate.element_hash(): 1.0,
                 **{s.element_hash(): float(v) for s, v in zip(split(self.flat.p), self.p, strict=True)}}
        values = [known.get(s.element_hash(), np.nan) for s in symbols]
        return float(ca.Function("value", [stack(symbols)], [expression])(values))

    def _quantities(self) -> list[Quantity]:
        quantities = []
        for j, (name, unknown) in enumerate(zip(self.unknowns, self.flat.unknowns, strict=True)):
            start = self.point.get(self.flat.levels[0][j].element_hash(), 0.0)
            quantities.append(Quantity(name, unknown.unit, start, unknown.doc, unknown.low, unknown.high, unknown.nominal))
        for (j, k), name in self.rates.items():
            start = self.point.get(self.flat.levels[k][j].element_hash(), 0.0)
            quantities.append(Quantity(name, derived(self.flat.unknowns[j].unit, k), start))
        return quantities

    def _unknowns(self) -> list[Quantity]:
        """Declare the unknowns; the start values of the states are fixed."""
        fixed = {self.rates[j, k] if k else self.unknowns[j] for j, k in self.assembly.reduced.states}
        states, texts = [], {name: u.name for name, u in zip(self.unknowns, self.flat.unknowns, strict=True)}
        lines = []
        for q in self._quantities():
            state = ", fixed = true, stateSelect = StateSelect.prefer" if q.name in fixed else ""
            nominal = f", nominal = {literal(q.nominal)}" if q.nominal not in (0.0, 1.0) else ""
            doc = ": ".join(part for part in (texts.get(q.name, ""), q.doc) if part)
            lines.append(f"  Real {q.name}(unit = \"{unit_name(q.unit)}\", start = {literal(q.start)}{nominal}{state})"
                         f"{' ' + _quoted(doc) if doc else ''};")
            states += [q] if state else []
        for h in self.flat.held:
            lines.append(f"  discrete Real {self.held[h.index]}(unit = \"{unit_name(h.unit)}\", start = "
                         f"{literal(float(self.p[h.index]))}, fixed = true) {_quoted(f'{h.name}: {h.doc}'.rstrip(': '))};")
        self.declarations += lines
        return states

    # -- events --------------------------------------------------------------------------------------------------------
    def _events(self, events: Sequence[tuple[int, FlatEvent]]) -> None:
        """The `when` clauses: one for each event, or one for each variable that several events set."""
        first_row = np.cumsum([0, *(len(e.resets) for e in self.flat.events)]).tolist()
        direct = split(self.updates.direct)
        signals = traced_signals(self.assembly.reduced)[1]
        for event, begin, end in zip(self.flat.events, first_row, first_row[1:], strict=False):
            if event.indicator is not None and event.resets:  # a signal follows at once what an event before has set
                direct[begin:end] = split(substituted(stack(direct[begin:end]), signals))
        values = written(direct, self.before).terms
        group = {k: k for k, _ in events}

        def root(k: int) -> int:
            while group[k] != k:
                k = group[k]
            return k

        setter: dict[str, int] = {}
        for k, event in events:
            for reset in event.resets:
                group[root(k)] = root(setter.setdefault(reset.name, k))
        members: dict[int, list[int]] = {}
        for k, _ in events:
            members.setdefault(root(k), []).append(k)
        conditions = {k: self._condition(event) for k, event in events}
        for together in members.values():
            assigned: dict[str, list[tuple[int, int]]] = {}
            for k in together:
                for n, reset in enumerate(self.flat.events[k].resets):
                    assigned.setdefault(reset.name, []).append((k, first_row[k] + n))
            notes = {k: f"{self.flat.events[k].name}: {self.flat.events[k].text}" for k in together}
            if len(together) == 1:
                k = together[0]
                body = [self._assignment(name, values[rows[0][1]].text) for name, rows in assigned.items()]
                body += [f"terminate({_quoted(self.flat.events[k].text)})"] if self.flat.events[k].ends else []
                self.equations += [f"  when {conditions[k]} then", *(f"    {line};" for line in body),
                                   f"  end when {_quoted(notes[k])};"]
                continue
            flags = {k: self.fresh(f"{self.flat.events[k].name}_event") for k in together}
            for k, flag in flags.items():
                self.declarations.append(f"  Boolean {flag} {_quoted(self.flat.events[k].text)};")
                self.equations.append(f"  {flag} = {conditions[k]};")
            for name, rows in assigned.items():  # the last of several that happen at once counts
                happening = ", ".join(flags[k] for k, _ in rows)
                value = values[rows[0][1]].within(SUM)
                for k, row in rows[1:]:
                    value = f"if edge({flags[k]}) then {values[row].within(RELATION)} else {value}"
                self.equations += [f"  when {'{' + happening + '}' if len(rows) > 1 else happening} then",
                                   f"    {self._assignment(name, value)};",
                                   f"  end when {_quoted('; '.join(notes[k] for k, _ in rows))};"]

    def _instants(self, event: FlatEvent) -> tuple[float, float]:
        """The first instant and the period of an event of time; a period of 0 for one that happens once."""
        period = ca.SX(0) if event.period is None else event.period
        first, length = ca.Function("instants", [self.flat.p], [event.first, period])(self.p)
        return float(first), float(length)

    def _passed(self, event: FlatEvent) -> bool:
        """Whether an event happens once, at the start or before it, so that the start values are those after it."""
        first = self._instants(event)[0]
        return event.indicator is None and event.period is None and \
            first <= self.assembly.begin + float(rounding(np.array([self.assembly.begin]))[0])

    def _assignment(self, name: str, value: str) -> str:
        held = next((self.held[h.index] for h in self.flat.held if h.name == name), None)
        if held is not None:
            return f"{held} = {value}"
        return f"reinit({self.unknowns[self.flat.names[name]]}, {value})"

    def _condition(self, event: FlatEvent) -> str:
        """The condition of a `when` clause."""
        if event.indicator is not None:
            names = {**self.terms, **{s.element_hash(): self.before[s.element_hash()]
                                      for k, s in enumerate(split(self.flat.p)) if k in self.held}}
            still = {h: replace(term, moves=False) for h, term in names.items()}  # events stop the integrator
            return positive(written([event.indicator], still).terms[0])
        instant, step = written([event.first, ca.SX(0) if event.period is None else event.period], self.terms).terms
        if event.period is None:
            return f"time >= {instant.within(SUM)}"
        (first, length), begin = self._instants(event), self.assembly.begin
        passed = 0 if first > begin + float(rounding(np.array([begin]))[0]) else floor((begin - first) / length + 1e-9) + 1
        later = "" if not passed else f" + {'' if passed == 1 else f'{passed}*'}{step.within(SUM + 1)}"
        return f"sample({(instant.text + later).removeprefix('0 + ')}, {step.text})"


def _balanced(term: Term) -> str:
    """An equation `residual = 0` with the negative terms on the other side."""
    terms = term.terms or ((1, term.text),)
    left, right = ([text for sign, text in terms if sign == side] for side in (1, -1))
    if not left or (len(right) == 1 and len(left) > 1 and re.fullmatch(r"[\w.]+|der\(\w+\)", right[0])):
        left, right = right, left
    sides = [added(tuple((1, text) for text in side)) if side else "0" for side in (left, right)]
    return " = ".join(sides)

