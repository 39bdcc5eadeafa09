"""Modes by sparse matrices against all modes of the same machine and closed forms."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.cli import main
from heavebond.linear.linearisation import Linearisation
from heavebond.linear.operating_point import OperatingPoints
from heavebond.linear.slow_modes import SlowModes, slow_modes
from heavebond.reports.analysis_tables import named as _named

N, M, C = 60, 2.0, 5e3
ROW = f"""
component: Row
summary: A mass behind a spring.
ports: {{a: translational, b: translational}}
components:
  spring: {{is: Spring, c: {C:g} N/m}}
  mass:   {{is: Mass, m: {M:g} kg}}
nodes:
  left: [a, spring.a]
  right: [spring.b, mass.a, b]
"""
CHAIN = f"""
model: chain
components:
  wall: {{is: Fixed}}
  row:  {{is: Row, repeat: {N}}}
  push: {{is: ForceSource, u: "=1 N*s/m*end.v"}}
nodes:
  ground: [wall.a, row.a]
  end:    [row.b, push.a]
initial: {{start: rest}}
simulate: {{until: 10 s}}
"""
CLOSED = np.sort(2 * np.sqrt(C / M) * np.sin((2 * np.arange(1, N + 1) - 1) * np.pi / (2 * (2 * N + 1))))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "components").mkdir()
    (tmp_path / "components" / "row.yaml").write_text(ROW, encoding="utf-8")
    return tmp_path



def found(model: hb.Model, count: int = 12) -> tuple[SlowModes, np.ndarray]:
    """The slowest modes, and all eigenvalues (imaginary part >= 0) by the dense method."""
    points = OperatingPoints(model)
    point, linearisation = points.at(), Linearisation(points.assembly)
    every = np.array([mode.value for mode in linearisation.at(point).modes()])
    return slow_modes(linearisation, point, 10.0, count), every


def test_the_slowest_modes_of_a_chain_have_their_closed_form(folder: Path) -> None:
    """w_k = 2 sqrt(c/m) sin((2k - 1) pi/(2 (2n + 1))): fixed at one end, free at the other, and undamped."""
    modes, _ = found(hb.loads(CHAIN.replace("1 N*s/m", "0 N*s/m"), folder))
    assert [mode.value.imag for mode in modes.slowest] == pytest.approx(CLOSED[:6], rel=1e-9)
    assert all(abs(mode.value.real) < 1e-9 for mode in modes.slowest)
    assert modes.unstable == 0 and not modes.growing
    assert modes.searched[1] == pytest.approx(CLOSED[-1], rel=0.05)
    first = modes.slowest[0]
    assert first.left.conj() @ first.right == pytest.approx(1)


@pytest.mark.parametrize("push", ["1 N*s/m", "1e-3 N*s/m"])
def test_one_fast_growing_mode_among_slow_ones_is_found(folder: Path, push: str) -> None:
    """A light mass on a stiff spring at the end of the chain, pushed along: its mode grows by as little as 1e-6 of its
    frequency, a thousand times that of the slowest."""
    text = CHAIN.replace("push: {is: ForceSource, u: \"=1 N*s/m*end.v\"}", f"""whip: {{is: Spring, c: 5e5 N/m}}
  tip: {{is: Mass, m: 0.5 kg}}
  push: {{is: ForceSource, u: "={push}*tip.v"}}""")
    text = text.replace("[row.b, push.a]", "[row.b, whip.a]\n  tip: [whip.b, tip.a, push.a]")
    modes, every = found(hb.loads(text, folder))
    mode, = modes.growing
    assert mode.value == pytest.approx(every[-1], rel=1e-9) and mode.value.real > 0


def test_algebraic_unknowns_free_bodies_and_growth_are_those_of_all_modes() -> None:
    """The compensator with a gain beyond its stability boundary."""
    modes, every = found(hb.load("cmc_ahc").with_parameters({"controller.K_p": "7 1/m"}), 4)
    values = [mode.value for mode in modes.slowest]
    assert values == pytest.approx(every[:len(values)].tolist(), rel=1e-7, abs=1e-9)
    grow = {complex(value) for value in every if value.real > 0}
    assert grow
    assert modes.unstable == len(grow)
    for value in grow:
        assert any(mode.value == pytest.approx(value, rel=1e-7) for mode in modes.modes)


def test_the_command_says_what_was_not_computed(folder: Path, monkeypatch: pytest.MonkeyPatch,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(folder)
    (folder / "chain.yaml").write_text(CHAIN, encoding="utf-8")
    with pytest.raises(SystemExit) as caught:
        main(["modes", "chain.yaml", "--slowest", "4", "--json", "told.json"])
    assert caught.value.code == 0
    told = json.loads((folder / "told.json").read_text(encoding="utf-8"))
    assert [mode["imaginary"] for mode in told["modes"][:2]] == pytest.approx(CLOSED[:2], rel=1e-4)
    assert told["stability"] == "unstable"
    out = " ".join(capsys.readouterr().out.split())
    assert "the 4 slowest eigenvalues of 120" in out and "does not exclude others" in out
    with pytest.raises(SystemExit):
        main(["modes", "chain.yaml", "--slowest", "500"])
    assert "500 modes of 120 states" in capsys.readouterr().err


def test_many_small_shares_are_those_of_their_block() -> None:
    assert _named({**{f"string.piece_{k}": 0.04 for k in range(20)}, "hook": 0.2}) == "hook 20 %"
    assert _named({**{f"string.piece_{k}": 0.04 for k in range(24)}, "hook": 0.04}) == "string 96 %"
