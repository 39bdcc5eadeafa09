"""heavebond: acausal modelling of machines from YAML diagrams, beside their measurements.

The pipeline, each step a pure function between frozen values:

    YAML text --source--> tree --library, model--> Model --expand, connect, flatten--> Flat
      --structure, index_reduction, states, reduce--> Reduced --dae--> Assembly
      --initialise--> Start --simulation (IDAS)--> Result --comparison--> Comparison

    import heavebond as hb
    model = hb.load("cmc_ahc")
    result = hb.simulate(model, "120 s", every="10 ms")
    result["crown.x"]
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from heavebond.analysis.linear_system import StateSpace, state_space
    from heavebond.analysis.locus import root_locus
    from heavebond.analysis.margins import loop_crossings, loop_margins
    from heavebond.analysis.simplification import simplify
    from heavebond.basis.errors import (
        DataError,
        HeavebondError,
        ModelError,
        RunWarning,
        SimulationError,
        StartError,
        UsageError,
    )
    from heavebond.basis.saved import SavedRun, read_run
    from heavebond.evidence.catalogue import candidates
    from heavebond.evidence.comparison import Comparison, compare
    from heavebond.evidence.diagnosis import Diagnosis, attempt, diagnose
    from heavebond.evidence.experiment import Experiment, load_experiment
    from heavebond.evidence.finding import ladder
    from heavebond.evidence.fitting import Fit, fit
    from heavebond.evidence.misfit import Where, where
    from heavebond.language.model import Model, load, loads
    from heavebond.numbers.dae import Assembly, assemble
    from heavebond.numbers.result import Result
    from heavebond.numbers.simulation import simulate
    from heavebond.numbers.simulator import Simulator
    from heavebond.pictures.drawing import draw
    from heavebond.studies.campaign import StudyResult, run_study
    from heavebond.studies.energy import audit
    from heavebond.studies.study import Study, load_study
    from heavebond.studies.tuning import tune

__version__ = "0.1.0"

# name -> module; loaded when first used, so that `import heavebond` and `heavebond --help` stay quick. No name is that of
# a module: importing the module would put it in the function's place.
_EXPORTS = {
    "analysis.linear_system": ("state_space", "StateSpace"),
    "analysis.locus": ("root_locus",),
    "analysis.margins": ("loop_crossings", "loop_margins"),
    "analysis.simplification": ("simplify",),
    "basis.errors": ("DataError", "HeavebondError", "ModelError", "RunWarning", "SimulationError", "StartError",
                     "UsageError"),
    "basis.saved": ("read_run", "SavedRun"),
    "evidence.catalogue": ("candidates",),
    "evidence.comparison": ("compare", "Comparison"),
    "evidence.diagnosis": ("attempt", "diagnose", "Diagnosis"),
    "evidence.experiment": ("Experiment", "load_experiment"),
    "evidence.finding": ("ladder",),
    "evidence.fitting": ("Fit", "fit"),
    "evidence.misfit": ("Where", "where"),
    "language.model": ("load", "loads", "Model"),
    "numbers.dae": ("assemble", "Assembly"),
    "numbers.result": ("Result",),
    "numbers.simulation": ("simulate",),
    "numbers.simulator": ("Simulator",),
    "pictures.drawing": ("draw",),
    "studies.campaign": ("run_study", "StudyResult"),
    "studies.energy": ("audit",),
    "studies.study": ("load_study", "Study"),
    "studies.tuning": ("tune",),
}
_WHERE = {name: module for module, names in _EXPORTS.items() for name in names}
__all__ = [
    "Assembly", "Comparison", "DataError", "Diagnosis", "Experiment", "Fit", "HeavebondError", "Model", "ModelError",
    "Result", "RunWarning", "SavedRun", "SimulationError", "Simulator", "StartError", "StateSpace", "Study", "StudyResult",
    "UsageError", "Where", "assemble", "attempt", "audit", "candidates", "compare", "diagnose", "draw", "fit", "ladder",
    "load", "load_experiment", "load_study", "loads", "loop_crossings", "loop_margins", "read_run", "root_locus",
    "run_study", "simplify", "simulate", "state_space", "tune", "where",
]


# what other packages call it
_ELSEWHERE = {"run": "simulate", "integrate": "simulate", "read": "load", "open": "load", "optimise": "tune",
              "optimize": "tune", "estimate": "fit", "identify": "fit", "linearise": "state_space",
              "linearize": "state_space", "localise": "where", "localize": "where", "energy": "audit", "plot": "draw",
              "margins": "loop_margins"}


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


def __getattr__(name: str) -> object:
    if name not in _WHERE:
        from difflib import get_close_matches

        near = _ELSEWHERE.get(name) or next(iter(get_close_matches(name, __all__, 1)), "")
        raise AttributeError(f"module 'heavebond' has no attribute '{name}'" + (f"; did you mean '{near}'?" if near else ""))
    return getattr(importlib.import_module(f"heavebond.{_WHERE[name]}"), name)
