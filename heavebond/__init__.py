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
    from heavebond.campaign import StudyResult, run_study
    from heavebond.catalogue import candidates
    from heavebond.comparison import Comparison, compare
    from heavebond.dae import Assembly, assemble
    from heavebond.diagnosis import Diagnosis, attempt, diagnose
    from heavebond.drawing import draw
    from heavebond.energy import audit
    from heavebond.errors import DataError, HeavebondError, ModelError, SimulationError, StartError, UsageError
    from heavebond.experiment import Experiment, load_experiment
    from heavebond.finding import ladder
    from heavebond.fitting import Fit, fit
    from heavebond.linear_system import StateSpace, state_space
    from heavebond.locus import root_locus
    from heavebond.margins import loop_margins
    from heavebond.misfit import Where, where
    from heavebond.model import Model, load, loads
    from heavebond.result import Result
    from heavebond.saved import SavedRun, read_run
    from heavebond.simplification import simplify
    from heavebond.simulation import Simulator, simulate
    from heavebond.study import Study, load_study
    from heavebond.tuning import tune

__version__ = "0.1.0"

# name -> module; loaded when first used, so that `import heavebond` and `heavebond --help` stay quick. No name is that of
# a module: importing the module would put it in the function's place.
_WHERE = {
    "Diagnosis": "diagnosis", "diagnose": "diagnosis", "attempt": "diagnosis", "candidates": "catalogue",
    "ladder": "finding",
    "audit": "energy", "Fit": "fitting", "fit": "fitting", "Study": "study", "load_study": "study", "tune": "tuning",
    "StudyResult": "campaign", "run_study": "campaign",
    "Comparison": "comparison", "compare": "comparison", "draw": "drawing", "Experiment": "experiment",
    "load_experiment": "experiment",
    "Assembly": "dae", "assemble": "dae", "DataError": "errors", "HeavebondError": "errors", "ModelError": "errors",
    "SimulationError": "errors", "StartError": "errors", "UsageError": "errors",
    "StateSpace": "linear_system", "state_space": "linear_system", "loop_margins": "margins", "root_locus": "locus",
    "simplify": "simplification",
    "Model": "model", "load": "model", "loads": "model", "Result": "result", "SavedRun": "saved",
    "read_run": "saved", "Simulator": "simulation", "simulate": "simulation", "Where": "misfit", "where": "misfit",
}
__all__ = [
    "Assembly", "Comparison", "DataError", "Diagnosis", "Experiment", "Fit", "HeavebondError", "Model", "ModelError",
    "Result", "SavedRun", "SimulationError", "Simulator", "StartError", "StateSpace", "Study", "StudyResult",
    "UsageError", "Where", "assemble", "attempt", "audit", "candidates", "compare", "diagnose", "draw", "fit", "ladder",
    "load", "load_experiment", "load_study", "loads", "loop_margins", "read_run", "root_locus", "run_study", "simplify",
    "simulate", "state_space", "tune", "where",
]


def __getattr__(name: str) -> object:
    if name not in _WHERE:
        raise AttributeError(f"module 'heavebond' has no attribute '{name}'")
    return getattr(importlib.import_module(f"heavebond.{_WHERE[name]}"), name)
