"""Reports: HTML pages of diagnoses, tables for notebooks and the terminal, and summaries of models."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heavebond.core.facade import provides

if TYPE_CHECKING:
    from heavebond.diagnosis.diagnose import Diagnosis
    from heavebond.estimation.comparison import Comparison
    from heavebond.estimation.fitting import Fit
    from heavebond.language.model import Model
    from heavebond.numerics.result import Result
    from heavebond.records.saved_runs import SavedRun


@provides("Model._repr_html_")
def _model(model: Model) -> str | None:
    from heavebond.reports.notebook import model_html

    return model_html(model)


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
