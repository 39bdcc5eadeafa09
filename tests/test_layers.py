"""Imports point down: docs/architecture.md lists the modules from top to bottom, and the code keeps to it."""

from __future__ import annotations

import ast
import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import pytest

import heavebond

ROOT = Path(heavebond.__file__).parent
TABLE = ROOT.parent / "docs" / "architecture.md"
ROW = re.compile(r"^\|[^|]*\| `([\w.]+)` \|", re.MULTILINE)
ONLY_IMPORTER = {"yaml": "text.source", "pint": "basis.units"}
# loaded inside functions only, so that `import heavebond` and `heavebond --help` stay quick
HEAVY = {"casadi", "numpy", "scipy", "pandas", "matplotlib", "networkx", "rich", "pint"}
QUICK = ("__init__", "cli", "commands.terminal", "basis.errors", "basis.interrupts", "basis.limits",
         "basis.numerals", "basis.progress", "basis.quoting", "basis.writable")


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


FILES = {_name(path): path for path in sorted(ROOT.rglob("*.py"))}
LISTED = ROW.findall(TABLE.read_text(encoding="utf-8"))


def _statements(node: ast.AST, *, inside: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """The imports below `node`, those in functions too if `inside`; what is for the type checker alone is left out."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            yield child
        elif inside or not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield from _statements(child, inside=inside)


def _imported(module: str, *, inside: bool = True) -> set[str]:
    """Dotted names that a module imports, `heavebond.basis.units` as well as `numpy.typing`."""
    found: set[str] = set()
    for statement in _statements(ast.parse(FILES[module].read_text(encoding="utf-8")), inside=inside):
        if isinstance(statement, ast.Import):
            found |= {alias.name for alias in statement.names}
        else:
            assert not statement.level, f"{module} imports relatively"
            found |= {f"{statement.module}.{alias.name}" for alias in statement.names}
    return found


def _own(module: str) -> set[str]:
    """Modules of ours that a module imports: of `heavebond.basis.units.Unit`, `units`."""
    found = set()
    for name in _imported(module):
        words = name.split(".")
        if words[0] == "heavebond":
            inner = [".".join(words[1:k]) for k in range(len(words), 1, -1)]
            found.add(next((candidate for candidate in inner if candidate in FILES), "__init__"))
    return found - {module}


def test_every_module_has_one_row() -> None:
    assert sorted(LISTED) == sorted(FILES)


@pytest.mark.parametrize("module", FILES)
def test_imports_point_down(module: str) -> None:
    rank = {name: k for k, name in enumerate(LISTED)}
    upwards = [name for name in _own(module) if rank[name] <= rank[module]]
    assert not upwards, f"{module} imports {upwards}, which stand above it in docs/architecture.md"


def test_the_picture_of_the_layers_is_that_of_the_table() -> None:
    """`make pages` draws it anew."""
    draw = runpy.run_path(str(TABLE.parent / "pictures" / "layers.py"))
    table = TABLE.read_text(encoding="utf-8")
    assert [name for modules in draw["layers"](table).values() for name in modules] == LISTED
    drawn = (TABLE.parent / "pictures" / "layers.svg").read_text(encoding="utf-8")
    assert drawn == draw["picture"](table), "run `make pages`"


def test_no_module_forms_a_circle() -> None:
    """Implied by the order of the rows, but found here whatever the table says."""
    done: set[str] = set()

    def visit(module: str, path: tuple[str, ...]) -> None:
        assert module not in path, " > ".join([*path[path.index(module):], module])
        if module not in done:
            for name in sorted(_own(module)):
                visit(name, (*path, module))
            done.add(module)

    for module in FILES:
        visit(module, ())


@pytest.mark.parametrize(("package", "importer"), ONLY_IMPORTER.items())
def test_one_importer_of_a_package(package: str, importer: str) -> None:
    found = [module for module in FILES if any(name.split(".")[0] == package for name in _imported(module))]
    assert found == [importer]


@pytest.mark.parametrize("module", [m for m in FILES if m in QUICK or m.startswith("commands")])
def test_quick_modules_import_nothing_heavy(module: str) -> None:
    at_once = _imported(module, inside=False)
    assert not {name.split(".")[0] for name in at_once} & HEAVY
    ours = {name.removeprefix("heavebond.").rpartition(".")[0] for name in at_once if name.startswith("heavebond.")}
    assert all(name in QUICK or name.startswith("commands") for name in ours if name)
