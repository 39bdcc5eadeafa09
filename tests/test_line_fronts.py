"""Fronts that are shorter than the segments of a line: the run says so, with the number of segments that resolves them."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.errors import RunWarning
from heavebond.numerics.result import Result

LENGTH, RHO, BETA, D = 20.0, 998.0, 2.2e9, 0.05
CLOSING = """
model: closing
components:
  s: {{is: PressureSource, p_0: 30 bar}}
  w: {{is: Fluid, rho: 998 kg/m**3, nu: 1 mm**2/s, beta: 2.2 GPa}}
  l: {{is: {line}, n: {n}, length: 20 m, d: 50 mm}}
  v: {{is: FlowSource, u: "=-120 L/min*(1 - min(max((time - 2 ms)/({closing} s), 0), 1))"}}
nodes: {{s: [s.a, w.a, l.a], e: [l.b, v.a]}}
initial: {{start: steady}}
simulate: {{until: 28 ms, every: 0.05 ms}}
"""
ROD = """
model: rod
components:
  f: {{is: Fixed}}
  r: {{is: DistributedDrillString, n: {n}, L: 100 m, D_o: 0.1 m, T_d: 0 s, g: 0 m/s**2}}
  p: {{is: ForceSource, u: "=10 kN*min(time/({rise} s), 1)"}}
nodes: {{t: [f.a, r.a], b: [r.b, p.a]}}
initial: {{start: steady}}
simulate: {{until: 19 ms, every: 0.05 ms}}
"""


def run(text: str) -> Result:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RunWarning)
        return hb.simulate(hb.loads(text))


def peak(found: Result) -> float:
    """The rise of the pressure at the valve over that of Joukowsky, rho*a*v."""
    speed = np.sqrt(BETA / RHO)
    return float((found["e.p"].max() - found["e.p"][0]) / (RHO * speed * 2e-3 / (np.pi / 4 * D**2)))


@pytest.mark.long
@pytest.mark.parametrize("line", ["Line", "DynamicLine"])
def test_a_front_shorter_than_a_segment_is_reported_with_the_segments_that_resolve_it(line: str) -> None:
    closing = 1.5 * LENGTH / 10 / np.sqrt(BETA / RHO)  # 1.5 of 10 segments
    found = run(CLOSING.format(line=line, n=10, closing=closing))
    assert peak(found) > 1.15
    findings = [f for f in found.verdict.findings if f.kind == "front"]
    assert [f.part for f in findings] == ["l"]
    assert not found.verdict.failed
    number = int(re.findall(r"about (\d+) segments", findings[0].advice)[0])
    assert 50 <= number <= 100  # nine segments in the front: 60
    resolved = run(CLOSING.format(line="Line", n=number, closing=closing))
    assert not [f for f in resolved.verdict.findings if f.kind == "front"]
    assert peak(resolved) < 1.06


@pytest.mark.parametrize("line", ["Line", "DynamicLine"])
def test_a_front_of_many_segments_is_not_reported(line: str) -> None:
    found = run(CLOSING.format(line=line, n=20, closing=8e-3))
    assert found.verdict.status == "clean"
    assert peak(found) < 1.03


def test_a_blow_on_a_rod_is_reported_where_it_is_shorter_than_an_element() -> None:
    found = run(ROD.format(n=20, rise=0.2e-3))  # the elements take 1 ms each
    assert [(f.kind, f.part) for f in found.verdict.findings] == [("front", "r")]
    assert run(ROD.format(n=20, rise=10e-3)).verdict.status == "clean"


def test_segments_in_a_series_of_the_diagram_are_one_line() -> None:
    text = CLOSING.format(line="Line", n=10, closing=1e-4).replace("is: Line, n: 10, length: 20 m", "is: LineSegment, "
                                                                    "repeat: 10, length: 2 m")
    found = run(text)
    assert [(f.kind, f.part) for f in found.verdict.findings] == [("front", "l")]


@pytest.mark.filterwarnings("ignore::heavebond.RunWarning")
@pytest.mark.parametrize("line", ["DynamicLine", "Line", "TransmissionLine"])
def test_a_valve_that_shuts_at_once_gives_the_shock_of_joukowsky_or_a_warning(line: str) -> None:
    """20 L/min in 20 mm: rho c v = 11.7 bar above 10 bar; lines of 4 segments are up to 45 % too high and say so."""
    segments = "" if line == "TransmissionLine" else "n: 4, "
    found = hb.simulate(hb.loads(f"""
model: shut
components:
  f: {{is: Fluid, rho: 870 kg/m**3, nu: 1e-6 m**2/s, beta: 1.4 GPa}}
  s: {{is: PressureSource, p_0: 20 bar}}
  l: {{is: {line}, {segments}length: 20 m, d: 20 mm}}
  q: {{is: FlowSource, u: "=if_else(time < 0.1 s, -20 L/min, 0 L/min)"}}
nodes: {{a: [s.a, l.a, f.a], b: [l.b, q.a]}}
initial: {{start: steady}}
simulate: {{until: 0.12 s}}
"""))
    shock = 870 * np.sqrt(1.4e9 / 870) * 20 / 6e4 / (np.pi * 0.01**2)
    rise = (found.si["b.p"].max() - 20e5) / shock
    warned = any("segments" in finding.advice for finding in found.verdict.findings)
    assert rise == pytest.approx(1, rel=2e-3) if line == "TransmissionLine" else (rise > 1.2 and warned)
