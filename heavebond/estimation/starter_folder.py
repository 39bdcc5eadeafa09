"""The starter folder of `heavebond new`: a diagram, an experiment, records and a readme with commands."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from heavebond.core.errors import HeavebondError, Problem, UsageError, listing, suggest
from heavebond.core.writable import make_folder, new_file, write_text
from heavebond.estimation.experiment import load_experiment
from heavebond.language.library import bundled
from heavebond.language.model import load
from heavebond.numerics.simulation import simulate
from heavebond.text.yaml_source import Scalar, read

TEMPLATE = Path(__file__).parents[1] / "starter"
# motion of the shaker on each day: sines below, at and above the resonance of the load
MOTIONS = {
    "monday": "35 mm*sin(2*pi*time/2.9 s) + 12 mm*sin(2*pi*time/1.1 s) + 4 mm*sin(2*pi*time/0.6 s)",
    "tuesday": "28 mm*sin(2*pi*time/2.3 s) + 15 mm*sin(2*pi*time/1.4 s) + 5 mm*sin(2*pi*time/0.7 s)"}
EASED = "(1 - exp(-(time/2 s)**2))"  # it begins with a smooth start
# columns of the records: signal, standard deviation of the noise (the shaker reports its motion)
COLUMNS = {"deck_m": ("deck.x", 0.0), "load_m": ("load.x", 0.2e-3), "force_N": ("shaker.a.f", 2.0)}
SEED = 20


@dataclass(frozen=True)
class StarterFolder:
    """The written files, and among them diagrams and experiments that can be run."""

    folder: Path
    files: tuple[Path, ...]
    diagrams: tuple[Path, ...]
    experiments: tuple[Path, ...]


def new(folder: str | Path, origin: str | None = None) -> StarterFolder:
    """Create a folder with a rig of one load and synthetic records of it, or with a copy of the bundled machine `origin`.

    Raises UsageError if the folder is not empty, its name cannot name a diagram, or the machine does not exist.
    """
    folder = Path(folder)
    name = folder.name
    if not re.fullmatch(r"[A-Za-z]\w*", name, flags=re.ASCII):
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        hint = f"Write for example `heavebond new {plain if plain[:1].isalpha() else 'rig'}`."
        raise UsageError([Problem("name-bad", f"'{name}' cannot name a diagram and its files: letters, digits and _", None,
                                  hint)])
    # the folder of a bundled machine
    machine = None
    if origin is not None:
        machine = bundled("models") / origin
        known = [p.name for p in sorted(bundled("models").iterdir()) if (p / f"{p.name}.yaml").is_file()]
        if origin not in known:
            raise UsageError([Problem("machine-unknown", f"there is no bundled machine '{origin}'", None,
                                      suggest(origin, known) or f"Machines: {listing(known)}.")])
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError([Problem("folder-exists", f"'{folder}' exists already", None,
                                  "Take another name, or remove it first.")])
    if not folder.parent.is_dir():
        raise UsageError([Problem("file-unwritable", f"there is no folder '{folder.parent}'", None, "Make it first.")])
    make_folder(folder)
    return _copied(machine, folder) if machine is not None else _filled_folder(folder, name)


# -- a rig of one load -----------------------------------------------------------------------------------------------
def _filled_folder(folder: Path, name: str) -> StarterFolder:
    make_folder(folder / "data")
    places = {"NAME.yaml": f"{name}.yaml", "hidden.yaml": "data/hidden.yaml"}
    files = []
    for template in sorted(TEMPLATE.iterdir()):
        path = folder / places.get(template.name, template.name)
        write_text(path, template.read_text(encoding="utf-8").replace("NAME", name))
        files.append(path)
    files += _records(folder / "data" / "hidden.yaml")
    return StarterFolder(folder, tuple(files), (folder / f"{name}.yaml",), (folder / "measured.yaml",))


def _records(hidden: Path) -> Iterable[Path]:
    """Runs of the hidden diagram with noise, as records."""
    model, noise = load(hidden), np.random.default_rng(SEED)
    for day, motion in MOTIONS.items():
        run = simulate(model.with_parameters({"shaker.u": f"={EASED}*({motion})"}))
        columns = [run.time]
        columns += [run.display[signal] + size * noise.standard_normal(len(run.time)) for signal, size in COLUMNS.values()]
        path = hidden.parent / f"{day}.csv"
        with new_file(path) as fresh:
            np.savetxt(fresh, np.column_stack(columns), delimiter=",", header=",".join(["time_s", *COLUMNS]), comments="",
                       fmt="%.7g")
        yield path


# -- a bundled machine -----------------------------------------------------------------------------------------------
def _copied(machine: Path, folder: Path) -> StarterFolder:
    """Copy all files of a machine except those that reveal the hidden effects of its records."""
    for source in sorted(path for path in machine.rglob("*") if path.is_file() and path.name != "truth.yaml"):
        copy = folder / source.relative_to(machine)
        make_folder(copy.parent)
        with new_file(copy) as fresh:
            shutil.copyfile(source, fresh)
    heads: dict[str, list[Path]] = {}
    for path in sorted(folder.glob("*.yaml")):
        items = read(path).root.items
        kind = next((head for head in ("experiment", "study", "model") if isinstance(items.get(head), Scalar)), "")
        heads.setdefault(kind, []).append(path)
    main = folder / f"{machine.name}.yaml"
    diagrams = sorted(heads.get("model", []), key=lambda path: path != main)
    experiments = [path for path in heads.get("experiment", []) if _complete(path)]
    readme = folder / "README.md"
    studies = heads.get("study", [])
    first = diagrams[0]
    parts = [f"# {folder.name}", "", f"A copy of the bundled machine {machine.name}: {load(first).summary}", "",
             "Type the commands in this folder.", "", "```sh", f"heavebond check {first.name}",
             f"heavebond run {first.name} --output {first.stem}.png"]
    if experiments:
        parts += [f"heavebond compare {experiments[0].name} --output compared.png",
                  f"heavebond diagnose {experiments[0].name}"]
    parts += [f"heavebond tune {path.name}" for path in studies] + ["```", ""]
    for heading, paths in (("Diagrams", diagrams), ("Experiments", experiments), ("Studies", studies)):
        parts += [f"* {heading}: {', '.join(f'`{path.name}`' for path in paths)}."] if paths else []
    if not experiments and (Path(first).parent / "data").is_dir():
        parts += ["", "The records are not part of heavebond; `data/README.md` states their source."]
    write_text(readme, "\n".join(parts) + "\n")
    return StarterFolder(folder, tuple(sorted(p for p in folder.rglob("*") if p.is_file())), tuple(diagrams),
                         tuple(experiments))


def _complete(path: Path) -> bool:
    """True if all records of an experiment exist: the licences of some do not permit distribution."""
    try:
        return all(record.file.is_file() for record in load_experiment(path).records.values())
    except HeavebondError:
        return False
