"""One submodel made of equations, as a component: symbols, statements, states and events."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.evaluate import MEMBERS, MOST_ELEMENTS, Evaluator, Matrix, fold
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.names import camel, identifier
from heavebond.import_20sim.sidops_tree import Assign, Declared, Do, Equations, Expr, For, If, Port, Statement, Submodel
from heavebond.import_20sim.units import unit_text

Env = dict[str, Expr]
ACROSS_IS_FLOW = {"translation", "rotation", "mechanical"}
MOST_TURNS = 500


class Builder:
    """The component of one submodel; `comments` by line, `ends` the connections of a knot's ports (name, direction)."""

    def __init__(self, submodel: Submodel, comments: Mapping[int, str], ends: Iterable[tuple[str, str, str]] = (),
                 known: Mapping[str, float] | None = None):
        self.submodel, self.comments = submodel, comments
        self.source = submodel.equations or Equations()
        self.made = Component(camel(submodel.type or submodel.name), "")
        self.names: dict[str, Matrix] = {}
        self.many: dict[str, list[tuple[str, bool]]] = {}  # of a knot's port: elements and whether they point out
        self.numbers: dict[str, float] = dict(known or {})
        self.evaluate = Evaluator(self.names, self.numbers, self)
        self.target = ""
        self.ends = list(ends)
        self.targets: dict[str, Expr] = {}  # what a statement assigns, by its text

    def build(self) -> Component:
        """The component; what cannot be translated is listed in it."""
        made = self.made
        made.untranslated += [*self.submodel.problems, *self.source.problems]
        self._declare()
        try:
            self._equations()
        except Unreadable as problem:
            made.untranslated.append((problem.line, problem.reason))
        except RecursionError:
            made.untranslated.append((self.submodel.line, "an expression is nested too deeply"))
        if made.untranslated:
            self._placeholder()
        return made

    def _placeholder(self) -> None:
        """A component with constant outputs and free ports in place of equations that are not translated."""
        made = self.made
        made.equations, made.events, made.initial, made.gives = [], {}, {}, {}
        made.items = {n: item for n, item in made.items.items() if item.kind not in ("variable", "held")}
        for item in list(made.items.values()):
            if item.kind == "out":
                value, doc = self._fresh(f"{item.name}_value"), f"value of the output {item.name}, which is not computed"
                made.items[value] = Item(value, "parameter", "", doc, 0.0)
                made.equations.append((f.name(item.name), f.name(value), "not translated"))
            elif item.kind == "bond":
                made.equations.append((f.name(f"{item.name}.f"), f.number(0), "not translated"))

    # -- symbols -----------------------------------------------------------------------------------------------------
    def _declare(self) -> None:
        for constant in self.source.constants:
            self._guard(partial(self._constant, constant), constant.line)
        everything = [*self.submodel.parameters, *self.source.parameters]
        for parameter in everything:  # sizes may need whole parameters
            if parameter.kind == "integer" and parameter.value is not None and not parameter.size:
                value = fold(parameter.value, self.numbers)
                if value is not None:
                    self.numbers[parameter.name] = value
        for port in self.submodel.ports:
            self._guard(partial(self._port, port), port.line)
        for parameter in everything:
            self._guard(partial(self._parameter, parameter), parameter.line)
        for parameter in everything:
            self.numbers.pop(parameter.name, None) if not parameter.size else None
        for variable in [*self.submodel.variables, *self.source.variables, *self.source.externals]:
            self._guard(partial(self._variable, variable), variable.line)

    def _guard(self, action: Callable[[], None], line: int) -> None:
        try:
            action()
        except Unreadable as problem:
            self.made.untranslated.append((problem.line or line, problem.reason))

    def _constant(self, item: Declared) -> None:
        if item.kind == "string" or item.value is None:
            return
        value = fold(self.evaluate.scalar(item.value), self.numbers)
        if value is not None:
            self.numbers[item.name] = value

    def _shape(self, size: tuple[Expr, ...]) -> tuple[int, int]:
        sizes = [self.evaluate.whole(e) for e in size]
        rows, columns = (*sizes, 1, 1)[:2] if sizes else (1, 1)
        if rows < 1 or columns < 1 or rows * columns > MOST_ELEMENTS:
            raise Unreadable(self.submodel.line, f"a size of {rows} x {columns} is not possible")
        return rows, columns

    def _elements(self, label: str, size: tuple[Expr, ...], *, taken: bool = True) -> list[list[str]]:
        """The names of the elements of a quantity: `x`, or `x_1`, `x_2`, or `x_1_1` ..."""
        rows, columns = self._shape(size)
        base = identifier(label)
        while taken and any(i.name == base for i in self.made.items.values()):
            base += "_"
        if (rows, columns) == (1, 1):
            return [[base]]
        if columns == 1:
            return [[f"{base}_{i + 1}"] for i in range(rows)]
        return [[f"{base}_{i + 1}_{k + 1}" for k in range(columns)] for i in range(rows)]

    def _port(self, port: Port) -> None:
        if port.many:
            names = [(identifier(name), way == "out") for own, name, way in self.ends if own == port.name]
            self.many[port.name] = names
            groups = [[[name]] for name, _ in names]
        else:
            groups = [self._elements(port.name, port.size, taken=False)]
        for k, group in enumerate(groups):
            out = self.many[port.name][k][1] if port.many else port.direction == "out"
            rows, columns = self._shape(port.size)
            if port.many and rows * columns > 1:
                group = [[f"{group[0][0]}_{i + 1}"] for i in range(rows * columns)]
            label = self.many[port.name][k][0] if port.many else port.name
            if port.domain == "signal":
                for name in (e for row in group for e in row):
                    self.made.items[name] = Item(name, "out" if port.direction == "out" else "in", port.unit)
                self.names[label] = [[f.name(e) for e in row] for row in group]
                continue
            for name in (e for row in group for e in row):
                self.made.items[name] = Item(name, "bond", "", "" if port.domain == "power" else port.domain)
            effort = [[f.name(f"{e}.e") for e in row] for row in group]
            flow = [[f.negative(f.name(f"{e}.f")) if out else f.name(f"{e}.f") for e in row] for row in group]
            a, b = MEMBERS.get(port.domain, ("e", "f"))
            across, through = (flow, effort) if port.domain in ACROSS_IS_FLOW else (effort, flow)
            self.names.update({f"{label}.e": effort, f"{label}.f": flow, f"{label}.{a}": effort, f"{label}.{b}": flow,
                               f"{label}.a": across, f"{label}.t": through})

    def _parameter(self, item: Declared) -> None:
        if item.kind == "string":
            return
        names = self._elements(item.name, item.size)
        unit, factor, doc = unit_text(item.unit)
        values: Matrix | None = None
        if item.value is not None:
            values = self.evaluate(item.value)
            flat = [e for row in values for e in row]
            count = len(names) * len(names[0])
            flat = flat * count if len(flat) == 1 else flat
            if len(flat) != count:
                raise Unreadable(item.line, f"'{item.name}' has {len(flat)} values for {count} elements")
            values = [flat]
        for k, name in enumerate(e for row in names for e in row):
            value = fold(values[0][k], self.numbers) if values else None
            self.made.items[name] = Item(name, "parameter", unit, " ".join(filter(None, (item.doc, doc))),
                                         None if value is None else value * factor)
            if item.is_global:
                self.made.shared[name] = f"{item.name}{name[len(identifier(item.name)):]}"
        self.names[item.name] = [[f.name(e) for e in row] for row in names]

    def _variable(self, item: Declared) -> None:
        if item.kind == "string" or item.name in self.names:
            return
        names = self._elements(item.name, item.size)
        unit, _, doc = unit_text(item.unit)
        for name in (e for row in names for e in row):
            kind = "in" if "import" in item.words else "variable"
            self.made.items[name] = Item(name, kind, unit, " ".join(filter(None, (item.doc, doc))))
            if item.is_global and kind == "variable":
                self.made.gives[name] = item.name if len(names) == 1 else f"{item.name}{name[len(identifier(item.name)):]}"
        self.names[item.name] = [[f.name(e) for e in row] for row in names]

    # -- statements --------------------------------------------------------------------------------------------------
    def _equations(self) -> None:
        start: Env = {}
        self._run(self.source.initial, start, quiet=True)
        written: set[str] = set()
        several = _assigned_again(self.source.equations)
        again: Env = {}
        for statement in self.source.equations:
            if several & set(_assigned(statement)):
                self._run([statement], again)
            else:
                self._guard(partial(self._top, statement, written), statement.line)
        for name, value in again.items():
            self._code_result(name, value, start, written)
        code: Env = {}
        self.evaluate.values = code
        self._run(self.source.code, code)
        self.evaluate.values = {}
        for name, value in code.items():
            self._code_result(name, value, start, written)
        used = {n for left, right, _ in self.made.equations for n in (*_names(left), *_names(right))} \
            | {n for *_, then in self.made.events.values() for v in then.values() for n in _names(v)}
        for name, value in start.items():
            item = self.made.items.get(name)
            if item is None or name in written or item.kind not in ("variable", "out"):
                continue
            if name in used or item.kind == "out" or name in self.made.gives:
                self.made.equations.append((f.name(name), value, "set once, at the start"))
                written.add(name)
        used |= {n for left, right, _ in self.made.equations for n in (*_names(left), *_names(right))}
        for name, item in list(self.made.items.items()):
            if item.kind != "variable" or name in written:
                continue
            if name in self.made.gives:
                item.kind = "in"  # computed by another submodel
                self.made.shared[name] = self.made.gives.pop(name)
            elif name not in used:
                del self.made.items[name]

    def _top(self, statement: Statement, written: set[str]) -> None:
        """A statement of `equations`."""
        if isinstance(statement, Assign):
            self._equation(statement, written)
        elif isinstance(statement, Do):
            self._do(statement)
        else:
            env: Env = {}
            self._statement(statement, env)
            for name, value in env.items():
                self._code_result(name, value, {}, written)

    def _do(self, statement: Do) -> None:
        if statement.error:
            raise Unreadable(statement.line, statement.error)
        function, call = statement.call.name.lower(), statement.call
        if function == "equal" and call.args and call.args[0].op == "call":
            elements = self._collected(call.args[0])
            for other in elements[1:]:
                self._pairs(elements[0][1], other[1])
        elif function not in ("warning", "stopsimulation", "effortincausality"):
            raise Unreadable(statement.line, f"`{statement.call.name}` is not translated")

    def _pairs(self, left: Matrix, right: Matrix, comment: str = "") -> None:
        a, b = [e for row in left for e in row], [e for row in right for e in row]
        for x, y in zip(a, b if len(b) == len(a) else b * len(a), strict=False):
            self.made.equations.append((x, y, comment))

    def _collected(self, call: Expr) -> list[tuple[bool, Matrix]]:
        """The elements of `collect (p.e)` or `direct (p.e)` with whether each points out."""
        inner = call.args[0].name
        port, _, member = inner.partition(".")
        if port not in self.many:
            return [(False, self.evaluate(call.args[0]))]
        return [(out, self.names[f"{name}.{member}" if member else name]) for name, out in self.many[port]]

    def _knot(self, expr: Expr) -> Matrix | None:
        """`sum (direct (p.f))`, `first (p.e)` and sums of these, for knots; None where it is nothing of the kind."""
        name = expr.name.lower() if expr.op == "call" else ""
        if name == "sum" and expr.args[0].op == "call" and expr.args[0].name.lower() in ("direct", "collect"):
            total: Matrix | None = None
            for out, matrix in self._collected(expr.args[0]):
                turned = out and expr.args[0].name.lower() == "direct"
                signed = [[f.negative(e) if turned else e for e in row] for row in matrix]
                total = signed if total is None else [[f.add(a, b) for a, b in zip(r, s, strict=True)]
                                                      for r, s in zip(total, signed, strict=True)]
            return total or [[f.number(0)]]
        if name == "first" and expr.args[0].name.partition(".")[0] in self.many:
            found = self._collected(expr)
            return found[0][1] if found else [[f.number(0)]]
        if expr.op in ("+", "-") and (left := self._knot(expr.args[0])) is not None:
            right = self._knot(expr.args[1])
            if right is not None:
                return [[f.add(a, f.negative(b) if expr.op == "-" else b) for a, b in zip(r, s, strict=False)]
                        for r, s in zip(left, right, strict=False)]
        return None

    def _equation(self, statement: Assign, written: set[str]) -> None:
        left, right, line = statement.left, statement.right, statement.line
        comment = self.comments.get(line, "")
        if left.op == "call" and left.name.lower() == "collect":
            for _, matrix in self._collected(left):
                self._pairs(matrix, self.evaluate(right), comment)
            return
        if (sides := self._knot(left) or (self._knot(right) and self.evaluate(left))) and \
                ((other := self._knot(right)) or right.op == "number"):
            self._pairs(sides, other or self.evaluate(right), comment)
            return
        if left.op == "call" and left.name.lower() == "ddt":
            target = self.evaluate(left.args[0])
            if len(left.args) > 1:
                self._initial(target, self.evaluate(left.args[1]))
            self._pairs([[f.call("der", e) for e in row] for row in target], self.evaluate(right), comment)
            written.update(f.text(e) for row in target for e in row)
            return
        target = self.evaluate(left)
        self.target = f.text(target[0][0]) if left.op in ("name", "index") else ""
        if right.op == "call" and right.name.lower() == "int" and self.target and \
                all(e.op == "name" and "." not in e.name for row in target for e in row):
            self._pairs([[f.call("der", e) for e in row] for row in target], self.evaluate(right.args[0]), comment)
            self._initial(target, self.evaluate(right.args[1]) if len(right.args) > 1 else [[f.number(0)]])
        else:
            self._pairs(target, self.evaluate(right), comment)
        written.update(f.text(e) for row in target for e in row)

    def _initial(self, target: Matrix, values: Matrix) -> None:
        flat = [e for row in values for e in row]
        names = [e for row in target for e in row]
        for e, value in zip(names, flat if len(flat) == len(names) else flat * len(names), strict=False):
            self.made.initial[f.text(e)] = value

    def _run(self, statements: Iterable[Statement], env: Env, *, quiet: bool = False) -> None:
        """Execute assignments one after the other with symbols; `env` holds what they assign."""
        outer, self.evaluate.values = self.evaluate.values, env
        for statement in statements:
            try:
                self._statement(statement, env)
            except Unreadable as problem:
                self.made.untranslated.append((problem.line or statement.line, problem.reason))
        self.evaluate.values = outer

    def _statement(self, statement: Statement, env: Env) -> None:
        outer, self.evaluate.values = self.evaluate.values, env
        try:
            if isinstance(statement, Assign):
                value = self.evaluate(statement.right)
                self.evaluate.values = {}
                target = self.evaluate(statement.left)
                flat, names = [e for row in value for e in row], [e for row in target for e in row]
                for e, v in zip(names, flat if len(flat) == len(names) else flat * len(names), strict=False):
                    env[f.text(e)] = v
                    self.targets[f.text(e)] = e
            elif isinstance(statement, If):
                self._branches(statement, env)
            elif isinstance(statement, For):
                self._loop(statement, env)
            else:
                self._do(statement)
        finally:
            self.evaluate.values = outer

    def _branches(self, statement: If, env: Env) -> None:
        condition = self.evaluate.scalar(statement.condition)
        then, otherwise = dict(env), dict(env)
        for body, own in ((statement.then, then), (statement.otherwise, otherwise)):
            for inner in body:
                self._statement(inner, own)
        for name in dict.fromkeys([*then, *otherwise]):
            a, b = (side.get(name, env.get(name, Expr("prev", name=name))) for side in (then, otherwise))
            env[name] = a if a == b else Expr("if", (condition, a, b))

    def _loop(self, statement: For, env: Env) -> None:
        first, last = self.evaluate.whole(statement.first), self.evaluate.whole(statement.last)
        if last - first > MOST_TURNS:
            raise Unreadable(statement.line, f"a loop of more than {MOST_TURNS} turns is not translated")
        shadowed = self.numbers.get(statement.name)
        for k in range(first, last + 1):
            self.numbers[statement.name] = float(k)
            for inner in statement.body:
                self._statement(inner, env)
        self.numbers.pop(statement.name, None)
        if shadowed is not None:
            self.numbers[statement.name] = shadowed

    # -- states and events -------------------------------------------------------------------------------------------
    def _fresh(self, base: str) -> str:
        k, found = 1, base
        while found in self.made.items:
            k, found = k + 1, f"{base}_{k + 1}"
        return found

    def state(self, rate: Expr, first: Expr | None, line: int) -> Expr:
        """A new state with this rate, for an integral inside an expression."""
        label = rate.name if rate.op == "name" and "." not in rate.name else self.target or "integral"
        name = self._fresh(identifier(f"{label}_int"))
        self.made.items[name] = Item(name, "variable", "", f"integral in line {line} of the SIDOPS text")
        self.made.equations.append((f.call("der", f.name(name)), rate, ""))
        self.made.initial[name] = first or f.number(0)
        return f.name(name)

    def event(self, kind: str, args: list[Expr], line: int) -> Expr:
        """An event as a condition, to be used under `when:`."""
        if kind == "timeevent" and args:
            return Expr(">=", (f.name("time"), args[0]))
        if kind == "eventup" and args:
            return Expr(">", (args[0], f.number(0)))
        if kind == "eventdown" and args:
            return Expr("<", (args[0], f.number(0)))
        raise Unreadable(line, f"`{kind}` is not translated")

    def noise(self, line: int) -> Expr:
        """Random noise is left out."""
        self.made.omitted.append((line, "random noise is left out: 0 is used"))
        return f.number(0)

    def step_count(self, ratio: Expr, line: int) -> Expr:
        """The whole part of a ratio, which events follow."""
        name = self._fresh(identifier(f"{self.target or 'value'}_steps"))
        self.made.items[name] = Item(name, "held", "", "whole part of a ratio, for mod or div", 0.0)
        whole = Expr("if", (Expr(">=", (ratio, f.number(0))), f.call("floor", ratio),
                            f.negative(f.call("floor", f.negative(ratio)))))
        held = f.name(name)
        up = Expr("or", (Expr("and", (Expr(">=", (held, f.number(0))), Expr(">", (ratio, f.add(held, f.number(1)))))),
                         Expr("and", (Expr("<", (held, f.number(0))), Expr(">", (ratio, held))))))
        below = Expr("-", (held, f.number(1)))
        down = Expr("or", (Expr("and", (Expr("<=", (held, f.number(0))), Expr("<", (ratio, below)))),
                           Expr("and", (Expr(">", (held, f.number(0))), Expr("<", (ratio, held))))))
        self.made.events[f"{name}_at_start"] = ("at", "0", {name: whole})
        self.made.events[f"{name}_up"] = ("condition", f.text(up), {name: f.add(held, f.number(1))})
        self.made.events[f"{name}_down"] = ("condition", f.text(down), {name: below})
        return held

    def _moves(self, expr: Expr) -> bool:
        """Whether a value changes between events."""
        if expr.op == "name" and expr.name not in ("time", "pi"):
            item = self.made.items.get(expr.name)
            return item is None or item.kind in ("bond", "in", "out")
        return any(self._moves(e) for e in expr.args)

    def _passed(self, expr: Expr) -> Expr:
        """A condition of an event, where equality of what moves is nearness: such values are whole numbers."""
        if expr.op in ("==", "!=") and any(self._moves(e) for e in expr.args):
            near = Expr("<", (f.call("abs", Expr("-", expr.args)), f.number(0.5)))
            return near if expr.op == "==" else Expr("not", (near,))
        return Expr(expr.op, tuple(self._passed(e) for e in expr.args), expr.name, expr.value, expr.line, expr.columns)

    def _code_result(self, name: str, value: Expr, start: Env, written: set[str]) -> None:
        """What a variable is after the statements: an equation, or a held variable that events set."""
        if name in written:
            raise Unreadable(self.submodel.line, f"'{name}' is assigned in several places")
        written.add(name)
        item = self.made.items.get(name)
        if item is None and name in self.targets and not _keeps(value, name):
            self.made.equations.append((self.targets[name], value, ""))
            return
        if item is None or item.kind not in ("variable", "out"):
            self.made.untranslated.append((self.submodel.line, f"'{name}' cannot be assigned"))
            return
        if not _keeps(value, name):
            self.made.equations.append((f.name(name), value, ""))
            return
        leaves = _leaves(value, Expr("prev", name=name))
        if any(self._moves(leaf) for _, leaf in leaves):
            first = start.get(name, f.number(0))
            self.made.omitted.append((self.submodel.line, f"'{name}' keeps its value where no branch assigns it; "
                                      f"{f.text(first)} is used there"))
            self.made.equations.append((f.name(name), _replaced(value, name, first), ""))
            return
        held = name
        if item.kind == "out":
            held = self._fresh(f"{name}_held")
            self.made.equations.append((f.name(name), f.name(held), "kept between events"))
        known = fold(start[name], self.numbers) if name in start else None
        self.made.items[held] = Item(held, "held", item.unit, item.doc, known or 0.0)
        renamed = _renamed(value, name, held)
        self.made.events[f"{held}_at_start"] = ("at", "0", {held: renamed})
        for k, (condition, leaf) in enumerate(_leaves(renamed, f.name(held))):
            condition = self._passed(condition)
            self.made.events[f"{held}_event_{k + 1}"] = ("condition", f.text(condition), {held: leaf})


def _names(expr: Expr) -> list[str]:
    return [expr.name] if expr.op in ("name", "prev") else [n for e in expr.args for n in _names(e)]


def _keeps(expr: Expr, name: str) -> bool:
    """Whether a value depends on the value that the variable had before."""
    return (expr.op in ("prev", "name") and expr.name == name) or any(_keeps(e, name) for e in expr.args)


def _renamed(expr: Expr, old: str, new: str) -> Expr:
    if expr.op in ("name", "prev") and expr.name == old:
        return f.name(new)
    return Expr(expr.op, tuple(_renamed(e, old, new) for e in expr.args), expr.name, expr.value, expr.line, expr.columns)


def _replaced(expr: Expr, name: str, value: Expr) -> Expr:
    """An expression with a value in place of the one that a variable had before."""
    if expr.op == "prev" and expr.name == name:
        return value
    return Expr(expr.op, tuple(_replaced(e, name, value) for e in expr.args), expr.name, expr.value, expr.line, expr.columns)


def _assigned(statement: Statement) -> list[str]:
    """The names of the quantities that a statement assigns."""
    if isinstance(statement, Assign):
        left = statement.left
        return [left.args[0].name if left.op == "index" else left.name] if left.op in ("name", "index") else []
    if isinstance(statement, If):
        return [n for s in (*statement.then, *statement.otherwise) for n in _assigned(s)]
    return [n for s in statement.body for n in _assigned(s)] if isinstance(statement, For) else []


def _assigned_again(statements: Iterable[Statement]) -> set[str]:
    """The quantities that several statements assign, one at least as a whole or in a branch."""
    seen: set[str] = set()
    again: set[str] = set()
    for statement in statements:
        if isinstance(statement, Assign) and statement.left.op == "index":
            key = {repr(_plain(statement.left))}
        else:
            key = set(_assigned(statement))
        again |= {k.partition("[")[0] for k in seen & key}
        seen |= key
    return again


def _plain(expr: Expr) -> object:
    return (expr.op, expr.name, expr.value, tuple(_plain(e) for e in expr.args))


def _leaves(expr: Expr, held: Expr) -> list[tuple[Expr, Expr]]:
    """The conditions and values of a nested choice, without the branches that keep the value."""
    if expr.op != "if":
        return []
    condition, then, otherwise = expr.args
    condition = f.truth(condition)
    found = []
    for guard, branch in ((condition, then), (Expr("not", (condition,)), otherwise)):
        if branch == held:
            continue
        inner = _leaves(branch, held)
        found += [(Expr("and", (guard, c)), v) for c, v in inner] if branch.op == "if" else [(guard, branch)]
    return found
