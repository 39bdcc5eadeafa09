"""Every component is shown and explained: an example, a symbol, a page, the source of its law, words for everything."""

from __future__ import annotations

from pathlib import Path

import pytest

from heavebond.language.definition import Component
from heavebond.language.library import bundled, example, library
from heavebond.language.model import load
from heavebond.pictures.pictograms import symbol

LIBRARY = library()
COMPONENTS = {name: LIBRARY.component(name) for name in LIBRARY.names()}
PAGES = Path(__file__).parent.parent / "docs" / "components"


def is_law(component: Component) -> bool:
    """Whether it states a law of physics with coefficients; ideal sources, sensors and signal blocks are definitions."""
    return bool(component.ports) and bool(component.parameters) and component.power != "source"


def lacks(component: Component) -> list[str]:
    """What a component's file or its surroundings do not say."""
    path = component.path.resolve()
    page = PAGES / path.relative_to(bundled("components").resolve()).with_suffix(".md")
    found = {"an example under models/examples": example(component), "a symbol": symbol(component),
             "a page (`make pages`)": page.is_file() and page.with_suffix(".svg").is_file(),
             "a source": component.source or not is_law(component)}
    words = [*component.parameters.values(), *component.variables.values(), *component.signals.values()]
    return [*(what for what, there in found.items() if not there),
            *(f"a doc of {item.name}" for item in words if not item.doc)]


@pytest.mark.parametrize("name", COMPONENTS)
def test_nothing_is_left_out(name: str) -> None:
    assert lacks(COMPONENTS[name]) == []


def test_each_example_is_named_as_a_component_and_uses_it() -> None:
    stems = {c.path.stem: name for name, c in COMPONENTS.items()}
    wrong = []
    for path in sorted((bundled("models") / "examples").glob("*.yaml")):
        kinds = {i.kind for i in load(path).body.instances.values()}
        if path.stem not in stems or stems[path.stem] not in kinds:
            wrong.append(path.name)
    assert not wrong
