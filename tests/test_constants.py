"""Constants of the methods: one frozen, documented object for each."""

from __future__ import annotations

import dataclasses
import importlib
import re
from pathlib import Path

import pytest

import heavebond

PACKAGE = Path(heavebond.__file__).parent
FOUND = [(path, name) for path in sorted(PACKAGE.rglob("*.py"))
         for name in re.findall(r"^([A-Z_]+) = \w+Constants\(\)$", path.read_text(encoding="utf-8"), re.MULTILINE)]


def test_the_methods_have_their_objects() -> None:
    assert {name for _, name in FOUND} >= {"NEWTON", "INITIALISATION", "EVENTS", "STATE_SELECTION", "INPUT_ESTIMATION",
                                           "SEARCH", "STABILITY", "UNIT_CHECKS"}


@pytest.mark.parametrize(("path", "name"), FOUND, ids=[name for _, name in FOUND])
def test_each_constant_says_what_it_is_whence_and_what_changes(path: Path, name: str) -> None:
    module = importlib.import_module(".".join(("heavebond", *path.relative_to(PACKAGE).with_suffix("").parts)))
    constants = getattr(module, name)
    parts = re.split(r"^\s+([a-z_0-9]+): ", constants.__doc__, flags=re.MULTILINE)
    said = dict(zip(parts[1::2], (" ".join(text.split()) for text in parts[2::2]), strict=True))
    fields = [field.name for field in dataclasses.fields(constants)]
    assert list(said) == fields
    assert all("Doubled" in text for text in said.values())
    assert "Origin of all" in parts[0] or all("Origin: " in text for text in said.values())
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(constants, fields[0], 0)
