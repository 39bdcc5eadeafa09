"""Data outside an imported model: tables in files in its folder, and functions of 20-sim's compiled libraries (DLLs)
whose laws its manual states. No library is called."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path, PureWindowsPath

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.component import Component
from heavebond.import_20sim.evaluate import EXTERNAL, Evaluator
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.matrices import Matrix
from heavebond.import_20sim.memory import Memory
from heavebond.import_20sim.names import identifier
from heavebond.import_20sim.sidops_tree import Expr
from heavebond.import_20sim.tables import Grid, Table, read_grid, read_table

# libraries and functions in lower case; profiles by their share of the stroke, with first and second derivative
TABLE, PROFILES = "table2d.dll", "motionprofiles.dll"


class External:
    """The tables and library functions of one component; `texts` are the names of files and functions."""

    def __init__(self, component: Component, memory: Memory, folder: Path | None, texts: Mapping[str, str]):
        self.made, self.memory, self.folder, self.texts = component, memory, folder, texts
        self.unread = False  # whether a table of two inputs could not be read

    def _text(self, name: Expr) -> str:
        return name.name if name.op == "text" else self.texts.get(identifier(name.name), "") if name.op == "name" else ""

    def table(self, name: Expr, value: Expr) -> Expr:
        """A value of a table in a file, whose name is a text or a parameter."""
        return Expr("table", (value,), self._entered(name, read_table))

    def _entered(self, name: Expr, read: Callable[[Path, str, int], Table | Grid]) -> str:
        """The label of the table in the named file."""
        text = self._text(name)
        if self.folder is None or not text:
            raise Unreadable(name.line, "the name of the table's file is not known")
        points = read(self.folder, text, name.line)
        label = next((n for n, known in self.made.tables.items() if known == points), None)
        if label is None:
            label = self.made.fresh(identifier(PureWindowsPath(text).stem))
            while label in self.made.tables or any(f"{label}_{kind}" in self.made.items for kind in "nmxyv"):
                label += "_table"
            self.made.tables[label] = points
            self.memory.note(name.line, f"outside its points, the table '{PureWindowsPath(text).name}' is constant")
        return label

    def function(self, call: Expr, evaluate: Evaluator) -> Matrix:
        """`dll (library, function, argument)`; raises Unreadable if its law is not known."""
        library, name = (self._text(e).lower() for e in (*call.args, call, call)[:2])
        if library == TABLE and name == "table2dinit" and len(call.args) == 3:
            self.unread = True
            self._entered(call.args[2], read_grid)
            self.unread = False
            return [[f.number(1)]]  # the number of the table, which has no effect: there is one
        if library == TABLE and name == "tableread" and len(call.args) == 3:
            return [[self._read(call, [e for row in evaluate(call.args[2]) for e in row])]]
        if library == PROFILES and len(call.args) == 3:
            share = evaluate.scalar(call.args[2])
            if name == "profileflat":
                return [[f.number(0)]] * 3
            if name == "profileramp":
                return [[share], [f.number(1)], [f.number(0)]]
        raise Unreadable(call.line, f"`{call.name}`: {EXTERNAL['dll']}")

    def _read(self, call: Expr, arguments: list[Expr]) -> Expr:
        """The value of a table of two inputs: the argument is its number and its inputs, of rows and of columns."""
        grids = [label for label, table in self.made.tables.items() if len(table) == 3]
        if self.unread:
            return f.number(0)  # its reason is listed
        if len(arguments) != 3 or len(grids) != 1:
            raise Unreadable(call.line, "`TableRead` takes a vector of one table's number and two inputs")
        return Expr("table2", tuple(arguments[1:]), grids[0])
