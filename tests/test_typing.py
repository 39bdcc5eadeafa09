"""Type checkers on a project that uses heavebond: `py.typed` holds."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import heavebond as hb

pytestmark = pytest.mark.long

PROJECT = '''
"A project that uses heavebond: what its author's type checker sees."

from __future__ import annotations

from pathlib import Path

import heavebond as hb


def rig(stiffness: float) -> hb.Diagram:
    diagram = hb.Diagram("rig", "A load on a spring.")
    diagram.add("Fixed", "wall").add("Spring", "spring", c=stiffness).add("Mass", "load", m="250 kg")
    diagram.connect("wall.a", "spring.a").connect("spring.b", "load.a", node="load")
    diagram.initial({"load.x": "20 mm", "load.v": "0 m/s"}).show("place", "load.x", unit="mm")
    return diagram.update(simulate={"until": "1 s", "every": "10 ms"})


def largest(run: hb.Result, name: str) -> float:
    signal: hb.Signal = run[name]
    return float(signal.to("m").magnitude.max())


def analysed(folder: Path) -> dict[str, float]:
    model: hb.Model = rig(42e3).model()
    run: hb.Result = hb.simulate(model, "2 s")
    modes: hb.Modes = hb.modes(model)
    audit: hb.EnergyAudit = hb.energy(model)
    ranking: hb.Rankings = hb.sensitivity(model, ["place"])
    swept: hb.StudyResult = hb.sweep(model, {"load.m": ["200 kg", 250.0]}, "rms(load.x) in mm", processes=1)
    analysis: hb.SignalAnalysis = hb.signal(run, "place")
    page: hb.TextPage = hb.check(model)
    path: Path = rig(1e3).save(folder / "rig.yaml")
    try:
        hb.simulate(path, parameters={"load.m": "3 N"})
    except hb.UsageError as error:
        print(error.problems[0].code)
    figures: dict[str, float] = {"frequency": modes.frequencies[0], "largest": largest(run, "place"), "energy": audit.stored,
                                 "influence": ranking["place"].influences[0].relative, "height": analysis.deviation}
    print(page, len(swept.outcomes))
    return figures
'''
WRONG = '''
import heavebond as hb

run = hb.simulate("cmc_ahc")
number: int = run.time
hb.modes("cmc_ahc", at="1 s", slowst=3)
hb.Diagram("rig").add("Mass")
'''


def run(*command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=900)


def test_the_example_project_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scope: dict[str, object] = {"__name__": "project"}
    exec(compile(PROJECT, "project.py", "exec"), scope)
    figures = scope["analysed"](tmp_path)  # type: ignore[operator]
    assert figures["largest"] == pytest.approx(0.02) and "unit-wrong" in capsys.readouterr().out
    assert figures["frequency"] == pytest.approx((42e3 / 250)**0.5 / 6.283185, rel=1e-6)


def test_mypy_accepts_the_example_project_and_finds_mistakes(tmp_path: Path) -> None:
    mypy = (sys.executable, "-m", "mypy", "--strict", "--config-file=", "--cache-dir", str(tmp_path / "cache"))
    (tmp_path / "project.py").write_text(PROJECT, encoding="utf-8")
    (tmp_path / "wrong.py").write_text(WRONG, encoding="utf-8")
    told = run(*mypy, "project.py", "wrong.py", folder=tmp_path).stdout
    assert "project.py" not in told and told.count("error:") == 3, told
    assert "wrong.py:5" in told and "wrong.py:6" in told and "wrong.py:7" in told and hb.__name__ == "heavebond"


def test_pyright_accepts_the_example_project(tmp_path: Path) -> None:
    pyright = shutil.which("pyright")
    if pyright is None:
        pytest.skip("pyright is not installed")
    (tmp_path / "project.py").write_text(PROJECT, encoding="utf-8")
    (tmp_path / "pyrightconfig.json").write_text('{"typeCheckingMode": "strict"}', encoding="utf-8")
    told = run(pyright, "--pythonpath", sys.executable, "project.py", folder=tmp_path)
    assert told.returncode == 0 and "0 errors" in told.stdout, told.stdout
