"""What an installed heavebond consists of: the package with its library and machines inside, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    return Path(next(WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])))


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a clone")
def test_no_other_folder_is_committed() -> None:
    """A command that was called in the repository may have left its results there."""
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert {name.split("/")[0] for name in files if "/" in name} == {
        ".ci", ".github", "benchmarks", "components", "docs", "heavebond", "models", "tests"}


def test_nothing_lands_beside_the_package(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names} == {"heavebond", wheel.name.split("-py3")[0] + ".dist-info"}
    assert "heavebond/components/domains.yaml" in names
    assert "heavebond/models/cmc_ahc/cmc_ahc.yaml" in names
    assert {"heavebond/web/report.css", "heavebond/web/report.js",
            "heavebond/web/animation.css", "heavebond/web/animation.js",
            "heavebond/web/space/three.js", "heavebond/web/space/three.LICENSE", "heavebond/web/space/scene.js",
            "heavebond/c/fmi2.c", "heavebond/c/fmi3.c", "heavebond/c/fmu_core.c", "heavebond/c/fmu_events.c",
            "heavebond/c/rosenbrock.c", "heavebond/c/run.c", "heavebond/c/c_run.c", "heavebond/c/limits.c",
            "heavebond/c/evaluate.c",
            "heavebond/studio/page/index.html", "heavebond/studio/page/main.js", "heavebond/studio/page/vendor/uPlot.js",
            "heavebond/studio/page/vendor/codemirror.js", "heavebond/studio/page/vendor/codemirror.LICENSE",
            "heavebond/starter/NAME.yaml", "heavebond/starter/README.md"} <= set(names)
    assert not any("__pycache__" in name for name in names)


def test_it_runs_from_any_folder(wheel: Path, tmp_path: Path) -> None:
    """The installed package finds its machines without the repository."""
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    code = "import heavebond, sys; assert heavebond.__file__.startswith(sys.argv.pop(1)); " \
        "from heavebond.cli import main; main()"
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "site"), "run", "cmc_ahc", "--until", "1 s"], cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path / "site")}, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "WOB" in run.stdout
