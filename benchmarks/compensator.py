"""The bundled crown-mounted compensator: from text to a running integrator, whole processes, sensitivities."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import yaml

import heavebond as hb
from benchmarks.measuring import PAIRS, SETTLE, Figure, at_most, paired, process, spoken
from heavebond.numerics.dae import Array
from heavebond.numerics.machine_code import compiler
from heavebond.optimise.adjoint import Adjoint
from heavebond.optimise.cost_evaluation import Evaluator
from heavebond.optimise.costs import read_cost
from heavebond.optimise.objective import TOLERANCES
from heavebond.optimise.tuning import tune
from heavebond.studies.study import load_study
from heavebond.text.yaml_source import Mapping, Node, Scalar, read

SENSITIVE = ("controller.K_p", "controller.K_v", "ahc.valve.f_n", "crown.m", "wave.a")
COMMAND = ("-c", "from heavebond.cli import main; main()")


# -- from text to a running integrator ---------------------------------------------------------------------------------
def copied(folder: Path) -> Path:
    """The diagram in `folder`, with every component file that it uses: files never read before, so nothing is cached."""
    model = hb.load("cmc_ahc")
    flat = hb.assemble(model).flat
    (folder / "components").mkdir(parents=True)
    for k, path in enumerate(sorted({leaf.component.path for leaf in flat.expanded.leaves.values()})):
        shutil.copy(path, folder / "components" / f"{k}_{path.name}")
    return Path(shutil.copy(model.path, folder / "diagram.yaml"))


def running(diagram: Path) -> hb.Simulator:
    """An integrator that is ready to run."""
    return hb.Simulator(hb.assemble(hb.load(diagram)))


def files(diagram: Path) -> list[Path]:
    """The diagram and its component files."""
    return [diagram, *sorted((diagram.parent / "components").iterdir())]


def composed(diagram: Path) -> list[yaml.Node | None]:
    """The node graphs of the same files by PyYAML."""
    found = (yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader) for path in files(diagram))
    return [node for node in found if node is not None]


def scalars_read(node: Node) -> Iterator[str]:
    """Every piece of text in a tree of ours, keys before their values."""
    if isinstance(node, Scalar):
        yield node.text
    elif isinstance(node, Mapping):
        for name, item in node.items.items():
            yield name
            yield from scalars_read(item)
    else:
        for item in node.items:
            yield from scalars_read(item)


def scalars_composed(node: yaml.Node | None) -> Iterator[str]:
    """Every piece of text in a node graph of PyYAML's."""
    if isinstance(node, yaml.ScalarNode):
        yield node.value
    for inner in node.value if isinstance(node, yaml.CollectionNode) else ():
        for item in inner if isinstance(inner, tuple) else (inner,):
            yield from scalars_composed(item)


def same_text(diagram: Path) -> bool:
    """Whether both sides read the same from the files."""
    return all([*scalars_read(read(path).root)] == [*scalars_composed(node)]
               for path, node in zip(files(diagram), composed(diagram), strict=True))


def assembly_figures() -> list[Figure]:
    """`yaml.compose` is the least that can be done with the files in Python."""
    with tempfile.TemporaryDirectory() as folder:
        diagrams = [copied(Path(folder) / str(k)) for k in range(30)]
        assert same_text(diagrams[0])
        fresh = iter(diagrams)
        found = paired(lambda: running(next(fresh)), lambda: composed(diagrams[0]))
    return [at_most("cmc_ahc: YAML files to running integrator / `yaml.compose` of the files", found, 20)]


# -- whole processes ---------------------------------------------------------------------------------------------------
def process_disagreement() -> float:
    """The last weight on bit that the command tells, against the same run in this process; a share of it."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "told.json"
        process(*COMMAND, "run", "cmc_ahc", "--json", str(told))
        said = float(json.loads(told.read_text(encoding="utf-8"))["outputs"]["WOB"]["final"])
    here = float(hb.simulate(hb.load("cmc_ahc")).display["WOB"][-1])
    return float(abs(said - here) / abs(here))


def process_figures() -> list[Figure]:
    """Start of Python included, on both sides."""
    assert process_disagreement() < 1e-6
    runs = (("`import heavebond` / `import numpy`", ("-c", "import heavebond"), "import numpy", 1.3),
            ("`heavebond --help` / `import numpy`", (*COMMAND, "--help"), "import numpy", 3.0),
            ("`heavebond run cmc_ahc` / `import casadi, numpy`", (*COMMAND, "run", "cmc_ahc"), "import casadi, numpy", 8.0))
    return [at_most(f"process: {what}", paired(partial(process, *ours), partial(process, "-c", theirs)), limit)
            for what, ours, theirs, limit in runs]


# -- sensitivities -----------------------------------------------------------------------------------------------------
def sensitivity_disagreement(until: float = 12.0, solver: str = "idas") -> float:
    """d WOB / d K_p against central differences of tight runs, as a share of its largest value."""
    assembly, name = hb.assemble(hb.load("cmc_ahc")), SENSITIVE[0]
    exact = hb.simulate(assembly, until, sensitivities=[name], solver=solver).sensitivity("WOB", name)
    value, step = assembly.parameter_values[name], 1e-3
    high, low = (hb.simulate(assembly, until, parameters={name: value + h}, rtol=1e-11, atol=1e-13).display["WOB"]
                 for h in (step, -step))
    return float(np.abs((high - low) / (2 * step) - exact).max() / np.abs(exact).max())


def sensitivity_figures() -> list[Figure]:
    """Runs with one, two and five forward sensitivities against plain ones by the same solver."""
    assembly, found = hb.assemble(hb.load("cmc_ahc")), []
    for solver, numbers, limit in (("idas", (1, 2, 5), 6), ("cvodes", (5,), 4.5), ("rosenbrock", (5,), 4.5)):
        if solver == "rosenbrock" and compiler() is None:
            continue
        assert sensitivity_disagreement(solver=solver) < 1e-3
        plain = hb.Simulator(assembly, solver=solver)
        for number in numbers:
            simulator = hb.Simulator(assembly, sensitivities=SENSITIVE[:number], solver=solver)
            measured = paired(simulator.run, plain.run, PAIRS + 2, SETTLE)
            what = f"cmc_ahc: run with sensitivities to {number} parameter{'s' * (number > 1)} / without, {solver}"
            found.append(at_most(what, measured, limit) if number == 5 else Figure(what, spoken(measured)))
    return found


def solver_figures() -> list[Figure]:
    """What a run by another solver takes of one by IDAS."""
    assembly, found = hb.assemble(hb.load("cmc_ahc")), []
    plain = hb.Simulator(assembly)
    for solver in ("cvodes", *(["rosenbrock"] if compiler() else [])):
        simulator = hb.Simulator(assembly, solver=solver)
        ours, theirs = simulator.run().display["WOB"], plain.run().display["WOB"]
        assert np.abs(ours - theirs).max() < 1e-4 * np.ptp(theirs)
        found.append(Figure(f"cmc_ahc: run by {solver} / by idas", spoken(paired(simulator.run, plain.run, settle=SETTLE))))
    return found


# -- tuning ------------------------------------------------------------------------------------------------------------
TEN = (*SENSITIVE, "cmc.friction.F_c", "cmc.friction.F_s", "drilling.string.c", "cmc.gas.c", "cmc.gas.d")
STARTS = 3


def adjoint_of(number: int) -> tuple[Adjoint, Array, dict[str, float]]:
    """The quality index by so many parameters, ready to be differentiated where it was not run yet."""
    study, assembly = load_study("cmc_ahc/quality_index"), hb.assemble(hb.load("cmc_ahc"))
    evaluator = Evaluator(assembly, [read_cost(assembly, study.tuning.cost)], 72.0, 96.0)
    plain = hb.Simulator(assembly, times=np.array([0.0, 72.0, 96.0]), tolerances=TOLERANCES,
                         quadratures=evaluator.quadratures, factors=evaluator.factors)
    references = evaluator.functional_values(plain.run())[0]
    made = Adjoint(plain, evaluator, TEN[:number])
    made.at(assembly.parameter_values, references)
    return made, references, assembly.parameter_values


def adjoint_figures() -> list[Figure]:
    """Cost and gradient from cold against a plain run with the same integrals."""
    found = []
    for number in (2, 10):
        made, references, values = adjoint_of(number)
        measured = paired(partial(made.at, values, references), partial(made.simulator.run, values), settle=SETTLE)
        found.append(at_most(f"cmc_ahc: cost and its gradient by {number} parameters, backwards / plain run", measured, 3.5))
    return found


def tuning_figures() -> list[Figure]:
    """Tuning both gains from starts beyond the limit of stability against runs of the diagram as `heavebond run` makes
    them."""
    found, task = [], load_study("cmc_ahc/quality_index").tuning
    for name in ("cmc_ahc", "cmc_ahc/active_frictionless"):
        assembly = hb.assemble(hb.load(name))
        plain, rng = hb.Simulator(assembly), np.random.default_rng(7)
        starts = [{"controller.K_p": rng.uniform(4, 8), "controller.K_v": rng.uniform(0, 1.2)} for _ in range(STARTS)]
        tunings = iter([assembly.with_parameters(starts[k % STARTS]) for k in range(30)])

        def tuned(tunings: Iterator[hb.Assembly] = tunings) -> object:
            return tune(next(tunings), task)

        measured = paired(tuned, plain.run, STARTS)
        found.append(at_most(f"{name}: both gains tuned from a bad start / run", measured, 40))
    return found


def figures() -> list[Figure]:
    """All of the above."""
    return [*assembly_figures(), *process_figures(), *solver_figures(), *sensitivity_figures(), *adjoint_figures(),
            *tuning_figures()]
