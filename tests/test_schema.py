"""The JSON Schema of the language: it takes every file that is right, and sees what it can see in those that are wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from click.testing import CliRunner
from collected import for_each
from doc_pages import PAGES, blocks

from heavebond.cli import main
from heavebond.core.units import unit
from heavebond.estimation import experiment
from heavebond.exchange.json_schema import component_file, diagram, schema, written_units
from heavebond.exchange.json_schema import experiment as experiment_file
from heavebond.exchange.json_schema import study as study_file
from heavebond.language import component_file as component_files
from heavebond.language import effects, library, model
from heavebond.studies import study

ROOT = Path(__file__).parent.parent
WRONG = Path(__file__).parent / "wrong"
# the library's list of domains and the notes beside records are no files of the language
BUNDLED = [p for folder in ("components", "models") for p in sorted((ROOT / folder).rglob("*.yaml"))
           if p.name not in ("domains.yaml", "effect_classes.yaml") and "data" not in p.parts]


def of_kind(validator: Any, condition: dict, instance: object, schema: dict) -> Iterator[jsonschema.ValidationError]:
    """The keyword `if`. The schema has one for each component, `{required: [is], properties: {is: {const: NAME}}}`; such a
    condition is compared here, in place of 900 000 calls of validators for the bundled files."""
    named = condition.get("properties", {}).get("is", {}).get("const")
    if condition != {"required": ["is"], "properties": {"is": {"const": named}}}:
        yield from jsonschema.Draft7Validator.VALIDATORS["if"](validator, condition, instance, schema)
    elif not isinstance(instance, dict) or instance.get("is") == named:
        yield from validator.descend(instance, schema["then"], schema_path="then")


Validator = jsonschema.validators.extend(jsonschema.Draft7Validator, {"if": of_kind})


@cache
def validator(folder: Path | None = None) -> object:
    found = schema(library.library([folder] if folder else []))
    jsonschema.Draft7Validator.check_schema(found)
    return Validator(found)


@pytest.fixture
def known() -> object:
    return validator()


def complaints(known: object, text: str) -> list[str]:
    """What the schema says of a text, innermost first."""
    found = []
    for error in known.iter_errors(yaml.safe_load(text)):
        found += [e.message for e in error.context or ()] + [error.message]
    return found


@pytest.mark.long
@for_each("path", BUNDLED, ids=lambda p: f"{p.parent.name}/{p.stem}", parts=2)
def test_every_bundled_file_is_valid(path: Path, known: object) -> None:
    folder = path.parent.parent if path.parent.name == "components" else path.parent
    local = validator(folder) if (folder / "components").is_dir() else known
    assert complaints(local, path.read_text()) == []


@pytest.mark.parametrize(("time", "valid"), [("{column: t, unit: s}", True), ("{every: 20 ms, from: 2 s}", True),
                                              ("{every: 20 ms, column: t}", False), ("{from: 2 s}", False)])
def test_the_times_of_an_experiment(time: str, valid: bool, known: object) -> None:
    text = f"experiment: e\nmodel: m.yaml\nrecords: {{r: {{file: r.csv, use: fit}}}}\ntime: {time}\n" \
        "inputs: {v.u: {column: u, unit: mm, interpolation: spline, factor: -1}}\n"
    assert (complaints(known, text) == []) == valid


@pytest.mark.long
@for_each("page", PAGES, ids=lambda p: p.stem)
def test_every_file_of_the_documentation_is_valid(page: Path, tmp_path: Path) -> None:
    shown = {b.mark[1]: b.text for b in blocks(page) if b.mark[0] == "file" and b.mark[1].endswith(".yaml")}
    for name, text in shown.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    if shown:
        # components that the page writes for itself are known in its folder only
        known = validator(tmp_path if any(text.startswith("component:") for text in shown.values()) else None)
        # components that the page writes by itself, as a wrong one that no check would let pass
        own = tuple(f"'{name}' is not one of" for name in re.findall(r"^component: (\w+)$", page.read_text(), re.MULTILINE))
        found = {name: [c for c in complaints(known, text) if not c.startswith(own)] for name, text in shown.items()}
        assert {name: said for name, said in found.items() if said} == {}


@pytest.mark.parametrize(("made", "keys"), [
    (diagram(), model.MODEL_KEYS), (experiment_file(), experiment.EXPERIMENT_KEYS), (study_file(), study.STUDY_KEYS),
    (study_file()["properties"]["tune"], study.TUNE_KEYS),
    (component_file(library.library()), component_files.COMPONENT_KEYS),
    (experiment_file()["properties"]["records"]["additionalProperties"], experiment.RECORD_KEYS),
    (component_file(library.library())["properties"]["effect"]["anyOf"][0], effects.KEYS),
])
def test_it_has_the_keys_of_the_language(made: dict, keys: tuple[str, ...]) -> None:
    assert set(made["properties"]) == set(keys)


RIGHT = """
model: rig
components:
  spring: {is: Spring, c: 40 kN/m, l0: 0}
  load:   {is: Mass, m: =m_load, at: [1, 2]}
  deck:   {is: PositionSource, u: {file: heave.csv, column: z, unit: m, interpolation: spline}}
nodes: {deck: [deck.a, spring.a], load: [spring.b, load.a]}
parameters: {m_load: 2 * 3 t}
initial: {start: steady, load.x: ~ -1e-3 m, solve: [spring.l0]}
show: {load: {is: load.x - 1 mm, unit: mm}, part: {is: load.x/1 m, unit: 1}}
simulate: {until: 60 s}
"""


@pytest.mark.parametrize(("old", "new", "said"), [
    ("", "", ""), ("parameters:", "paramters:", "paramters"), ("is: Spring", "is: Sprong", "Sprong"),
    ("c: 40 kN/m", "k: 40 kN/m", "'k'"), ("c: 40 kN/m", "c: 40", "40"), ("c: 40 kN/m", "c: 40kN/m", "40kN/m"),
    ("c: 40 kN/m", "c: '1,2 kN/m'", "1,2 kN/m"), ("c: 40 kN/m", "c: .5e3 kN/m", ""), ("c: 40 kN/m", "c: 50 mN/m", ""),
    ("unit: mm}", "units: mm}", "units"), ("start: steady", "start: steadi", "steadi"),
    ("interpolation: spline", "interpolation: cubic", "cubic"),
    ("60 s}", "60 s, solver: cvodes}", ""), ("60 s}", "60 s, solver: cvode}", "cvode"),
    ("column: z, ", "", "column"), ("until: 60 s", "until: 60", "60"), ("model: rig", "modle: rig", "model"),
    ("c: 40 kN/m", "c: 40 kN m", "40 kN m"),
    ("c: 40 kN/m", "c: 4 kN/m + 500 N/m", ""), ("c: 40 kN/m", "c: 40 N/m^1", "N/m^1"),
    ("at: [1, 2]", "at: here", "here"), ("is: Mass, m: =m_load, ", "", "'is' is a required property"),
])
def test_what_the_schema_sees(old: str, new: str, said: str, known: object) -> None:
    assert old in RIGHT
    found = complaints(known, RIGHT.replace(old, new, 1) if old else RIGHT)
    assert any(said in words for words in found) if said else found == [], found


# of the inputs that are known to be wrong, those whose fault a schema can know: it lies in one entry
SEEN = {
    "caret_as_power", "component_in_other_words", "decimal_comma", "decimal_comma_in_braces", "empty_file",
    "five_mistakes", "five_parts", "key_without_value", "list_at_the_top", "missing_unit", "number_glued_to_unit",
    "part_without_braces", "space_after_colon", "space_in_unit", "unknown_component", "unknown_key",
    "unknown_key_in_part", "unknown_parameter", "unknown_start", "until_without_unit", "words_as_values"}


@pytest.mark.parametrize("name", sorted(SEEN))
def test_wrong_files_that_it_sees(name: str, known: object) -> None:
    assert complaints(known, (WRONG / f"{name}.yaml").read_text())


def test_units_to_choose_from() -> None:
    assert written_units(unit("N/m"))[:3] == ("N/m", "kN/m", "MN/m")
    assert "bar" in written_units(unit("Pa")) and "N*m" not in written_units(unit("N"))
    assert "rpm" in written_units(unit("rad/s")) and "rpm" not in written_units(unit("Hz"))


def test_an_editor_is_told_components_parameters_and_units(known: object) -> None:
    found = schema(library.library())["definitions"]
    kinds = found["components"]["additionalProperties"]["properties"]["is"]
    assert kinds["enumDescriptions"][kinds["enum"].index("Spring")]
    stiffness = found["is.Spring"]["properties"]["c"]
    assert "stiffness" in stiffness["description"] and "N/m" in stiffness["description"]
    assert {"label": "... kN/m", "body": "${1:1} kN/m"} in stiffness["defaultSnippets"]


def test_the_command_writes_schema_and_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text(
        "component: Own\nsummary: Mine.\nports: {a: translational}\nparameters: {k: {unit: N}}\nequations: |\n  a.f = k\n")
    answer = CliRunner().invoke(main, ["export", "--schema"])
    assert answer.exit_code == 0, answer.output
    settings = json.loads((tmp_path / ".vscode" / "settings.json").read_text())
    path, = settings["yaml.schemas"]
    assert f"$schema={path}" in answer.stdout
    found = jsonschema.Draft7Validator(json.loads((tmp_path / path).read_text()))
    part = "model: m\ncomponents:\n  a: {is: Own, k: 3 N}\n"
    assert complaints(found, part) == []
    assert complaints(found, part.replace("k:", "q:"))
    # what is there is left alone
    (tmp_path / ".vscode" / "settings.json").write_text("{}")
    answer = CliRunner().invoke(main, ["export", "--schema"])
    assert "yaml.schemas" in answer.stdout
    assert (tmp_path / ".vscode" / "settings.json").read_text() == "{}"
    elsewhere = CliRunner().invoke(main, ["export", "--schema", "-o", "s.json"])
    assert elsewhere.exit_code == 0 and '"s.json"' in elsewhere.stdout


@pytest.mark.parametrize(("words", "code"), [
    (("nowhere",), "folder-missing"), (("-o", "s.yaml"), "file-suffix"), (("-o", "x/s.json"), "file-unwritable")])
def test_messages(words: tuple[str, ...], code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    answer = CliRunner().invoke(main, ["export", "--schema", *words])
    assert answer.exit_code == 2
    assert f"[{code}]" in answer.stderr
