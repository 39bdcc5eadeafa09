"""The sets of measured records: their diagrams, and the effects that are known to be missing, in words of the catalogue."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.diagnosis import measured


@pytest.mark.parametrize("name", measured.SETS)
def test_known_effects_of_a_measured_set_are_of_the_catalogue_and_in_its_diagram(name: str, tmp_path: Path) -> None:
    experiment, entry = measured.experiment(name, tmp_path), measured.SETS[name]
    laws = {c.name: c.effect.kind for c in experiment.model.library.effects() if c.effect is not None}
    body = experiment.model.body
    names = {*body.wires, *body.instances, *experiment.inputs, *experiment.outputs}
    assert all(record.file.is_relative_to(tmp_path / name) for record in experiment.records.values())
    for effect in entry.effects:
        assert effect["side"] in ("machine", "measuring chain")
        assert (effect["side"] == "measuring chain") == ("kind" not in effect)
        assert effect.get("kind", "source") in ("dissipation", "stiffness", "inertia", "storage", "source", "transport")
        assert effect["basis"] in ("authors", "publication", "inference")
        assert set(effect["classes"]) <= set(laws.values())
        assert all(laws[law] in effect["classes"] for law in effect["laws"])
        assert all(set(place) <= names for place in effect["places"])


def test_diagrams_of_measured_sets_use_library_components_only() -> None:
    assert [path.name for path in measured.DIAGRAMS.iterdir() if path.suffix != ".yaml"] == []
