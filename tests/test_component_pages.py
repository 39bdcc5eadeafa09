"""The pages about components: formulas are what the files say, and the committed pages are those of today's files."""

from __future__ import annotations

import runpy
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner

from heavebond.cli import main
from heavebond.text.expression import parse_equation, parse_formula
from heavebond.text.tex import equation_tex, formula_tex, symbol_tex, text_tex

COMMITTED = Path(__file__).parent.parent / "docs" / "components"
SCRIPT = runpy.run_path(str(COMMITTED.parent / "component_pages.py"))
made = cache(SCRIPT["pages"])


def test_the_committed_pages_are_those_of_the_files() -> None:
    """`make pages` writes them anew."""
    there = {path.relative_to(COMMITTED).as_posix(): path.read_text("utf-8")
             for path in COMMITTED.rglob("*") if path.is_file()}
    assert sorted(there) == sorted(made()), "run `make pages`"
    stale = [name for name, text in made().items() if there[name] != text]
    assert not stale, "run `make pages`"


def test_a_page_tells_restrictions_first_and_everything_that_the_file_says() -> None:
    page = made()["pneumatic/receiver_with_heat.md"]
    parts = ["**Restrictions.** Ideal gas", "## Ports and signs", "$H_{a}$ enthalpy flow into the component (W)",
             r"\frac{V}{\kappa - 1} \, \dot{p}_{a} &= H_{a} - Q && \text{energy balance} \\", "## Energy",
             r"\text{stored energy}\quad & \frac{p_{a} \, V}{\kappa - 1}", "heat to the walls leaves through no port",
             "| `kappa` | $\\kappa$ | – | `kappa` of the circuit's medium; without one `1.4` | ≥ 1.01, ≤ 1.67 | "
             "ratio of heat capacities (air) |",
             "**heat exchange**", "`G` from 0.01 to 10000 W/K", "Baehr"]
    places = [page.index(part) for part in parts]
    assert places == sorted(places)


def test_blocks_events_and_dormant_effects_have_their_words() -> None:
    assert "`sample` happens again and again, every `T_s`" in made()["signal/sample_hold.md"]
    assert "Dormant inside: **entrained air**, `air`, absent at 0, sought from 0 to 0.05; it wakes with `n_air`." \
        in made()["hydraulic/cylinder.md"]
    assert "[Spring](translational/spring.md)" in made()["index.md"]
    assert "| ![](spring.svg) | [Spring](spring.md) | Linear translational spring. |" in made()["translational/index.md"]


@pytest.mark.parametrize(("written", "tex"), [
    ("F = c*(b.x - a.x)", r"F &= c \, \left(x_{b} - x_{a}\right)"),
    ("p_up = max(a.p, b.p)", r"p_{\mathrm{up}} &= \max\left(p_{a}, p_{b}\right)"),
    ("a.f = -m*g*(1 - e)", r"f_{a} &= -m \, g \, \left(1 - e\right)"),
    ("m * der(a.v) = a.f", r"m \, \dot{v}_{a} &= f_{a}"),
    ("y = a - (b - c)", r"y &= a - \left(b - c\right)"),
    ("y = a - (b + c)", r"y &= a - \left(b + c\right)"),
    ("y = (a/b)**2", r"y &= \left(\frac{a}{b}\right)^{2}"),
    ("y = a + -b*c", r"y &= a + \left(-b \, c\right)"),
    ("y = -a**2", r"y &= -a^{2}"),
    ("y = (-a)**2", r"y &= \left(-a\right)^{2}"),
    ("y = (a**b)**c", r"y &= \left(a^{b}\right)^{c}"),
    ("y = x**((k - 1)/k)", r"y &= x^{\left(k - 1\right)/k}"),
    ("y = 2*1e-5*a", r"y &= 2 \cdot 10^{-5} \, a"),
    ("F = F_c*smooth_sign(v, v_t)", r"F &= F_{\mathrm{c}} \, \tanh\left(\frac{v}{v_{\mathrm{t}}}\right)"),
    ("q = K*signed_sqrt(dp, dp_t)", r"q &= K \, \frac{\Delta p}{\sqrt[4]{\Delta p^2 + \Delta p_{\mathrm{t}}^2}}"),
    ("y = if_else(x > 0 and not u <= 1, a, b)", r"y &= \begin{cases} a & \text{if } x > 0 \text{ and } \text{not } "
                                                r"\left(u \le 1\right) \\ b & \text{otherwise} \end{cases}"),
    ("z = sum(A[i]*sin(i*time) for i in 1..n)", r"z &= \sum_{i=1}^{n} A_{i} \, \sin\left(i \, t\right)"),
    ("sum(p.q) = 0", r"\sum_i q_{p_i} &= 0"),
    ("p[i].p = p[1].p", r"p_{p_{i}} &= p_{p_{1}}"),
    ("y = abs(x)", r"y &= \left\lvert x \right\rvert"),
])
def test_equations_as_tex(written: str, tex: str) -> None:
    assert equation_tex(parse_equation(written)) == tex


def test_a_variable_of_a_port_is_not_taken_for_one_of_the_component() -> None:
    assert formula_tex(parse_formula("a.p - p_a"), ["p_a"]) == r"\text{a.p} - p_{\mathrm{a}}"


def test_names_and_words() -> None:
    assert [symbol_tex(n) for n in ("l0", "dp_t", "sigma_0", "V_A0", "air", "F_s_max")] == [
        "l_{0}", r"\Delta p_{\mathrm{t}}", r"\sigma_{0}", r"V_{\mathrm{A0}}", r"\mathrm{air}",
        r"F_{\mathrm{s},\mathrm{max}}"]
    assert text_tex("50 % of a_b") == r"\text{50 \% of a\_b}"


def test_the_command_writes_pages_and_leaves_other_files_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.md").write_text("# My own page\n")
    gone = tmp_path / "hydraulic" / "gone.md"
    gone.parent.mkdir()
    gone.write_text(made()["index.md"])
    gone.with_suffix(".svg").write_text("<svg/>")
    assert SCRIPT["write_pages"](tmp_path) == sum(name.endswith(".svg") for name in made())
    assert (tmp_path / "pneumatic" / "receiver.md").read_text("utf-8") == made()["pneumatic/receiver.md"]
    assert (tmp_path / "mine.md").exists()
    assert not gone.exists() and not gone.with_suffix(".svg").exists()


def test_the_command_shows_the_example_of_a_component() -> None:
    answer = CliRunner().invoke(main, ["library", "Receiver"])
    assert "Example (heavebond run examples/receiver)" in answer.output
    assert "  compressor: {is: PneumaticFlowSource, u: 2 g/s}" in answer.output
