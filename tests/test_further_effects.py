"""Which effects after the first are named: those that take a material share and are as strong at all amplitudes."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import heavebond as hb
from heavebond.diagnosis.candidates.catalogue import EffectNumber
from heavebond.diagnosis.evidence.flexible_laws import _as_good, better
from heavebond.diagnosis.evidence.prediction import FITTED, SELECTION, PredictiveErrors
from heavebond.diagnosis.search import stepwise
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.step import fitted_base
from heavebond.diagnosis.search.stepwise import (
    Constancy,
    SelectedEffect,
    Selection,
    constancy,
    doubts,
    near_the_noise,
)

DIAGRAM = """
model: oscillator
components:
  drive:  {is: ForceSource, u: 0 N}
  mass:   {is: Mass, m: 1 kg}
  spring: {is: Spring, c: 39.5 N/m}
  damper: {is: Damper, d: 0.6 N*s/m}
  cubic:  {is: CubicSpring, c_3: 160 N/m**3}
  drag:   {is: Drag, d_2: 0.1 N*s**2/m**2}
  ground: {is: Fixed}
nodes:
  y: [drive.a, mass.a, spring.b, damper.b, cubic.b, drag.b]
  ground: [ground.a, spring.a, damper.a, cubic.a, drag.a]
initial: {y.x: 0 m, y.v: 0 m/s}
"""
MEASURED = """
experiment: an oscillator with a hardening spring
model: oscillator.yaml
records: {noise: {file: noise.csv, use: fit}}
time: {column: t, unit: s}
inputs: {drive.u: {column: u, unit: N, interpolation: spline}}
outputs: {y.x: {column: y, unit: m, noise: 0.1 mm}}
free: {spring.c: 39.5 N/m +- 20 %, damper.d: 0.6 N*s/m +- 50 %, cubic.c_3: 0 .. 500 N/m**3, drag.d_2: 0 .. 5 N*s**2/m**2}
"""


def record(file: Path, d_2: float, d_22: float, quiet: float = 0.0) -> None:
    """Growing noise on an oscillator whose damping force has d_2 v |v| and d_22 y**2 v (Runge-Kutta, 20 steps each), at rest
    in the share `quiet` of the record."""
    random, n, fs, steps = np.random.default_rng(1), 1200, 9.0, 20
    frequency = np.fft.rfftfreq(n, 1 / fs)
    u = np.fft.irfft(np.exp(2j * np.pi * random.random(len(frequency))) * ((frequency > 0) & (frequency < 2.4)), n)
    t, u = np.arange(n) / fs, u / u.std() * np.linspace(0.3, 1.7, n) * (np.arange(n) >= quiet * n)
    fine = CubicSpline(t, u)(np.arange(2 * steps * (n - 1) + 1) / fs / steps / 2).tolist()

    def rate(force: float, y: float, v: float) -> tuple[float, float]:
        return v, force - 0.6 * v - d_2 * v * abs(v) - d_22 * y * y * v - 39.5 * y - 160 * y**3

    h, y, v, found = 1 / fs / steps, 0.0, 0.0, [0.0]
    for k in range(steps * (n - 1)):
        a = rate(fine[2 * k], y, v)
        b = rate(fine[2 * k + 1], y + h / 2 * a[0], v + h / 2 * a[1])
        c = rate(fine[2 * k + 1], y + h / 2 * b[0], v + h / 2 * b[1])
        d = rate(fine[2 * k + 2], y + h * c[0], v + h * c[1])
        y += h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        v += h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        if (k + 1) % steps == 0:
            found.append(y)
    measured = np.array(found) + 1e-4 * random.standard_normal(n)
    np.savetxt(file, np.column_stack([t, u, measured]), delimiter=",", header="t,u,y", comments="")


@pytest.mark.parametrize(("d_2", "d_22", "quiet", "differs"), [
    (0.15, 0.0, 0.0, False), (0.0, 4.8, 0.0, True), (0.15, 0.0, 0.5, False)])
def test_a_number_is_constant_where_its_law_is_the_machine_s(d_2: float, d_22: float, quiet: float, differs: bool,
                                                            tmp_path: Path) -> None:
    """Quadratic damping takes nearly all of the misfit of a damping that grows with the square of the distance; its strength
    at small and at large motion tells them apart. Times at which the machine is at rest do not count."""
    (tmp_path / "oscillator.yaml").write_text(DIAGRAM)
    (tmp_path / "measured.yaml").write_text(MEASURED)
    record(tmp_path / "noise.csv", d_2, d_22, quiet)
    base: Base = fitted_base(hb.load_experiment(tmp_path / "measured.yaml"))
    unit = next(iter(base.problem.columns)).free.range.unit
    found = constancy(base, [EffectNumber("drag.d_2", unit, 0.0, None, None, True)])
    assert found is not None and found.differs is differs
    if not differs:
        assert found.strength == pytest.approx([1] * 5, abs=0.03)
    # a number without a neutral value has no strength
    assert constancy(base, [EffectNumber("damper.d", unit, 0.0, None, None, False)]) is None


def test_an_effect_that_does_not_act_in_the_fitted_part_has_no_strength(tmp_path: Path) -> None:
    """The last third is held out: the machine is at rest in all fitted samples, and the response underflows when squared."""
    (tmp_path / "oscillator.yaml").write_text(DIAGRAM)
    (tmp_path / "measured.yaml").write_text(MEASURED)
    record(tmp_path / "noise.csv", 0.15, 0.0, 0.8)
    base: Base = fitted_base(hb.load_experiment(tmp_path / "measured.yaml"))
    unit = next(iter(base.problem.columns)).free.range.unit
    assert constancy(base, [EffectNumber("drag.d_2", unit, 0.0, None, None, True)]) is None


def errors(chi2: float) -> PredictiveErrors:
    counts, half = np.full(40, 50.0), np.repeat([FITTED, SELECTION], 20)
    return PredictiveErrors(chi2 * counts, counts, half, half)


def ladder(*chi2: float, given: bool = True) -> Selection:
    """A ladder whose models leave these chi-squares, the first without an effect."""
    found: list[Any] = []
    for before, after in pairwise(chi2):
        candidate = SimpleNamespace(label=str(after), kind="dry friction", place="at b", component="X", attaches="at")
        trial = SimpleNamespace(errors=errors(after), chi2_fit=after, chi2_held_out=after, samples=2000,
                                samples_held_out=2000, experiment=SimpleNamespace(noise_given=given), candidate=candidate)
        step: Any = SimpleNamespace(errors=errors(before), chosen=trial, chi2_held_out=before, chi2_fit=before,
                                    samples_held_out=2000, experiment=None)
        found.append(SelectedEffect(step, ()))
    return tuple(found)


def curve(chi2: float) -> Any:
    candidate = SimpleNamespace(place="at b", kind="unknown law")
    return SimpleNamespace(errors=errors(chi2), chi2_fit=chi2, chi2_held_out=chi2, candidate=candidate)


@pytest.mark.parametrize(("chi2", "given", "varies", "other_law", "named"), [
    ((1000, 100, 20), True, False, 99.0, 2),       # most of the residual before it, constant
    ((1000, 100, 20), True, True, 99.0, 1),        # not constant
    ((1000, 100, 20), True, False, 55.0, 1),       # another law of the first explains more than half of that
    ((1000, 100, 20), True, False, 61.0, 2),       # less than half
    ((20000, 25, 1.0), True, True, 1.0, 2),        # the noise is left: nothing is asked
    ((1000, 1.2, 1.0), True, False, 1.0, 1),       # it was near the noise already
    ((1000, 100, 70, 20), True, False, 99.0, 3),
    ((1000, 990), True, True, 1.0, 1)])            # the first is named by other rules
def test_a_further_effect_is_judged_against_the_residual_before_it(
        chi2: tuple[float, ...], given: bool, varies: bool, other_law: float, named: int, monkeypatch: pytest.MonkeyPatch
        ) -> None:
    strength = Constancy((0.5, 0.7, 1.0, 1.1, 1.3) if varies else (1.0,) * 5, 1e-6 if varies else 0.6)
    monkeypatch.setattr(stepwise, "_constancy", lambda added: strength)
    monkeypatch.setattr(stepwise, "_at_earlier_place", lambda way: lambda candidate: False)
    doubtful = doubts(ladder(*chi2, given=given), lambda text: None,
                      curves=lambda experiment, among: cast(Any, SimpleNamespace(trials=(curve(other_law),))))
    assert len(doubtful) == len(chi2) - 1 - named
    if doubtful:
        assert ("0.5 to 1.3 times" if varies else "another law at b") in doubtful[0].words


def test_a_further_effect_at_the_place_of_an_earlier_one_is_part_of_the_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """Laminar and turbulent leakage at one gap: a curve there explains as much, and both are leakage."""
    monkeypatch.setattr(stepwise, "_at_earlier_place", lambda way: lambda candidate: True)
    assert doubts(ladder(7e6, 672, 4.3), lambda text: None) == []


@pytest.mark.parametrize(("chi2", "ends"), [
    ((1000, 1.3), False),           # a second effect may show that the first is wrong
    ((1000, 100, 1.3), True),       # near the noise: a further effect would be within its error
    ((20000, 25, 4), False)])       # a small share of the first misfit, but four times the noise
def test_a_search_ends_near_the_noise(chi2: tuple[float, ...], ends: bool) -> None:
    assert near_the_noise(ladder(*chi2)) is ends


def test_a_curve_at_another_place_predicts_as_well_only_where_it_explains_half_as_much() -> None:
    """Errors in one of forty blocks, as of a machine that runs away in it: no difference of two is significant then."""
    def leaving(chi2: float) -> Any:
        sums = errors(1.0).sums.copy()
        sums[3] += (chi2 - 1.0) * errors(1.0).counts.sum()
        return SimpleNamespace(errors=replace(errors(1.0), sums=sums), slack=0.0)

    named, misfit = leaving(6.0), 1000.0
    assert not better(named, leaving(900.0))
    assert not _as_good(leaving(600.0), named, misfit)  # 40 % of the misfit, where the law takes more than 99 %
    assert _as_good(leaving(450.0), named, misfit)
    assert _as_good(leaving(40.0), named, misfit)       # 3 % of the misfit more
