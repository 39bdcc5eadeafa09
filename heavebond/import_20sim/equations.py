"""One submodel made of equations, as a component: statements, states and held variables."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.assignments import (
    EVENTS,
    assigned,
    assigned_again,
    calls,
    derivatives,
    has_event,
    make_placeholder,
    mentioned,
)
from heavebond.import_20sim.branch_values import without_memory
from heavebond.import_20sim.choices import (
    at_event,
    at_start,
    begun,
    between_events,
    former,
    keeps,
    leaves,
    names,
    renamed,
    renamed_former,
    simplified,
    triggers,
)
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.declarations import Symbols
from heavebond.import_20sim.evaluate import spread
from heavebond.import_20sim.event_conditions import moves, passed, with_conditions_before
from heavebond.import_20sim.execution import Env, Execution
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.external import External, Programs
from heavebond.import_20sim.jumps import Kept, keep_values_before_jumps
from heavebond.import_20sim.knots import collected, knot_equations, knot_value, one_junction
from heavebond.import_20sim.matrices import Matrix
from heavebond.import_20sim.memory import Memory
from heavebond.import_20sim.names import camel, identifier
from heavebond.import_20sim.sidops_tree import Assign, Do, Expr, For, If, Statement, Submodel, While
from heavebond.import_20sim.splitting import read_held, share_repeated, split_deep

# functions of the solution of the equations
NO_EFFECT = {"warning", "stopsimulation", "effortincausality", "flowincausality", "seed"}

AT_EVERY_STEP = "'{}' depends on its value at the integration step before, and so on the integration method"


class Builder(Execution):
    """The component of one submodel; `comments` by line, `ends` the connections of a knot's ports (name, direction),
    `known` the values of global quantities, `discrete` True if its statements act at samples, `held` its inputs from
    discrete submodels, `plotted` its plotted quantities, `stated` the values of the experiment by name, `sampled` its
    quantities that change at samples only, in addition to continuous ones."""

    def __init__(self, submodel: Submodel, comments: Mapping[int, str], ends: Iterable[tuple[str, str, str]] = (),
                 known: Mapping[str, float] = MappingProxyType({}), texts: Mapping[str, str] = MappingProxyType({}),
                 folder: Path | None = None, discrete: bool = False, held: Iterable[str] = (),
                 plotted: Collection[str] = (), stated: Callable[[str], float | None] = lambda _: None,
                 sampled: Collection[str] = (), programs: Programs | None = None):
        super().__init__()
        self.discrete, self.held_inputs, self.plotted, self.sampled = discrete, held, plotted, sampled
        self.submodel, self.comments = submodel, comments
        self.component = Component(camel(submodel.type or submodel.name), "")
        self.memory = Memory(self.component)
        self.symbols = Symbols(submodel, self.component, self.memory, ends, known, stated)
        self.source, self.evaluate, self.numbers = self.symbols.source, self.symbols.evaluate, self.symbols.numbers
        self.evaluate.knots = partial(knot_value, self.symbols)
        self.evaluate.final = self._final
        everything = (*submodel.parameters, *self.source.parameters, *self.source.constants)
        declared = {identifier(d.name): d.value.name for d in everything if d.kind == "string" and d.value is not None}
        outside = External(self.component, self.memory, folder, {**declared, **texts}, programs or Programs(),
                           self._results_of)
        self.evaluate.table, self.evaluate.external = outside.table, outside.function
        self.labels: dict[str, str] = {}  # the quantities by the names of their elements
        self.triggers: Env = {}  # variables that are events
        self.start: Env = {}  # assignments of the initial equations
        self.assigned: Env = {}  # assignments of the statements whose results are being written
        self.followed: list[Kept] = []  # branches whose last value is stored
        self.momentary: Env = {}  # assignments, among these, of branches that end themselves

    def build(self) -> Component:
        """The component; it lists constructs that cannot be translated."""
        component = self.component
        component.line = self.submodel.line
        component.untranslated += [*self.submodel.problems, *self.source.problems]
        self.symbols.declare()
        self.labels = {f.text(e): label for label, rows in self.symbols.names.items() for row in rows for e in row}
        # inputs from a discrete submodel keep their values between the samples
        for port in self.held_inputs:
            for label in [name for name, _ in self.symbols.many.get(port, [(identifier(port), True)])]:
                held_names = self.symbols.names.get(label) or self.symbols.names.get(port, [])
                self.symbols.names[label if label in self.symbols.names else port] = [
                    [f.name(self.memory.at_samples(e)) for e in row] for row in held_names]
        try:
            self._equations()
        except Unreadable as problem:
            component.untranslated.append((problem.line, problem.reason))
        except RecursionError:
            component.untranslated.append((self.submodel.line, "an expression is nested too deeply"))
        if component.untranslated:
            sides = (e for s in (*self.source.equations, *self.source.code) if isinstance(s, Assign) and s.left.op == "name"
                     for row in self.symbols.names.get(s.left.name, []) for e in row)
            make_placeholder(component, {e.args[0].name if e.op == "negative" else e.name for e in sides})
        else:
            self.memory.keep_samples({name for name, label in self.labels.items() if label in self.sampled})
            component.junction = one_junction(self.symbols)
            keep_values_before_jumps(component, self.followed)
            read_held(component)
            split_deep(component)
            share_repeated(component)
        return component

    def _results_of(self, call: Expr) -> int:
        """The number of elements that a statement assigns from a call; 1 for a call within an expression."""
        waiting: list[object] = [self.source.equations, self.source.code, self.source.initial]
        while waiting:
            item = waiting.pop()
            if isinstance(item, Assign):
                if item.right == call:
                    return sum(len(row) for row in self.evaluate(item.left))
            elif isinstance(item, (list, tuple)):
                waiting += item
            elif isinstance(item, (If, For, While)):
                waiting += vars(item).values()
        return 1

    # -- statements --------------------------------------------------------------------------------------------------
    def _equations(self) -> None:
        elsewhere = {base for s in (*self.source.equations, *self.source.code) for base in assigned(s)}
        start = self.start = {name: simplified(begun(value)) for name, value in
                              self._in_turn(self.source.initial, {}, elsewhere).items()}
        written: set[str] = set()
        several = assigned_again(self.source.equations) - self._simultaneous()
        for statement in self.source.equations:
            self.symbols.guard(partial(self._trigger, statement), statement.line)
        again: Env = dict(self.triggers)
        for statement in self.source.equations:
            self.evaluate.values = self.triggers
            if several & set(assigned(statement)) or self._anywhere(statement):
                self._run([statement], again)
            else:
                self.symbols.guard(partial(self._top, statement, written, start), statement.line)
        self._results(again, start, written)
        # assignments of the statements of `code`
        env: Env = dict(self.triggers)
        if self.discrete:  # a quantity that is read before its assignment has the value of the last sample
            assigned_names = [base for s in self.source.code for base in assigned(s)]
            elements = [e for base in assigned_names for row in self.symbols.names.get(base, []) for e in row]
            env |= {e.name: Expr("prev", name=e.name) for e in elements if e.name in self.component.items}
        code = self._in_turn(self.source.code, env, set())
        if not self.discrete:
            code = self._without_memory(code, self.source.equations)
        self.evaluate.values = {}
        self._results(code, start, written)
        # the initial values of states for which `int` and `ddt` have none: from the initial equations, or 0
        assigned_labels = {label for s in (*self.source.equations, *self.source.code) for label in assigned(s)}
        for name, first in self.memory.begun.items():
            item = self.component.items.get(name)
            if item is not None and item.kind == "variable" and self.labels.get(name) not in assigned_labels:
                self.component.initial.setdefault(name, first)
        for left, right, _ in list(self.component.equations):
            for name in (e.args[0].name for side in (left, right) for e in derivatives(side) if e.args[0].op == "name"):
                value, own_initial = start.get(name), self.component.initial.get(name)
                if own_initial is None and (value is not None or left == f.call("der", f.name(name))):
                    self.component.initial[name] = f.number(0) if value is None else value
                elif own_initial is not None and value is not None and own_initial != value:
                    self.memory.note(self.submodel.line, f"the initial equation of '{name}' is not used: its integral or "
                                     "derivative states an initial value")
        self._unwritten(start, written)

    def _anywhere(self, statement: Statement) -> bool:
        """True if a statement assigns an element whose index is determined during the run."""
        try:
            return isinstance(statement, Assign) and bool(self.evaluate.places(statement.left, statement.right))
        except Unreadable:
            return False

    def _simultaneous(self) -> set[str]:
        """The quantities on the left side of several simultaneous equations: the numbers of equations and unknowns are
        equal only if each of them counts. 20-sim solves one of them for another quantity."""
        plain = [s for s in self.source.equations if isinstance(s, Assign)]
        left = [s.left.name for s in plain if s.left.op == "name"]
        other_statements = [s for s in (*self.source.equations, *self.source.code)
                            if not (isinstance(s, Assign) and s in plain)]
        elsewhere = {label for s in other_statements for label in assigned(s)}
        again = {label for label in left if left.count(label) > 1} - elsewhere
        if not again:
            return set()

        def size(label: str) -> int:
            return sum(len(row) for row in self.symbols.names.get(label, []))

        used = {n for s in (*self.source.equations, *self.source.code) for n in mentioned(s)}
        unknown = sum(size(label) for label in used if (rows := self.symbols.names.get(label)) and
                      (item := self.component.items.get(rows[0][0].name)) is not None and item.kind in ("variable", "out"))
        equation_count = sum(map(size, left)) + len(plain) - len(left) + sum(map(size, elsewhere - set(left)))
        return again if equation_count == unknown + len(self.component.of_kind("bond")) else set()

    def _in_turn(self, statements: list[Statement], env: Env, elsewhere: set[str]) -> Env:
        """Assignments of statements that are executed in sequence. After its last assignment, a variable represents its
        value in an equation as written, unless it is assigned elsewhere too."""
        final: Env = {}
        later: list[set[str]] = [elsewhere]
        for statement in reversed(statements):
            later.append(later[-1] | set(assigned(statement)))
        for statement, later_statements in zip(statements, reversed(later[:-1]), strict=True):
            self._run([statement], env)
            for base in dict.fromkeys(assigned(statement)):
                if base in later_statements:
                    continue
                for key in (f.text(e) for row in self.symbols.names.get(base, []) for e in row):
                    item, value = self.component.items.get(key), env.get(key)
                    if value is None or item is None or item.kind not in ("variable", "out") or value.op == "number" or \
                            triggers(value):
                        continue
                    final[key] = self.evaluate.defined[key] = value
                    env[key] = f.name(key)
        return {**env, **final}

    def _used(self) -> set[str]:
        return {n for left, right, _ in self.component.equations for n in (*names(left), *names(right))} \
            | {n for event in self.component.events.values() for v in event.then.values() for n in names(v)}

    def _unwritten(self, start: Env, written: set[str]) -> None:
        """Variables that are set once, that another submodel computes, or that are not used."""
        used = self._used() | set(self.component.gives)
        once = {name: value for name, value in start.items() if (item := self.component.items.get(name)) is not None
                and name not in written and item.kind in ("variable", "out")}
        reached = [name for name in once if name in used or self.component.items[name].kind == "out"]
        for name in reached:  # these may depend on others
            reached += [n for n in dict.fromkeys(names(once[name])) if n in once and n not in reached]
        for name in (n for n in once if n in reached):
            *before, beside = self.comment(self.labels.get(name, name)).split("\n")
            self.component.equations.append((f.name(name), once[name],
                                             "\n".join([*before, beside or "set once, at the start"])))
            written.add(name)
        used = self._used()
        for name, item in list(self.component.items.items()):
            if item.kind != "variable" or name in written or name in self.component.initial:
                continue
            if name in self.component.gives:
                item.kind = "in"  # computed by another submodel
                self.component.shared[name] = self.component.gives.pop(name)
            elif name not in used:
                del self.component.items[name]
        # set variables that no equation assigns to 0, as in 20-sim, if there are fewer equations than unknowns
        if self.component.untranslated:
            return
        unknown = self.component.of_kind("variable", "out", "bond")
        assigned = {left.args[0].name if left.op == "call" and left.args else left.name
                    for left, *_ in self.component.equations}
        missing = len(unknown) - len(self.component.equations)
        for unknown_item in [i for i in unknown if i.kind != "bond" and i.name not in assigned][:max(missing, 0)]:
            self.component.equations.append((f.name(unknown_item.name), f.number(0), "no equation assigns it"))
            base = re.sub(r"(_[0-9]+)+$", "", unknown_item.name)
            self.memory.note(self.submodel.line, f"no equation assigns '{base}'; it is 0")

    def _trigger(self, statement: Statement) -> None:
        """`b = event (x)`: a variable that is true at an instant only represents that event in other expressions."""
        if not isinstance(statement, Assign) or not has_event(statement.right) or \
                {n.lower() for n in calls(statement.right)} - EVENTS:
            return
        target = self.evaluate(statement.left)
        if len(target) == len(target[0]) == 1 and target[0][0].op == "name" and "." not in target[0][0].name:
            self.triggers[target[0][0].name] = self.evaluate.scalar(statement.right)

    def _top(self, statement: Statement, written: set[str], start: Env) -> None:
        """A statement of `equations`."""
        if isinstance(statement, Assign):
            self._equation(statement, written)
        elif isinstance(statement, Do):
            self._do(statement)
        else:
            env: Env = dict(self.triggers)
            self._statement(statement, env)
            other_statements = (s for s in (*self.source.equations, *self.source.code) if s is not statement)
            self._results(self._without_memory(env, other_statements), start, written)

    def _without_memory(self, env: Env, other_statements: Iterable[Statement]) -> Env:
        """Remove former values that are not needed; `other_statements` are the statements that read the values unchanged."""
        read = {n for s in other_statements for n in mentioned(s)} | self._used()  # by integrals and events, too
        read |= {n for e in self.component.events.values() for text in e.when.values() for n in re.findall(r"\w+", text)}
        read |= {n for first in (*self.component.initial.values(), *self.component.first.values()) for n in names(first)}
        kinds = {name: item.kind for name, item in self.component.items.items()}
        candidates = [name for name in env if kinds.get(name) == "variable" and name not in self.component.gives and
                      not {name, self.labels.get(name, name)} & {*read, *self.plotted}]
        reduced = without_memory(env, candidates, {n for n, kind in kinds.items() if kind == "parameter"})
        for name in candidates:
            if keeps(env[name], name) and not keeps(reduced[name], name) and reduced[name].op == "if" and \
                    f.number(0) in reduced[name].args[1:]:
                self.said.setdefault(self.labels.get(name, name), []).append("0 where no branch assigns it")
        return reduced

    def _do(self, statement: Do) -> None:
        if statement.error:
            raise Unreadable(statement.line, statement.error)
        function, call = statement.call.name.lower(), statement.call
        if function == "equal" and call.args and call.args[0].op == "call":
            elements = collected(self.symbols, call.args[0])
            for element in elements[1:]:
                self._pairs(elements[0][1], element[1])
        elif function not in NO_EFFECT:
            raise Unreadable(statement.line, f"`{statement.call.name}` is not translated")

    def _pairs(self, left: Matrix, right: Matrix, comment: str = "") -> None:
        a = [e for row in left for e in row]
        for k, (x, y) in enumerate(zip(a, spread(right, len(a), self.submodel.line), strict=True)):
            y = between_events(y)
            sides = (x.args[0], f.negative(y)) if x.op == "negative" else (x, y)
            self.component.equations.append((*sides, "" if k else comment))

    def _equation(self, statement: Assign, written: set[str]) -> None:
        left, right, line = statement.left, statement.right, statement.line
        comment = self.comments.get(line, "")
        if left.op == "name" and left.name in self.triggers:
            written.add(left.name)
            self._constant_trigger(left.name)
            return
        if knots := list(knot_equations(self.symbols, statement)):
            for sides in knots:
                self._pairs(*sides, comment)
            return
        if left.op == "call" and left.name.lower() in ("ddt", "next"):
            self._rate(left, right, comment, written)
            return
        if left.op == "name" and left.name in names(right) and any(
                d.kind == "integer" and d.name == left.name for d in self.source.variables):
            raise Unreadable(line, AT_EVERY_STEP.format(left.name))
        target = self.evaluate(left)
        if right.op == "call" and right.name.lower() == "constraint" and len(right.args) == 1:
            zero = self.evaluate(right.args[0])  # the left side keeps it at 0
            self._pairs(zero, [[f.number(0)]], comment or f"kept at 0 by {f.text(target[0][0])}")
            return
        self.memory.target = f.text(target[0][0]) if left.op in ("name", "index") else ""
        if right.op == "call" and right.name.lower() == "int" and self.memory.target and \
                all(e.op == "name" and "." not in e.name for row in target for e in row):
            self._pairs([[f.call("der", e) for e in row] for row in target], self.evaluate(right.args[0]), comment)
            if len(right.args) > 1:
                self._initial(target, self.evaluate(right.args[1]))
        else:
            self._pairs(target, self.evaluate(right), comment)
        written.update(f.text(e) for row in target for e in row)

    def _constant_trigger(self, name: str) -> None:
        """A variable that is true at instants only is omitted, or 0 if it is an output."""
        item = self.component.items.get(name)
        shared = name in self.component.gives
        if shared:
            why = f"the global event '{name}' is true at instants only; it is 0 elsewhere in the model"
            self.memory.note(self.submodel.line, why)
        if item is not None and (item.kind == "out" or shared):
            self.component.equations.append((f.name(name), f.number(0), "true at its events only"))
        elif item is not None:
            del self.component.items[name]

    def _rate(self, left: Expr, right: Expr, comment: str, written: set[str]) -> None:
        """`ddt (x) = ...`, or `next (x) = ...` for a discrete state."""
        target = self.evaluate(left.args[0])
        first = self.evaluate(left.args[1]) if len(left.args) > 1 else [[f.number(0)]]
        written.update(f.text(e) for row in target for e in row)
        if left.name.lower() == "ddt":
            if len(left.args) > 1:
                self._initial(target, first)
            self._pairs([[f.call("der", e) for e in row] for row in target], self.evaluate(right), comment)
            return
        elements = [e for row in target for e in row]
        values, begins = (spread(m, len(elements), left.line) for m in (self.evaluate(right), first))
        starts = {e.name: begins[k] for k, e in enumerate(elements)}
        for e, value in zip(elements, values, strict=True):
            item = self.component.items.get(e.name)
            if item is None or item.kind != "variable":
                raise Unreadable(left.line, "`next` sets variables only")
            item.kind, item.value = "held", 0.0
            self.component.first[e.name] = starts[e.name]
            self.memory.sampled({e.name: value})

    def _initial(self, target: Matrix, values: Matrix) -> None:
        elements = [e for row in target for e in row]
        for e, value in zip(elements, spread(values, len(elements), self.submodel.line), strict=True):
            self.component.initial[f.text(e)] = value

    def _final(self, expr: Expr) -> Matrix | None:
        """The variables in an expression, with their values after all statements."""
        elements = self.symbols.names.get(expr.name, []) if expr.op == "name" else []
        kinds = {item.kind if (item := self.component.items.get(e.name)) else "" for row in elements for e in row}
        return elements if elements and kinds <= {"variable", "out"} else None

    def _assign(self, statement: Assign, env: Env) -> None:
        if statement.left.op == "call" and statement.left.name.lower() == "next" and \
                any(statement is s for s in self.source.code):
            self._rate(statement.left, statement.right, self.comments.get(statement.line, ""), set())
        else:
            super()._assign(statement, env)

    # -- results -----------------------------------------------------------------------------------------------------
    def _results(self, env: Env, start: Env, written: set[str]) -> None:
        self.momentary = with_conditions_before(env)
        self.assigned = env = {**env, **self.momentary}
        for name, value in env.items():
            if self.triggers.get(name) != value:
                self._code_result(name, value, start, written)

    def _code_result(self, name: str, value: Expr, start: Env, written: set[str]) -> None:
        """The value of a variable after the statements: an equation, or a held variable that events set."""
        if name in written:
            raise Unreadable(self.submodel.line, f"'{name}' is assigned in several places")
        written.add(name)
        if value.size > f.LARGEST:
            raise Unreadable(self.submodel.line, f"'{name}' depends on too many branches one after the other")
        item = self.component.items.get(name)
        if self.discrete and item is not None and item.kind in ("variable", "out"):
            # a value in which former values of variables, its own among them, are the values at the last sample
            before = dict.fromkeys(n for n in former(value) if n in self.component.items)
            if keeps(value, name):
                before[name] = None
            for n in before:
                sampled_value = self.memory.at_samples(f.name(n), start.get(n, f.number(0)))
                value = renamed(value, n, f.name(sampled_value)) if n == name else renamed_former(value, n,
                                                                                                  f.name(sampled_value))
        between = at_event(value, None) if keeps(value, name) else between_events(value)
        comment = self.comment(self.labels.get(name, name))
        if item is None and name in self.targets and not keeps(value, name):
            self.component.equations.append((self.targets[name], between, comment))
            return
        if item is None or item.kind not in ("variable", "out"):
            self.component.untranslated.append((self.submodel.line, f"'{name}' cannot be assigned"))
            return
        if not keeps(value, name):
            if triggers(value) and between == f.number(0) and item.kind == "variable":
                self._constant_trigger(name)
            else:
                self.component.equations.append((f.name(name), between, comment))
            return
        if between.op not in ("if", "prev") and not triggers(value):
            raise Unreadable(self.submodel.line, AT_EVERY_STEP.format(name))
        cases = leaves(between, Expr("prev", name=name))
        if any(moves(self.component, leaf) for _, leaf in cases) and name not in self.momentary:
            if not any(keeps(e, name) for pair in cases for e in pair):
                self._follows(name, item, between, cases, start.get(name, f.number(0)), comment)
                return
            self.component.omitted.append((self.submodel.line,
                                           f"'{name}' depends on the value that it had before; it is set "
                                           "only at the instants at which the conditions of its branches become true"))
        # a variable that keeps its value: held, and set by events
        held = name
        if item.kind == "out":
            held = self.component.fresh(f"{name}_held")
            self.component.equations.append((f.name(name), f.name(held), comment or "kept between events"))
        doc = item.doc or ("" if held != name else "; ".join(filter(None, comment.split("\n"))))
        self.component.items[held] = Item(held, "held", item.unit, doc, 0.0, before=item.before if held == name else "")
        self.component.first[held] = start.get(name, f.number(0))
        value = renamed(value, name, f.name(held))
        begun = simplified(renamed(at_start(value), "time", f.number(0)))
        if begun != f.name(held):
            self.component.on("at_start", {"at": "0"}, {held: begun})
        for trigger in triggers(value):
            for ending, when in self.memory.instants(trigger):
                self.component.on(f"{held}_{ending}", when, {held: at_event(value, trigger)})
        for condition, leaf in leaves(at_event(value, None), f.name(held)):
            when = {"condition": f.text(passed(self.component, self.assigned, condition))}
            self.component.on(f"{held}_event", when, {held: leaf})

    def _follows(self, name: str, item: Item, value: Expr, cases: Iterable[tuple[Expr, Expr]], first: Expr,
                 text: str) -> None:
        """A variable that follows an expression while a branch assigns it, and keeps its last value otherwise."""
        held_value = self.component.hold(f"{name}_kept", item.unit, f"last value of {name}", first)
        self.component.equations.append((f.name(name), renamed(value, name, f.name(held_value)), text))
        for condition, leaf in cases:
            condition = passed(self.component, self.assigned, condition)
            flag = self.component.hold(f"{name}_assigned", "", f"1 while a branch assigns {name}", f.number(0))
            # exit only after entry: at the start a condition may change from equality to either side
            left = Expr("and", (simplified(Expr("not", (condition,))), Expr("==", (f.name(flag), f.number(1)))))
            self.component.on("at_start", {"at": "0"}, {flag: Expr("if", (condition, f.number(1), f.number(0)))})
            self.component.on(f"{name}_begins", {"condition": f.text(condition)}, {flag: f.number(1)})
            ends = self.component.on(f"{name}_ends", {"condition": f.text(left)}, {held_value: leaf, flag: f.number(0)})
            self.followed.append(Kept(held_value, flag, ends, condition, leaf))
