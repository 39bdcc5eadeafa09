"""Numbers are written with the digits 0 to 9, wherever they are read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.numerals import number, plain, whole
from heavebond.core.units import UnitProblem, parse_quantity, parse_range, unit
from heavebond.records.clock_times import ClockProblem, read_clock
from heavebond.records.measurements import column, read_table
from heavebond.text.expression import ExpressionProblem, parse_formula

# underscores as in Python, Arabic-Indic, Devanagari, full-width and superscript digits
ODD = ("1_0", "\u0661\u0662", "\u0967\u0968", "\uff11\uff12", "1\u00b2", "1\u0663")
SOURCE = Path(hb.__file__).parent


@pytest.mark.parametrize("text", ODD)
def test_underscores_and_digits_of_other_scripts_are_no_numbers(text: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is not a number"):
        number(text)
    assert whole(text) is None and not plain([text])
    for bad in (text, f"{text}.5", f"1e{text}"):
        path = tmp_path / "record.csv"
        path.write_text(f"t,x\n0,1\n1,{bad}\n2,3\n", encoding="utf-8")
        with pytest.raises(hb.DataError, match=r"is not a number \[record-text\]"):
            column(read_table(path), "x")
        for read, words in ((parse_quantity, f"{bad} kN"), (parse_range, f"{bad} .. 70 kN"),
                            (parse_range, f"5 kN +- {bad} %")):
            with pytest.raises(UnitProblem):
                read(words)
        with pytest.raises(ExpressionProblem):
            parse_formula(f"{bad}*x")
    with pytest.raises(UnitProblem):
        unit(f"m**{text}")
    with pytest.raises(ClockProblem):
        read_clock([f"12:{text}:00", "12:13:00"])
    with pytest.raises(ClockProblem):
        read_clock([f"2024-05-{text} 12:00:00"])


@pytest.mark.parametrize("text", ODD)
def test_a_saved_run_with_an_odd_number_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(f"time [s],x [m],rows left [1]\n0,{text},1\n1,2,0\n", encoding="utf-8")
    with pytest.raises(hb.DataError, match="not a number"):
        hb.read_run(tmp_path / "r.csv")


@pytest.mark.parametrize("text", [*ODD, "nan", "inf", "1e999"])
def test_the_command_line_refuses_them_too(text: str, tmp_path: Path) -> None:
    for command in (["run", "cmc_ahc", "--rtol", text], ["run", "cmc_ahc", "--until", f"{text} s"],
                    ["tune", "x.yaml", "--starts", text], ["sweep", "cmc_ahc", "--over", f"gas.c=1 .. 2 kN/m; {text}"],
                    ["sweep", "cmc_ahc", "--over", "gas.c=1 .. 2 kN/m", "--sample", f"sobol:{text}"],
                    ["diagnose", "x.yaml", "--seconds", text]):
        ended = CliRunner().invoke(main, command)
        assert ended.exit_code == 2, command
        assert "Traceback" not in ended.output


def test_counts_in_files_have_plain_digits(tmp_path: Path) -> None:
    from heavebond.diagnosis.answer.files import _counted

    assert _counted("rig_\u00b2", 1) == "rig_\u00b2_2"
    assert whole("9" * 5000) is None


def test_numbers_of_the_usual_forms_are_read() -> None:
    for text, value in (("1", 1.0), (" -1.5e-3 ", -1.5e-3), (".5", 0.5), ("5.", 5.0), ("+2E+6", 2e6), ("inf", float("inf"))):
        assert number(text) == value


def test_no_module_reads_numbers_by_a_grammar_of_its_own() -> None:
    for path in SOURCE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        # of editors; of SUNDIALS; of the names and indices in equations that the module wrote
        if path.name not in ("json_schema.py", "failure_messages.py", "modelica.py", "modelica_text.py"):
            assert not re.search(r"\\d(?![a-z])", text), path  # `\\cdot` is TeX
        if path.name != "arguments.py":
            assert not re.search(r"click\.(FloatRange|IntRange|FLOAT|INT)\b", text), path
        if path.name != "numerals.py":
            assert not re.search(r"\bint\((text|word|words|cell|steps)\b", text), path
