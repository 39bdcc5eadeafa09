"""Data outside an imported model: tables in files in its folder, and functions of 20-sim's compiled libraries (DLLs)
whose laws its manual states. No library is called."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.component import Component
from heavebond.import_20sim.evaluate import EXTERNAL, Evaluator
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.matrices import Matrix
from heavebond.import_20sim.memory import Memory
from heavebond.import_20sim.names import identifier, snake
from heavebond.import_20sim.sidops_tree import Expr
from heavebond.import_20sim.tables import Grid, Table, read_grid, read_table
from heavebond.language.external_functions import source_text
from heavebond.language.library import library_functions
from heavebond.text.expression import FUNCTIONS

# libraries and functions in lower case; profiles by their share of the stroke, with first and second derivative
TABLE, PROFILES = "table2d.dll", "motionprofiles.dll"


@dataclass
class Programs:
    """C sources that replace functions of compiled libraries, by the lower-case names of the functions. `called` are the
    functions of the imported model, each with the numbers of its arguments and results, by their names in the diagram;
    `without` the functions for which no source is given."""

    sources: Mapping[str, Path] = field(default_factory=dict)
    called: dict[str, tuple[str, int, int]] = field(default_factory=dict)
    without: dict[str, None] = field(default_factory=dict)

    def call(self, function: str, args: list[Expr], results: int) -> list[Expr] | None:
        """The results of a call; None if there is no source."""
        if function.lower() not in self.sources:
            self.without[function] = None
            return None
        base = snake(identifier(function)) or "program"
        name, number = base, 2
        entry = function, len(args), results
        while (name in FUNCTIONS or name in library_functions() or name in self.called) and self.called.get(name) != entry:
            name, number = f"{base}_{number}", number + 1
        self.called[name] = entry
        return [f.call(name if results == 1 else f"{name}.y_{k + 1}", *args) for k in range(results)]

    def files(self) -> dict[str, str]:
        """The files of the functions and of their sources, by their names in the folder of the import."""
        written = {}
        for name, (function, arguments, results) in self.called.items():
            source = self.sources[function.lower()]
            inputs = [f"  x_{k + 1}: {{unit: 1, nominal: 1, doc: argument {k + 1}}}" for k in range(arguments)]
            outputs = [f"  y_{k + 1}: {{unit: 1, doc: result {k + 1}}}" for k in range(results)]
            written[f"components/{name}.yaml"] = "\n".join([
                f"function: {name}", "is: external",
                f"summary: Function {function} of a compiled library of the 20-sim model.", f"file: {source.name}",
                f"call: {function}", "signature: 20-sim", "inputs:", *inputs, "outputs:", *outputs, ""])
            written[f"components/{source.name}"] = source_text(source)
        return written


class External:
    """The tables and library functions of one component; `texts` are the names of files and functions, `programs` the
    functions with C sources, `results` gives the number of results that a statement takes from a call."""

    def __init__(self, component: Component, memory: Memory, folder: Path | None, texts: Mapping[str, str],
                 programs: Programs, results: Callable[[Expr], int]):
        self.component, self.memory, self.folder, self.texts = component, memory, folder, texts
        self.programs, self.results = programs, results
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
        label = next((n for n, known in self.component.tables.items() if known == points), None)
        if label is None:
            label = self.component.fresh(identifier(PureWindowsPath(text).stem))
            while label in self.component.tables or any(f"{label}_{kind}" in self.component.items for kind in "nmxyv"):
                label += "_table"
            self.component.tables[label] = points
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
        function = self._text(call.args[1]) if len(call.args) == 3 else ""
        if re.fullmatch(r"[A-Za-z_]\w*", function, re.ASCII):
            args = [e for row in evaluate(call.args[2]) for e in row]
            if (results := self.programs.call(function, args, self.results(call))) is not None:
                return [[e] for e in results]
            raise Unreadable(call.line, f"`{call.name}`: {EXTERNAL['dll']}; import it again with its C source, "
                             f"`--function {function}=source.c`")
        raise Unreadable(call.line, f"`{call.name}`: {EXTERNAL['dll']}")

    def _read(self, call: Expr, arguments: list[Expr]) -> Expr:
        """The value of a table of two inputs: the argument is its number and its inputs, of rows and of columns."""
        grids = [label for label, table in self.component.tables.items() if len(table) == 3]
        if self.unread:
            return f.number(0)  # its reason is listed
        if len(arguments) != 3 or len(grids) != 1:
            raise Unreadable(call.line, "`TableRead` takes a vector of one table's number and two inputs")
        return Expr("table2", tuple(arguments[1:]), grids[0])
