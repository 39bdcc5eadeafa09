"""The tasks of the studio's workers: check and draw diagrams, simulate them, and look up their signals."""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from base64 import b64decode, b64encode
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from heavebond.core.errors import HeavebondError, Problem, Problems, RunWarning, UsageError
from heavebond.core.presentation import readable_units
from heavebond.core.writable import confined, new_file
from heavebond.equations.connect import connect_as_far
from heavebond.equations.expand import expand_as_far
from heavebond.equations.expanded import Expanded
from heavebond.estimation.experiment import Experiment, experiment_from_source
from heavebond.imports.models import import_model
from heavebond.language.definition import Instance
from heavebond.language.model import Model, from_source
from heavebond.language.power_terms import CREATED, power_problems, used
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.idas import Tolerances
from heavebond.numerics.initialise import start
from heavebond.numerics.inputs import pieced
from heavebond.numerics.output_times import grid
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.simulation import changes_of, simulate
from heavebond.pictures.animation import packed
from heavebond.pictures.drawing import draw_expanded, symbol_picture
from heavebond.pictures.motion import animate
from heavebond.pictures.picture import converter, draw
from heavebond.records.spectra import evenly, spectrum
from heavebond.studies.run_case import checked
from heavebond.studies.study import study_from_source
from heavebond.studio.animation import animation, modes
from heavebond.studio.blocks import is_block, read_block
from heavebond.studio.command_forms import forms
from heavebond.studio.contents import (
    Entry,
    contents,
    own_parameters,
    own_port_entries,
    part_lines,
    problem_entry,
)
from heavebond.studio.difference import differences
from heavebond.studio.edit_actions import edited
from heavebond.studio.event_log import event_log
from heavebond.studio.evidence import (
    Evidence,
    assembled,
    experiment_entry,
    files_of,
    fitting_classes,
    proposal,
    written_experiment,
)
from heavebond.studio.job import Job
from heavebond.studio.palette import component_entry, palette
from heavebond.studio.sheet_edits import sheet_entry
from heavebond.text.yaml_source import Source, parse

# tolerance of runs while a slider moves: the width of a line on the screen is a thousandth of the range; the final run is
# exact
PREVIEWED = Tolerances(rtol=1e-6, atol=1e-8)
KEPT = 24  # results that a worker keeps; older runs are repeated if a further signal of them is requested


def read(job: Job) -> Model:
    """The diagram; ModelError with its problems."""
    model = from_source(parse(job.text, Path(job.path), job.name))
    return model.with_parameters(dict(job.values)) if job.values else model


def stamps(files: Sequence[Path]) -> tuple[Any, ...]:
    """Fingerprints by which a change of the other files of a diagram is detected."""
    return tuple((str(p), p.stat().st_mtime_ns) for p in files if p.exists())


def dependencies(model: Model, path: Path) -> list[Path]:
    """Other files that a diagram consists of: diagrams that it extends, lists of values, and the components in its
    folder."""
    folder = path.parent.resolve()
    library = [p for p in model.library.files.values() if folder in p.resolve().parents]
    return [p for p in dict.fromkeys([*model.sources, *library]) if p.resolve() != path.resolve()]


# -- check and drawing -----------------------------------------------------------------------------------------------
def view(job: Job, opened: Sequence[str] = ()) -> Entry:
    """The drawing and the contents of a diagram, with the problems that `heavebond check` finds; incomplete after an
    error.
    """
    problems, entry, parts = Problems(), Entry(), dict[str, tuple[int, int]]()
    experiment = study = None
    try:
        source = parse(job.text, Path(job.path), job.name)
        parts = part_lines(source.root)
        if is_block(source):
            # the inside of a block, in the form of a diagram; for a component without parts its symbol
            block = read_block(source)
            problems.found += block.problems.found
            inside = block.component.composite
            opened_blocks = [name for name in opened if name in block.expanded.blocks]
            svg, drawn = draw_expanded(block.whole, block.network, open=opened_blocks) if inside else \
                (symbol_picture(block.component), None)
            leaf_entry = {"name": block.component.name,
                          "ports": own_port_entries(block.component, block.network, block.expanded, drawn)
                          if drawn is not None else []}
            entry |= {**contents(block.expanded, block.network, None, job.name, drawn), "svg": svg, "opened": opened_blocks,
                      "component": leaf_entry, "parameters": own_parameters(block.component), "settings": None,
                      "runs": False,
                      "files": [str(p) for p in block.model.library.files.values()
                                if p.parent == block.model.path.parent and p != block.model.path],
                      **sheet_entry(drawn),
                      "whole": all(_is_known(i, block.expanded) for i in block.model.body.instances.values())}
            return {**entry, "problems": [problem_entry(p, job.name, parts) for p in problems.found]}
        if "experiment" in source.root.items:
            entry["evidence"] = True
            experiment = experiment_from_source(source)
            entry["experiment"] = experiment_entry(experiment)
        elif "study" in source.root.items:
            entry["study"] = {"name": "", "summary": ""}
            study = study_from_source(source)
            entry["study"] = {"name": study.name, "summary": study.summary, "cases": len(study.cases)}
            checked(study)
        model = experiment.model if experiment is not None else study.model if study is not None else from_source(source)
        files = [*dependencies(model, Path(job.path)), *(files_of(experiment) if experiment is not None else [])]
        entry["files"] = [str(p) for p in dict.fromkeys(files) if p.resolve() != Path(job.path).resolve()]
        expanded, faults = expand_as_far(model)
        network, mixed = connect_as_far(expanded)
        blocks = [name for name in opened if name in expanded.blocks]
        drawn = None
        entry |= {"svg": "", "opened": blocks, "whole": all(_is_known(i, expanded) for i in model.body.instances.values())}
        if expanded.leaves:
            entry["svg"], drawn = draw_expanded(expanded, network, open=blocks)
            entry |= sheet_entry(drawn)
        unfinished = faults.found or mixed.found
        problems.found += unfinished
        assembly = None if unfinished else _checked(model, problems) if experiment is None else _driven(experiment, problems)
        entry |= contents(expanded, network, assembly, job.name, drawn)
        entry["runs"] = assembly is not None
    except HeavebondError as error:
        problems.extend(error)
    order = sorted(problems.found, key=lambda p: (p.place.file != job.name, p.place.line, p.place.column) if p.place else
                   (True, 0, 0))
    return {**entry, "problems": [problem_entry(p, job.name, parts) for p in order]}


def _is_known(instance: Instance, expanded: Expanded) -> bool:
    """True if the component of a part is known, so that it can be drawn."""
    return instance.repeat is not None or instance.name in expanded.leaves


def _checked(model: Model, problems: Problems) -> Assembly | None:
    """Assemble the diagram and add the problems of its structure, its start and the power of its components."""
    try:
        assembly = assemble(model)
    except HeavebondError as error:
        problems.extend(error)
        return None
    for problem in power_problems(used(model.library, [model.body]), model.library.domains):
        if problem.code == CREATED:
            problems.extend(HeavebondError([problem]))
    try:
        u = None
        if assembly.flat.inputs:
            times = grid(model, None, None)
            u = pieced(assembly.flat, float(times[0]), float(times[-1])).at(times[:1])[:, 0]
        start(assembly, None, u)
    except HeavebondError as error:
        problems.extend(error)
    return assembly


def _driven(experiment: Experiment, problems: Problems) -> Assembly | None:
    """Assemble the diagram with the inputs of the first record, and add the mistakes in the experiment."""
    try:
        return assembled(experiment)
    except HeavebondError as error:
        problems.extend(error)
        return None


def _model(source: Source) -> Model:
    """A diagram, or the diagram of an experiment or a study; ModelError with the problems of the file."""
    return experiment_from_source(source).model if "experiment" in source.root.items else \
        study_from_source(source).model if "study" in source.root.items else from_source(source)


def compared(before: Job, after: Job) -> Entry:
    """The differences of the diagrams of two files, the second one with the values of the sliders."""
    models = [_model(parse(job.text, Path(job.path), job.name)).with_parameters(dict(job.values)) for job in (before, after)]
    return {"differences": differences(*models)}


THUMBNAILS = 200  # drawings of the first page that a worker keeps
LETTERS = re.compile(r"<(text|title|desc)\b.*?</\1>", re.DOTALL)


class Thumbnails:
    """The small drawings of the first page: the diagrams of files without their texts, the latest ones kept."""

    def __init__(self) -> None:
        self._drawn: OrderedDict[tuple[str, str], tuple[Any, Sequence[Path], str]] = OrderedDict()

    def thumbnail(self, job: Job) -> tuple[Entry, None]:
        """The drawing of a diagram, or of the diagram of an experiment or a study; the symbol of a component. ModelError
        for a file that cannot be read."""
        key = (job.path, job.text)
        stamp, files, svg = self._drawn.get(key, (None, (), ""))
        if stamp is None or stamp != stamps(files):
            source = parse(job.text, Path(job.path), job.name)
            if is_block(source):
                files, svg = (), symbol_picture(read_block(source).component)
            else:
                model = _model(source)
                files, svg = dependencies(model, Path(job.path)), draw(model)
            svg = LETTERS.sub("", svg)
        self._drawn[key] = (stamps(files), files, svg)
        self._drawn.move_to_end(key)
        while len(self._drawn) > THUMBNAILS:
            self._drawn.popitem(last=False)
        return {"svg": svg}, None


def imported(name: str, content: str, root: str) -> Entry:
    """Import a model of another program, whose bytes are `content` in base64, into a new folder below `root`."""
    stem = re.sub(r"\W+", "_", Path(name).stem, flags=re.ASCII).strip("_")[:60] or "imported"
    folder = Path(root).resolve() / stem
    if os.path.lexists(folder):
        raise UsageError([Problem("file-exists", f"the folder {stem} exists already", None,
                                  "Rename it, or rename the file that you import.")])
    with tempfile.TemporaryDirectory(prefix="heavebond-") as scratch:
        file = Path(scratch) / f"{stem}{Path(name).suffix.lower()}"
        with new_file(file) as fresh:
            fresh.write_bytes(b64decode(content))
        with confined(Path(root)):
            model = import_model(file, folder)
    name = model.path.resolve().relative_to(Path(root).resolve()).as_posix()
    return {"name": name, "placeholders": list(model.placeholders),
            "untranslated": [f"{u.submodel}, line {u.line}: {u.reason}" for u in model.untranslated]}


# -- runs ------------------------------------------------------------------------------------------------------------
class Bench:
    """Runs of one page: the assembly of the present text, and the latest results."""

    def __init__(self) -> None:
        self._assembled: tuple[Any, Assembly, Sequence[Path]] | None = None
        self._quick: tuple[Any, QuickSimulator] | None = None
        self._probe: tuple[Any, Probe] | None = None  # reduced to the signals that previews show
        self._results: OrderedDict[Any, Result] = OrderedDict()

    def _assembly(self, job: Job) -> tuple[Any, Assembly]:
        """The diagram as written, without the values of sliders."""
        if self._assembled is not None:
            key, assembly, files = self._assembled
            if key == (job.text, job.path, job.name, stamps(files)):
                return key, assembly
        model = read(replace(job, values={}))
        files = dependencies(model, Path(job.path))
        key = (job.text, job.path, job.name, stamps(files))
        self._assembled = (key, assemble(model), files)
        return key, self._assembled[1]

    def run(self, job: Job, names: Sequence[str] = ()) -> tuple[Entry, Array]:
        """A run as by `heavebond run`, with the values of the sliders as `--set`."""
        result = self._result(job)
        output_names = list(result.assembly.model.show) or result.assembly.state_names
        figures = {name: {**numbers.as_dict(), "unit": result.unit(name)}
                   for name, numbers in result.figures(list(dict.fromkeys([*output_names, *names]))).items()}
        entry: Entry = {
            "outputs": figures, "verdict": {"status": result.verdict.status, "text": result.verdict.text},
            "events": len(result.events), "until": float(result.time[-1]), "points": len(result.time),
            "solver": str(result.statistics.get("solver", "")), "notes": changes_of(result)}
        return _with_series(entry, result, names)

    def _result(self, job: Job) -> Result:
        key, assembly = self._assembly(job)
        run_key = (key, tuple(sorted(job.values.items())))
        if run_key not in self._results:
            if job.values:
                # assembled with the values, so that their limits and all dependent values are checked
                assembly = assemble(read(job))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RunWarning)  # the page shows the verdict
                self._results[run_key] = simulate(assembly)
            while len(self._results) > KEPT:
                self._results.popitem(last=False)
        self._results.move_to_end(run_key)
        return self._results[run_key]

    def prepare(self, job: Job, names: Sequence[str]) -> tuple[Entry, Array]:
        """Build the simulator for sliders and these signals, which may take a second (a program is compiled)."""
        self._previewer(job, names)
        return {}, np.zeros((0, 0))

    def _previewer(self, job: Job, names: Sequence[str]) -> tuple[QuickSimulator, Probe]:
        key, assembly = self._assembly(job)
        if self._quick is None or self._quick[0] != key:
            self._quick = (key, QuickSimulator(assembly, tolerances=PREVIEWED))
        previewer_key = (key, tuple(names))
        if self._probe is None or self._probe[0] != previewer_key:
            self._probe = (previewer_key, Probe(assembly, names))
        return self._quick[1], self._probe[1]

    def preview(self, job: Job, names: Sequence[str]) -> tuple[Entry, Array]:
        """A run while a slider moves: the same equations with other numbers, by the integrator of searches, which does
        not analyse failures, with tolerances for display."""
        names = list(dict.fromkeys(names))
        quick, probe = self._previewer(job, names)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = quick.run(dict(job.values))
        entry: Entry = {"verdict": {"status": "clean", "text": ""}, "signals": names,
                        **_units({name: result.unit(name) for name in names})}
        return entry, np.vstack([result.time, *(probe.values(result) if names else [])])

    def animation(self, job: Job) -> tuple[Entry, Array]:
        """Animated quantities on the drawing of a run."""
        return animation(self._result(job))

    def film(self, job: Job) -> tuple[Entry, None]:
        """The shapes under `view:` over time, as `heavebond animate` shows them."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RunWarning)
            return {"film": packed(animate(read(job)))}, None

    def modes(self, job: Job) -> tuple[Entry, None]:
        """The modes at the start with the values of the sliders."""
        return modes(self._assembly(job)[1], job.values), None

    def spectrum(self, job: Job, names: Sequence[str]) -> tuple[Entry, Array]:
        """The frequency (Hz) and the density of a signal, as `heavebond signal` computes them."""
        result, name = self._result(job), names[0]
        density = spectrum(evenly(name, result.unit(name), result.time, result.signals([name])[name]))
        return {"signals": [name]}, np.vstack([density.frequency[1:], density.density[1:]])

    def events(self, job: Job, name: str) -> tuple[Entry, None]:
        """The events of a run, or those with a name."""
        return event_log(self._result(job), name), None

    def signals(self, job: Job, names: Sequence[str]) -> tuple[Entry, Array]:
        """Further signals of a run; a run that is not stored any more is repeated."""
        return _with_series({}, self._result(job), names)


def _with_series(entry: Entry, result: Result, names: Sequence[str]) -> tuple[Entry, Array]:
    """Description of a run with the units of signals, and their values: the time in s, then each signal."""
    names = list(dict.fromkeys(names))
    signals = result.signals(names) if names else {}
    entry = {**entry, "signals": names, **_units({name: result.unit(name) for name in names})}
    return entry, np.vstack([result.time, *(signals[name] for name in names)])


def _units(units: dict[str, str]) -> Entry:
    """The units of signals, and the display units of the charts for values in base units, by the size of the values."""
    steps = {unit: readable_units(unit) for unit in units.values()}
    return {"units": units, "readable": {unit: display_steps for unit, display_steps in steps.items() if display_steps}}


def tasks() -> dict[str, Callable[..., tuple[Entry, Array | None]]]:
    """The functions of a worker, by the name of the task."""
    bench, evidence, thumbnails = Bench(), Evidence(), Thumbnails()
    return {"view": lambda job, opened: (view(job, opened), None), "run": bench.run, "prepare": bench.prepare,
            "preview": bench.preview, "signals": bench.signals, "spectrum": bench.spectrum, "animation": bench.animation,
            "modes": bench.modes, "film": bench.film, "events": bench.events,
            "compare": evidence.compare, "channel": evidence.channel,
            "against": evidence.against, "propose": proposal, "experiment": written_experiment,
            "edit": lambda job, action: (edited(job, action), None),
            "classes": lambda job: (fitting_classes(job), None),
            "import": lambda name, content, root: (imported(name, content, root), None),
            "thumbnail": thumbnails.thumbnail, "difference": lambda before, after: (compared(before, after), None),
            "palette": lambda job: (palette(Path(job.path).parent), None),
            "forms": lambda command_line: ({"forms": forms(command_line)}, None),
            "picture": lambda job: ({"pdf": b64encode(converter(Path("x.pdf"))(draw(read(job)))).decode("ascii")}, None),
            "component": lambda job, name: (component_entry(Path(job.path).parent, name), None)}
