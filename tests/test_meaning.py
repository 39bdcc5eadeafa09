"""Sentences of physics in the component files, and the kinds of the classes of effects."""

from __future__ import annotations

from pathlib import Path

import pytest

from heavebond.core.errors import ModelError
from heavebond.language.definition import Component, Parameter
from heavebond.language.library import KINDS, effect_kind, library
from heavebond.text.expression import names

LIBRARY = library()
EFFECTS = LIBRARY.effects()
DORMANT = [(component, parameter) for component in map(LIBRARY.component, LIBRARY.names())
           for parameter in component.parameters.values() if parameter.neutral is not None]
CURVES = "unknown law"  # identified curves: a shape, no name


def _fields(component: Component, parameter: Parameter | None = None) -> set[str]:
    meaning = parameter.meaning if parameter is not None else component.effect.meaning if component.effect else None
    assert meaning is not None, f"{component.name} has no meaning"
    return {name for field in meaning.fields
            for name in ([field] if isinstance(field, str) else [n.text for n in names(field)])}


def test_every_effect_of_the_library_has_a_sentence_of_physics_with_its_place() -> None:
    """A sentence without the place or part would not say where the effect acts; one without a number not how large it is."""
    for component in EFFECTS:
        effect = component.effect
        assert effect is not None
        if effect.attaches == ("parameter",):
            continue  # a factor: its sentence names the parameter and what it depends on (`answer.variations`)
        fields = _fields(component)
        assert fields & {"place", "part", "a"}, component.name
        if effect.kind != CURVES:
            assert fields & {*effect.amplitude, *effect.shapes}, component.name


def test_every_dormant_parameter_of_the_library_has_a_sentence_with_its_value_and_part() -> None:
    assert len(DORMANT) > 100
    for component, parameter in DORMANT:
        assert {parameter.name, "part"} <= _fields(component, parameter), f"{component.name}.{parameter.name}"


def test_every_class_of_effects_has_a_kind() -> None:
    classes = {c.effect.kind for c in EFFECTS if c.effect is not None} | {p.kind for _, p in DORMANT}
    assert {name for name in classes - {CURVES} if effect_kind(name) not in KINDS} == set()
    assert effect_kind("internal leakage") == effect_kind("leakage") == "rate"
    assert effect_kind("no such class") == ""


COMPONENT = """\
component: Loss
summary: a loss
ports: {a: translational, b: translational}
parameters:
  F: {unit: N, min: 0}
  d: {unit: N*s/m, default: 1 N*s/m}
variables: {v: {unit: m/s}}
equations: |
  v = b.v - a.v                # speed
  b.f = F*tanh(v/(1 * 1)) + d*v   # force
  a.f = -b.f                   # reaction
effect: {class: loss, attaches: across, amplitude: [F], description: a loss, meaning: "MEANING"}
"""


@pytest.mark.parametrize(("meaning", "said", "hint"), [
    ("A loss of {G} {place}.",
     "'G' in the meaning is not a parameter of this component", "Fields: F, d, part, place, a, b."),
    ("A loss of {F + d} {place}.", "'+' joins N and N*s/m", ""),
    ("A loss of {F {place}.", "a brace of the meaning has no partner", "Write a field as `{F_c}`"),
    ("A loss of {F *} {place}.", "", ""),
])
def test_a_wrong_field_of_a_meaning_is_reported_with_file_and_line(tmp_path: Path, meaning: str, said: str, hint: str
                                                                  ) -> None:
    file = tmp_path / "loss.yaml"
    file.write_text(COMPONENT.replace("MEANING", meaning))
    with pytest.raises(ModelError) as error:
        library([tmp_path]).component("Loss")
    problem = error.value.problems[0]
    assert said in problem.message and hint in (problem.hint or "")
    assert problem.place is not None and problem.place.line == 12


def test_a_meaning_of_a_parameter_that_is_no_effect_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "loss.yaml"
    text = COMPONENT.replace("MEANING", "{F} {place}")
    file.write_text(text.replace("F: {unit: N, min: 0}", 'F: {unit: N, meaning: "{F}"}'))
    with pytest.raises(ModelError) as error:
        library([tmp_path]).component("Loss")
    assert "no value at which the effect is absent" in error.value.problems[0].message
