"""Both sides of each benchmark compute the same; how fast they do is for `make bench`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from benchmarks import chain, compensator, heave, hundred_thousand, large
from benchmarks.measuring import Paired, at_most, duration
from heavebond.numerics import idas


@pytest.mark.parametrize("gain", heave.GAINS.values(), ids=list(heave.GAINS))
def test_the_diagram_and_the_flat_equations_of_the_heave_compensator_agree(gain: float) -> None:
    assert heave.Heave(gain, until=6.0, points=600).disagreement() < 1e-4


def test_the_diagram_and_the_flat_equations_of_the_chain_agree() -> None:
    assert chain.disagreement(20) < 1e-3


@pytest.mark.long
@pytest.mark.parametrize(("machine", "size", "until"), [(large.LARGE[0], 20, 6.0), (large.LARGE[1], 20, 0.5),
                                                        (large.LARGE[2], 100, 0.3)], ids=["string", "line", "cylinders"])
def test_the_diagram_and_the_flat_equations_of_large_machines_agree(machine: large.Large, size: int, until: float) -> None:
    # both are integrated to 1e-6 of what moves, each with its own steps
    assert machine.disagreement(size, until) < 1e-3


@pytest.mark.parametrize("name", hundred_thousand.MACHINES)
def test_the_machines_of_100_000_unknowns_run_in_small(name: str) -> None:
    result = hundred_thousand.run(hundred_thousand.MACHINES[name].small())
    assert np.isfinite(result.x).all() and np.ptp(result.x, axis=1).max() > 0
    assert result.verdict.text == "clean"


def test_the_order_of_least_fill_changes_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """States and algebraic unknowns of a mechanism, which is small enough to be taken as it comes."""
    assembly = hb.assemble(hb.load("mechanisms/four_bar"))
    assert len(assembly.x_nominal) and len(assembly.z_nominal)
    usual = hb.simulate(assembly, 0.5, every=0.05)
    monkeypatch.setattr(idas, "LARGE", 1)
    ordered = hb.simulate(assembly, 0.5, every=0.05)
    # to the integrator's tolerances, as its rounding differs
    assert ordered.x == pytest.approx(usual.x, abs=1e-8)
    assert ordered.z == pytest.approx(usual.z, rel=1e-6, abs=1e-6)


def test_pyyaml_reads_the_same_text_from_the_compensator(tmp_path: Path) -> None:
    diagram = compensator.copied(tmp_path / "copy")
    assert len(compensator.files(diagram)) > 20
    assert compensator.same_text(diagram)
    # the copies are what is assembled, not the bundled files
    assert all(tmp_path in leaf.component.path.parents for leaf in
               compensator.running(diagram).assembly.flat.expanded.leaves.values())


@pytest.mark.long
def test_the_command_computes_what_the_library_does() -> None:
    assert compensator.process_disagreement() < 1e-9


def test_the_sensitivities_are_those_of_differences() -> None:
    assert compensator.sensitivity_disagreement(until=3.0) < 1e-3


def test_figures_are_shown_in_units_that_fit() -> None:
    assert duration(0.0861) == "86.1 ms"
    assert duration(1.617) == "1.62 s"
    line = at_most("this", Paired(3.0, 0.5, 6.1), 6)
    assert (line.measured, line.target, line.met) == ("6.10 (3.00 s / 500 ms)", "≤ 6", False)
