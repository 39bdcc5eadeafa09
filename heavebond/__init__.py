"""heavebond: acausal modelling of machines from YAML diagrams, and their comparison with measurements.

The pipeline, each step a pure function between frozen values:

    YAML text --yaml_source--> tree --library, model--> Model --expand, connect, flatten--> Flat
      --matching, index_reduction, state_selection, reduce--> Reduced --dae--> Assembly
      --initialise--> Start --simulator (IDAS)--> Result --comparison--> Comparison

    import heavebond as hb
    model = hb.load("cmc_ahc")
    result = hb.simulate(model, "120 s", every="10 ms")
    result["crown.x"]
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

# these three packages register functions as methods of classes below them (see `core.facade`)
from heavebond import equations, pictures, reports  # noqa: F401
from heavebond.core.version import VERSION

if TYPE_CHECKING:
    from heavebond.core.errors import (
        DataError,
        HeavebondError,
        ModelError,
        RunWarning,
        SimulationError,
        StartError,
        UsageError,
    )
    from heavebond.core.native_permission import native_code
    from heavebond.diagnosis.attempt import attempt
    from heavebond.diagnosis.candidates.places import candidates
    from heavebond.diagnosis.diagnose import Diagnosis, diagnose
    from heavebond.diagnosis.state import errors
    from heavebond.energy_audit.audit import EnergyAudit, energy
    from heavebond.energy_audit.simplification import simplify
    from heavebond.estimation.comparison import Comparison, compare
    from heavebond.estimation.experiment import Experiment, load_experiment
    from heavebond.estimation.fitting import Fit, fit
    from heavebond.estimation.starter_folder import new
    from heavebond.exchange.export import export
    from heavebond.imports.models import ImportedModel, import_model
    from heavebond.language.diagram import Diagram
    from heavebond.language.model import Model, load, loads
    from heavebond.laws.find import FoundLaw, Laws, find_laws
    from heavebond.linear.design import design_gains, design_lead, design_notch, design_schedule, filter_coefficients
    from heavebond.linear.linear_system import StateSpace, state_space
    from heavebond.linear.linearisation import ModesAtStart
    from heavebond.linear.margins import loop_crossings, loop_margins
    from heavebond.linear.modes import Modes, modes
    from heavebond.linear.optimal_design import design_lqg, design_lqr, design_mpc, lqg
    from heavebond.linear.root_locus import root_locus
    from heavebond.localise.misfit import Localization, localize
    from heavebond.monitoring.estimates import StateEstimate
    from heavebond.monitoring.kalman_filter import Estimator
    from heavebond.monitoring.monitor import Monitoring, monitor
    from heavebond.monitoring.moving_horizon import moving_horizon
    from heavebond.numerics.dae import Assembly, assemble
    from heavebond.numerics.result import Result
    from heavebond.numerics.simulation import simulate
    from heavebond.numerics.simulator import Simulator
    from heavebond.optimise.influence import Rankings, sensitivity
    from heavebond.optimise.objective import TuningProblem, tuning_task
    from heavebond.optimise.optimal import Optimal, OptimalProblem, optimal, optimal_task
    from heavebond.optimise.predictive_control import PredictedPlan, PredictiveControl
    from heavebond.optimise.tuning import Tuned, tune
    from heavebond.pictures.motion import Motion, animate, animate_mode
    from heavebond.pictures.picture import Picture, draw
    from heavebond.records.saved_runs import SavedRun, read_run
    from heavebond.records.signal_array import Signal
    from heavebond.records.spectra import SignalAnalysis, signal
    from heavebond.reports.check import check
    from heavebond.reports.library_page import library
    from heavebond.reports.text_page import TextPage
    from heavebond.studies.campaign import StudyResult, study
    from heavebond.studies.study import Study, load_study
    from heavebond.studies.sweep import sweep

__version__ = VERSION

# name -> module; loaded when first used, so that `import heavebond` and `heavebond --help` stay quick. No name is that of
# a module: importing the module would put it in the function's place.
_EXPORTS = {
    "linear.linear_system": ("state_space", "StateSpace"),
    "linear.root_locus": ("root_locus",),
    "linear.design": ("design_gains", "design_lead", "design_notch", "design_schedule", "filter_coefficients"),
    "linear.optimal_design": ("design_lqg", "design_lqr", "design_mpc", "lqg"),
    "linear.margins": ("loop_crossings", "loop_margins"),
    "energy_audit.simplification": ("simplify",),
    "core.errors": ("DataError", "HeavebondError", "ModelError", "RunWarning", "SimulationError", "StartError",
                     "UsageError"),
    "records.saved_runs": ("read_run", "SavedRun"),
    "records.signal_array": ("Signal",),
    "diagnosis.candidates.places": ("candidates",),
    "estimation.comparison": ("compare", "Comparison"),
    "diagnosis.attempt": ("attempt",),
    "diagnosis.diagnose": ("diagnose", "Diagnosis"),
    "estimation.experiment": ("Experiment", "load_experiment"),
    "diagnosis.state": ("errors",),
    "estimation.fitting": ("Fit", "fit"),
    "localise.misfit": ("Localization", "localize"),
    "language.diagram": ("Diagram",),
    "core.native_permission": ("native_code",),
    "language.model": ("load", "loads", "Model"),
    "laws.find": ("find_laws", "FoundLaw", "Laws"),
    "monitoring.estimates": ("StateEstimate",),
    "monitoring.kalman_filter": ("Estimator",),
    "monitoring.monitor": ("monitor", "Monitoring"),
    "monitoring.moving_horizon": ("moving_horizon",),
    "numerics.dae": ("assemble", "Assembly"),
    "numerics.result": ("Result",),
    "numerics.simulation": ("simulate",),
    "numerics.simulator": ("Simulator",),
    "pictures.picture": ("draw", "Picture"),
    "pictures.motion": ("animate", "animate_mode", "Motion"),
    "linear.linearisation": ("ModesAtStart",),
    "linear.modes": ("modes", "Modes"),
    "optimise.influence": ("sensitivity", "Rankings"),
    "records.spectra": ("signal", "SignalAnalysis"),
    "reports.check": ("check",),
    "reports.library_page": ("library",),
    "reports.text_page": ("TextPage",),
    "studies.sweep": ("sweep",),
    "exchange.export": ("export",),
    "imports.models": ("import_model", "ImportedModel"),
    "estimation.starter_folder": ("new",),
    "studies.campaign": ("study", "StudyResult"),
    "energy_audit.audit": ("energy", "EnergyAudit"),
    "studies.study": ("load_study", "Study"),
    "optimise.objective": ("TuningProblem", "tuning_task"),
    "optimise.optimal": ("optimal", "optimal_task", "Optimal", "OptimalProblem"),
    "optimise.predictive_control": ("PredictiveControl", "PredictedPlan"),
    "optimise.tuning": ("tune", "Tuned"),
}
_MODULE_OF = {name: module for module, names in _EXPORTS.items() for name in names}
__all__ = [
    "Assembly", "Comparison", "DataError", "Diagnosis", "Diagram", "EnergyAudit", "Estimator", "Experiment", "Fit",
    "FoundLaw", "HeavebondError", "ImportedModel", "Laws", "Localization", "Model", "ModelError", "Modes",
    "ModesAtStart", "Monitoring", "Motion", "Optimal", "OptimalProblem", "Picture", "PredictedPlan", "PredictiveControl",
    "Rankings", "Result",
    "RunWarning", "SavedRun", "Signal", "SignalAnalysis", "SimulationError", "Simulator", "StartError",
    "StateEstimate", "StateSpace", "Study", "StudyResult", "TextPage", "Tuned", "TuningProblem", "UsageError",
    "animate", "animate_mode", "assemble", "attempt", "candidates", "check", "compare", "design_gains", "design_lead",
    "design_lqg", "design_lqr", "design_mpc", "design_notch", "design_schedule", "diagnose", "draw", "energy", "errors",
    "export", "filter_coefficients", "find_laws", "fit", "import_model", "library", "load", "load_experiment", "load_study",
    "loads", "localize", "loop_crossings", "loop_margins", "lqg", "modes", "monitor", "moving_horizon", "native_code",
    "new", "optimal", "optimal_task", "read_run", "root_locus", "sensitivity", "signal", "simplify", "simulate",
    "state_space", "study", "sweep", "tune", "tuning_task",
]


# what other packages call it
_ELSEWHERE = {
    "run": "simulate", "integrate": "simulate", "read": "load", "open": "load", "optimise": "tune",
    "optimize": "tune", "estimate": "fit", "identify": "fit", "linearise": "state_space", "linearize": "state_space",
    "localise": "localize", "where": "localize", "audit": "energy", "run_study": "study", "ladder": "errors",
    "try": "attempt", "import": "import_model", "eigenvalues": "modes", "influence": "sensitivity",
    "spectrum": "signal", "plot": "draw", "margins": "loop_margins",
    "kalman_filter": "Estimator", "estimate_states": "Estimator", "mhe": "moving_horizon", "watch": "monitor",
    "nmpc": "PredictiveControl",
}


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        from difflib import get_close_matches

        near = _ELSEWHERE.get(name) or next(iter(get_close_matches(name, __all__, 1)), "")
        raise AttributeError(f"module 'heavebond' has no attribute '{name}'" + (f"; did you mean '{near}'?" if near else ""))
    return getattr(importlib.import_module(f"heavebond.{_MODULE_OF[name]}"), name)
