"""`heavebond candidates`, `try`, `diagnose` and `ladder` used wrongly: what is wrong, and what to type instead.

Nothing here may reach the search: every mistake is told before it.
"""

from __future__ import annotations

import errno
import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from heavebond import cli
from heavebond.diagnosis.answer.files import Targets
from heavebond.estimation.experiment import load_experiment
from heavebond.language.library import bundled

# a spring that is to take the place of another one; %s is what the test gets wrong
OWN = """\
component: FirmSpring
summary: A spring that stiffens.
ports: {a: translational, b: translational}
parameters:
  c: {unit: N/m, min: 0, doc: stiffness}
  k: {unit: N/m**3, min: 0, default: 0 N/m**3, doc: stiffening}
variables:
  s: {unit: m, doc: elongation}
equations: |
  s   = b.x - a.x           # elongation
  b.f = c * s + k * s**3    # law
  a.f = -c * s - k * s**3   # reaction
stores: c * s**2/2 + k * s**4/4
effect:
  class: nonlinear stiffness
  description: a spring that stiffens
  amplitude: [k]
  replaces: %s
  start: {c: %s}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Every test runs in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    return tmp_path


def call(*words: str) -> Result:
    return CliRunner().invoke(cli.main, words)


@pytest.mark.parametrize(("words", "said"), [
    (("try", "receiver_rig/choked", "PneumaticOrfice"), """\
no effect 'PneumaticOrfice' fits anywhere in this diagram [try-unknown]
  Did you mean 'PneumaticOrifice' or 'PneumaticLine'?
"""),
    (("try", "receiver_rig/choked", "inlet.b"), """\
no effect 'inlet.b' fits anywhere in this diagram [try-unknown]
  Did you mean 'inlet.b_cr'?
"""),
    (("try", "passive_rig/friction", "Accumulator"), """\
no effect 'Accumulator' fits anywhere in this diagram [try-unknown]
  `heavebond candidates` lists what does.
"""),
    (("try", "passive_rig/friction", "CoulombFriction"), """\
CoulombFriction fits at several places [try-places]
  Say which, with --between NODE NODE or --at NAME: between platform and crown, between seabed and crown, \
between platform and seabed.
"""),
    (("try", "passive_rig/friction", "CoulombFriction", "--between", "platform", "crwn"), """\
CoulombFriction does not fit at platform, crwn [try-place]
  It fits between platform and crown, between seabed and crown, between platform and seabed.
"""),
    (("try", "passive_rig/friction", "CoulombFriction", "--at", "gas.c"), """\
CoulombFriction does not fit at gas.c [try-place]
  It fits between platform and crown, between seabed and crown, between platform and seabed.
"""),
    (("try", "passive_rig/friction", "dry friction", "--between", "platform", "crown"), """\
'dry friction' is a class of effects, not one of them [try-class]
  Try CoulombFriction, DahlFriction, DirectionalFriction, LuGreFriction, StribeckFriction.
"""),
    (("try", "passive_rig/friction", "choked flow"), """\
no effect 'choked flow' fits anywhere in this diagram [try-unknown]
  `heavebond candidates` lists what does.
"""),
    (("try", "passive_rig/friction", "CoulombFriction", "--between", "crown", "crown"), """\
'crown' is named twice; an effect between two nodes needs two [try-place]
  Write --between and the names of two different nodes.
"""),
    (("diagnose", "passive_rig/friction", "--only", "dry fricton"), """\
no effect of class 'dry fricton' fits in this diagram [class-unknown]
  Did you mean 'dry friction'?
"""),
    (("diagnose", "receiver_rig/choked", "--only", "dry friction"), """\
no effect of class 'dry friction' fits in this diagram [class-unknown]
  Classes: choked flow, ..., heat exchange, ..., unknown law, value of a parameter.
"""),
    (("diagnose", "passive_rig/friction", "--only", "dry"), """\
no effect of class 'dry' fits in this diagram [class-unknown]
  Did you mean 'dry friction'?
"""),
    (("fit", "receiver_rig/choked", "--profile", "inlet.c"), """\
--profile inlet.c: this parameter is not free [free-unknown]
  Did you mean 'inlet.C'?
"""),
    (("compare", __file__), f"""\
'{__file__}' is not a YAML file [file-suffix]
  Give the experiment, whose name ends in .yaml.
"""),
    (("diagnose", "receiver_rig/choked", "--report", "found.txt"), """\
'found.txt' does not end in .html [file-suffix]
  Write for example found.html.
"""),
    (("errors", "passive_rig/friction", "receiver_rig/choked"), """\
choked.yaml and friction.yaml have different records or channels, so their errors cannot be compared [ladder-records]
  Let the later experiments `extends:` the first one.
"""),
])
def test_what_is_said_of_a_mistake(words: tuple[str, ...], said: str, folder: Path) -> None:
    answer = call(*words)
    assert answer.exit_code == 2
    # `...` stands for classes that the library may gain
    assert re.fullmatch(re.escape(said).replace(re.escape(", ..., "), ", (?:[^\n]*, )?"), answer.stderr), answer.stderr
    assert not list(folder.iterdir())


def test_a_file_of_the_users_is_told_before_the_fit(folder: Path) -> None:
    (folder / "rig.yaml").write_text("mine")
    answer = call("fit", "receiver_rig/choked", "--write", "rig.yaml")
    assert (answer.exit_code, answer.stdout) == (2, "")
    assert answer.stderr == "rig.yaml exists already [file-exists]\n  Give another name, or remove it first.\n"


def test_a_folder_that_takes_no_file_is_told_before_the_search(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a medium does that is read only, whatever its rights say."""
    def full(**_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("tempfile.TemporaryFile", full)
    for words, place in ((("diagnose", "receiver_rig/choked"), "nothing can be written in '.'"),
                         (("compare", "receiver_rig/choked", "--output", "a.png"), "'a.png' cannot be written")):
        answer = call(*words)
        assert (answer.exit_code, answer.stdout) == (2, "")
        assert answer.stderr.startswith(f"{place}: read-only file system [file-unwritable]\n")


def test_a_folder_is_made_with_its_parents(folder: Path) -> None:
    given = load_experiment("receiver_rig/choked")
    assert Targets.beside(given, Path("results/monday")).pair(0)[1] == Path("results/monday/choked_2.yaml")
    assert (folder / "results" / "monday").is_dir()
    (folder / "taken").write_text("mine")
    answer = call("diagnose", "receiver_rig/choked", "--folder", "taken/monday")
    assert answer.exit_code == 2
    assert answer.stderr == "the folder 'taken/monday' cannot be created: not a directory [file-unwritable]\n" \
        "  Give another one.\n"


@pytest.mark.parametrize("there", ["choked_2.yaml", "receiver_rig_2.yaml", "choked_2_input.csv"])
def test_nothing_is_written_over(there: str, folder: Path) -> None:
    given = load_experiment("receiver_rig/choked")
    (folder / there).write_text("mine")
    (folder / "choked_4.yaml").write_text("mine too")
    (folder / "choked_report.html").write_text("an earlier one")
    found = Targets.beside(given, None)
    assert [found.pair(k)[1].name for k in range(3)] == ["choked_3.yaml", "choked_5.yaml", "choked_6.yaml"]
    assert (found.proposal.name, found.report.name) == ("choked_3_input.csv", "choked_report_2.html")
    assert found.passed == Path(there)


@pytest.mark.long
def test_a_diagnosis_can_be_repeated(folder: Path) -> None:
    """The same command again keeps the files of the first and writes others."""
    words = ("diagnose", "receiver_rig/choked", "--only", "choked flow", "--processes", "1")
    assert call(*words).exit_code == 0
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    again = call(*words)
    assert again.exit_code == 0, again.stderr
    assert "receiver_rig_2.yaml exists and is kept: the new files have the next free number" in again.stdout
    assert "wrote choked_3.yaml" in again.stdout and "wrote choked_report_2.html" in again.stdout
    assert {name: (folder / name).read_bytes() for name in before} == before
    assert load_experiment(folder / "choked_3.yaml").model.path.name == "receiver_rig_3.yaml"


@pytest.mark.long
def test_a_file_that_try_is_told_to_write(folder: Path) -> None:
    """An earlier result is kept, the next free number is taken; a file of the user is refused."""
    words = ("try", "receiver_rig/choked", "inlet.b_cr", "--write", "results/choking.yaml")
    first, again = call(*words), call(*words)
    assert (first.exit_code, again.exit_code) == (0, 0), again.stderr
    assert "wrote results/choking.yaml" in first.stdout and "next free number" not in first.stdout
    assert "results/choking_diagram.yaml exists and is kept" in again.stdout
    assert "wrote results/choking_2.yaml" in again.stdout
    assert load_experiment(folder / "results" / "choking_2.yaml").model.path.name == "choking_diagram_2.yaml"
    assert "next: heavebond compare results/choking_2.yaml; heavebond diagnose" in again.stdout
    unjustified = call(*words[:2], "outlet.b_cr", "--write", "results")
    assert "does not lower the error" in unjustified.stdout and "heavebond diagnose" not in unjustified.stdout
    (folder / "mine.yaml").write_text("experiment: mine")
    refused = call(*words[:-1], "mine.yaml")
    assert refused.exit_code == 2
    assert refused.stderr == "mine.yaml exists already [file-exists]\n  Give another name, or remove it first.\n"
    assert (folder / "mine.yaml").read_text() == "experiment: mine"


@pytest.mark.parametrize(("replaces", "start", "said"), [
    ("Sprng", "old.c", """\
rig/firm_spring.yaml:15: there is no component 'Sprng' [component-unknown]
   15 |   class: nonlinear stiffness
      |   ^
  Did you mean 'Spring' or 'GasSpring'?
"""),
    ("Spring", "2*old.k", """\
rig/firm_spring.yaml:19: 'old.k' is not a parameter of Spring [effect-start]
   19 |   start: {c: 2*old.k}
      |              ^^^^^^^
  Did you mean 'old.c' or 'old.l0'?
"""),
    ("Fixed", "1", """\
rig/firm_spring.yaml:15: FirmSpring cannot take the place of Fixed: their ports have other names [effect-ports]
   15 |   class: nonlinear stiffness
      |   ^
  Fixed has a.
"""),
])
def test_an_effect_that_cannot_take_anothers_place(replaces: str, start: str, said: str, folder: Path) -> None:
    shutil.copytree(bundled("models") / "passive_rig", folder / "rig")
    (folder / "rig" / "firm_spring.yaml").write_text(OWN % (replaces, start))
    answer = call("candidates", "rig/friction.yaml")
    assert answer.exit_code == 1
    assert answer.stderr == said


def test_what_candidates_lists_can_be_typed(folder: Path) -> None:
    listed = call("candidates", "cylinder_rig/leakage").stdout
    assert "cylinder.leakage" in listed
    # one of several places of the same two nodes is told by the node that presses
    several = call("try", "cylinder_rig/leakage", "SealFriction", "--between", "frame", "load")
    assert "pressed by chamber_a" in several.stderr
    told = call("try", "cylinder_rig/leakage", "SealFriction", "--between", "frame", "load", "--at", "chamber_x")
    assert "does not fit" in told.stderr
