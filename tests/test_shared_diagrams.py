"""Candidates that sleep in one diagram: who may, and that their scores are those of diagrams of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.diagnosis.rigs import RIGS
from heavebond.core.errors import ModelError
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.places import candidates, named_apart
from heavebond.diagnosis.search.base_model import Base, SharedDiagram, shared_diagrams
from heavebond.diagnosis.search.scoring import Score, scored
from heavebond.diagnosis.search.step import fitted_base
from heavebond.diagnosis.search.workers import Workers
from heavebond.estimation.experiment import load_experiment
from heavebond.language.edits import Change
from heavebond.text.yaml_source import parse

EXPERIMENT = RIGS["passive"].experiment


@pytest.fixture(scope="module")
def base() -> Base:
    return fitted_base(load_experiment(EXPERIMENT))


@pytest.fixture(scope="module")
def found(base: Base) -> dict[str, Candidate]:
    return {c.label: c for c in candidates(base.problem.experiment)}


@pytest.fixture(scope="module")
def shared(base: Base, found: Mapping[str, Candidate]) -> dict[str, SharedDiagram]:
    library = base.problem.experiment.model.library
    return shared_diagrams(library, [c for c in named_apart(base.problem.experiment) if c.label in found])


def test_the_same_candidates_have_names_of_their_own(found: Mapping[str, Candidate], base: Base) -> None:
    apart = named_apart(base.problem.experiment)
    assert [c.label for c in apart] == list(found)
    assert [len(c.numbers) for c in apart] == [len(c.numbers) for c in found.values()]
    parts = [name for c in apart if not c.members and c.attaches != "replaces" for name in c.change.components]
    assert len(parts) == len(set(parts))
    assert len({name for c in found.values() for name in c.change.components}) < len(parts)


def test_written_changes_are_read_alike_by_both_readers(found: Mapping[str, Candidate],
                                                        shared: Mapping[str, SharedDiagram]) -> None:
    changes = [c.change for c in found.values()] + [s.change for s in shared.values()]
    changes.append(Change(settings={"mass.größe": "=2*a[1]", "b": "12:30"}, channels={}, initial={"x": '~ ="y" #'}))
    for change in changes:
        text = change.diagram("Größe: \"1\" \t\u2028 #", "yes", "a b.yaml")
        assert parse(text, trusted=True) == parse(text)


def test_no_two_of_one_diagram_name_the_same(shared: Mapping[str, SharedDiagram]) -> None:
    for diagram in {id(s): s for s in shared.values()}.values():
        whole = diagram.change
        assert len(diagram.members) > 1
        for key in ("components", "settings", "channels", "moved", "initial"):
            assert len(getattr(whole, key)) == sum(len(getattr(c.change, key)) for c in diagram.members), key
        assert len(set(diagram.amplitudes)) == len(diagram.amplitudes)


def test_laws_with_states_and_those_that_never_vanish_have_their_own(
        shared: Mapping[str, SharedDiagram], found: Mapping[str, Candidate]) -> None:
    alone = {found[label].component for label in found.keys() - shared.keys()}
    together = {found[label].component for label in shared}
    assert {"Delay", "FirstOrderLag", "Saturation", "DahlFriction", "Mass", "SeriesCompliance"} <= alone
    assert {"CoulombFriction", "Damper", "EndStop", "Spring", "SensorOffset"} <= together
    assert len(shared) > len(found) / 3


def _same(one: list[Score], other: list[Score]) -> None:
    """Of a law with a kink the derivatives are rough: there the clearest figures agree to a percent only."""
    assert [(s.shapes.keys(), s.along, s.side, s.candidate.label) for s in one] == \
        [(s.shapes.keys(), s.along, s.side, s.candidate.label) for s in other]
    for s, t in zip(one, other, strict=True):
        assert dict(s.shapes) == pytest.approx(dict(t.shapes), rel=1e-6)
        assert s.z == pytest.approx(t.z, rel=1e-2, abs=0.05)
        assert s.size == pytest.approx(t.size, rel=1e-2)
        assert s.told_apart == t.told_apart
        if s.told_apart:
            assert abs(float(s.direction @ t.direction)) > 0.999


def test_scores_are_those_of_own_diagrams(base: Base, found: Mapping[str, Candidate], shared: Mapping[str, SharedDiagram]
                                          ) -> None:
    made = 0
    for label in list(shared)[::3]:
        together = scored(base, found[label], shared[label])
        _same(together, scored(base, found[label]))
        assert all(s.candidate is found[label] for s in together)
        made += len(together)
    assert made > 20
    assert all(base.shared.values())  # none of these diagrams had to be divided


def test_one_that_cannot_stand_there_leaves_the_others_together(
        base: Base, found: Mapping[str, Candidate], shared: Mapping[str, SharedDiagram]) -> None:
    members = next(s for s in shared.values() if len(s.members) >= 4).members[:4]
    broken = replace(members[0], change=Change(settings={"nothing.here": "1"}))
    with pytest.raises(ModelError):
        base.runs(broken.change, [])
    diagram = SharedDiagram((broken, *members[1:]))
    assert scored(base, replace(found[broken.label], change=broken.change), diagram) == []
    last = members[-1].label
    _same(scored(base, found[last], diagram), scored(base, found[last]))
    divided = base.sleeping(diagram, last)
    assert divided is not None and divided is base.shared[repr(SharedDiagram(members[2:]).members)]


def test_one_that_does_not_sleep_is_found_out(base: Base, found: Mapping[str, Candidate], shared: Mapping[str, SharedDiagram]
                                              ) -> None:
    members = next(s for s in shared.values() if len(s.members) >= 2).members[:2]
    name, value = next((q, v) for q, v in base.problem.runs[0].assembly.parameter_values.items() if q.endswith(".m"))
    awake = replace(members[0], change=members[0].change.joined(Change(settings={name: repr(1.5 * value)})))
    assert base.sleeping(SharedDiagram((awake, members[1])), awake.label) is None


def test_workers_share_and_give_what_is_asked_for(base: Base, found: Mapping[str, Candidate]) -> None:
    chosen = [c for c in found.values() if c.component in ("SensorGain", "SensorOffset", "Delay")]
    with Workers(base, 1) as workers:
        scores = {c.label: got for c, got in workers.score(chosen)}
    assert set(scores) == {c.label for c in chosen}
    assert all(got and np.isfinite(got[0].z) for got in scores.values())
