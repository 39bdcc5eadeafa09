"""Reports: HTML pages of diagnoses, tables for notebooks and the terminal, and summaries of models."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heavebond.core.facade import provides

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from heavebond.diagnosis.attempt import Attempt
    from heavebond.diagnosis.diagnose import Diagnosis
    from heavebond.energy_audit.audit import EnergyAudit
    from heavebond.estimation.comparison import Comparison
    from heavebond.estimation.fitting import Fit
    from heavebond.language.diagram import Diagram
    from heavebond.language.model import Model
    from heavebond.laws.find import Laws
    from heavebond.linear.modes import Modes
    from heavebond.linear.root_locus import RootLocus
    from heavebond.localise.misfit import Localization
    from heavebond.monitoring.monitor import Monitoring
    from heavebond.numerics.result import Result
    from heavebond.optimise.influence import Rankings
    from heavebond.optimise.tuning import Tuned
    from heavebond.records.saved_runs import SavedRun
    from heavebond.records.spectra import SignalAnalysis
    from heavebond.reports.text_page import TextPage
    from heavebond.studies.campaign import StudyResult
    from heavebond.studies.uncertainty import OccurrenceMeans, Spread


@provides("Model._repr_html_")
def _model(model: Model) -> str | None:
    from heavebond.reports.notebook import model_html

    return model_html(model)


@provides("Diagram._repr_html_")
def _diagram(diagram: Diagram) -> str:
    from heavebond.core.errors import HeavebondError
    from heavebond.equations.connect import connect
    from heavebond.equations.expand import expand
    from heavebond.pictures.markup import element
    from heavebond.reports.notebook import model_html

    try:
        model = diagram.model()
        connect(expand(model))
    except HeavebondError as error:
        return str(element("pre", str(error)))
    return str(model_html(model))


@provides("Result._repr_html_")
def _result(result: Result) -> str:
    from heavebond.reports.notebook import result_html

    return result_html(result)


@provides("SavedRun._repr_html_")
def _saved_run(run: SavedRun) -> str:
    from heavebond.reports.notebook import saved_run_html

    return saved_run_html(run)


@provides("Comparison._repr_html_")
def _comparison(comparison: Comparison) -> str:
    from heavebond.reports.notebook import comparison_html

    return comparison_html(comparison)


@provides("Fit._repr_html_")
def _fit(fit: Fit) -> str:
    from heavebond.reports.notebook import fit_html

    return fit_html(fit)


@provides("Diagnosis._repr_html_")
def _diagnosis(diagnosis: Diagnosis) -> str:
    from heavebond.reports.notebook import diagnosis_html

    return diagnosis_html(diagnosis)


@provides("Modes._repr_html_")
def _modes(modes: Modes) -> str:
    from heavebond.reports import analysis_tables, notebook

    return notebook.items_html(modes.model, modes.at, analysis_tables.modes_items(modes))


@provides("RootLocus._repr_html_")
def _root_locus(locus: RootLocus) -> str:
    from heavebond.reports import notebook

    return notebook.items_html(locus.parameter, repr(locus).partition(": ")[2].rstrip(">"), [], [locus.plot()])


@provides("Rankings._repr_html_")
def _rankings(rankings: Rankings) -> str:
    from heavebond.reports import analysis_tables, notebook

    return notebook.items_html(rankings.model, "influence of parameters", analysis_tables.sensitivity_items(rankings))


@provides("EnergyAudit._repr_html_")
def _energy(audit: EnergyAudit) -> str:
    from heavebond.reports import analysis_tables, notebook

    return notebook.items_html(audit.result.assembly.model.name, "energy", analysis_tables.energy_items(audit))


@provides("SignalAnalysis._repr_html_")
def _signal(analysis: SignalAnalysis) -> str:
    from heavebond.pictures.plot_spectra import plot_spectra
    from heavebond.reports import analysis_tables, notebook

    figures = [] if analysis.still else [plot_spectra([analysis])]
    return notebook.items_html(analysis.course.name, analysis.course.unit, analysis_tables.signal_items(analysis), figures)


@provides("Tuned._repr_html_")
def _tuned(tuned: Tuned) -> str:
    from heavebond.reports import notebook, study_tables

    return notebook.items_html("tuning", tuned.message, study_tables.tuning_items("", None, tuned))


@provides("StudyResult._repr_html_")
def _study(result: StudyResult) -> str:
    from heavebond.reports import notebook, study_tables

    return notebook.items_html(result.study.name, result.study.summary, study_tables.study_items(result), result.plot())


@provides("StudyResult.to_pandas")
def _study_table(result: StudyResult) -> pd.DataFrame:
    from heavebond.studies.tables import to_pandas

    return to_pandas(result)


@provides("StudyResult.spreads")
def _study_spreads(result: StudyResult) -> list[Spread]:
    from heavebond.studies.uncertainty import spreads

    return list(spreads(result))


@provides("StudyResult.occurrence_means")
def _study_occurrence(result: StudyResult) -> list[OccurrenceMeans]:
    from heavebond.studies.uncertainty import occurrence_means

    return occurrence_means(result)


@provides("StudyResult.to_xarray")
def _study_dataset(result: StudyResult) -> xr.Dataset:
    from heavebond.studies.tables import to_xarray

    return to_xarray(result)


@provides("Localization._repr_html_")
def _localization(localization: Localization) -> str:
    from heavebond.reports import notebook, result_tables

    return notebook.items_html(localization.experiment.name, "where the model fails",
                               result_tables.localization_items(localization))


@provides("Laws._repr_html_")
def _laws(laws: Laws) -> str:
    from heavebond.reports import notebook, result_tables

    return notebook.items_html(laws.experiment.name, "laws", result_tables.laws_items(laws))


@provides("Attempt._repr_html_")
def _attempt(attempt: Attempt) -> str:
    from heavebond.reports import notebook, result_tables

    return notebook.items_html(attempt.finding.rung.name, "an effect, fitted", result_tables.attempt_items(attempt))


@provides("TextPage._repr_html_")
def _text_page(page: TextPage) -> str:
    from heavebond.pictures.markup import element

    return str(element("pre", str(page)))


@provides("Monitoring._repr_html_")
def _monitoring(monitoring: Monitoring) -> str:
    from heavebond.reports import notebook
    from heavebond.reports.monitoring_page import monitoring_items

    return notebook.items_html(monitoring.experiment.name, "monitored records", monitoring_items(monitoring))
