"""Elements of SIDOPS one by one: delays, whole numbers, constants, descriptions, and what an earlier import has left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from test_import_20sim import at, one_part, run_part
from test_import_20sim_models import imported, part

from heavebond.cli import main
from heavebond.import_20sim.importer import import_emx
from heavebond.language.library import library


def written(folder: Path, text: str) -> dict[str, str]:
    """The files of an import."""
    (folder / "cart.emx").write_text(text)
    return import_emx(folder / "cart.emx", frozenset(library().names())).files


def test_a_delay_in_an_equation_is_that_of_pade(tmp_path: Path) -> None:
    """A sine that begins slowly, delayed by 0.3 s; the delay changes nothing in it but its phase."""
    text = one_part("parameters\n real T = 0.3 {s};\nequations\n y = 2 * tdelay (sin (2 * time)^2, T);", "y", 4)
    run = run_part(tmp_path, text, untranslated=1)  # how it is approximated
    late = run.time > 1.5
    # the phase error of order 6 at 4 rad/s and 0.3 s is below 1e-6
    assert run["Part.y"][late] == pytest.approx(2 * np.sin(2 * (run.time[late] - 0.3))**2, abs=2e-5)


def test_a_submodel_that_delays_its_input_is_the_delay_of_the_library(tmp_path: Path) -> None:
    parts = part("Source", "signal out y", "equations\n y = sin (time)^2;") + \
        part("Late", "signal in input; signal out output", "parameters\n real T = 0.25 {s};\nequations\n"
             " output = tdelay (input, T);") + \
        part("Use", "signal in u; signal out y", "equations\n y = u^2 + u;")
    imported(tmp_path, parts, "Source\\y -> Late\\input; Late\\output -> Use\\u", 2.0, untranslated=1)
    diagram = next(tmp_path.rglob("*.yaml")).parent
    text = "\n".join(path.read_text() for path in diagram.glob("*.yaml"))
    assert "{is: Delay, T: 0.25 s" in text


def test_the_rest_of_a_division_counts_from_zero_in_both_directions(tmp_path: Path) -> None:
    run = run_part(tmp_path, one_part("equations\n up = time mod 0.4;\n down = (1 - time) mod 0.4;\n n = time div 0.5;",
                                      "up down n"))
    assert at(run, "up", 0.3, 0.5, 1.9) == pytest.approx([0.3, 0.1, 0.3])
    assert at(run, "down", 0.4, 1.3, 1.9) == pytest.approx([0.2, -0.3, -0.1])
    assert at(run, "n", 0.4, 0.9, 1.9) == [0, 1, 3]


def test_constants_descriptions_and_derivatives_of_expressions(tmp_path: Path) -> None:
    body = ("constants\n real C[2,3] = [1, 2, 3; 4, 5, 6];\nvariables\n real x {m};\n \"the square of the time\"\n"
            "equations\n x = time^2;\n y = C[2,1] * ddt (x * time);\nfinalequations\n x = 0;")
    text = one_part(body, "y").replace("signal out y;", "signal out y {N}; \"what comes out\"")
    assert at(run_part(tmp_path, text), "y", 0.5, 1.5) == pytest.approx([4 * 3 * 0.25, 4 * 3 * 2.25], rel=1e-6)
    (component,) = (t for name, t in written(tmp_path, text).items() if name.startswith("components/"))
    assert "what comes out" in component and "doc: the square of the time" in component


def test_a_component_of_the_library_keeps_the_global_quantity_that_feeds_it(tmp_path: Path) -> None:
    """`Own` hands a global quantity on that another submodel computes: a Gain of 1 by its law."""
    parts = part("Maker", "signal out y", "variables\n real global G;\nequations\n G = 3 * time;\n y = 0;") + \
        part("Own", "signal out y", "variables\n real global G;\nequations\n y = G;") + \
        part("Use", "signal in u; signal out y", "equations\n y = u + 1;")
    run = imported(tmp_path, parts, "Own\\y -> Use\\u", 2.0)
    assert run["Use.y"][-1] == pytest.approx(7)


def test_an_import_tells_what_an_earlier_one_has_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = one_part("equations\n y = time^2;", "y")
    written(tmp_path, text)
    assert CliRunner().invoke(main, ["import", "cart.emx"]).exit_code == 0
    own = Path("cart/components/mine.yaml")
    own.write_text("component: Mine\nsummary: My own.\nports: {y: {signal: out, unit: 1}}\nequations: y = 1\n")
    written(tmp_path, text.replace("type Own", "type Other"))
    answer = CliRunner().invoke(main, ["import", "cart.emx"])
    assert "no longer part of the model: cart/components/own.yaml" in answer.output
    assert "mine.yaml" not in answer.output
    assert Path("cart/components/own.yaml").exists() and Path("cart/components/other.yaml").exists()


def test_plotted_quantities_of_ports_keep_their_sign(tmp_path: Path) -> None:
    """A source pushes 3 into a resistance of 2: 1.5 flow out of the one and into the other."""
    parts = part("Source", "power out p", "equations\n p.e = 3;\n") + \
        part("Load", "power in p", "parameters\n real r = 2;\nequations\n p.e = r * p.f + 0 * time;")
    curves = "".join(f"<Curve><YCurveData><VarName>{name}</VarName></YCurveData></Curve>"
                     for name in ("Source\\p.f", "Load\\p.f", "Load\\p.e"))
    run = imported(tmp_path, parts, "Source\\p => Load\\p", 1.0, f"<PlotSpecs><Plots><Plot><Curves>{curves}</Curves></Plot>"
                   "</Plots></PlotSpecs>")
    assert [float(run.display[n][-1]) for n in ("Source_p_f", "Load_p_f", "Load_p_e")] == pytest.approx([1.5, 1.5, 3.0])
