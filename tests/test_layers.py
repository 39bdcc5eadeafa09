"""Imports point down: docs/architecture.md lists the packages from top to bottom, and the code keeps to it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from collected import for_each

import heavebond

ROOT = Path(heavebond.__file__).parent
PAGE = ROOT.parent / "docs" / "architecture.md"
ROW = re.compile(r"^\| `(\w+)` \|", re.MULTILINE)
ONLY_IMPORTER = {"yaml": "text.yaml_source", "pint": "core.units"}
# loaded inside functions only, so that `import heavebond` and `heavebond --help` stay quick
HEAVY = {"casadi", "numpy", "scipy", "pandas", "matplotlib", "networkx", "rich", "pint"}
QUICK = ("__init__", "cli", "commands.terminal", "core.errors", "core.cancellation", "core.limits",
         "core.facade", "core.numerals", "core.progress", "core.quoting", "core.version", "core.writable",
         "equations", "pictures", "reports")


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


FILES = {_name(path): path for path in sorted(ROOT.rglob("*.py"))}
PACKAGES = ROW.findall(PAGE.read_text(encoding="utf-8"))


def _statements(node: ast.AST, *, inside: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """The imports below `node`; with `inside`, those in functions and for the type checker too."""
    for child in ast.iter_child_nodes(node):
        if not inside and isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            yield child
        elif inside or not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield from _statements(child, inside=inside)


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(FILES[module].read_text(encoding="utf-8"))


@cache
def _imported(module: str, *, inside: bool = True) -> set[str]:
    """Dotted names that a module imports, `heavebond.core.units` as well as `numpy.typing`."""
    found: set[str] = set()
    for statement in _statements(_tree(module), inside=inside):
        if isinstance(statement, ast.Import):
            found |= {alias.name for alias in statement.names}
        else:
            assert not statement.level, f"{module} imports relatively"
            found |= {f"{statement.module}.{alias.name}" for alias in statement.names}
    return found


def _own(module: str) -> set[str]:
    """Modules of ours that a module imports: of `heavebond.core.units.Unit`, `units`."""
    found = set()
    for name in _imported(module):
        words = name.split(".")
        if words[0] == "heavebond":
            inner = [".".join(words[1:k]) for k in range(len(words), 1, -1)]
            found.add(next((candidate for candidate in inner if candidate in FILES), "__init__"))
    return found - {module}


def _package(module: str) -> str:
    return module.partition(".")[0]


def test_every_package_has_one_row() -> None:
    assert sorted(PACKAGES) == sorted({_package(module) for module in FILES} - {"__init__"})


@pytest.mark.long
@for_each("module", [m for m in FILES if m != "__init__"])
def test_imports_point_down(module: str) -> None:
    rank = {name: k for k, name in enumerate(PACKAGES)}
    upwards = [name for name in _own(module) if name != "__init__" and rank[_package(name)] < rank[_package(module)]]
    assert not upwards, f"{module} imports {upwards}, of packages that stand above its own in docs/architecture.md"


def test_an_import_for_the_type_checker_counts() -> None:
    tree = ast.parse("if TYPE_CHECKING:\n    from heavebond.numerics.simulator import Simulator")
    assert len(list(_statements(tree, inside=True))) == 1


@for_each("module", FILES)
def test_the_first_line_says_what_a_module_is_for(module: str) -> None:
    first = (ast.get_docstring(_tree(module)) or "").partition("\n")[0]
    assert len(first) > 20, f"{module} begins with no sentence about its purpose"


def test_no_module_forms_a_circle() -> None:
    """Within a package too; the public names of `heavebond` are loaded when they are used."""
    done: set[str] = {"__init__"}

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


@for_each("module", [m for m in FILES if m in QUICK or m.startswith("commands")])
def test_quick_modules_import_nothing_heavy(module: str) -> None:
    at_once = _imported(module, inside=False)
    assert not {name.split(".")[0] for name in at_once} & HEAVY
    ours = {name.removeprefix("heavebond.").rpartition(".")[0] for name in at_once if name.startswith("heavebond.")}
    assert all(name in QUICK or name.startswith("commands") for name in ours if name)
