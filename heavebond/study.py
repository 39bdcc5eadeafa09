"""A tuning study as a file: the diagram, what is free, the cost, the limits and the cases."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from heavebond import reading
from heavebond.definition import FileInput
from heavebond.errors import ModelError, Problem, Problems, suggest
from heavebond.expression import constant
from heavebond.model import Model, find, load_beside, read_settings
from heavebond.objective import Case, Task
from heavebond.source import Mapping, Node, Source, read
from heavebond.units import Range, UnitProblem, parse_quantity, parse_range

STUDY_KEYS = ("study", "summary", "model", "free", "evaluate", "reference", "cost", "limits", "modes", "cases", "uncertain",
              "notes")


@dataclass(frozen=True)
class Study:
    """A diagram and what is to be tuned in it."""

    name: str
    path: Path
    model: Model
    task: Task


def load_study(name: str | Path) -> Study:
    """Load a study: the path of a file, or a bundled one (`cmc_ahc/quality_index`)."""
    source = read(find(name, "study"))
    root = source.root
    problems = Problems()
    if "study" not in root.items:
        raise ModelError([Problem("not-a-study", f"{source.name} is no study: it has no `study:`", root.place,
                                  suggest("study", root.items) or "A study begins with `study: name`.")])
    reading.known_keys(root, STUDY_KEYS, "a study", problems, required=("model", "free", "cost"))
    problems.raise_as(ModelError)
    model = load_beside(source, root.items["model"], problems)
    task = _task(source, problems)
    problems.raise_as(ModelError)
    return Study(reading.text(root.items["study"], "study", problems), source.path, model, task)


def _task(source: Source, problems: Problems) -> Task:
    root = source.root
    begin, end = _window(root.items.get("evaluate"), problems)
    limits = tuple(s.text for s in reading.words(root.items.get("limits"), "limits", problems))
    cases = _cases(root.items.get("cases"), source, problems)
    return Task(_free(root.items.get("free"), problems), reading.text(root.items.get("cost"), "cost", problems), limits,
                begin, end, _values(root.items.get("reference"), source, problems), cases or (Case("diagram", {}),),
                _values(root.items.get("modes"), source, problems), _widths(root.items.get("uncertain"), problems))


def _free(node: Node | None, problems: Problems) -> dict[str, Range]:
    entries = reading.mapping(node, "free", problems)
    found: dict[str, Range] = {}
    for name, item in (entries.items if entries else {}).items():
        try:
            found[name] = parse_range(reading.text(item, name, problems))
        except UnitProblem as problem:
            problems.add(problem.code, f"{name}: {problem.message}", item.place, hint=problem.hint)
    return found


def _window(node: Node | None, problems: Problems) -> tuple[float, float | None]:
    entries = reading.mapping(node, "evaluate", problems)
    if entries is None:
        return 0.0, None
    reading.known_keys(entries, ("from", "to"), "evaluate", problems)
    times = {name: reading.seconds(item, name, problems) for name, item in entries.items.items()}
    return times.get("from") or 0.0, times.get("to")


def _widths(node: Node | None, problems: Problems) -> dict[str, str]:
    """Uncertainties as written; they are compared with the parameters where these are known."""
    entries = reading.mapping(node, "uncertain", problems)
    found: dict[str, str] = {}
    for name, item in (entries.items if entries else {}).items():
        text = reading.text(item, name, problems)
        try:
            width, _ = parse_quantity(text)
        except UnitProblem as problem:
            problems.add(problem.code, f"{name}: {problem.message}", item.place, hint="Write `20 %` or `3 kN`.")
            continue
        if width <= 0:
            problems.add("uncertainty-not-positive", f"{name}: an uncertainty is above 0", item.place,
                         hint="Write `20 %` or `3 kN`.")
        found[name] = text
    return found


def _values(node: Node | None, source: Source, problems: Problems) -> dict[str, float | str]:
    """Quantities as written; their units are checked where they are set."""
    found: dict[str, float | str] = {}
    for path, setting in read_settings(node, source, problems).items():
        if isinstance(setting.value, FileInput) or setting.value.formula:
            problems.add("not-a-quantity", f"{path} must be a plain quantity here", setting.place)
        else:
            found[path] = setting.value.text
    return found


def _cases(node: Node | None, source: Source, problems: Problems) -> tuple[Case, ...]:
    entries = reading.mapping(node, "cases", problems)
    found = []
    for name, item in (entries.items if entries else {}).items():
        weight = 1.0
        if isinstance(item, Mapping) and "weight" in item.items:
            given = item.items["weight"]
            value = reading.value(given, "weight", problems)
            number = constant(value.expr) if value is not None else None
            weight = number if number is not None and number > 0 else 1.0
            rest = {k: v for k, v in item.items.items() if k != "weight"}
            item = Mapping(rest, {k: item.keys[k] for k in rest}, item.place)
        found.append(Case(name, _values(item, source, problems), weight))
    return tuple(found)


